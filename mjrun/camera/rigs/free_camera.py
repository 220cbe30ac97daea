"""MuJoCo's free camera around a point or an object: free, orbiting or tracking."""

from collections.abc import Iterator, Mapping
from typing import ClassVar

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, Frustum, around, turn
from mjrun.camera.rigs.rig import (
    EASINGS,
    EasedNumber,
    MujocoCameras,
    ObjectNameKind,
    ObjectOrPointKind,
    RampKind,
    Rig,
    ShotTime,
)
from mjrun.camera.targets import BoundObjectOrPoint, ObjectOrPoint, Vector, find_target
from mjrun.dataclass import dataclass
from mjrun.errors import concerning
from mjrun.options.kinds import ChoiceKind, FlagKind, optional
from mjrun.options.number_kinds import PointKind
from mjrun.options.option import option, positional_options, required
from mjrun.options.schema_validation import Path

DISTANCE = "Distance of the camera [m]; MuJoCo's free camera's if left out."
DIRECTION = "Direction of view, counter-clockwise from above [deg]"
AZIMUTH = f"{DIRECTION}: 0 along x, 90 along y."
ELEVATION = "Upward angle of the view [deg]: -90 looks straight down."
LOOKAT = "Point to look at: an object, as in box, geom:edge, site:tip or subtree:torso, or a point [m]."


@positional_options
class FreeRig(Rig):
    """MuJoCo's free camera, around a point or an object."""

    kind: ClassVar[str] = "free"
    help: ClassVar[str] = "MuJoCo's free camera."

    lookat: ObjectOrPoint | None = option(converter=optional(ObjectOrPointKind()), default=None, help=LOOKAT)
    distance: EasedNumber | None = option(
        converter=optional(RampKind("metres", positive=True)), default=None, help=DISTANCE
    )
    azimuth: EasedNumber | None = option(converter=optional(RampKind("degrees")), default=None, help=AZIMUTH)
    elevation: EasedNumber | None = option(converter=optional(RampKind("degrees")), default=None, help=ELEVATION)

    def bind(self, cameras: MujocoCameras, where: str) -> "BoundAroundRig":
        azimuth = self.azimuth or EasedNumber.still(cameras.free.azimuth)
        return _bound("lookat", self.lookat, self.distance, azimuth, self.elevation, cameras)


@positional_options
class OrbitRig(Rig):
    """A camera around a point or an object: in a full circle, or from one azimuth to another."""

    kind: ClassVar[str] = "orbit"
    help: ClassVar[str] = "Around a point or an object."
    eased: ClassVar[bool] = True

    lookat: ObjectOrPoint | None = option(converter=optional(ObjectOrPointKind()), default=None, help=LOOKAT)
    distance: EasedNumber | None = option(
        converter=optional(RampKind("metres", positive=True)), default=None, help=DISTANCE
    )
    azimuth: EasedNumber | None = option(
        converter=optional(RampKind("degrees")), default=None, help=f"{DIRECTION}; a full circle if left out."
    )
    elevation: EasedNumber | None = option(converter=optional(RampKind("degrees")), default=None, help=ELEVATION)
    ease: str = option(
        converter=ChoiceKind((*EASINGS,)),
        default="linear",
        help="Easing of the full circle; an azimuth has a separate ease.",
    )

    def bind(self, cameras: MujocoCameras, where: str) -> "BoundAroundRig":
        start = cameras.free.azimuth
        azimuth = self.azimuth or EasedNumber(start, start + 360, self.ease)
        return _bound("lookat", self.lookat, self.distance, azimuth, self.elevation, cameras)

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        if "ease" in values and "azimuth" in values:
            yield ("ease",), "set the ease within azimuth: {from, to, ease}"


@positional_options
class TrackRig(Rig):
    """A camera that follows an object."""

    kind: ClassVar[str] = "track"
    help: ClassVar[str] = "Following an object."
    eased: ClassVar[bool] = True

    target: str = required(converter=ObjectNameKind(), help="The object: box, geom:edge, site:tip or subtree:torso.")
    distance: EasedNumber | None = option(
        converter=optional(RampKind("metres", positive=True)), default=None, help=DISTANCE
    )
    azimuth: EasedNumber | None = option(converter=optional(RampKind("degrees")), default=None, help=AZIMUTH)
    elevation: EasedNumber | None = option(converter=optional(RampKind("degrees")), default=None, help=ELEVATION)
    heading: bool = option(
        converter=FlagKind(),
        default=False,
        help="Whether the azimuth turns with the object, as with a chase camera; 0 then looks along the object's "
        "x axis.",
    )
    offset: Vector = option(
        converter=PointKind(),
        default=(0.0, 0.0, 0.0),
        help="Offset of the focus from the target [m], in world axes; turned with the object if heading is true.",
    )

    def bind(self, cameras: MujocoCameras, where: str) -> "BoundAroundRig":
        azimuth = self.azimuth or EasedNumber.still(cameras.free.azimuth)
        return _bound("target", self.target, self.distance, azimuth, self.elevation, cameras, self.heading, self.offset)


@dataclass(frozen=True)
class BoundAroundRig:
    """MuJoCo's free camera around a resolved target.

    Attributes:
      heading: whether azimuth and offset turn with the target.
      offset: offset of the focus from the target `(3,)` [m].
    """

    target: BoundObjectOrPoint
    distance: EasedNumber
    azimuth: EasedNumber
    elevation: EasedNumber
    frustum: Frustum
    heading: bool
    offset: np.ndarray

    def pose(self, data: mujoco.MjData, at: ShotTime) -> CameraPose:
        yaw = self.target.yaw(data) if self.heading else 0.0
        distance, azimuth, elevation = (ramp.at(at.phase) for ramp in (self.distance, self.azimuth, self.elevation))
        lookat = self.target.position(data) + turn(2, yaw) @ self.offset
        return around(lookat, distance, azimuth + yaw, elevation, self.frustum)


def _bound(
    key: str,
    place: ObjectOrPoint | None,
    distance: EasedNumber | None,
    azimuth: EasedNumber,
    elevation: EasedNumber | None,
    cameras: MujocoCameras,
    heading: bool = False,
    offset: Vector = (0.0, 0.0, 0.0),
) -> BoundAroundRig:
    """Binds a rig to the place in the setting `key`; None means the value of MuJoCo's free camera."""
    free = cameras.free
    x, y, z = map(float, free.lookat)
    with concerning(key):
        target = find_target((x, y, z) if place is None else place, cameras.model)
    return BoundAroundRig(
        target,
        distance or EasedNumber.still(free.distance),
        azimuth,
        elevation or EasedNumber.still(free.elevation),
        cameras.frustum,
        heading,
        np.array(offset),
    )
