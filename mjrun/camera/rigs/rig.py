"""The interface of rigs: settings, which are bound to a model and then give the camera's pose at any time of a shot."""

from abc import ABC, abstractmethod
from typing import ClassVar, Protocol

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, Frustum, heading, pose_of, rotation
from mjrun.dataclass import dataclass
from mjrun.errors import UsageError
from mjrun.options.kinds import AnyKind
from mjrun.options.option import Options, options_of
from mjrun.options.structured_kinds import OptionsMappingKind

SAME_POINT = 1e-9  # [m], distance from the camera below which it coincides with its target


@dataclass(frozen=True)
class ShotTime:
    """A time within a shot.

    Attributes:
      time: simulated time [s].
      elapsed: time since the shot began [s], from 0 to its duration.
      phase: share of the shot, from 0 to 1.
    """

    time: float
    elapsed: float
    phase: float


class BoundRig(Protocol):
    """A rig whose objects are resolved in a model."""

    @property
    def frustum(self) -> Frustum:
        """The view of the camera, unless the shot sets a field of view."""
        ...

    def pose(self, data: mujoco.MjData, at: ShotTime) -> CameraPose:
        """Returns the pose at an instant, whose positions `data` holds.

        Raises:
          UsageError: the camera coincides with the point that it looks at.
        """
        ...


class MujocoCameras:
    """MuJoCo's own cameras for a model: its free camera, and the pose of any camera as MuJoCo computes it.

    Args:
      is_framed: whether the default camera frames the model closely, instead of being MuJoCo's free camera.

    Attributes:
      data: the model's initial state, with positions computed.
      free: MuJoCo's free camera.
      frustum: the view of the free camera.
    """

    def __init__(self, model: mujoco.MjModel, *, is_framed: bool = False) -> None:
        self.model, self.data, self.free = model, mujoco.MjData(model), mujoco.MjvCamera()
        self.is_framed = is_framed
        compute_positions(model, self.data)
        mujoco.mjv_defaultFreeCamera(model, self.free)
        self._scene = mujoco.MjvScene(model, 1)
        self.frustum = self.pose(self.data, self.free).frustum

    def pose(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> CameraPose:
        """Returns the pose of `camera` as MuJoCo computes it, in float32."""
        mujoco.mjv_updateCamera(self.model, data, camera, self._scene)
        return pose_of(self._scene)


def compute_positions(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Computes the positions of everything that a camera can follow or be attached to."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)


class Rig(Options, ABC):
    """The movement of a camera. Its settings have the same keys in documents and on the command line.

    The command line supports the rigs that have an example in `RIG_EXAMPLES`.

    Attributes:
      kind: name in documents and on the command line.
      help: a few words for a list of rigs.
      eased: whether the command line accepts an `ease` for all its ramps.
    """

    kind: ClassVar[str]
    help: ClassVar[str]
    eased: ClassVar[bool] = False

    @abstractmethod
    def bind(self, cameras: MujocoCameras, where: str) -> BoundRig:
        """Resolves the objects of the rig in a model.

        Args:
          where: the name of the shot in errors.

        Raises:
          UnknownNameError: an object is unknown; the message lists the valid ones.
          UsageError: settings contradict each other in this model.
        """

    @classmethod
    def form(cls) -> AnyKind:
        """Returns the kind of the values that documents write for this rig."""
        blank = not any(each.is_required for each in options_of(cls))
        return OptionsMappingKind(cls, cls, name=cls.__name__.removesuffix("Rig"), blank=blank)


def looking_at(eye: np.ndarray, target: np.ndarray, frustum: Frustum, where: str, at: ShotTime) -> CameraPose:
    """Returns an upright pose at `eye` `(3,)` [m] that looks at `target` `(3,)` [m].

    Raises:
      UsageError: both are the same point; the message names the time.
    """
    distance = float(np.linalg.norm(target - eye))
    if distance < SAME_POINT:
        raise UsageError(f"{where}: at {at.time:.9g} s the camera coincides with the point that it looks at")
    return CameraPose(eye, rotation(*heading(target - eye)), frustum, distance)
