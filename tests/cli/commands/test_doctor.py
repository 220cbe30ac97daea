"""`mjrun doctor`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import mujoco
import pytest

from mjrun.rendering.backend import WorkingBackend

if TYPE_CHECKING:
    from pathlib import Path

    from tests.conftest import Command

pytestmark = pytest.mark.usefixtures("codecs_are_tried_once")


def test_the_doctor_names_what_works_in_document_and_page(mjrun_here: Command, backend: WorkingBackend) -> None:
    done = mjrun_here("doctor", "--json")
    assert done.returncode == 0
    found = json.loads(done.stdout)
    by_name = {(finding["group"], finding["name"]): finding for finding in found["findings"]}
    assert found["can_draw"]
    assert by_name["opengl", backend.name]["status"] == "ok"
    assert backend.renderer in by_name["opengl", backend.name]["value"]
    assert by_name["software", "mujoco"]["value"] == mujoco.mj_versionString()
    assert (by_name["software", "mujoco"]["status"] == "warning") == (mujoco.mj_versionString() == "4.0.0")
    assert "h264" in by_name["encoder", "codecs"]["value"]
    assert {"egl", "osmesa", "glfw"} <= {name for group, name in by_name if group == "opengl"}
    device = by_name["egl devices", "device 0"]
    assert (device["status"], "(MUJOCO_EGL_DEVICE_ID=" in device["value"]) == ("ok", True)

    page = mjrun_here("doctor").stdout.decode()
    for finding in found["findings"]:
        assert finding["value"] in page
        assert finding["remedy"] in page


def test_the_doctor_says_who_draws_with_filament(mjrun_here: Command, vulkan: WorkingBackend) -> None:
    found = json.loads(mjrun_here("doctor", "--json").stdout)["findings"]
    filament = next(finding for finding in found if finding["name"] == "filament")
    assert filament["status"] == "ok"
    assert vulkan.renderer in filament["value"]


NO_EGL = {"__EGL_VENDOR_LIBRARY_FILENAMES": "/none.json"}
NO_DISPLAY = {"DISPLAY": "", "WAYLAND_DISPLAY": "", "LD_PRELOAD": ""}
NO_VULKAN = {"VK_ICD_FILENAMES": "/none.json", "VK_DRIVER_FILES": "/none.json"}


def of(mjrun: Command, env: dict[str, str]) -> tuple[int, dict[str, dict[str, str]]]:
    """The exit code of the doctor, and its findings by name."""
    done = mjrun("doctor", "--json", env=env)
    found = json.loads(done.stdout)
    assert found["can_draw"] == (done.returncode == 0)
    return done.returncode, {finding["name"]: finding for finding in found["findings"]}


@pytest.mark.parametrize(("vulkan_is_there", "code"), [(True, 0), (False, 5)])
@pytest.mark.slow
def test_where_no_opengl_draws_the_doctor_says_what_to_install_and_ends_with_five_unless_filament_does(
    mjrun_here: Command, vulkan: WorkingBackend, vulkan_is_there: bool, code: int
) -> None:
    given = {"MUJOCO_GL": "auto", **NO_EGL, **NO_DISPLAY, **({} if vulkan_is_there else NO_VULKAN)}
    ended, found = of(mjrun_here, given)
    if found["osmesa"]["status"] == "ok":
        pytest.skip("osmesa cannot be hidden")
    assert ended == code
    assert found["egl"]["status"] == "missing"
    assert "libegl1" in found["egl"]["remedy"] or "libEGL" in found["egl"]["remedy"]
    assert found["used"]["value"] == "nothing draws with OpenGL"
    assert ("--renderer filament draws" in found["filament"]["remedy"]) == vulkan_is_there


@pytest.mark.parametrize(
    ("given", "value"),
    [
        ({"MUJOCO_GL": "cgl"}, "nothing draws with MUJOCO_GL=cgl"),
        ({"MUJOCO_GL": "bogus"}, "nothing: no OpenGL backend 'bogus' in MUJOCO_GL"),
        ({"MUJOCO_GL": "off"}, "nothing: MUJOCO_GL is 'off', which switches rendering off"),
        ({"MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "99"}, "nothing draws with MUJOCO_GL=egl and MUJOCO_EGL_DEV"),
    ],
)
@pytest.mark.gl
@pytest.mark.slow
def test_the_doctor_agrees_with_a_picture_about_what_the_environment_asks_for(
    mjrun_here: Command, swing: Path, backend: WorkingBackend, given: dict[str, str], value: str
) -> None:
    if backend.name != "egl":
        pytest.skip("another backend draws")
    code, found = of(mjrun_here, {**NO_DISPLAY, **given})
    assert code == 5
    assert mjrun_here("image", swing, "-o", "a.png", env={**NO_DISPLAY, **given}).returncode in (2, 5)
    assert found["used"]["value"].startswith(value)
    assert "unset MUJOCO_" in found["used"]["remedy"]
    assert "used" not in found["egl"]["value"]
    if "MUJOCO_EGL_DEVICE_ID" in given:
        assert found["egl"]["remedy"] == "unset MUJOCO_EGL_DEVICE_ID: egl draws on another device"


@pytest.mark.slow
def test_the_backend_that_the_environment_asks_for_is_the_one_used(
    mjrun_here: Command, backend: WorkingBackend
) -> None:
    for asked, mark in ((backend.name, "used by MUJOCO_GL)"), ("auto", "used by default)")):
        code, found = of(mjrun_here, {"MUJOCO_GL": asked})
        assert code == 0
        assert mark in found[backend.name]["value"]


def test_where_filament_cannot_draw_the_doctor_says_what_to_install_and_all_else_is_well(mjrun_here: Command) -> None:
    done = mjrun_here("doctor", "--json", env=NO_VULKAN)
    found = json.loads(done.stdout)
    filament = next(finding for finding in found["findings"] if finding["name"] == "filament")
    assert done.returncode == 0
    assert filament["status"] == "missing"
    assert filament["value"].startswith("no driver works")
    assert filament["remedy"].startswith("not needed except for --renderer filament; ")
    assert "mesa-vulkan-drivers" in filament["remedy"] or "Vulkan" in filament["remedy"]
