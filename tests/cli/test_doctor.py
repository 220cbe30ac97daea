"""`mjrun doctor`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import mujoco

from mjrun.render.backend import Backend

if TYPE_CHECKING:
    from tests.conftest import Command


def test_the_doctor_names_what_works(mjrun: Command, backend: Backend) -> None:
    done = mjrun("doctor", "--json")
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


def test_the_doctor_says_who_draws_with_filament(mjrun: Command, vulkan: Backend) -> None:
    found = json.loads(mjrun("doctor", "--json").stdout)["findings"]
    filament = next(finding for finding in found if finding["name"] == "filament")
    assert filament["status"] == "ok"
    assert vulkan.renderer in filament["value"]


def test_the_page_and_the_document_say_the_same(mjrun: Command) -> None:
    page = mjrun("doctor").stdout.decode()
    for finding in json.loads(mjrun("doctor", "--json").stdout)["findings"]:
        assert finding["value"] in page
        assert finding["remedy"] in page


def test_where_nothing_can_draw_the_doctor_says_what_to_install_and_ends_with_five(mjrun: Command) -> None:
    hidden = {"MUJOCO_EGL_DEVICE_ID": "99", "DISPLAY": "", "WAYLAND_DISPLAY": "", "LD_PRELOAD": ""}
    done = mjrun("doctor", "--json", env=hidden)
    found = json.loads(done.stdout)
    osmesa = next(finding for finding in found["findings"] if finding["name"] == "osmesa")
    egl = next(finding for finding in found["findings"] if finding["name"] == "egl")
    assert egl["status"] == "missing"
    if osmesa["status"] == "missing":
        assert done.returncode == 5
        assert not found["can_draw"]
        assert "libegl1" in egl["remedy"] or "libEGL" in egl["remedy"]
    else:
        assert done.returncode == 0


def test_where_filament_cannot_draw_the_doctor_says_what_to_install_and_all_else_is_well(mjrun: Command) -> None:
    done = mjrun("doctor", "--json", env={"VK_ICD_FILENAMES": "/none.json", "VK_DRIVER_FILES": "/none.json"})
    found = json.loads(done.stdout)
    filament = next(finding for finding in found["findings"] if finding["name"] == "filament")
    assert done.returncode == 0
    assert filament["status"] == "missing"
    assert filament["value"].startswith("no driver works")
    assert filament["remedy"].startswith("not needed but for --renderer filament; ")
    assert "mesa-vulkan-drivers" in filament["remedy"] or "Vulkan" in filament["remedy"]
