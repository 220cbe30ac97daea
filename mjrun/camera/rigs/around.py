"""MuJoCo's free camera around a point or an object: free, orbiting or tracking."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import mujoco
import numpy as np

from mjrun.camera.easing import EASINGS, Ramp
from mjrun.camera.pose import Frustum, Pose, around, turn
from mjrun.camera.rigs.rig import ModelCameras, Rig, ShotTime
from mjrun.camera.rigs.settings import ErrorPath, Setting
from mjrun.camera.targets import Place, Target, Vector, find_target
from mjrun.errors import concerning

DISTANCE = Setting(
    "ramp",
    "How far away the camera is [m]; as MuJoCo's free camera if left out.",
    positive=True,
    unit="metres",
)
DIRECTION = "Where the camera looks, counter-clockwise from above [deg]"
AZIMUTH = Setting("ramp", f"{DIRECTION}: 0 along x, 90 along y.")
ELEVATION = Setting("ramp", "How far the camera looks up [deg]: -90 looks straight down.")
LOOKAT = Setting(
    "place", "What is looked at: an object, as in box, geom:edge, site:tip or subtree:torso, or a point [m]."
)
HEADING = Setting(
    "flag",
    "Whether the azimuth turns with the object, as that of a chase camera; 0 looks along the object's own x then.",
)
OFFSET = Setting(
    "point",
    "Of the point that is looked at from the target [m], in the world; turned with the object if heading is true.",
)


@dataclass(frozen=True)
class FreeRig(Rig):
    """MuJoCo's free camera, around a point or an object."""

    kind: ClassVar[str] = "free"
    help: ClassVar[str] = "MuJoCo's free camera."
    argument: ClassVar[str] = "free"

    lookat: Annotated[Place | None, LOOKAT] = None
    distance: Annotated[Ramp | None, DISTANCE] = None
    azimuth: Annotated[Ramp | None, AZIMUTH] = None
    elevation: Annotated[Ramp | None, ELEVATION] = None

    def bind(self, cameras: ModelCameras, where: str) -> "BoundAroundRig":
        self.check(where)
        azimuth = self.azimuth or Ramp.still(cameras.free.azimuth)
        return _bound("lookat", self.lookat, self.distance, azimuth, self.elevation, cameras)


@dataclass(frozen=True)
class OrbitRig(Rig):
    """Around a point or an object: once, or from one azimuth to another."""

    kind: ClassVar[str] = "orbit"
    help: ClassVar[str] = "Around a point or an object."
    argument: ClassVar[str] = "orbit:…"
    eased: ClassVar[bool] = True

    lookat: Annotated[Place | None, LOOKAT] = None
    distance: Annotated[Ramp | None, DISTANCE] = None
    azimuth: Annotated[Ramp | None, Setting("ramp", f"{DIRECTION}; once round if left out.")] = None
    elevation: Annotated[Ramp | None, ELEVATION] = None
    ease: Annotated[
        str, Setting("choice", "How it goes once round; an azimuth has an ease of its own.", choices=tuple(EASINGS))
    ] = "linear"

    def bind(self, cameras: ModelCameras, where: str) -> "BoundAroundRig":
        self.check(where)
        start = cameras.free.azimuth
        azimuth = self.azimuth or Ramp(start, start + 360, self.ease)
        return _bound("lookat", self.lookat, self.distance, azimuth, self.elevation, cameras)

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[ErrorPath, str]]:
        if "ease" in values and "azimuth" in values:
            yield ("ease",), "set the ease within azimuth: {from, to, ease}"


@dataclass(frozen=True)
class TrackRig(Rig):
    """Goes with an object."""

    kind: ClassVar[str] = "track"
    help: ClassVar[str] = "With an object."
    argument: ClassVar[str] = "track:BODY"
    eased: ClassVar[bool] = True

    target: Annotated[str, Setting("object", "The object: box, geom:edge, site:tip or subtree:torso.")]
    distance: Annotated[Ramp | None, DISTANCE] = None
    azimuth: Annotated[Ramp | None, AZIMUTH] = None
    elevation: Annotated[Ramp | None, ELEVATION] = None
    heading: Annotated[bool, HEADING] = False
    offset: Annotated[Vector, OFFSET] = (0.0, 0.0, 0.0)

    def bind(self, cameras: ModelCameras, where: str) -> "BoundAroundRig":
        self.check(where)
        azimuth = self.azimuth or Ramp.still(cameras.free.azimuth)
        return _bound("target", self.target, self.distance, azimuth, self.elevation, cameras, self.heading, self.offset)


@dataclass(frozen=True)
class BoundAroundRig:
    """MuJoCo's free camera around something.

    Attributes:
      heading: whether azimuth and offset turn with the target.
      offset: of the point that is looked at from the target `(3,)` [m].
    """

    target: Target
    distance: Ramp
    azimuth: Ramp
    elevation: Ramp
    frustum: Frustum
    heading: bool
    offset: np.ndarray

    def pose(self, data: mujoco.MjData, at: ShotTime) -> Pose:
        yaw = self.target.yaw(data) if self.heading else 0.0
        distance, azimuth, elevation = (ramp.at(at.phase) for ramp in (self.distance, self.azimuth, self.elevation))
        lookat = self.target.position(data) + turn(2, yaw) @ self.offset
        return around(lookat, distance, azimuth + yaw, elevation, self.frustum)


def _bound(
    key: str,
    place: Place | None,
    distance: Ramp | None,
    azimuth: Ramp,
    elevation: Ramp | None,
    cameras: ModelCameras,
    heading: bool = False,
    offset: Vector = (0.0, 0.0, 0.0),
) -> BoundAroundRig:
    """Around the place that the setting `key` names; what is None is as MuJoCo's free camera has it."""
    free = cameras.free
    x, y, z = map(float, free.lookat)
    with concerning(key):
        target = find_target((x, y, z) if place is None else place, cameras.model)
    return BoundAroundRig(
        target,
        distance or Ramp.still(free.distance),
        azimuth,
        elevation or Ramp.still(free.elevation),
        cameras.frustum,
        heading,
        np.array(offset),
    )
