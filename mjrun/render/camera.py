"""Where the view is from: cameras of the model, and rigs that mjrun moves.

A camera is asked for by text: a model camera's name or index, `free`, or a rig with settings,
`orbit:lookat=box,distance=2,azimuth=140..240` or `track:hand,distance=.3`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean
from mjrun.model.names import identify, names
from mjrun.render.objects import TARGETS, identify_object

EASINGS: dict[str, Callable[[float], float]] = {
    "linear": lambda u: u,
    "cosine": lambda u: 0.5 - math.cos(math.pi * u) / 2,
}
NUMBERS = ("distance", "azimuth", "elevation")
SETTINGS = {
    "free": ("lookat", *NUMBERS),
    "orbit": ("lookat", *NUMBERS, "ease"),
    "track": (*NUMBERS, "ease"),
}


class Rig(Protocol):
    """Anything that can aim a camera."""

    def aim(self, camera: mujoco.MjvCamera, data: mujoco.MjData, phase: float) -> None:
        """Points `camera` for the instant in `data`; `phase` runs from 0 to 1 over the film."""
        ...


@dataclass(frozen=True)
class ModelCamera:
    """A camera declared in the model."""

    id: int

    def aim(self, camera: mujoco.MjvCamera, data: mujoco.MjData, phase: float) -> None:
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED.value
        camera.fixedcamid = self.id


@dataclass(frozen=True)
class Ramp:
    """A number that goes from `start` to `end` over the film."""

    start: float
    end: float

    def at(self, u: float) -> float:
        return self.start + (self.end - self.start) * u


@dataclass(frozen=True)
class FreeRig:
    """MuJoCo's free camera at a distance, azimuth and elevation [deg] from a point or a moving object.

    Args:
      target: kind (`body`, `geom`, `site`) and id to follow by position, or a fixed point [m].
      orthographic: without perspective, as the model may want its free camera.
    """

    target: tuple[str, int] | tuple[float, float, float]
    distance: Ramp
    azimuth: Ramp
    elevation: Ramp
    ease: str = "linear"
    orthographic: bool = False

    def aim(self, camera: mujoco.MjvCamera, data: mujoco.MjData, phase: float) -> None:
        u = EASINGS[self.ease](phase)
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE.value
        camera.orthographic = self.orthographic
        camera.lookat[:] = self._lookat(data)
        camera.distance = self.distance.at(u)
        camera.azimuth = self.azimuth.at(u)
        camera.elevation = self.elevation.at(u)

    def _lookat(self, data: mujoco.MjData) -> np.ndarray:
        if len(self.target) == 2:
            kind, index = self.target
            return getattr(data, TARGETS[kind])[index]
        return np.array(self.target)


def rig(text: str, model: mujoco.MjModel) -> Rig:
    """The rig that `text` asks for in `model`.

    Raises:
      UnknownNameError: a camera, object or setting that is not there; the message lists those that are.
      BadValueError: a setting's value does not fit.
    """
    cameras = names(model, "camera")
    kind, _, rest = text.partition(":")
    if text in cameras or (kind not in SETTINGS):
        return ModelCamera(_model_camera(text, model, cameras))
    parts = [part for part in rest.split(",") if part]
    followed = parts.pop(0) if kind == "track" and parts and "=" not in parts[0] else None
    return _free_rig(kind, followed, _settings(kind, parts), model)


def _model_camera(text: str, model: mujoco.MjModel, cameras: list[str]) -> int:
    try:
        return identify(model, "camera", text)
    except UnknownNameError:
        raise UnknownNameError("camera", text, [*cameras, "free", "orbit:…", "track:BODY"]) from None


def _settings(kind: str, parts: list[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for part in parts:
        name, equals, value = part.partition("=")
        if name not in SETTINGS[kind]:
            raise UnknownNameError("setting", name, SETTINGS[kind], where=f"--camera {kind}")
        if not equals or not value or name in found:
            raise UsageError(f"--camera {kind}: write {clean(name)}=VALUE, once")
        found[name] = value
    return found


def _free_rig(kind: str, followed: str | None, settings: Mapping[str, str], model: mujoco.MjModel) -> FreeRig:
    default = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, default)
    if kind != "track":
        target = _target(settings.get("lookat"), model, default)
    elif followed:
        target = identify_object(followed, model)
    else:
        raise UsageError("--camera track: which object? write track:BODY[,distance=…,azimuth=…,elevation=…]")
    ramps = {name: _ramp(kind, name, settings.get(name), getattr(default, name)) for name in NUMBERS}
    if kind == "orbit" and "azimuth" not in settings:
        ramps["azimuth"] = Ramp(default.azimuth, default.azimuth + 360)
    for end in (ramps["distance"].start, ramps["distance"].end):
        if end <= 0:
            raise BadValueError(f"--camera {kind}: distance", f"{end:g}", "a positive number of metres")
    ease = settings.get("ease", "linear")
    if ease not in EASINGS:
        raise UnknownNameError("ease", ease, list(EASINGS), where=f"--camera {kind}")
    return FreeRig(target, **ramps, ease=ease, orthographic=bool(default.orthographic))


def _ramp(kind: str, name: str, text: str | None, default: float) -> Ramp:
    """`140` or `140..240`."""
    if text is None:
        return Ramp(default, default)
    first, dots, last = text.partition("..")
    try:
        ramp = Ramp(float(first), float(last if dots else first))
    except ValueError:
        ramp = Ramp(math.nan, math.nan)
    if not (math.isfinite(ramp.start) and math.isfinite(ramp.end)):
        raise BadValueError(f"--camera {kind}: {name}", text, "a number, or two as in 140..240")
    return ramp


def _target(
    text: str | None, model: mujoco.MjModel, default: mujoco.MjvCamera
) -> tuple[str, int] | tuple[float, float, float]:
    if text is None:
        x, y, z = map(float, default.lookat)
        return (x, y, z)
    try:
        x, y, z = map(float, text.split("/"))
    except ValueError:
        return identify_object(text, model)
    if not all(map(math.isfinite, (x, y, z))):
        raise BadValueError("lookat", text, "a point x/y/z [m]")
    return (x, y, z)
