"""Rendering backends: MuJoCo's OpenGL backends and Vulkan, and the detection of one that works.

Each is tried in a child process, since a broken driver may hang, print or crash.
"""

import importlib
import json
import os
import platform
import sys
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn, Protocol

from mjrun.child_process import ChildProcess, may_fork, memory_file
from mjrun.dataclass import dataclass
from mjrun.errors import DrawError, NoRendererError, SoftwareRendererError, UnknownNameError, option
from mjrun.platform import system
from mjrun.platform.installation import as_root

AUTO = "auto"
GL, DEVICE = "MUJOCO_GL", "MUJOCO_EGL_DEVICE_ID"  # environment variables
BACKENDS = ("egl", "osmesa", "glfw", "cgl")
# Values that MuJoCo accepts in MUJOCO_GL in addition to the names of its backends.
ALIASES = {"": AUTO, "enable": AUTO, "enabled": AUTO, "on": AUTO, "true": AUTO, "1": AUTO, "glx": "glfw", "wgl": "glfw"}
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software rasterizer")

# The beginnings of commands that install packages, by family of distribution; lists of packages may be empty or old.
INSTALLERS = {
    "debian": "apt-get update && apt-get install",
    "fedora": "dnf install",
    "arch": "pacman -S",
}
# The packages of each library, by family of distribution; without a family, the advice.
OPENGL = {
    "debian": "libegl1 libopengl0 libegl-mesa0 libgl1-mesa-dri",
    "fedora": "mesa-libEGL mesa-dri-drivers libglvnd-opengl",
    "arch": "mesa libglvnd",
    "": "install your distribution's packages for libEGL, libOpenGL and Mesa's software renderer (llvmpipe)",
}
OSMESA = {
    "debian": "libosmesa6",
    "fedora": "mesa-libOSMesa",
    "": "install your distribution's package for libOSMesa",
}
VULKAN = {
    "debian": "mesa-vulkan-drivers libvulkan1",
    "fedora": "mesa-vulkan-drivers vulkan-loader",
    "arch": "vulkan-swrast vulkan-icd-loader",
    "": "install your distribution's packages for the Vulkan loader and Mesa's software driver (lavapipe)",
}
TIMEOUT = 60  # [s], for a driver that hangs
GPU_DEVICES = ("dri/renderD*", "nvidiactl", "dxg")  # patterns of files in /dev


class OpenGLContext(Protocol):
    """An OpenGL context of one of MuJoCo's backends."""

    def make_current(self) -> None:
        """Directs this thread's OpenGL calls to the context."""
        ...

    def free(self) -> None:
        """Frees the driver's resources."""
        ...


@dataclass(frozen=True)
class WorkingBackend:
    """A backend that works on this machine.

    Attributes:
      name: `egl`, `osmesa`, `glfw` or `cgl`; or `vulkan`, which has no OpenGL context.
      renderer, vendor, version: OpenGL's strings, or Vulkan's device, driver and version.
      max_size: the largest width or height that it can render [pixels].
    """

    name: str
    renderer: str
    vendor: str
    version: str
    max_size: int

    @property
    def software(self) -> bool:
        """True if a CPU renders."""
        return self.name == "osmesa" or any(mark in self.renderer.lower() for mark in SOFTWARE)

    def context(self, width: int, height: int) -> OpenGLContext:
        """Creates an OpenGL context and makes it current in this thread; the caller frees it.

        Raises:
          DrawError: this process is a copy of one that has rendered.
        """
        require_own_opengl()
        context: OpenGLContext = self.load().GLContext(width, height)
        context.make_current()
        return context

    def load(self) -> ModuleType:
        """Loads the driver, and returns MuJoCo's module that creates contexts."""
        _require_shader_cache()
        return importlib.import_module(f"mujoco.{self.name}")


_rendering_process = 0  # id of the process that created the first OpenGL context here; 0 for none


def require_own_opengl() -> None:
    """Raises DrawError in a fork of a process that has rendered: a driver would wait for threads that are missing."""
    global _rendering_process
    _rendering_process = _rendering_process or os.getpid()
    if _rendering_process != os.getpid():
        reason = "this process is a fork of one that has used OpenGL, which drivers do not allow"
        raise DrawError(f"{reason}\nstart new processes, as with multiprocessing.get_context('spawn')")


def may_draw_in_fork() -> bool:
    """Returns whether a copy of this process could render: this one has no threads and has not used OpenGL."""
    return "OpenGL" not in sys.modules and may_fork()


def _require_shader_cache() -> None:
    """Switches Mesa's cache of shaders off where it cannot be made: Mesa would print a message for each process."""
    cache = Path(os.environ.get("MESA_SHADER_CACHE_DIR") or system.cache_home())
    nearest = next((folder for folder in (cache, *cache.parents) if os.path.isdir(folder)), cache)  # noqa: PTH112
    if not os.access(nearest, os.W_OK):
        os.environ["MESA_SHADER_CACHE_DISABLE"] = "true"


def candidates() -> tuple[str, ...]:
    """Returns the backends worth trying on this system, best first."""
    if platform.system() == "Darwin":
        return ("cgl", "glfw")
    if platform.system() == "Windows":
        return ("glfw",)
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return ("egl", "osmesa", "glfw") if display else ("egl", "osmesa")


def lacks_gpu() -> bool:
    """Returns whether a CPU renders for certain, whatever backend is detected; False if that is not known."""
    return platform.system() == "Linux" and not any(any(Path("/dev").glob(device)) for device in GPU_DEVICES)


def requested_backends(requested: str | None = None) -> Sequence[str]:
    """Returns the backends to try, best first.

    Args:
      requested: `auto` for those worth trying, else the only one; None for the value of MUJOCO_GL.

    Raises:
      UnknownNameError: the backend is unknown.
      NoRendererError: MUJOCO_GL switches rendering off.
    """
    text = (os.environ.get(GL, "") if requested is None else requested).strip().lower()
    if text in ("disable", "disabled", "off", "false", "0"):
        raise NoRendererError({GL: f"is {text!r}, which switches rendering off"}, "unset it to enable rendering")
    name = ALIASES.get(text, text)
    if name == AUTO:
        return candidates()
    if name not in BACKENDS:
        raise UnknownNameError("OpenGL backend", text, [AUTO, *BACKENDS], GL if is_from_environment(requested) else "")
    return (name,)


def is_from_environment(requested: str | None) -> bool:
    """Returns whether the environment requested the backend, possibly as an option's default."""
    return GL in os.environ and requested in (None, os.environ[GL])


class BackendTrialProcess:
    """A backend, `vulkan`, or EGL's `devices`, being tried in a child process, which starts at once.

    Args:
      draw: whether an image is also rendered and checked.
      device: the EGL device, as in MUJOCO_EGL_DEVICE_ID.
      unset: environment variables to remove.
      is_fork: whether the child is a copy of this process, which has not imported mujoco; see `child_process.may_fork`.
    """

    def __init__(
        self,
        name: str,
        draw: bool = False,
        device: int | None = None,
        unset: Sequence[str] = (),
        is_fork: bool = False,
    ) -> None:
        self.name = name
        environment = {**dict.fromkeys(unset), GL: "disable"}
        if device is not None:
            environment[DEVICE] = str(device)
        script = Path(__file__).with_name("try_backend.py")
        command = [sys.executable, "-P", str(script), name, *(["draw"] if draw else [])]
        self._log = os.fdopen(memory_file(), "w+b")  # a file, since the child reads Filament's log from it
        self._process = ChildProcess(
            command,
            environment=environment,
            stdout="capture",
            stderr=self._log,
            run_in_fork=partial(_report, name) if is_fork else None,
        )

    def answer(self) -> dict[str, Any]:
        """Waits for the child's answer, which has an `error` if the backend fails."""
        with self._log:
            ending = self._process.wait(TIMEOUT)
            if ending.cause == "time":
                return {"error": f"did not answer within {TIMEOUT} s"}
            try:
                return json.loads(self._process.stdout)
            except ValueError:
                self._log.seek(0)
                last = self._log.read().decode(errors="replace").strip().rpartition("\n")[2]
                return {"error": f"its process {ending}{last and f' ({last})'}"}

    def result(self) -> WorkingBackend | str:
        """Returns the backend, or the reason why it does not work."""
        answer = self.answer()
        return answer["error"] if "error" in answer else WorkingBackend(self.name, **answer)

    def cancel(self) -> None:
        """Ends the child."""
        self._log.close()
        self._process.end()


def _report(name: str) -> NoReturn:
    from mjrun.rendering.try_backend import report  # only in the child

    report(name)


# The backends that worked in this process, by name and environment variables: Python code renders again and again.
_working: dict[tuple[str, frozenset[tuple[str, str]]], WorkingBackend] = {}
# Trials that wait for the first `BackendDetector` in the same environment, which takes them over.
_started_early: dict[tuple[str, frozenset[tuple[str, str]]], BackendTrialProcess] = {}


def start_early(requested: str | None = None) -> None:
    """Starts to try the first backend of a later `BackendDetector` in a copy of this process.

    Raises:
      UnknownNameError: the backend is unknown.
      NoRendererError: MUJOCO_GL switches rendering off.
    """
    name = requested_backends(requested)[0]
    _started_early[name, frozenset(os.environ.items())] = BackendTrialProcess(name, is_fork=True)


class BackendDetector:
    """A detector of a working backend, which starts at once, so that it runs while the model loads.

    A backend that has worked in this process is not tried again until an environment variable changes.

    Args:
      requested: `auto` or None for the best that works, else the only one to try.

    Raises:
      UnknownNameError: the backend is unknown.
      NoRendererError: MUJOCO_GL switches rendering off.
    """

    def __init__(self, requested: str | None = None) -> None:
        self._start(requested, requested_backends(requested))

    def _start(self, requested: str | None, names: Sequence[str]) -> None:
        self._requested, self._names = requested, names
        self._environment = frozenset(os.environ.items())
        key = names[0], self._environment
        self._first = None if key in _working else _started_early.pop(key, None) or BackendTrialProcess(names[0])

    def result(self, require_gpu: bool = False) -> WorkingBackend:
        """Returns the first backend that works.

        Raises:
          NoRendererError: no backend works; the message gives the reasons and the packages to install.
          SoftwareRendererError: `require_gpu` is set, and only software renders.
        """
        reasons: dict[str, str] = {}
        software: WorkingBackend | None = None
        for name in self._names:
            answer = self._answer(name)
            if isinstance(answer, str):
                reasons[name] = answer
            elif not (require_gpu and answer.software):
                return answer
            else:
                software = software or answer
        if software:
            raise SoftwareRendererError(software.renderer)
        raise NoRendererError(reasons, self._advice(reasons))

    def _answer(self, name: str) -> WorkingBackend | str:
        """Returns a backend, or the reason why it does not work."""
        key = name, self._environment
        if key not in _working:
            first = self._first if name == self._names[0] else None
            answer = (first or BackendTrialProcess(name)).result()
            if isinstance(answer, str):
                return answer
            _working[key] = answer
        return _working[key]

    def cancel(self) -> None:
        """Ends the child that is still running."""
        if self._first:
            self._first.cancel()

    def _advice(self, reasons: Mapping[str, str]) -> str:
        """Returns advice on how to render although these backends do not work."""
        return alternative(reasons, self._requested) or f"to draw in software: {install_advice()}"


class VulkanDetector(BackendDetector):
    """A detector of the Vulkan device of Filament, which starts at once."""

    def __init__(self) -> None:
        self._start(None, ("vulkan",))

    def _advice(self, reasons: Mapping[str, str]) -> str:
        install = f"to draw with filament in software: {install_advice(VULKAN)}"
        return f"{install}\n{option('renderer')} classic needs no Vulkan"


def alternative(tried: Collection[str], requested: str | None = None) -> str:
    """Returns advice on a backend that works instead of the tried ones; empty if none does.

    Args:
      requested: as in `requested_backends`.
    """
    for name in candidates():
        if name not in tried and isinstance(BackendTrialProcess(name).result(), WorkingBackend):
            unset = f"unset {GL}, or " if is_from_environment(requested) else ""
            return f"{name} draws: {unset}give {option('gl')} {name}"
    if _draws_on_another_device():
        variables = DEVICE if "egl" in tried else f"{GL} and {DEVICE}"
        return f"egl draws on another device: unset {variables}"
    return ""


def repair_advice(name: str) -> str:
    """Returns advice on how to make the backend `name` work."""
    if name == "egl" and _draws_on_another_device():
        return f"unset {DEVICE}: egl draws on another device"
    if name == "glfw":
        return "run it in a desktop session, or under xvfb-run"
    return f"until Mesa 25.0: {install_advice(OSMESA)}" if name == "osmesa" else install_advice()


def _draws_on_another_device() -> bool:
    """Returns whether EGL works on a device other than the one that the environment selects."""
    return DEVICE in os.environ and isinstance(BackendTrialProcess("egl", unset=(DEVICE,)).result(), WorkingBackend)


def install_advice(packages: Mapping[str, str] = OPENGL) -> str:
    """Returns the command that installs `packages` on this system's distribution."""
    if platform.system() != "Linux":
        return "install a graphics driver"
    try:
        release = platform.freedesktop_os_release()
    except OSError:
        release = {}
    families = [release.get("ID", ""), *release.get("ID_LIKE", "").split()]
    family = next((name for name in families if name in INSTALLERS and name in packages), "")
    return as_root(f"{INSTALLERS[family]} {packages[family]}") if family else packages[""]
