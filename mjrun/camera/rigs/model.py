"""A camera that is declared in the model."""

from typing import ClassVar

import mujoco

from mjrun.camera.pose import CameraPose
from mjrun.camera.rigs.rig import MujocoCameras, Rig, ShotTime
from mjrun.model.names import identify
from mjrun.options.kinds import AnyKind, Kind, NameOrIndexKind, ReadingContext
from mjrun.options.option import positional_options, required
from mjrun.options.schema_validation import Schema

_KEY = NameOrIndexKind(expected="the name or index of a camera")


@positional_options
class ModelRig(Rig):
    """A camera of the model."""

    kind: ClassVar[str] = "camera"
    help: ClassVar[str] = "A camera of the model, by name or index."

    camera: str = required(converter=_KEY, help="The name or index of the camera.")

    def bind(self, cameras: MujocoCameras, where: str) -> "BoundModelRig":
        return BoundModelRig(cameras, identify(cameras.model, "camera", self.camera))

    @classmethod
    def form(cls) -> AnyKind:
        return _CameraForm()


class _CameraForm(Kind[ModelRig, ModelRig]):
    """A camera of the model, as documents write it: by name or index alone."""

    def schema(self, reader: ReadingContext, definitions: dict[str, Schema]) -> Schema:
        return _KEY.form

    def read(self, value: object, reader: ReadingContext) -> object:
        return ModelRig(str(_KEY.read(value, reader)))

    def plain(self, value: ModelRig) -> object:
        return value.camera


class BoundModelRig:
    """A camera of the model. Its distance reaches to the point of its axis that is nearest to the model's centre."""

    def __init__(self, cameras: MujocoCameras, camera: int) -> None:
        self._cameras, self._camera = cameras, mujoco.MjvCamera()
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, camera
        self.frustum = cameras.pose(cameras.data, self._camera).frustum

    def pose(self, data: mujoco.MjData, at: ShotTime) -> CameraPose:
        pose, statistic = self._cameras.pose(data, self._camera), self._cameras.model.stat
        distance = max(float(pose.forward @ (statistic.center - pose.position)), 0.1 * statistic.extent)
        return CameraPose(pose.position, pose.rotation, pose.frustum, distance)
