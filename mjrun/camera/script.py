"""Camera scripts as plain values: shots in time, each with a rig. Names are not yet resolved in a model.

An argument of the command line is a script of one shot: `top`, a camera of the model; or a rig with its settings,
as in `free`, `orbit:lookat=box,distance=2,azimuth=140..240`, `track:hand,distance=.3,heading`.
"""

import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from importlib import import_module
from typing import cast

import mujoco

from mjrun import errors
from mjrun.camera import rigs
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.rig import BLENDS, EASINGS, EasedNumber, ObjectNameKind, RampKind, Rig, Shake, ShotBlend
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, near
from mjrun.model.names import identify, names
from mjrun.options.kinds import ChoiceKind, FlagKind, ReadingContext, TextKind, optional
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind, Number, RealKind, refuse_loose_coordinate
from mjrun.options.option import (
    Options,
    document_key,
    located,
    option,
    options,
    options_of,
    positional_options,
    required,
)
from mjrun.options.rendering import RIG_EXAMPLES
from mjrun.options.schema_validation import InvalidValueError, Path, Schema
from mjrun.options.structured_kinds import ListKind, OneOfKind, OptionsMappingKind, mappings_in, plain_values
from mjrun.suffixes import is_yaml
from mjrun.timeline import rational

END = "end"  # of the simulation

for _module in pkgutil.iter_modules(rigs.__path__):
    import_module(f"{rigs.__name__}.{_module.name}")

# All rigs, by their names in documents and on the command line.
RIGS: dict[str, type[Rig]] = {rig.kind: rig for rig in sorted(Rig.__subclasses__(), key=lambda rig: rig.kind)}
LEVEL = EasedNumber.still(0.0)
SHOT_SETTINGS = ("roll", "fovy")


@positional_options
class FramedObject(Options):
    """An object to keep whole in the image, with everything attached to it, by adjusting the distance."""

    target: str = required(converter=ObjectNameKind(), help="A body, geom or site.")
    margin: float = option(converter=RealKind(least=1), default=1.2, help="Size of the image relative to the object.")


class _InstantOrEndKind(ExactNumberKind):
    """A time [s], kept exactly, or the end."""

    def __init__(self) -> None:
        super().__init__(zero=True)

    @property
    def expected(self) -> str:
        return f"a time [s] of at least 0, or {END}"

    @property
    def form(self) -> Schema:
        return {"anyOf": [super().form, {"type": "string", "enum": [END]}]}

    def __call__(self, value: Number) -> Fraction | str:  # pyright: ignore[reportIncompatibleMethodOverride]
        return END if value == END else super().__call__(value)


@positional_options
class ConditionEvent(Options):
    """An event in the simulation: the instant when a condition becomes true."""

    when: str = required(
        converter=TextKind(), help="The condition, as in speed(box) > 0.02; quote it if it contains ': ' or ' #'."
    )
    nth: int = option(converter=IntegerKind(1), default=1, help="Number of the occurrence to use, counted from 1.")
    offset: Fraction = option(
        converter=ExactNumberKind(signed=True),
        default=0,
        help="Delay after the event [s]; negative for a time before it.",
    )
    otherwise: Fraction | str | None = option(
        converter=optional(_InstantOrEndKind()),
        default=None,
        key="else",
        help="Fallback if it never happens: a time of the simulation [s], or end; an error if left out.",
    )


class InstantOrEventKind(OneOfKind["float | str | Fraction | ConditionEvent", "Fraction | ConditionEvent"]):
    """A time [s], kept exactly, or an event.

    Args:
      zero: whether the time in a document may be 0.
    """

    def __init__(self, zero: bool = False) -> None:
        time = ExactNumberKind(zero=zero)
        forms = "a time [s] or {when, nth, offset, else}"
        super().__init__(forms, number=time, string=time, object=OptionsMappingKind(ConditionEvent, ConditionEvent))

    def __call__(self, value: "float | str | Fraction | ConditionEvent") -> "Fraction | ConditionEvent":
        return value if isinstance(value, ConditionEvent) else ExactNumberKind(zero=True)(value)

    def plain(self, value: "Fraction | ConditionEvent") -> object:
        return plain_values(value) if isinstance(value, ConditionEvent) else value


class _BlendKind(OneOfKind["ShotBlend | str | float", ShotBlend]):
    """A blend, its shape or its width."""

    def __init__(self) -> None:
        forms = "a shape, a width [s] or {shape, width}"
        shape, width = ChoiceKind((*BLENDS,)), RealKind(above=0)
        super().__init__(forms, string=shape, number=width, object=OptionsMappingKind(ShotBlend, ShotBlend))

    def __call__(self, value: "ShotBlend | str | float") -> ShotBlend:
        match value:
            case ShotBlend():
                return value
            case str():
                return ShotBlend(shape=value)
            case _:
                return ShotBlend(width=value)

    def plain(self, value: ShotBlend) -> object:
        return plain_values(value)


class _FramedObjectKind(OneOfKind["FramedObject | str", FramedObject]):
    """An object to frame, or its name."""

    def __init__(self) -> None:
        super().__init__(
            "an object's name or {target, margin}",
            string=ObjectNameKind(),
            object=OptionsMappingKind(FramedObject, FramedObject),
        )

    def __call__(self, value: "FramedObject | str") -> FramedObject:
        return FramedObject(value) if isinstance(value, str) else value

    def plain(self, value: FramedObject) -> object:
        return value.target if value == FramedObject(value.target) else plain_values(value)


@positional_options
class Shot(Options):
    """A rig for a stretch of time."""

    rig: Rig
    until: Fraction | ConditionEvent | None = option(
        converter=optional(InstantOrEventKind()),
        default=None,
        help="End of the shot: a time of the simulation [s], or an event.",
    )
    lasting: Fraction | None = option(
        converter=optional(ExactNumberKind()),
        default=None,
        key="duration",
        help="Duration of the shot [s] in simulated time, instead of until.",
    )
    speed: Fraction | None = option(
        converter=optional(ExactNumberKind()),
        default=None,
        help="Simulated seconds per second of video: 0.5 is slow motion.",
    )
    blend: ShotBlend | None = option(
        converter=optional(_BlendKind()),
        default=None,
        help="Transition from the previous shot: a shape, a width [s], or both; a cut if left out.",
    )
    roll: EasedNumber = option(
        converter=RampKind("degrees"), default=LEVEL, help="Clockwise turn around the axis of view [deg]."
    )
    fovy: EasedNumber | None = option(
        converter=optional(RampKind("degrees", positive=True)),
        default=None,
        help="Vertical field of view [deg], or its height [m] if orthographic; the model's if left out.",
    )
    shake: Shake | None = option(
        converter=optional(OptionsMappingKind(Shake, Shake, blank=True)),
        default=None,
        help="Shake of a hand-held camera.",
    )
    fit: FramedObject | None = option(
        converter=optional(_FramedObjectKind()),
        default=None,
        help="Object to keep whole in the image by adjusting the distance.",
    )


class ShotMappingKind(OptionsMappingKind[Shot]):
    """A shot in a document, whose rig is one of its keys."""

    def __init__(self) -> None:
        super().__init__(Shot, _shot, more=[document_key(kind, rig.form(), rig.help) for kind, rig in RIGS.items()])

    def conflicts(self, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        rigs = [key for key in values if key in RIGS]
        mistyped = any(near(key, RIGS) for key in {*values} - {each.key for each in self.options()})
        if not rigs and not mistyped:
            yield (), f"expected one of {', '.join(RIGS)}, got none"
        yield from (((rig,), f"a shot has only one rig; this one already has {rigs[0]}") for rig in rigs[1:])

    def mapping_schema(self, reader: ReadingContext, definitions: dict[str, Schema]) -> dict[str, object]:
        schema = super().mapping_schema(reader, definitions)
        return {**schema, "oneOf": [{"required": [rig]} for rig in RIGS]}

    def plain(self, value: Shot) -> object:
        return {value.rig.kind: value.rig.form().plain(value.rig), **plain_values(value)}


def _shot(**values: object) -> Shot:
    rig = next(values.pop(kind) for kind in RIGS if kind in values)
    return cast("Callable[..., Shot]", Shot)(rig, **values)


@options
class CameraDocument(Options):
    """The camera's shots in a video, one after the other."""

    speed: Fraction | None = option(
        converter=optional(ExactNumberKind()),
        default=None,
        help="Simulated seconds per second of video, for shots without a speed: 0.5 is slow motion.",
    )
    shots: tuple[Shot, ...] = required(
        converter=ListKind[Shot](ShotMappingKind(), least=1),
        help="The shots in order; all but the last set their end with until or duration.",
    )

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        if shots := mappings_in(values.get("shots")):
            yield from shot_conflicts(shots)

    def script(self, name: str, file: str = "") -> "CameraScript":
        """Returns the script under a name, as read from a file."""
        return CameraScript(name, [replace(shot, speed=shot.speed or self.speed) for shot in self.shots], file)


@options
class InlineCamera(CameraDocument):
    """A camera script written in place."""

    name: str = option(converter=TextKind(), default="script", help="Name of the camera in captions and files.")


@dataclass(frozen=True)
class CameraScript:
    """A sequence of shots, with a name for captions and files.

    Attributes:
      file: the document that it was read from; empty if it was written in place.
    """

    name: str
    shots: Sequence[Shot]
    file: str = field(default="", compare=False, repr=False)

    def inline(self) -> InlineCamera:
        """Returns the script as options."""
        return InlineCamera(name=self.name, shots=self.shots)  # pyright: ignore[reportArgumentType]

    def check(self) -> None:
        """Checks that the shots are consistent.

        Raises:
          UsageError: shots contradict each other.
        """
        shots: list[dict[str, object]] = []
        for shot in self.shots:
            values = {"until": shot.until, "duration": shot.lasting, "blend": shot.blend}
            shots.append({key: value for key, value in values.items() if value is not None})
        for path, message in shot_conflicts(shots):
            with concerning(*path):
                raise UsageError(f"camera {clean(self.name)}: {located(message, path)}")


def shot_conflicts(shots: Sequence[Mapping[str, object]]) -> Iterator[tuple[Path, str]]:
    """Yields errors in the shots of a script that need no simulation: location and sentence.

    Args:
      shots: the values of each by key, as written in a document, of any type.
    """
    if not shots:
        yield ("shots",), "expected at least one shot"
    elif "blend" in shots[0]:
        yield ("shots", 0, "blend"), "the first shot has no previous shot to blend with"
    for i, shot in enumerate(shots):
        if "until" in shot and "duration" in shot:
            yield ("shots", i, "duration"), "a shot ends by until or after a duration, not both"
    for i, shot in enumerate(shots[:-1]):
        if "until" not in shot and "duration" not in shot:
            yield ("shots", i), "the end of this shot is missing: all shots but the last need until or duration"
    yield from _disordered(shots)


def _disordered(shots: Sequence[Mapping[str, object]]) -> Iterator[tuple[Path, str]]:
    """Yields the shots that would end before they begin, as far as their times are known."""
    begun = Fraction(0)  # at the earliest
    for i, shot in enumerate(shots):
        until, duration = _number(shot.get("until")), _number(shot.get("duration"))
        if 0 < until <= begun:
            yield ("shots", i, "until"), f"expected a time later than {float(begun):g}, when the shot begins"
        begun = max(begun + max(duration, Fraction(0)), until)


def _number(value: object) -> Fraction:
    """Returns a number exactly, and 0 for anything else."""
    if not isinstance(value, int | float | Fraction) or isinstance(value, bool):
        return Fraction(0)
    try:
        return rational(value)
    except (ValueError, OverflowError):  # not finite
        return Fraction(0)


def parse_camera(text: str, model: mujoco.MjModel) -> CameraScript:
    """Parses a camera argument into a script of one shot. A camera of `model` takes precedence over a rig of that name.

    Objects that it names are resolved later, by a BoundCameraScript.

    Raises:
      UnknownNameError: the camera or setting is unknown; the message lists the valid ones.
      BadValueError: the value of a setting is invalid.
      UsageError: a setting is missing or repeated.
    """
    cameras = names(model, "camera")
    kind, _, rest = text.partition(":")
    rig = RIGS.get(kind)  # a class in a module of camera/rigs, whose `kind` is this name
    if text in cameras or rig is None or kind not in RIG_EXAMPLES:
        shot = Shot(_model_camera(text, model, cameras))
    else:
        shot = _RigArgument(rig).shot([part for part in rest.split(",") if part])
    name = text if isinstance(shot.rig, ModelRig) else short_name(text)
    return CameraScript(name, (shot,))


def short_name(camera: object) -> str:
    """Returns the name of a script or of a camera argument: a rig's without settings after the first."""
    if isinstance(camera, CameraScript):
        return camera.name
    text = str(camera)
    return text.partition(",")[0] if text.partition(":")[0] in RIG_EXAMPLES else text  # a name may hold a comma


def _model_camera(text: str, model: mujoco.MjModel, cameras: list[str]) -> ModelRig:
    try:
        identify(model, "camera", text)
    except UnknownNameError:
        if is_yaml(text):
            raise UsageError(f"{clean(text)}: camera scripts do not apply here; give a camera or a rig") from None
        kind, colon, _ = text.partition(":")
        meant = near(kind, RIG_EXAMPLES) if colon else ()
        raise UnknownNameError("camera", text, [*dict.fromkeys([*cameras, *RIG_EXAMPLES])], meant=meant) from None
    return ModelRig(text)


class _RigArgument:
    """The argument of one rig: the settings that its options declare, by key, and those of the shot."""

    def __init__(self, rig: type[Rig]) -> None:
        self._rig, self._where, self._example = rig, f"{errors.option('camera')} {rig.kind}", RIG_EXAMPLES[rig.kind]
        declared = options_of(rig)
        self._object = next((each for each in declared if isinstance(each.kind, ObjectNameKind)), None)
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
                refuse_loose_coordinate(key, self._where)
                raise UnknownNameError("setting", key, self.keys, where=self._where)
            if key != "ease" and isinstance(self._kinds[key], FlagKind):
                if equals or key in texts:
                    raise UsageError(f"{self._where}: write {key} once")
            elif not equals or not value or key in texts:
                raise UsageError(f"{self._where}: write {clean(key)}=VALUE once")
            texts[key] = value
        return texts

    def _value(self, key: str, text: str, ease: str) -> object:
        kind = self._kinds[key]
        if isinstance(kind, FlagKind):
            return True
        try:
            value = kind.parse(text)
        except InvalidValueError as error:
            wrong = text if error.part is None else error.part
            raise BadValueError(f"{self._where}: {key}", wrong, error.expected) from None
        return replace(value, ease=ease) if isinstance(value, EasedNumber) else value
