"""What draws: the OpenGL backends of MuJoCo, and Vulkan; which there are, and which one the user asks for."""

import importlib
import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from mjrun.errors import NoRendererError, UnknownNameError

AUTO = "auto"
GL, DEVICE = "MUJOCO_GL", "MUJOCO_EGL_DEVICE_ID"  # variables of the environment
BACKENDS = ("egl", "osmesa", "glfw", "cgl")
# What MuJoCo accepts in MUJOCO_GL beside the names of its backends.
ALIASES = {"": AUTO, "enable": AUTO, "enabled": AUTO, "on": AUTO, "true": AUTO, "1": AUTO, "glx": "glfw", "wgl": "glfw"}
OFF = ("disable", "disabled", "off", "false", "0")
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software rasterizer")


class OpenGLContext(Protocol):
    """A context of one of MuJoCo's backends."""

    def make_current(self) -> None:
        """Directs this thread's OpenGL calls to it."""
        ...

    def free(self) -> None:
        """Frees what the driver holds for it."""
        ...


@dataclass(frozen=True)
class Backend:
    """A backend that works here.

    Attributes:
      name: `egl`, `osmesa`, `glfw` or `cgl`; or `vulkan`, which has no OpenGL context.
      renderer, vendor, version: OpenGL's own strings; Vulkan's device, driver and version.
      max_size: the largest width or height it can draw [pixels].
    """

    name: str
    renderer: str
    vendor: str
    version: str
    max_size: int

    @property
    def software(self) -> bool:
        """Whether a CPU draws."""
        return self.name == "osmesa" or any(mark in self.renderer.lower() for mark in SOFTWARE)

    def context(self, width: int, height: int) -> OpenGLContext:
        """A new OpenGL context, current in this thread; the caller frees it."""
        context: OpenGLContext = importlib.import_module(f"mujoco.{self.name}").GLContext(width, height)
        context.make_current()
        return context


def candidates() -> tuple[str, ...]:
    """The backends worth trying on this system, best first."""
    if platform.system() == "Darwin":
        return ("cgl", "glfw")
    if platform.system() == "Windows":
        return ("glfw",)
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return ("egl", "osmesa", "glfw") if display else ("egl", "osmesa")


def requested_backends(requested: str | None = None) -> Sequence[str]:
    """The backends to try, best first.

    Args:
      requested: `auto` for those worth trying, else the only one; as MUJOCO_GL says when None.

    Raises:
      UnknownNameError: no such backend.
      NoRendererError: rendering is switched off by MUJOCO_GL.
    """
    text = (os.environ.get(GL, "") if requested is None else requested).strip().lower()
    if text in OFF:
        raise NoRendererError({GL: f"is {text!r}, which switches rendering off"}, "unset it to draw")
    name = ALIASES.get(text, text)
    if name == AUTO:
        return candidates()
    if name not in BACKENDS:
        raise UnknownNameError("OpenGL backend", text, [AUTO, *BACKENDS], GL if is_from_environment(requested) else "")
    return (name,)


def is_from_environment(requested: str | None) -> bool:
    """Whether the environment requested it, as the default of an option too."""
    return GL in os.environ and requested in (None, os.environ[GL])
