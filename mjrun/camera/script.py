"""Camera scripts as plain values: shots in time, each with a rig. Names are not looked up in a model yet."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from mjrun.camera.easing import Blend, Ramp
from mjrun.camera.rigs.rig import Rig
from mjrun.camera.shake import Shake


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
