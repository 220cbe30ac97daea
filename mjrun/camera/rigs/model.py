"""A camera that is declared in the model."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import mujoco

from mjrun.camera.pose import Pose
from mjrun.camera.rigs.rig import ModelCameras, Rig, ShotTime
from mjrun.camera.rigs.settings import Setting
from mjrun.model.names import identify


@dataclass(frozen=True)
class ModelRig(Rig):
    """A camera of the model."""

    kind: ClassVar[str] = "camera"
    help: ClassVar[str] = "A camera of the model, by name or index."

    camera: Annotated[str, Setting("object", "The name or index of the camera.")]

    def bind(self, cameras: ModelCameras, where: str) -> "BoundModelRig":
        return BoundModelRig(cameras, identify(cameras.model, "camera", self.camera))


class BoundModelRig:
    """A camera of the model. It looks as far as the point of its axis that is nearest to the model's centre."""

    def __init__(self, cameras: ModelCameras, camera: int) -> None:
        self._cameras, self._camera = cameras, mujoco.MjvCamera()
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, camera
        self.frustum = cameras.pose(cameras.data, self._camera).frustum

    def pose(self, data: mujoco.MjData, at: ShotTime) -> Pose:
        pose, statistic = self._cameras.pose(data, self._camera), self._cameras.model.stat
        distance = max(float(pose.forward @ (statistic.center - pose.position)), 0.1 * statistic.extent)
        return Pose(pose.position, pose.rotation, pose.frustum, distance)
