"""What a camera is to do, in one word of a command line.

`top`, a camera of the model; or a rig with its settings: `free`, `orbit:lookat=box,distance=2,azimuth=140..240`,
`track:hand,distance=.3,heading`, `look:from=0/-2/1,at=box`.
"""

import math
from collections.abc import Mapping, Sequence

import mujoco

from mjrun.camera.easing import EASINGS, Ramp
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.registry import RIGS
from mjrun.camera.rigs.rig import Rig
from mjrun.camera.rigs.settings import DeclaredField, declared_fields
from mjrun.camera.script import CameraScript, Shot
from mjrun.camera.targets import Place, Vector
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, option
from mjrun.model.names import identify, names

SHOT_SETTINGS = ("roll", "fovy")


def parse_camera(text: str, model: mujoco.MjModel) -> CameraScript:
    """The script of one shot that `text` asks for. A camera of `model` wins over a rig of the same name.

    Objects that it names are looked up later, by a CameraMotion.

    Raises:
      UnknownNameError: there is no such camera or setting; the message lists those there are.
      BadValueError: a setting's value does not fit.
      UsageError: something is missing, or given twice.
    """
    return CameraScript(text.partition(",")[0], (_shot(text, model),))


def _shot(text: str, model: mujoco.MjModel) -> Shot:
    cameras = names(model, "camera")
    kind, _, rest = text.partition(":")
    rig = RIGS.get(kind)
    if text in cameras or rig is None or not rig.argument:
        return Shot(_model_camera(text, model, cameras))
    return _RigArgument(rig).shot([part for part in rest.split(",") if part])


def _model_camera(text: str, model: mujoco.MjModel, cameras: list[str]) -> ModelRig:
    try:
        identify(model, "camera", text)
    except UnknownNameError:
        arguments = [rig.argument for rig in RIGS.values() if rig.argument]
        raise UnknownNameError("camera", text, [*cameras, *arguments]) from None
    return ModelRig(text)


class _RigArgument:
    """The argument of one rig: its settings by key, as its fields declare them, and those of the shot."""

    def __init__(self, rig: type[Rig]) -> None:
        self._rig, self._where = rig, f"{option('camera')} {rig.kind}"
        fields = declared_fields(rig)
        self._object = next((field for field in fields if field.setting.kind == "object"), None)
        self._fields = {field.key: field for field in fields if field is not self._object}

    @property
    def keys(self) -> list[str]:
        """The keys of all settings."""
        return [*(key for key in self._fields if key != "ease"), *SHOT_SETTINGS, *(["ease"] if self._rig.eased else [])]

    def shot(self, parts: list[str]) -> Shot:
        """The shot that the comma-separated parts of an argument describe."""
        values: dict[str, object] = {}
        if self._object:
            if not parts or "=" in parts[0]:
                raise UsageError(f"{self._where}: which object? write {self._usage()}")
            values[self._object.name] = parts.pop(0)
        texts = self._texts(parts)
        ease = texts.get("ease", "linear")
        if ease not in EASINGS:
            raise UnknownNameError("ease", ease, list(EASINGS), where=self._where)
        conflicts = dict(self._rig.conflicts(texts))
        for path, message in conflicts.items():
            if path != ("ease",):  # that of the ramps, then
                raise UsageError(f"{self._where}: {message}")
        for key, field in self._fields.items():
            if key in texts and (key,) not in conflicts:
                values[field.name] = self._value(field, texts[key], ease)
            elif field.required:
                raise UsageError(f"{self._where}: {key} is missing: write {self._rig.argument}")
        rig = self._rig(**values)
        rig.check(self._where)
        ramps = {key: self._ramp(key, texts[key], ease) for key in SHOT_SETTINGS if key in texts}
        return Shot(rig, roll=ramps.get("roll", Ramp.still(0.0)), fovy=ramps.get("fovy"))

    def _usage(self) -> str:
        ramps = [f"{key}=…" for key, field in self._fields.items() if field.setting.kind == "ramp"]
        return f"{self._rig.argument}[,{','.join(ramps)}]"

    def _texts(self, parts: Sequence[str]) -> Mapping[str, str]:
        """The texts of the values by key."""
        texts: dict[str, str] = {}
        for part in parts:
            key, equals, value = part.partition("=")
            if key not in self.keys:
                raise UnknownNameError("setting", key, self.keys, where=self._where)
            if key in self._fields and self._fields[key].setting.kind == "flag":
                if equals or key in texts:
                    raise UsageError(f"{self._where}: write {key}, once")
            elif not equals or not value or key in texts:
                raise UsageError(f"{self._where}: write {clean(key)}=VALUE, once")
            texts[key] = value
        return texts

    def _value(self, field: DeclaredField, text: str, ease: str) -> object:
        match field.setting.kind:
            case "flag":
                return True
            case "ramp":
                return self._ramp(field.key, text, ease)
            case "place":
                return _place(field.key, text)
            case "point":
                return parse_point(field.key, text)
            case _:
                return text

    def _ramp(self, key: str, text: str, ease: str) -> Ramp:
        """`140` or `140..240`."""
        first, dots, last = text.partition("..")
        try:
            ramp = Ramp(float(first), float(last if dots else first), ease)
        except ValueError:
            ramp = Ramp.still(math.nan)
        if not (math.isfinite(ramp.start) and math.isfinite(ramp.end)):
            raise BadValueError(f"{self._where}: {key}", text, "a number, or two as in 140..240")
        return ramp


def _place(key: str, text: str) -> Place:
    """The name of an object, or a point `x/y/z`."""
    try:
        _, _, _ = map(float, text.split("/"))
    except ValueError:
        return text
    return parse_point(key, text)


def parse_point(what: str, text: str, expected: str = "a point x/y/z [m]") -> Vector:
    """The three numbers in `x/y/z`.

    Raises:
      BadValueError: `what` is not `expected`.
    """
    try:
        x, y, z = map(float, text.split("/"))
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise BadValueError(what, text, expected)
    return (x, y, z)
