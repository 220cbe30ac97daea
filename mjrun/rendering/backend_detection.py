"""Finds a backend that works, by trying each in a child process: a broken driver may hang, print or crash."""

import json
import os
import platform
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from mjrun.child_process import ChildProcess
from mjrun.errors import NoRendererError, SoftwareRendererError, option
from mjrun.rendering.backend import DEVICE, GL, Backend, candidates, is_from_environment, requested_backends
from mjrun.rendering.worker_process import memory_file

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
ADVICE = {"egl": OPENGL, "osmesa": OSMESA, "glfw": DISPLAY}
TIMEOUT = 60  # [s], for a driver that hangs


class BackendTrialProcess:
    """One backend, `vulkan`, or `devices` of EGL, being tried in a child process, which starts at once.

    Args:
      draw: whether an image is drawn and checked too.
      device: of EGL, as MUJOCO_EGL_DEVICE_ID has it.
      unset: variables of the environment to remove.
    """

    def __init__(self, name: str, draw: bool = False, device: int | None = None, unset: Sequence[str] = ()) -> None:
        self.name = name
        environment = {**dict.fromkeys(unset), GL: "disable"}
        if device is not None:
            environment[DEVICE] = str(device)
        script = Path(__file__).with_name("try_backend.py")
        command = [sys.executable, "-P", str(script), name, *(["draw"] if draw else [])]
        self._log = os.fdopen(memory_file(), "w+b")  # a file, since the child reads what Filament logs
        self._process = ChildProcess(command, environment=environment, stdout="capture", stderr=self._log)

    def answer(self) -> dict[str, Any]:
        """What the child reports, or `error`."""
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

    def result(self) -> Backend | str:
        """The backend, or why there is none."""
        answer = self.answer()
        return answer["error"] if "error" in answer else Backend(self.name, **answer)

    def cancel(self) -> None:
        """Ends the child."""
        self._log.close()
        self._process.end()


class BackendDetection:
    """The search for a working backend, begun at once so that it runs while the model loads.

    Args:
      requested: `auto` or None for the best that works, else the only one to try.

    Raises:
      UnknownNameError: no such backend.
      NoRendererError: rendering is switched off by MUJOCO_GL.
    """

    def __init__(self, requested: str | None = None) -> None:
        self._requested, self._names = requested, requested_backends(requested)
        self._first = BackendTrialProcess(self._names[0])

    def result(self, require_gpu: bool = False) -> Backend:
        """The first backend that works.

        Raises:
          NoRendererError: none does; the message says why, and what to install.
          SoftwareRendererError: `require_gpu`, and only software draws.
        """
        reasons: dict[str, str] = {}
        software: Backend | None = None
        for name in self._names:
            answer = (self._first if name == self._first.name else BackendTrialProcess(name)).result()
            if isinstance(answer, str):
                reasons[name] = answer
            elif not (require_gpu and answer.software):
                return answer
            else:
                software = software or answer
        if software:
            raise SoftwareRendererError(software.renderer)
        advice = alternative(reasons, self._requested) or f"to draw in software: {install_advice()}"
        raise NoRendererError(reasons, advice)

    def cancel(self) -> None:
        """Ends the child that is still trying."""
        self._first.cancel()


class VulkanDetection:
    """The search for a Vulkan device that Filament draws with, begun at once; used like `BackendDetection`."""

    def __init__(self) -> None:
        self._trial = BackendTrialProcess("vulkan")

    def result(self, require_gpu: bool = False) -> Backend:
        """The device that Filament has chosen and drawn with.

        Raises:
          NoRendererError: there is none; the message says why, and what to install.
          SoftwareRendererError: `require_gpu`, and only software draws.
        """
        answer = self._trial.result()
        if isinstance(answer, str):
            install = f"to draw with filament in software: {install_advice(VULKAN)}"
            raise NoRendererError({"vulkan": answer}, f"{install}\n{option('renderer')} classic needs no Vulkan")
        if require_gpu and answer.software:
            raise SoftwareRendererError(answer.renderer)
        return answer

    def cancel(self) -> None:
        """Ends the child if it is still trying."""
        self._trial.cancel()


def alternative(tried: Collection[str], requested: str | None = None) -> str:
    """What else would draw where `tried` do not, and how to ask for it; empty where nothing would.

    Args:
      requested: as in `requested_backends`.
    """
    for name in candidates():
        if name not in tried and isinstance(BackendTrialProcess(name).result(), Backend):
            unset = f"unset {GL}, or " if is_from_environment(requested) else ""
            return f"{name} draws: {unset}give {option('gl')} {name}"
    if _draws_on_another_device():
        variables = DEVICE if "egl" in tried else f"{GL} and {DEVICE}"
        return f"egl draws on another device: unset {variables}"
    return ""


def repair_advice(name: str) -> str:
    """How to make the backend `name` draw, which does not."""
    if name == "egl" and _draws_on_another_device():
        return f"unset {DEVICE}: egl draws on another device"
    return install_advice(ADVICE.get(name, OPENGL))


def _draws_on_another_device() -> bool:
    """Whether EGL draws on a device other than the one the environment asks for."""
    return DEVICE in os.environ and isinstance(BackendTrialProcess("egl", unset=(DEVICE,)).result(), Backend)


def install_advice(commands: Mapping[str, str] = OPENGL) -> str:
    """The one of `commands` for the family of this system's distribution."""
    if platform.system() != "Linux":
        return "install a graphics driver"
    try:
        system = platform.freedesktop_os_release()
    except OSError:
        system = {}
    family = next((name for name in [system.get("ID"), *system.get("ID_LIKE", "").split()] if name in commands), "")
    return commands[family or ""]
