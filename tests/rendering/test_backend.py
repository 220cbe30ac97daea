"""Which backends there are."""

import platform

import pytest

from mjrun.errors import NoRendererError, UnknownNameError
from mjrun.rendering.backend import Backend, candidates, requested_backends


def test_an_unknown_backend_in_the_environment_is_said_to_be_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "elg")
    with pytest.raises(UnknownNameError, match="no OpenGL backend 'elg' in MUJOCO_GL"):
        requested_backends()


def test_an_unknown_backend_lists_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="auto, egl, osmesa, glfw"):
        requested_backends("elg")


@pytest.mark.parametrize("off", ["off", "0", "disabled", "False"])
def test_rendering_that_is_switched_off_is_said_so(off: str) -> None:
    with pytest.raises(NoRendererError, match="switches rendering off"):
        requested_backends(off)


@pytest.mark.parametrize(
    ("renderer", "name", "software"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", "egl", True),
        ("softpipe", "egl", True),
        ("Google SwiftShader", "egl", True),
        ("anything", "osmesa", True),
        ("NVIDIA H200/PCIe/SSE2", "egl", False),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", "egl", False),
        ("AMD Radeon RX 6800 (radeonsi)", "glfw", False),
    ],
)
def test_software_is_told_from_a_gpu_by_the_renderer(renderer: str, name: str, software: bool) -> None:
    assert Backend(name, renderer, "", "", 16384).software is software


def test_glfw_is_tried_only_where_there_is_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "system", lambda: "Linux")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    assert candidates() == ("egl", "osmesa")
    monkeypatch.setenv("DISPLAY", ":0")
    assert candidates() == ("egl", "osmesa", "glfw")
