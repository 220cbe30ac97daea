"""Backends: which there are, how each is tried, and the detection of one that works."""

import os
import platform
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from mjrun.errors import NoRendererError, SoftwareRendererError, UnknownNameError
from mjrun.platform import system
from mjrun.rendering import backend as backend_module
from mjrun.rendering import try_backend
from mjrun.rendering.backend import (
    BackendDetector,
    BackendTrialProcess,
    VulkanDetector,
    WorkingBackend,
    candidates,
    install_advice,
    requested_backends,
)
from tests.cases import cases


def test_an_unknown_backend_in_the_environment_is_reported_to_be_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "elg")
    with pytest.raises(UnknownNameError, match="no OpenGL backend 'elg' in MUJOCO_GL"):
        requested_backends()


def test_an_unknown_backend_lists_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="auto, egl, osmesa, glfw"):
        requested_backends("elg")


@pytest.mark.parametrize("off", ["off", "0", "disabled", "False"])
def test_rendering_that_is_switched_off_is_reported_so(off: str) -> None:
    with pytest.raises(NoRendererError, match="switches rendering off"):
        requested_backends(off)


@cases("renderer, name, software")
def test_software_is_reported_from_a_gpu_by_the_renderer(renderer: str, name: str, software: bool) -> None:
    assert WorkingBackend(name, renderer, "", "", 16384).software is software


def test_glfw_is_tried_only_where_there_is_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "system", lambda: "Linux")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    assert candidates() == ("egl", "osmesa")
    monkeypatch.setenv("DISPLAY", ":0")
    assert candidates() == ("egl", "osmesa", "glfw")


@pytest.fixture(autouse=True)
def each_trial_takes_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replaces the remembered trials of other tests."""
    monkeypatch.setattr(backend_module, "BackendTrialProcess", BackendTrialProcess)


def test_a_renderer_is_found_without_being_told(backend: WorkingBackend) -> None:
    assert backend.name in candidates()
    assert backend.renderer
    assert backend.max_size >= 2048


def test_a_requested_backend_is_the_only_one_tried(backend: WorkingBackend) -> None:
    assert BackendDetector(backend.name).result() == backend


@pytest.mark.parametrize(
    ("variables", "folder"),
    [
        ({"HOME": "/no/where"}, "/"),
        ({"HOME": "/usr"}, "/usr"),
        ({"HOME": "/usr", "XDG_CACHE_HOME": "/etc/x"}, "/etc"),
        ({"XDG_CACHE_HOME": "/usr", "MESA_SHADER_CACHE_DIR": "/etc"}, "/etc"),
    ],
)
def test_shaders_are_cached_where_they_can_be(
    monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], folder: str
) -> None:
    monkeypatch.setattr(os, "environ", variables)
    tried: list[str] = []
    monkeypatch.setattr(os, "access", lambda path, mode: tried.append(str(path)))
    backend_module._require_shader_cache()
    assert (tried, variables.pop("MESA_SHADER_CACHE_DISABLE")) == ([folder], "true")
    monkeypatch.setattr(os, "access", lambda path, mode: True)
    backend_module._require_shader_cache()
    assert "MESA_SHADER_CACHE_DISABLE" not in variables


def test_mujoco_gl_is_honoured_when_nothing_is_requested(
    monkeypatch: pytest.MonkeyPatch, backend: WorkingBackend
) -> None:
    monkeypatch.setenv("MUJOCO_GL", backend.name.upper())
    assert BackendDetector().result() == backend


def test_a_backend_that_does_not_work_is_reported_with_its_reason_and_the_packages(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(backend_module, "candidates", lambda: ("glfw",))
    monkeypatch.setattr(platform, "freedesktop_os_release", lambda: {"ID": "ubuntu", "ID_LIKE": "debian"})
    with pytest.raises(NoRendererError) as caught:
        BackendDetector("glfw").result()
    message = str(caught.value)
    assert "glfw: made no OpenGL context (it needs a display)" in message
    assert "apt-get update && apt-get install libegl1 libopengl0 libegl-mesa0 libgl1-mesa-dri" in message


@pytest.mark.parametrize(
    ("requested", "variables", "cure"),
    [
        ("cgl", {"MUJOCO_GL": "cgl"}, "egl draws: unset MUJOCO_GL, or give gl egl"),
        ("cgl", {"MUJOCO_GL": "auto"}, "egl draws: give gl egl"),
        ("egl", {"MUJOCO_EGL_DEVICE_ID": "99"}, "egl draws on another device: unset MUJOCO_EGL_DEVICE_ID"),
        (None, {"MUJOCO_GL": "cgl", "MUJOCO_EGL_DEVICE_ID": "99"}, "device: unset MUJOCO_GL and MUJOCO_EGL_DEVICE_ID"),
    ],
)
@pytest.mark.gl
def test_where_the_environment_is_the_cause_to_change_it_is_the_cure(
    monkeypatch: pytest.MonkeyPatch,
    backend: WorkingBackend,
    requested: str | None,
    variables: dict[str, str],
    cure: str,
) -> None:
    if backend.name != "egl":
        pytest.skip("another backend draws")
    monkeypatch.setattr(backend_module, "candidates", lambda: ("egl",))
    for variable, value in variables.items():
        monkeypatch.setenv(variable, value)
    with pytest.raises(NoRendererError) as caught:
        BackendDetector(requested).result()
    assert str(caught.value).endswith(cure)
    assert "install" not in str(caught.value)


def test_a_search_continues_to_the_next_backend(monkeypatch: pytest.MonkeyPatch, backend: WorkingBackend) -> None:
    monkeypatch.setattr(backend_module, "candidates", lambda: ("nonsense", backend.name))
    assert BackendDetector("auto").result() == backend


@dataclass(frozen=True)
class Hardware:
    """A machine with these renderers instead of this one."""

    renderers: dict[str, str]

    def __call__(self, name: str) -> SimpleNamespace:
        found = WorkingBackend(name, self.renderers[name], "", "", 16384)
        return SimpleNamespace(name=name, result=lambda: found)


def test_a_required_gpu_refuses_software(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend_module, "BackendTrialProcess", Hardware({"egl": "llvmpipe"}))
    with pytest.raises(SoftwareRendererError, match="llvmpipe"):
        BackendDetector("egl").result(require_gpu=True)


def test_a_required_gpu_is_found_behind_a_software_backend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend_module, "candidates", lambda: ("egl", "glfw"))
    monkeypatch.setattr(backend_module, "BackendTrialProcess", Hardware({"egl": "llvmpipe", "glfw": "NVIDIA"}))
    assert BackendDetector("auto").result(require_gpu=True).name == "glfw"


def test_a_backend_that_worked_is_tried_again_only_in_another_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend_module, "BackendTrialProcess", Hardware({"egl": "llvmpipe"}))
    found = BackendDetector("egl").result()
    monkeypatch.setattr(backend_module, "BackendTrialProcess", Hardware({"egl": "NVIDIA"}))
    search = BackendDetector("egl")
    assert search.result() == found
    search.cancel()
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "1")
    assert BackendDetector("egl").result().renderer == "NVIDIA"


def test_vulkan_is_found_by_drawing_with_it(vulkan: WorkingBackend) -> None:
    assert vulkan.name == "vulkan"
    assert vulkan.renderer
    assert vulkan.version.startswith("1.")
    assert vulkan.max_size >= 4096


def test_a_vulkan_without_a_driver_is_reported_with_the_packages_and_the_other_renderer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for variable in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):
        monkeypatch.setenv(variable, "/nonexistent.json")
    monkeypatch.setattr(platform, "freedesktop_os_release", lambda: {"ID": "debian"})
    with pytest.raises(NoRendererError) as caught:
        VulkanDetector().result()
    message = str(caught.value)
    assert "vulkan: no driver works (vkCreateInstance: -9)" in message
    assert "apt-get update && apt-get install mesa-vulkan-drivers libvulkan1" in message
    assert "renderer classic" in message


@pytest.mark.parametrize(("renderer", "refused"), [("llvmpipe (LLVM 15.0.6, 256 bits)", True), ("NVIDIA H200", False)])
def test_a_required_gpu_refuses_software_vulkan(monkeypatch: pytest.MonkeyPatch, renderer: str, refused: bool) -> None:
    monkeypatch.setattr(backend_module, "BackendTrialProcess", Hardware({"vulkan": renderer}))
    search = VulkanDetector()
    if refused:
        with pytest.raises(SoftwareRendererError, match="llvmpipe"):
            search.result(require_gpu=True)
    else:
        assert search.result(require_gpu=True).renderer == renderer


def test_a_search_for_vulkan_can_be_given_up() -> None:
    search = VulkanDetector()
    search.cancel()
    assert search._first
    assert not search._first._process.running


def test_no_temporary_folder_is_needed(monkeypatch: pytest.MonkeyPatch, backend: WorkingBackend) -> None:
    def no_folder(*_: object, **__: object) -> str:
        raise FileNotFoundError("No usable temporary directory found")

    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_get_default_tempdir", no_folder)
    assert BackendDetector(backend.name).result() == backend


@cases("system, command")
def test_the_remedy_speaks_the_language_of_the_distribution(
    monkeypatch: pytest.MonkeyPatch, system: dict[str, str], command: str
) -> None:
    monkeypatch.setattr(platform, "system", lambda: "Linux")
    monkeypatch.setattr(platform, "freedesktop_os_release", lambda: system)
    assert command in install_advice()


def test_a_driver_that_crashes_is_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    assert BackendTrialProcess("egl").result() == "its process ended with code 1"


def test_a_driver_that_crashes_has_the_last_word(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    crash = tmp_path / "crash"
    crash.write_text("#!/bin/sh\necho noise\necho one >&2\necho 'reason: no device' >&2\nexit 3\n")
    crash.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(crash))
    assert BackendTrialProcess("vulkan").result() == "its process ended with code 3 (reason: no device)"


def test_a_driver_that_hangs_is_an_answer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    hang = tmp_path / "hang"
    hang.write_text("#!/bin/sh\nexec sleep 60\n")
    hang.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(hang))
    monkeypatch.setattr(backend_module, "TIMEOUT", 0.1)
    assert BackendTrialProcess("egl").result() == "did not answer within 0.1 s"


def test_a_backend_that_draws_is_seen_to_and_one_that_draws_nothing_is_refused(
    backend: WorkingBackend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert BackendTrialProcess(backend.name, draw=True).result() == backend
    script = Path(try_backend.__file__).read_text()
    blind = tmp_path / "try_backend.py"
    blind.write_text(script.replace("mujoco.mjr_render(rect, scene, context)", "pass"))
    monkeypatch.setattr(backend_module, "__file__", str(tmp_path / "backend.py"))
    assert BackendTrialProcess(backend.name, draw=True).result() == f"{backend.renderer} draws wrongly"
    assert BackendTrialProcess(backend.name).result() == backend


@pytest.mark.skipif(not system.CAN_FORK_LATE, reason="no copies of processes")
def test_a_trial_in_a_copy_of_the_process_that_starts_early_is_the_one_of_the_detection(
    backend: WorkingBackend,
) -> None:
    code = """
import os, sys
from mjrun.child_process import may_fork
from mjrun.rendering import backend, try_backend
assert may_fork()
backend.start_early()
(early,) = backend._started_early.values()
detection = backend.BackendDetector()
assert detection._first is early
print(detection.result())
assert not {"mujoco", "OpenGL"} & {*sys.modules}  # which the copy alone has imported

try_backend.opengl = lambda *_: os.abort()
print(backend.BackendTrialProcess("egl", is_fork=True).result())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [str(backend), "its process was killed by SIGABRT"]


def test_egl_tells_its_devices(backend: WorkingBackend) -> None:
    devices = BackendTrialProcess("devices").answer()["devices"]
    assert [device["index"] for device in devices] == list(range(len(devices)))
    assert all(set(device) == {"index", "cuda", "file"} for device in devices)
    assert devices or backend.name != "egl"
