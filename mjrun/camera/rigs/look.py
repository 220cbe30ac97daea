"""A camera at one place that looks at another."""

from collections.abc import Iterator, Mapping
from typing import ClassVar

import mujoco

from mjrun.camera.pose import CameraPose, Frustum
from mjrun.camera.rigs.rig import MujocoCameras, ObjectOrPointKind, Rig, ShotTime, looking_at
from mjrun.camera.targets import BoundObjectOrPoint, ObjectOrPoint, find_target
from mjrun.dataclass import dataclass
from mjrun.errors import concerning
from mjrun.options.option import positional_options, required
from mjrun.options.schema_validation import Path


@positional_options
class LookRig(Rig):
    """A camera at one place that looks at another, upright; each is fixed or moves."""

    kind: ClassVar[str] = "look"
    help: ClassVar[str] = "From one place at another."

    eye: ObjectOrPoint = required(
        converter=ObjectOrPointKind(), key="from", help="Position of the camera: an object, or a point [m]."
    )
    target: ObjectOrPoint = required(
        converter=ObjectOrPointKind(), key="at", help="Point to look at: an object, or a point [m]."
    )

    def bind(self, cameras: MujocoCameras, where: str) -> "BoundLookRig":
        with concerning("from"):
            eye = find_target(self.eye, cameras.model)
        with concerning("at"):
            target = find_target(self.target, cameras.model)
        return BoundLookRig(eye, target, cameras.frustum, where)

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        if "from" in values and values["from"] == values.get("at"):
            yield ("at",), "the camera cannot look at its own position"


@dataclass(frozen=True)
class BoundLookRig:
    """A camera at one place that looks at another, upright, with resolved places."""

    eye: BoundObjectOrPoint
    target: BoundObjectOrPoint
    frustum: Frustum
    where: str

    def pose(self, data: mujoco.MjData, at: ShotTime) -> CameraPose:
        return looking_at(self.eye.position(data), self.target.position(data), self.frustum, self.where, at)
