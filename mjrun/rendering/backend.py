"""What draws: an OpenGL backend or Vulkan, chosen by trying each in a child process."""

import importlib
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjrun.errors import NoRendererError, SoftwareRendererError, UnknownNameError

AUTO = "auto"
GL, DEVICE = "MUJOCO_GL", "MUJOCO_EGL_DEVICE_ID"  # variables of the environment
BACKENDS = ("egl", "osmesa", "glfw", "cgl")
# What MuJoCo accepts in MUJOCO_GL beside the names of its backends.
ALIASES = {"": AUTO, "enable": AUTO, "enabled": AUTO, "on": AUTO, "true": AUTO, "1": AUTO, "glx": "glfw", "wgl": "glfw"}
OFF = ("disable", "disabled", "off", "false", "0")
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software rasterizer")
TIMEOUT = 60  # [s], for a driver that hangs

# Commands that make each library work, by family of distribution.
OPENGL = {
    "debian": "sudo apt-get install libegl1 libopengl0 libegl-mesa0 libgl1-mesa-dri",
    "fedora": "sudo dnf install mesa-libEGL mesa-dri-drivers libglvnd-opengl",
    "arch": "sudo pacman -S mesa libglvnd",
    "": "install your distribution's packages for libEGL, libOpenGL and Mesa's software renderer (llvmpipe)",
}
OSMESA = {
    "debian": "sudo apt-get install libosmesa6 (gone from Mesa 25.1 on)",
    "fedora": "sudo dnf install mesa-libOSMesa (gone from Mesa 25.1 on)",
    "": "install your distribution's package for libOSMesa (gone from Mesa 25.1 on)",
}
DISPLAY = {"": "run it in a desktop session, or under xvfb-run"}
VULKAN = {
    "debian": "sudo apt-get install mesa-vulkan-drivers libvulkan1",
    "fedora": "sudo dnf install mesa-vulkan-drivers vulkan-loader",
    "arch": "sudo pacman -S vulkan-swrast vulkan-icd-loader",
    "": "install your distribution's packages for the Vulkan loader and Mesa's software driver (lavapipe)",
}
CURES = {"egl": OPENGL, "osmesa": OSMESA, "glfw": DISPLAY}


@dataclass(frozen=True)
class Backend:
    """A backend that was seen to work.

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

    def context(self, width: int, height: int) -> Any:
        """A new OpenGL context, current in this thread; whoever gets it calls `free`."""
        context = importlib.import_module(f"mujoco.{self.name}").GLContext(width, height)
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


def remedy(commands: Mapping[str, str] = OPENGL) -> str:
    """The one of `commands` for this system."""
    if platform.system() != "Linux":
        return "install a graphics driver"
    try:
        system = platform.freedesktop_os_release()
    except OSError:
        system = {}
    family = next((name for name in [system.get("ID"), *system.get("ID_LIKE", "").split()] if name in commands), "")
    return commands[family or ""]


def sought(requested: str | None = None) -> Sequence[str]:
    """The backends that are tried, best first.

    Args:
      requested: `auto` for those worth trying, else the only one; MUJOCO_GL says it when None.

    Raises:
      UnknownNameError: no such backend.
      NoRendererError: rendering is switched off by MUJOCO_GL.
    """
    asked = (os.environ.get(GL, "") if requested is None else requested).strip().lower()
    if asked in OFF:
        raise NoRendererError({GL: f"is {asked!r}, which switches rendering off"}, "unset it to draw")
    name = ALIASES.get(asked, asked)
    if name == AUTO:
        return candidates()
    if name not in BACKENDS:
        raise UnknownNameError("OpenGL backend", asked, [AUTO, *BACKENDS], GL if _of_environment(requested) else "")
    return (name,)


def way_out(tried: Collection[str], requested: str | None = None) -> str:
    """What else would draw where `tried` do not, and how to ask for it; empty where nothing would.

    Args:
      requested: as `sought` has it.
    """
    for name in candidates():
        if name not in tried and isinstance(Probe(name).result(), Backend):
            return f"{name} draws: {f'unset {GL}, or ' if _of_environment(requested) else ''}give --gl {name}"
    if _draws_on_another_device():
        variables = DEVICE if "egl" in tried else f"{GL} and {DEVICE}"
        return f"egl draws on another device: unset {variables}"
    return ""


def cure(name: str) -> str:
    """What to do so that the backend `name` draws, which does not."""
    if name == "egl" and _draws_on_another_device():
        return f"unset {DEVICE}: egl draws on another device"
    return remedy(CURES.get(name, OPENGL))


def _of_environment(requested: str | None) -> bool:
    """Whether it was the environment that requested it, as the default of an option too."""
    return GL in os.environ and requested in (None, os.environ[GL])


def _draws_on_another_device() -> bool:
    """Whether EGL draws on a device other than the one the environment asks for."""
    return DEVICE in os.environ and isinstance(Probe("egl", unset=(DEVICE,)).result(), Backend)


class Probe:
    """One backend, `vulkan`, or `devices` of EGL, being tried in a child process, which starts at once.

    Args:
      draw: whether a picture is drawn and looked at too.
      device: of EGL, as MUJOCO_EGL_DEVICE_ID has it.
      unset: variables of the environment that it does without.
    """

    def __init__(self, name: str, draw: bool = False, device: int | None = None, unset: Sequence[str] = ()) -> None:
        self.name = name
        kept = {variable: value for variable, value in os.environ.items() if variable not in unset}
        chosen = {} if device is None else {DEVICE: str(device)}
        script = Path(__file__).with_name("backend_test.py")
        self._said = tempfile.TemporaryFile()  # noqa: SIM115
        self._child = subprocess.Popen(
            [sys.executable, "-P", str(script), name, *(["draw"] if draw else [])],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self._said,
            env={**kept, GL: "disable", **chosen},
        )

    def answer(self) -> dict[str, Any]:
        """What the child found, or `error`."""
        with self._said:
            try:
                out, _ = self._child.communicate(timeout=TIMEOUT)
                return json.loads(out)
            except subprocess.TimeoutExpired:
                self.cancel()
                return {"error": f"did not answer within {TIMEOUT} s"}
            except ValueError:
                self._said.seek(0)
                last = self._said.read().decode(errors="replace").strip().rpartition("\n")[2]
                return {"error": f"its process ended with code {self._child.returncode}{last and f' ({last})'}"}

    def result(self) -> Backend | str:
        """The backend, or why there is none."""
        answer = self.answer()
        return answer["error"] if "error" in answer else Backend(self.name, **answer)

    def cancel(self) -> None:
        """Ends the child."""
        self._said.close()
        self._child.kill()
        self._child.wait()
        if self._child.stdout:
            self._child.stdout.close()


class Search:
    """The search for a working backend, begun at once so that it runs while the model loads.

    Args:
      requested: `auto` or None for the best that works, else the only one to try.

    Raises:
      UnknownNameError: no such backend.
      NoRendererError: rendering is switched off by MUJOCO_GL.
    """

    def __init__(self, requested: str | None = None) -> None:
        self._requested, self._names = requested, sought(requested)
        self._first = Probe(self._names[0])

    def result(self, require_gpu: bool = False) -> Backend:
        """The first backend that works.

        Raises:
          NoRendererError: none does; the message says why, and what to install.
          SoftwareRendererError: `require_gpu`, and only software draws.
        """
        tried: dict[str, str] = {}
        software: Backend | None = None
        for name in self._names:
            answer = (self._first if name == self._first.name else Probe(name)).result()
            if isinstance(answer, str):
                tried[name] = answer
            elif not (require_gpu and answer.software):
                return answer
            else:
                software = software or answer
        if software:
            raise SoftwareRendererError(software.renderer)
        raise NoRendererError(tried, way_out(tried, self._requested) or f"to draw in software: {remedy()}")

    def cancel(self) -> None:
        """Ends the child that is still trying."""
        self._first.cancel()


class VulkanSearch:
    """The search for a Vulkan that Filament draws with, begun at once; to be used like `Search`."""

    def __init__(self) -> None:
        self._probe = Probe("vulkan")

    def result(self, require_gpu: bool = False) -> Backend:
        """The device that Filament has chosen and drawn with.

        Raises:
          NoRendererError: there is none; the message says why, and what to install.
          SoftwareRendererError: `require_gpu`, and only software draws.
        """
        answer = self._probe.result()
        if isinstance(answer, str):
            cure = f"to draw with filament in software: {remedy(VULKAN)}\n--renderer classic needs no Vulkan"
            raise NoRendererError({"vulkan": answer}, cure)
        if require_gpu and answer.software:
            raise SoftwareRendererError(answer.renderer)
        return answer

    def cancel(self) -> None:
        """Ends the child if it is still trying."""
        self._probe.cancel()
