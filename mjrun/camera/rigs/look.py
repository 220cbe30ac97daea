"""A camera at one place that looks at another."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import mujoco

from mjrun.camera.pose import Frustum, Pose
from mjrun.camera.rigs.rig import ModelCameras, Rig, ShotTime, looking_at
from mjrun.camera.rigs.settings import Setting
from mjrun.camera.targets import Place, Target, find_target
from mjrun.errors import UsageError, concerning


@dataclass(frozen=True)
class LookRig(Rig):
    """From one place at another, upright; each stands still or moves."""

    kind: ClassVar[str] = "look"
    help: ClassVar[str] = "From one place at another."
    argument: ClassVar[str] = "look:from=PLACE,at=PLACE"

    eye: Annotated[Place, Setting("place", "Where the camera is: an object, or a point [m].", key="from")]
    target: Annotated[Place, Setting("place", "What is looked at: an object, or a point [m].", key="at")]

    def bind(self, cameras: ModelCameras, where: str) -> "BoundLookRig":
        if self.eye == self.target:
            raise UsageError(f"{where}: the camera cannot look at where it is")
        with concerning("from"):
            eye = find_target(self.eye, cameras.model)
        with concerning("at"):
            target = find_target(self.target, cameras.model)
        return BoundLookRig(eye, target, cameras.frustum, where)


@dataclass(frozen=True)
class BoundLookRig:
    """From one place at another, upright."""

    eye: Target
    target: Target
    frustum: Frustum
    where: str

    def pose(self, data: mujoco.MjData, at: ShotTime) -> Pose:
        return looking_at(self.eye.position(data), self.target.position(data), self.frustum, self.where, at)
