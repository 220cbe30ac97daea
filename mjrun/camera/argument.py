"""What a camera is to do, said in one word of a command line.

`top`, a camera of the model; `free`; or a rig with settings: `orbit:lookat=box,distance=2,azimuth=140..240`,
`track:hand,distance=.3,heading`.
"""

import math
from collections.abc import Mapping

import mujoco

from mjrun.camera.easing import EASINGS
from mjrun.camera.rigs import check_ramp
from mjrun.camera.script import AroundRig, ModelRig, Place, Ramp, Script, Shot
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean
from mjrun.model.names import identify, names

NUMBERS = ("distance", "azimuth", "elevation", "roll", "fovy")
SETTINGS = {
    "free": ("lookat", *NUMBERS),
    "orbit": ("lookat", *NUMBERS, "ease"),
    "track": (*NUMBERS, "heading", "ease"),
}


def script(text: str, model: mujoco.MjModel) -> Script:
    """The script of one shot that `text` asks for. A camera of `model` wins over a rig of the same name.

    Objects that it names are looked up later, by a CameraMotion.

    Raises:
      UnknownNameError: a camera or setting that is not there; the message lists those that are.
      BadValueError: a setting's value does not fit.
      UsageError: something is missing, or said twice.
    """
    return Script(text.partition(",")[0], (_shot(text, model),))


def _shot(text: str, model: mujoco.MjModel) -> Shot:
    cameras = names(model, "camera")
    kind, _, rest = text.partition(":")
    if text in cameras or kind not in SETTINGS:
        return Shot(_model_camera(text, model, cameras))
    parts = [part for part in rest.split(",") if part]
    followed = parts.pop(0) if kind == "track" and parts and "=" not in parts[0] else None
    return _rig_shot(kind, followed, _settings(kind, parts))


def _model_camera(text: str, model: mujoco.MjModel, cameras: list[str]) -> ModelRig:
    try:
        identify(model, "camera", text)
    except UnknownNameError:
        raise UnknownNameError("camera", text, [*cameras, "free", "orbit:…", "track:BODY"]) from None
    return ModelRig(text)


def _settings(kind: str, parts: list[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for part in parts:
        name, equals, value = part.partition("=")
        if name not in SETTINGS[kind]:
            raise UnknownNameError("setting", name, SETTINGS[kind], where=f"--camera {kind}")
        if name == "heading":
            if equals or name in found:
                raise UsageError(f"--camera {kind}: write heading, once")
        elif not equals or not value or name in found:
            raise UsageError(f"--camera {kind}: write {clean(name)}=VALUE, once")
        found[name] = value
    return found


def _rig_shot(kind: str, followed: str | None, settings: Mapping[str, str]) -> Shot:
    if kind == "track" and not followed:
        raise UsageError("--camera track: which object? write track:BODY[,distance=…,azimuth=…,elevation=…]")
    ease = settings.get("ease", "linear")
    if ease not in EASINGS:
        raise UnknownNameError("ease", ease, list(EASINGS), where=f"--camera {kind}")
    ramps = {name: _ramp(kind, name, settings[name], ease) for name in NUMBERS if name in settings}
    if "distance" in ramps:
        check_ramp(ramps["distance"], f"--camera {kind}: distance", 0.0, expected="a positive number of metres")
    rig = AroundRig(
        target=followed or _place(settings.get("lookat")),
        distance=ramps.get("distance"),
        azimuth=ramps.get("azimuth"),
        elevation=ramps.get("elevation"),
        heading="heading" in settings,
        turn=ease if kind == "orbit" and "azimuth" not in settings else None,
    )
    return Shot(rig, roll=ramps.get("roll", Ramp.still(0.0)), fovy=ramps.get("fovy"))


def _ramp(kind: str, name: str, text: str, ease: str) -> Ramp:
    """`140` or `140..240`."""
    first, dots, last = text.partition("..")
    try:
        ramp = Ramp(float(first), float(last if dots else first), ease)
    except ValueError:
        ramp = Ramp.still(math.nan)
    if not (math.isfinite(ramp.start) and math.isfinite(ramp.end)):
        raise BadValueError(f"--camera {kind}: {name}", text, "a number, or two as in 140..240")
    return ramp


def _place(text: str | None) -> Place | None:
    """An object's name, or a point `x/y/z`."""
    if text is None:
        return None
    try:
        x, y, z = map(float, text.split("/"))
    except ValueError:
        return text
    if not all(map(math.isfinite, (x, y, z))):
        raise BadValueError("lookat", text, "a point x/y/z [m]")
    return (x, y, z)
