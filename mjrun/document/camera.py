"""The camera document: shots in time, each a rig, with cuts, blends and events.

```yaml
speed: 0.25
shots:
  - orbit: {lookat: floor, distance: 0.9, azimuth: {from: 140, to: 240, ease: cosine}, elevation: -30}
    until: {when: speed(box) > 0.02}
  - track: {target: box, distance: 0.08, azimuth: 280, elevation: -10}
    blend: {shape: sigmoid, width: 0.3}
```
"""

import pathlib
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Annotated, Literal

from pydantic import BeforeValidator, ConfigDict, Field, Tag

from mjrun.camera import easing, script, shake
from mjrun.camera.easing import BLENDS
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.registry import RIGS
from mjrun.camera.rigs.rig import Rig, mappings_in
from mjrun.document.document_model import (
    MAPPING,
    NUMBER,
    TEXT,
    DocumentModel,
    Location,
    Name,
    Omittable,
    OneOfTexts,
    Positive,
    by_type,
    empty_if_null,
    model_with_keys,
)
from mjrun.document.reader import read
from mjrun.document.rigs import DeclaredModel, NumberOrRamp, PositiveNumberOrRamp, optional_ramp, ramp, rig_fields
from mjrun.errors import near
from mjrun.timeline import rational

Shape = Annotated[str, OneOfTexts(tuple(BLENDS))]
Index = Annotated[int, Field(ge=0)]
Time = Annotated[float, Field(ge=0)]


class Event(DocumentModel):
    """Something that happens in the simulation: the instant when a condition begins to hold."""

    when: Name
    """The condition, as in speed(box) > 0.02; with ': ' or ' #' in it, it goes in quotes."""
    nth: Annotated[int, Field(ge=1)] = 1
    """Which time that it begins to hold, from 1 on."""
    offset: float = 0.0
    """How much later the shot ends [s], or earlier if negative."""
    otherwise: Omittable[
        Annotated[
            Annotated[Time, Tag(NUMBER)] | Annotated[Literal["end"], Tag(TEXT)],
            by_type("a time [s] or end", NUMBER, TEXT),
        ]
    ] = Field(None, alias="else")
    """What counts if it never happens: a time of the simulation [s], or end; an error if left out."""

    def event(self) -> script.Event:
        """The event."""
        otherwise = self.otherwise if isinstance(self.otherwise, str) else _exact(self.otherwise)
        return script.Event(self.when, self.nth, rational(self.offset), otherwise)


class Blend(DocumentModel):
    """How one shot becomes the next."""

    shape: Shape = "cosine"
    """The shape of the transition."""
    width: Positive = 0.5
    """How long it takes [s]; of a sigmoid, the time in which it goes from 1/2 to 1/(1+e)."""


class Shake(DocumentModel):
    """The trembling of a hand that holds the camera."""

    angle: Positive = 0.3
    """Standard deviation of each angle [deg]."""
    frequency: Positive = 2.0
    """Of the trembling [Hz], in the time of the video."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the trembling."""


class Fit(DocumentModel):
    """Keeps an object, with all that hangs on it, whole in the image, by the distance."""

    target: Name
    """A body, geom or site."""
    margin: Annotated[float, Field(ge=1)] = 1.2
    """How much larger than the object the image is."""


class _ModelCamera(DocumentModel):
    camera: Omittable[
        Annotated[
            Annotated[Name, Tag(TEXT)] | Annotated[Index, Tag(NUMBER)],
            by_type("the name or index of a camera", TEXT, NUMBER),
        ]
    ] = None
    """A camera of the model, by name or index."""


class Shot(model_with_keys("_Rigs", _ModelCamera, rig_fields(), None)):
    """A rig for a stretch of time."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": [rig]} for rig in RIGS]})

    until: Omittable[
        Annotated[
            Annotated[Positive, Tag(NUMBER)] | Annotated[Event, Tag(MAPPING)],
            by_type("a time [s] or {when, nth, offset, else}", NUMBER, MAPPING),
        ]
    ] = None
    """When the shot ends: a time of the simulation [s], or an event."""
    duration: Omittable[Positive] = None
    """How long the shot lasts [s] of the simulation, instead of until."""
    speed: Omittable[Positive] = None
    """Simulated seconds per second of video: 0.5 is slow motion."""
    blend: Omittable[
        Annotated[
            Annotated[Shape, Tag(TEXT)] | Annotated[Positive, Tag(NUMBER)] | Annotated[Blend, Tag(MAPPING)],
            by_type("a shape, a width [s] or {shape, width}", TEXT, NUMBER, MAPPING),
        ]
    ] = None
    """How the shot before becomes this one: a shape, a width [s], or both; a cut if left out."""
    roll: NumberOrRamp = 0.0
    """Turn around the axis of view [deg], clockwise."""
    fovy: Omittable[PositiveNumberOrRamp] = None
    """Vertical field of view [deg], what is seen [m] if orthographic; the model's if left out."""
    shake: Omittable[Annotated[Shake, BeforeValidator(empty_if_null, json_schema_input_type=Shake | None)]] = None
    """The trembling of a hand that holds the camera."""
    fit: Omittable[
        Annotated[
            Annotated[Name, Tag(TEXT)] | Annotated[Fit, Tag(MAPPING)],
            by_type("an object's name or {target, margin}", TEXT, MAPPING),
        ]
    ] = None
    """Keeps an object whole in the image, by the distance."""

    @classmethod
    def cross_field_errors(cls, values: Mapping[str, object]) -> Iterator[tuple[Location, str]]:
        rigs = [key for key in values if key in RIGS]
        mistyped = any(near(key, RIGS) for key in {*values} - {*cls.key_names()})
        if not rigs and not mistyped:
            yield (), f"expected one of {', '.join(RIGS)}, got none"
        yield from (((rig,), f"a shot has one rig, and this one has {rigs[0]} already") for rig in rigs[1:])

    def shot(self, speed: float | None) -> script.Shot:
        """The shot, at a speed if it says none."""
        speed = speed if self.speed is None else self.speed
        return script.Shot(
            rig=self._rig(),
            until=self.until.event() if isinstance(self.until, Event) else _exact(self.until),
            lasting=_exact(self.duration),
            speed=_exact(speed),
            blend=_blend(self.blend),
            roll=ramp(self.roll),
            fovy=optional_ramp(self.fovy),
            shake=_shake(self.shake),
            fit=_fit(self.fit),
        )

    def _rig(self) -> Rig:
        for _, value in self:
            if isinstance(value, DeclaredModel) and isinstance(rig := value.value(), Rig):
                return rig
        return ModelRig(str(self.camera))


class CameraDocument(DocumentModel):
    """What a camera does in a video: shots, one after the other."""

    speed: Omittable[Positive] = None
    """Simulated seconds per second of video, of all shots that do not say their own: 0.5 is slow motion."""
    shots: list[Shot] = Field(min_length=1)
    """The shots in order; all but the last say when they end, by until or duration."""

    @classmethod
    def cross_field_errors(cls, values: Mapping[str, object]) -> Iterator[tuple[Location, str]]:
        shots = mappings_in(values.get("shots"))
        if shots:
            yield from script.shot_conflicts(shots)

    def script(self, name: str) -> script.CameraScript:
        """The script, under a name."""
        return script.CameraScript(name, [shot.shot(self.speed) for shot in self.shots])


def read_camera(path: pathlib.Path | str) -> script.CameraScript:
    """The camera document at `path`; the script is called as the file is, less its suffix.

    Raises:
      DocumentError: with everything that is wrong in it, line by line.
      FileError: it is not there, or cannot be read.
    """
    return read(path, CameraDocument).script(pathlib.Path(path).stem)


def _exact(value: float | None) -> Fraction | None:
    return None if value is None else rational(value)


def _blend(written: str | float | Blend | None) -> easing.Blend | None:
    if isinstance(written, Blend):
        return easing.Blend(written.shape, written.width)
    if isinstance(written, str):
        return easing.Blend(shape=written)
    return None if written is None else easing.Blend(width=written)


def _shake(written: Shake | None) -> shake.Shake | None:
    return None if written is None else shake.Shake(written.angle, written.frequency, written.seed)


def _fit(written: str | Fit | None) -> script.Fit | None:
    if isinstance(written, Fit):
        return script.Fit(written.target, written.margin)
    return None if written is None else script.Fit(written)
