"""The camera argument of the command line, in one word.

`top`, a camera of the model; or a rig with its settings: `free`, `orbit:lookat=box,distance=2,azimuth=140..240`,
`track:hand,distance=.3,heading`, `look:from=0/-2/1,at=box`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import cast

import mujoco

from mjrun.camera.easing_and_shake import EASINGS, EasedNumber
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.rig import Rig
from mjrun.camera.script import RIGS, CameraScript, Shot
from mjrun.camera.setting_kinds import ObjectName
from mjrun.camera.targets import Vector
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, option
from mjrun.model.names import identify, names
from mjrun.options.kinds import Flag
from mjrun.options.number_kinds import Point
from mjrun.options.option import options_of
from mjrun.options.rendering import RIG_EXAMPLES
from mjrun.options.schema_validation import InvalidValueError

SHOT_SETTINGS = ("roll", "fovy")


def parse_camera(text: str, model: mujoco.MjModel) -> CameraScript:
    """Parses a camera argument into a script of one shot. A camera of `model` takes precedence over a rig of that name.

    Objects that it names are resolved later, by a CameraMotion.

    Raises:
      UnknownNameError: the camera or setting is unknown; the message lists the valid ones.
      BadValueError: the value of a setting is invalid.
      UsageError: a setting is missing or repeated.
    """
    return CameraScript(text.partition(",")[0], (_shot(text, model),))


def _shot(text: str, model: mujoco.MjModel) -> Shot:
    cameras = names(model, "camera")
    kind, _, rest = text.partition(":")
    rig = RIGS.get(kind)
    if text in cameras or rig is None or kind not in RIG_EXAMPLES:
        return Shot(_model_camera(text, model, cameras))
    return _RigArgument(rig).shot([part for part in rest.split(",") if part])


def _model_camera(text: str, model: mujoco.MjModel, cameras: list[str]) -> ModelRig:
    try:
        identify(model, "camera", text)
    except UnknownNameError:
        raise UnknownNameError("camera", text, [*cameras, *RIG_EXAMPLES]) from None
    return ModelRig(text)


class _RigArgument:
    """The argument of one rig: the settings that its options declare, by key, and those of the shot."""

    def __init__(self, rig: type[Rig]) -> None:
        self._rig, self._where, self._example = rig, f"{option('camera')} {rig.kind}", RIG_EXAMPLES[rig.kind]
        declared = options_of(rig)
        self._object = next((each for each in declared if isinstance(each.kind, ObjectName)), None)
        self._settings = {each.key: each for each in declared if each is not self._object}
        shots = {each.key: each for each in options_of(Shot) if each.key in SHOT_SETTINGS}
        self._kinds = {key: each.kind for key, each in (self._settings | shots).items()}

    @property
    def keys(self) -> list[str]:
        """The keys of all settings."""
        return [*(key for key in self._kinds if key != "ease"), *(["ease"] if self._rig.eased else [])]

    def shot(self, parts: list[str]) -> Shot:
        """Returns the shot that the comma-separated parts of an argument describe."""
        values: dict[str, object] = {}
        if self._object:
            if not parts or "=" in parts[0]:
                raise UsageError(f"{self._where}: no object given: write {self._example}")
            values[self._object.attribute] = parts.pop(0)
        texts = self._texts(parts)
        ease = texts.get("ease", "linear")
        if ease not in EASINGS:
            raise UnknownNameError("ease", ease, list(EASINGS), where=self._where)
        conflicts = dict(self._rig.conflicts(texts))
        for path, message in conflicts.items():
            if path != ("ease",):  # which then belongs to the ramps
                raise UsageError(f"{self._where}: {message}")
        for key, each in self._settings.items():
            if key in texts and (key,) not in conflicts:
                values[each.attribute] = self._value(key, texts[key], ease)
            elif each.is_required:
                raise UsageError(f"{self._where}: {key} is missing: write {self._example}")
        ramps = {key: self._value(key, texts[key], ease) for key in SHOT_SETTINGS if key in texts}
        return cast("Callable[..., Shot]", Shot)(self._rig(**values), **ramps)

    def _texts(self, parts: Sequence[str]) -> Mapping[str, str]:
        """Returns the texts of the values by key."""
        texts: dict[str, str] = {}
        for part in parts:
            key, equals, value = part.partition("=")
            if key not in self.keys:
                raise UnknownNameError("setting", key, self.keys, where=self._where)
            if key != "ease" and isinstance(self._kinds[key], Flag):
                if equals or key in texts:
                    raise UsageError(f"{self._where}: write {key} once")
            elif not equals or not value or key in texts:
                raise UsageError(f"{self._where}: write {clean(key)}=VALUE once")
            texts[key] = value
        return texts

    def _value(self, key: str, text: str, ease: str) -> object:
        kind = self._kinds[key]
        if isinstance(kind, Flag):
            return True
        try:
            value = kind.parse(text)
        except InvalidValueError as error:
            wrong = text if error.part is None else error.part
            raise BadValueError(f"{self._where}: {key}", wrong, error.expected) from None
        return replace(value, ease=ease) if isinstance(value, EasedNumber) else value


def parse_point(what: str, text: str, expected: str = "a point x/y/z [m]") -> Vector:
    """Parses the three numbers in `x/y/z`.

    Raises:
      BadValueError: the text is not a point; the message names `what` and the `expected` form.
    """
    try:
        return Point().parse(text)
    except InvalidValueError:
        raise BadValueError(what, text, expected) from None
