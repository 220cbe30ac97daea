"""Camera scripts as plain values: shots in time, each with a rig. Names are not looked up in a model yet."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from mjrun.camera.easing import Blend, Ramp
from mjrun.camera.rigs.rig import Rig, located
from mjrun.camera.rigs.settings import ErrorPath
from mjrun.camera.shake import Shake
from mjrun.errors import UsageError, clean, concerning
from mjrun.timeline import rational


@dataclass(frozen=True)
class Fit:
    """Keeps an object and all its descendants inside the image, by the distance of the camera.

    Attributes:
      target: a body, geom or site.
      margin: the size of the image relative to the object, from 1 on.
    """

    target: str
    margin: float = 1.2


@dataclass(frozen=True)
class Event:
    """An event in a simulation: the instant at which a condition begins to hold.

    Attributes:
      when: the condition, such as `speed(box) > 0.02`.
      nth: which of its occurrences, from 1 on.
      offset: how much later [s], or earlier if negative.
      otherwise: the time if it never occurs [s], or the `end`; when None, that is an error.
    """

    when: str
    nth: int = 1
    offset: Fraction = Fraction(0)
    otherwise: Fraction | str | None = None


LEVEL = Ramp.still(0.0)


@dataclass(frozen=True)
class Shot:
    """A rig for a stretch of time.

    Attributes:
      until: when it ends: a time [s] of the simulation or an event; None with `lasting` or at the end.
      lasting: how long it lasts instead [s], in the simulation.
      speed: simulated seconds per second of video; the video's own when None.
      blend: the transition from the shot before; a cut when None.
      roll: rotation around the axis of view [deg], clockwise.
      fovy: vertical field of view [deg]; the model's when None.
    """

    rig: Rig
    until: Fraction | Event | None = None
    lasting: Fraction | None = None
    speed: Fraction | None = None
    blend: Blend | None = None
    roll: Ramp = LEVEL
    fovy: Ramp | None = None
    shake: Shake | None = None
    fit: Fit | None = None


@dataclass(frozen=True)
class CameraScript:
    """A sequence of shots, with a name for captions and files."""

    name: str
    shots: Sequence[Shot]

    def check(self) -> None:
        """Checks that the shots go together.

        Raises:
          UsageError: they do not.
        """
        shots: list[dict[str, object]] = []
        for shot in self.shots:
            values = {"until": shot.until, "duration": shot.lasting, "blend": shot.blend}
            shots.append({key: value for key, value in values.items() if value is not None})
        for path, message in shot_conflicts(shots):
            with concerning(*path):
                raise UsageError(f"{located(f'camera {clean(self.name)}', path)}: {message}")


def shot_conflicts(shots: Sequence[Mapping[str, object]]) -> Iterator[tuple[ErrorPath, str]]:
    """Yields what is wrong with the shots of a script, as far as no simulation is needed: where, and the sentence.

    Args:
      shots: the values of each by key, as they are written in a document, of any type.
    """
    if not shots:
        yield ("shots",), "at least one is needed"
    elif "blend" in shots[0]:
        yield ("shots", 0, "blend"), "there is no shot before the first to blend with"
    for i, shot in enumerate(shots):
        if "until" in shot and "duration" in shot:
            yield ("shots", i, "duration"), "a shot ends by until or after a duration, not both"
    for i, shot in enumerate(shots[:-1]):
        if "until" not in shot and "duration" not in shot:
            yield ("shots", i), "when does this shot end? all but the last say until or duration"
    yield from _disordered(shots)


def _disordered(shots: Sequence[Mapping[str, object]]) -> Iterator[tuple[ErrorPath, str]]:
    """Yields the shots that would end before they begin, as far as their times tell it."""
    begun = Fraction(0)  # at the earliest
    for i, shot in enumerate(shots):
        until, duration = _number(shot.get("until")), _number(shot.get("duration"))
        if 0 < until <= begun:
            yield ("shots", i, "until"), f"expected a time later than {float(begun):g}, when the shot begins"
        begun = max(begun + max(duration, Fraction(0)), until)


def _number(value: object) -> Fraction:
    """Returns a number exactly, and 0 for what is none."""
    if not isinstance(value, int | float | Fraction) or isinstance(value, bool):
        return Fraction(0)
    try:
        return rational(value)
    except (ValueError, OverflowError):  # it is not finite
        return Fraction(0)
