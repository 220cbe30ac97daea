"""What a camera is to do, as plain values: shots in time, each a rig. Names are not looked up yet."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

Vector = tuple[float, float, float]
Place = str | Vector  # an object, `box`, `geom:edge`, `site:tip`, `subtree:torso`, or a point [m]


@dataclass(frozen=True)
class Ramp:
    """A number that goes from `start` to `end` over a shot, by one of `ease.EASINGS`."""

    start: float
    end: float
    ease: str = "linear"

    @classmethod
    def still(cls, value: float) -> "Ramp":
        """One that does not move."""
        return cls(value, value)


@dataclass(frozen=True)
class ModelRig:
    """A camera of the model, by name or index."""

    camera: str


@dataclass(frozen=True)
class AroundRig:
    """MuJoCo's free camera around a point or an object: free, orbiting or tracking.

    Attributes:
      target: what is looked at; None: what MuJoCo's free camera looks at.
      distance: [m]; azimuth, elevation: [deg]; None: those of MuJoCo's free camera.
      heading: whether the azimuth turns with the object, as if seen by a chase camera.
      offset: of the point that is looked at from the target [m], in the world; turned with it if `heading`.
      turn: without an azimuth: once round by this ease, counter-clockwise from above, from that of MuJoCo's free
        camera.
    """

    target: Place | None = None
    distance: Ramp | None = None
    azimuth: Ramp | None = None
    elevation: Ramp | None = None
    heading: bool = False
    offset: Vector = (0.0, 0.0, 0.0)
    turn: str | None = None


@dataclass(frozen=True)
class LookRig:
    """Looks at `target` from `eye`, upright. Each stands still or moves."""

    eye: Place
    target: Place


@dataclass(frozen=True)
class Waypoint:
    """A point on a camera's path: `eye` [m], or `distance` [m], `azimuth` and `elevation` [deg] around `lookat`.

    Attributes:
      lookat: what is looked at from there; None: what the path looks at.
      at: when the camera is there [s], from the beginning of the shot; needed where the path is paced by time.
    """

    eye: Vector | None = None
    distance: float | None = None
    azimuth: float | None = None
    elevation: float | None = None
    lookat: Place | None = None
    at: float | None = None


@dataclass(frozen=True)
class PathRig:
    """A path through waypoints.

    Attributes:
      lookat: what is looked at on the way; None: where the path leads, unless waypoints say.
      curve: `spline` or `linear`.
      pace: `constant` speed along the path, or `time`, as the waypoints say.
      ease: of the way along the path, by one of `ease.EASINGS`; with constant pace only.
    """

    waypoints: Sequence[Waypoint]
    lookat: Place | None = None
    curve: str = "spline"
    pace: str = "constant"
    ease: str = "linear"


Rig = ModelRig | AroundRig | LookRig | PathRig


@dataclass(frozen=True)
class Shake:
    """A hand that trembles: smooth noise on the direction of view.

    Attributes:
      angle: standard deviation of each angle [deg].
      frequency: of the trembling [Hz], in time of the film.
    """

    angle: float = 0.3
    frequency: float = 2.0
    seed: int = 0


@dataclass(frozen=True)
class Fit:
    """Keeps an object, with all that hangs on it, whole in the picture, by the distance.

    Attributes:
      target: a body, geom or site.
      margin: how much larger than the object the picture is, from 1 on.
    """

    target: str
    margin: float = 1.2


@dataclass(frozen=True)
class Event:
    """Something that happens in a simulation: the instant when a condition begins to hold.

    Attributes:
      when: `speed(box) > 0.02`.
      nth: which time, from 1 on.
      offset: how much later [s], or earlier if negative.
      otherwise: what counts if it never happens: a time [s], or the `end`; an error if None.
    """

    when: str
    nth: int = 1
    offset: Fraction = Fraction(0)
    otherwise: Fraction | str | None = None


@dataclass(frozen=True)
class Blend:
    """How one shot becomes the next, by one of `ease.BLENDS`.

    Attributes:
      width: of the change [s]; of a sigmoid the time in which it changes from 1/2 to 1/(1+e).
    """

    shape: str = "cosine"
    width: float = 0.5


@dataclass(frozen=True)
class Shot:
    """A rig for a stretch of time.

    Attributes:
      until: when it ends: a time [s] of the simulation or an event; None with `lasting` or at the end.
      lasting: how long it lasts [s] of the simulation, instead.
      speed: simulated seconds per second of film; the film's own when None.
      blend: how the shot before becomes this one; a cut when None.
      roll: turn around the axis of view [deg], clockwise.
      fovy: vertical field of view [deg]; the model's when None.
    """

    rig: Rig
    until: Fraction | Event | None = None
    lasting: Fraction | None = None
    speed: Fraction | None = None
    blend: Blend | None = None
    roll: Ramp = Ramp(0.0, 0.0)
    fovy: Ramp | None = None
    shake: Shake | None = None
    fit: Fit | None = None


@dataclass(frozen=True)
class Script:
    """Shots, one after the other, under a name for captions and files."""

    name: str
    shots: Sequence[Shot]
