"""The search for something that can draw."""

import platform
import tempfile
from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from mjrun.errors import NoRendererError, SoftwareRendererError
from mjrun.rendering import backend as backend_module
from mjrun.rendering import backend_detection
from mjrun.rendering.backend import Backend, candidates
from mjrun.rendering.backend_detection import BackendDetection, VulkanDetection, install_advice


def test_a_renderer_is_found_without_being_told(backend: Backend) -> None:
    assert backend.name in candidates()
    assert backend.renderer
    assert backend.max_size >= 2048


def test_a_requested_backend_is_the_only_one_tried(backend: Backend) -> None:
    assert BackendDetection(backend.name).result() == backend


def test_mujoco_gl_is_honoured_when_nothing_is_requested(monkeypatch: pytest.MonkeyPatch, backend: Backend) -> None:
    monkeypatch.setenv("MUJOCO_GL", backend.name.upper())
    assert BackendDetection().result() == backend


def test_a_backend_that_does_not_work_is_reported_with_its_reason_and_the_packages(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(backend_detection, "candidates", lambda: ("glfw",))
    monkeypatch.setattr(platform, "freedesktop_os_release", lambda: {"ID": "ubuntu", "ID_LIKE": "debian"})
    with pytest.raises(NoRendererError) as caught:
        BackendDetection("glfw").result()
    message = str(caught.value)
    assert "glfw: made no OpenGL context (it needs a display)" in message
    assert "sudo apt-get install libegl1 libopengl0 libegl-mesa0 libgl1-mesa-dri" in message


@pytest.mark.parametrize(
    ("requested", "variables", "cure"),
    [
        (None, {"MUJOCO_GL": "cgl"}, "egl draws: unset MUJOCO_GL, or give gl egl"),
        ("cgl", {"MUJOCO_GL": "cgl"}, "egl draws: unset MUJOCO_GL, or give gl egl"),
        ("cgl", {"MUJOCO_GL": "auto"}, "egl draws: give gl egl"),
        ("egl", {"MUJOCO_EGL_DEVICE_ID": "99"}, "egl draws on another device: unset MUJOCO_EGL_DEVICE_ID"),
        (None, {"MUJOCO_GL": "cgl", "MUJOCO_EGL_DEVICE_ID": "99"}, "device: unset MUJOCO_GL and MUJOCO_EGL_DEVICE_ID"),
    ],
)
@pytest.mark.gl
def test_where_the_environment_is_the_cause_to_change_it_is_the_cure(
    monkeypatch: pytest.MonkeyPatch, backend: Backend, requested: str | None, variables: dict[str, str], cure: str
) -> None:
    if backend.name != "egl":
        pytest.skip("another backend draws")
    monkeypatch.setattr(backend_detection, "candidates", lambda: ("egl",))
    for variable, value in variables.items():
        monkeypatch.setenv(variable, value)
    with pytest.raises(NoRendererError) as caught:
        BackendDetection(requested).result()
    assert str(caught.value).endswith(cure)
    assert "install" not in str(caught.value)


def test_a_search_goes_on_to_the_next_backend(monkeypatch: pytest.MonkeyPatch, backend: Backend) -> None:
    monkeypatch.setattr(backend_module, "candidates", lambda: ("nonsense", backend.name))
    assert BackendDetection("auto").result() == backend


@dataclass(frozen=True)
class Hardware:
    """A machine with these renderers instead of this one."""

    renderers: dict[str, str]

    def __call__(self, name: str) -> SimpleNamespace:
        found = Backend(name, self.renderers[name], "", "", 16384)
        return SimpleNamespace(name=name, result=lambda: found)


def test_a_required_gpu_refuses_software(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend_detection, "BackendTrialProcess", Hardware({"egl": "llvmpipe"}))
    with pytest.raises(SoftwareRendererError, match="llvmpipe"):
        BackendDetection("egl").result(require_gpu=True)


def test_a_required_gpu_is_found_behind_a_software_backend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend_module, "candidates", lambda: ("egl", "glfw"))
    monkeypatch.setattr(backend_detection, "BackendTrialProcess", Hardware({"egl": "llvmpipe", "glfw": "NVIDIA"}))
    assert BackendDetection("auto").result(require_gpu=True).name == "glfw"


def test_vulkan_is_found_by_drawing_with_it(vulkan: Backend) -> None:
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
        VulkanDetection().result()
    message = str(caught.value)
    assert "vulkan: no driver works (vkCreateInstance: -9)" in message
    assert "sudo apt-get install mesa-vulkan-drivers libvulkan1" in message
    assert "renderer classic" in message


@pytest.mark.parametrize(("renderer", "refused"), [("llvmpipe (LLVM 15.0.6, 256 bits)", True), ("NVIDIA H200", False)])
def test_a_required_gpu_refuses_software_vulkan(monkeypatch: pytest.MonkeyPatch, renderer: str, refused: bool) -> None:
    monkeypatch.setattr(backend_detection, "BackendTrialProcess", Hardware({"vulkan": renderer}))
    search = VulkanDetection()
    if refused:
        with pytest.raises(SoftwareRendererError, match="llvmpipe"):
            search.result(require_gpu=True)
    else:
        assert search.result(require_gpu=True).renderer == renderer


def test_a_search_for_vulkan_can_be_given_up() -> None:
    search = VulkanDetection()
    search.cancel()
    assert not search._trial._process.running


def test_no_temporary_folder_is_needed(monkeypatch: pytest.MonkeyPatch, backend: Backend) -> None:
    def no_folder(*_: object, **__: object) -> str:
        raise FileNotFoundError("No usable temporary directory found")

    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_get_default_tempdir", no_folder)
    assert BackendDetection(backend.name).result() == backend


@pytest.mark.parametrize(
    ("system", "command"),
    [
        ({"ID": "debian"}, "apt-get"),
        ({"ID": "linuxmint", "ID_LIKE": "ubuntu debian"}, "apt-get"),
        ({"ID": "fedora"}, "dnf"),
        ({"ID": "rocky", "ID_LIKE": "rhel centos fedora"}, "dnf"),
        ({"ID": "arch"}, "pacman"),
        ({"ID": "nixos"}, "your distribution's packages"),
        ({}, "your distribution's packages"),
    ],
)
def test_the_remedy_speaks_the_language_of_the_distribution(
    monkeypatch: pytest.MonkeyPatch, system: dict[str, str], command: str
) -> None:
    monkeypatch.setattr(platform, "system", lambda: "Linux")
    monkeypatch.setattr(platform, "freedesktop_os_release", lambda: system)
    assert command in install_advice()
