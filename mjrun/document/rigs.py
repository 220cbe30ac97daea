"""The rigs of a camera document: what each may say, and what it is to the camera."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, Tag

from mjrun.camera import script
from mjrun.camera.easing import EASINGS
from mjrun.document.document_model import (
    LIST,
    MAPPING,
    NUMBER,
    TEXT,
    Among,
    Form,
    Loc,
    Maybe,
    Name,
    Positive,
    Vector,
    given_nothing,
    kinds,
)

Ease = Annotated[str, Among(tuple(EASINGS))]
Place = Annotated[
    Annotated[Name, Tag(TEXT)] | Annotated[Vector, Tag(LIST)],
    kinds("an object's name or a point [x, y, z]", TEXT, LIST),
]
SLIDING = "a number or {from, to, ease}"


class Slide(Form):
    """A number that changes over the shot."""

    start: float = Field(alias="from")
    """At the beginning of the shot."""
    end: float = Field(alias="to")
    """At the end of the shot."""
    ease: Ease = "linear"
    """How it goes from one to the other."""


class PositiveSlide(Slide):
    """A positive number that changes over the shot."""

    start: Positive = Field(alias="from")
    """At the beginning of the shot."""
    end: Positive = Field(alias="to")
    """At the end of the shot."""


Sliding = Annotated[Annotated[float, Tag(NUMBER)] | Annotated[Slide, Tag(MAPPING)], kinds(SLIDING, NUMBER, MAPPING)]
PositiveSliding = Annotated[
    Annotated[Positive, Tag(NUMBER)] | Annotated[PositiveSlide, Tag(MAPPING)], kinds(SLIDING, NUMBER, MAPPING)
]


def ramp(given: float | Slide) -> script.Ramp:
    """A number that slides or stands still."""
    if isinstance(given, Slide):
        return script.Ramp(given.start, given.end, given.ease)
    return script.Ramp.still(given)


def maybe_ramp(given: float | Slide | None) -> script.Ramp | None:
    """The same of one that may be left out."""
    return None if given is None else ramp(given)


class Around(Form):
    """What the free, orbiting and tracking rigs have in common."""

    distance: Maybe[PositiveSliding] = None
    """How far away the camera is [m]; as MuJoCo's free camera if left out."""
    azimuth: Maybe[Sliding] = None
    """Where the camera looks, counter-clockwise from above [deg]: 0 along x, 90 along y."""
    elevation: Maybe[Sliding] = None
    """How far the camera looks up [deg]: -90 looks straight down."""

    def around(self, target: script.Place | None, **settings: Any) -> script.AroundRig:
        """The rig around `target`; None: what MuJoCo's free camera looks at."""
        distance, azimuth, elevation = map(maybe_ramp, (self.distance, self.azimuth, self.elevation))
        return script.AroundRig(target, distance, azimuth, elevation, **settings)


class Aimed(Form):
    """What looks at something."""

    lookat: Maybe[Place] = None
    """What is looked at: an object, as in box, geom:edge, site:tip or subtree:torso, or a point [m]."""


class Free(Around, Aimed):
    """MuJoCo's free camera, around a point or an object."""

    def rig(self) -> script.AroundRig:
        """The rig."""
        return self.around(self.lookat)


class Orbit(Free):
    """Around a point or an object: once, or from one azimuth to another."""

    azimuth: Maybe[Sliding] = None
    """Where the camera looks, counter-clockwise from above [deg]; once round if left out."""
    ease: Ease = "linear"
    """How it goes once round; an azimuth has an ease of its own."""

    @classmethod
    def complaints(cls, given: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
        if "ease" in given and "azimuth" in given:
            yield ("ease",), "the ease belongs into the azimuth: {from, to, ease}"

    def rig(self) -> script.AroundRig:
        """Without an azimuth the camera turns once."""
        return self.around(self.lookat, turn=self.ease if self.azimuth is None else None)


class Track(Around):
    """Goes with an object."""

    target: Name
    """The object: box, geom:edge, site:tip or subtree:torso."""
    heading: bool = False
    """Whether the azimuth turns with the object, as that of a chase camera; 0 looks along the object's own x then."""
    offset: Vector = (0.0, 0.0, 0.0)
    """Of the point that is looked at from the target [m], in the world; turned with the object if heading is true."""

    def rig(self) -> script.AroundRig:
        """The rig."""
        return self.around(self.target, heading=self.heading, offset=self.offset)


class Look(Form):
    """From one place at another, upright; each stands still or moves."""

    eye: Place = Field(alias="from")
    """Where the camera is: an object, or a point [m]."""
    target: Place = Field(alias="at")
    """What is looked at: an object, or a point [m]."""

    def rig(self) -> script.LookRig:
        """The rig."""
        return script.LookRig(self.eye, self.target)


class Waypoint(Form):
    """A point on the camera's path: an eye, or distance, azimuth and elevation around what is looked at."""

    eye: Maybe[Vector] = None
    """Where the camera is [m]."""
    distance: Maybe[Positive] = None
    """How far from what is looked at [m]."""
    azimuth: Maybe[float] = None
    """Where the camera looks, counter-clockwise from above [deg]."""
    elevation: Maybe[float] = None
    """How far the camera looks up [deg]."""
    lookat: Maybe[Place] = None
    """What is looked at from here: an object, or a point [m]; what the path looks at if left out."""
    at: Maybe[Annotated[float, Field(ge=0)]] = None
    """When the camera is here [s], from the beginning of the shot; only with pace: time."""

    @classmethod
    def complaints(cls, given: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
        around = ("distance", "azimuth", "elevation")
        found = [key for key in around if key in given]
        if "eye" in given:
            yield from (((key,), f"an eye has no {key} beside it") for key in found)
        elif len(found) < len(around):
            yield (), f"expected eye, or distance, azimuth and elevation, got {' and '.join(found) or 'none of them'}"

    def point(self) -> script.Waypoint:
        """The waypoint."""
        return script.Waypoint(self.eye, self.distance, self.azimuth, self.elevation, self.lookat, self.at)


class Path(Form):
    """Along a path through waypoints."""

    waypoints: list[Waypoint] = Field(min_length=2)
    """The points, in order; all by eye, or all by distance, azimuth and elevation."""
    lookat: Maybe[Place] = None
    """What is looked at on the way: an object, or a point [m]; where the path leads if left out."""
    curve: Literal["spline", "linear"] = "spline"
    """What is between waypoints: a smooth curve, or straight lines."""
    pace: Literal["constant", "time"] = "constant"
    """Constant speed along the path, or by the times of the waypoints."""
    ease: Ease = "linear"
    """How the camera starts and stops; with pace: constant only."""

    @classmethod
    def complaints(cls, given: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
        timed = given.get("pace") == "time"
        if timed and "ease" in given:
            yield ("ease",), "ease is for pace: constant; with pace: time the waypoints' times say it all"
        points = given.get("waypoints")
        points = points if isinstance(points, list) and all(isinstance(p, dict) for p in points) else []
        yield from _mixed(points, "lookat" in given)
        for i, point in enumerate(points):
            if ("at" in point) != timed:
                where: Loc = ("waypoints", i) if timed else ("waypoints", i, "at")
                yield where, "with pace: time each waypoint needs its at [s]" if timed else "at needs pace: time"
        yield from _disordered(points if timed else [])

    def rig(self) -> script.PathRig:
        """The rig."""
        points = [waypoint.point() for waypoint in self.waypoints]
        return script.PathRig(points, self.lookat, self.curve, self.pace, self.ease)


def _mixed(points: list[dict[str, Any]], looking: bool) -> Iterator[tuple[Loc, str]]:
    """What waypoints of one path have to have in common."""
    for i, point in enumerate(points):
        if ("eye" in point) != ("eye" in points[0]) and {"eye", "distance"} & point.keys():
            yield ("waypoints", i), "waypoints are all given by eye, or all by distance, azimuth and elevation"
    needed = any("lookat" in point or "distance" in point for point in points)
    for i, point in enumerate(points):
        if needed and not looking and "lookat" not in point:
            yield ("waypoints", i), "what is looked at from here? give it a lookat, or the path"


def _disordered(points: list[dict[str, Any]]) -> Iterator[tuple[Loc, str]]:
    latest = -1.0
    for i, point in enumerate(points):
        time = point.get("at")
        if isinstance(time, int | float):
            if time <= latest:
                yield ("waypoints", i, "at"), f"expected a time later than {latest:g}, that of the waypoint before"
            latest = max(latest, time)


FreeOrEmpty = Annotated[Free, BeforeValidator(given_nothing, json_schema_input_type=Free | None)]
OrbitOrEmpty = Annotated[Orbit, BeforeValidator(given_nothing, json_schema_input_type=Orbit | None)]
