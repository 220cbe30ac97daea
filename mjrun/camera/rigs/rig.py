"""What every rig is: settings, which are bound to a model and then give the camera's pose at any time of a shot."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Protocol

import mujoco
import numpy as np

from mjrun.camera.curve import SAME_POINT
from mjrun.camera.pose import Frustum, Pose, heading, pose_of, rotation
from mjrun.errors import UsageError
from mjrun.options.kinds import AnyKind
from mjrun.options.option import Options, options_of
from mjrun.options.record import Record


@dataclass(frozen=True)
class ShotTime:
    """An instant of a shot.

    Attributes:
      time: simulated [s].
      elapsed: since the shot began [s], from 0 to its duration.
      phase: the same from 0 to 1.
    """

    time: float
    elapsed: float
    phase: float


class BoundRig(Protocol):
    """A rig whose objects have been found in a model."""

    @property
    def frustum(self) -> Frustum:
        """What the camera sees, unless the shot has a field of view of its own."""
        ...

    def pose(self, data: mujoco.MjData, at: ShotTime) -> Pose:
        """The pose at an instant, of which `data` holds the positions.

        Raises:
          UsageError: the camera is at the point that it looks at.
        """
        ...


class ModelCameras:
    """The cameras that MuJoCo itself has for a model.

    Attributes:
      data: the model's initial state, with positions computed.
      free: MuJoCo's free camera.
      frustum: what the free camera sees.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self.data, self.free = model, mujoco.MjData(model), mujoco.MjvCamera()
        compute_positions(model, self.data)
        mujoco.mjv_defaultFreeCamera(model, self.free)
        self._scene = mujoco.MjvScene(model, 1)
        self.frustum = self.pose(self.data, self.free).frustum

    def pose(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> Pose:
        """The pose of `camera` as MuJoCo computes it, in float32."""
        mujoco.mjv_updateCamera(self.model, data, camera, self._scene)
        return pose_of(self._scene)


def compute_positions(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Computes where everything is that a camera can follow or be attached to."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)


class Rig(Options, ABC):
    """How a view moves: options, the settings of which documents and the command line write as they are declared.

    Attributes:
      kind: its name in documents and on the command line.
      help: a few words about it, for a list of rigs.
      argument: how the command line writes it, in short; empty if it takes more than one word.
      eased: whether the command line has an `ease` for all its ramps.
    """

    kind: ClassVar[str]
    help: ClassVar[str]
    argument: ClassVar[str] = ""
    eased: ClassVar[bool] = False

    @abstractmethod
    def bind(self, cameras: ModelCameras, where: str) -> BoundRig:
        """The rig with its objects found in a model.

        Args:
          where: what errors call the shot.

        Raises:
          UnknownNameError: there is no such object; the message lists those that are.
          UsageError: settings do not go together in this model.
        """

    @classmethod
    def form(cls) -> AnyKind:
        """The kind of what documents write for such a rig."""
        blank = not any(each.is_required for each in options_of(cls))
        return Record(cls, cls, name=cls.__name__.removesuffix("Rig"), blank=blank)


def looking_at(eye: np.ndarray, target: np.ndarray, frustum: Frustum, where: str, at: ShotTime) -> Pose:
    """An upright pose at `eye` `(3,)` [m] that looks at `target` `(3,)` [m].

    Raises:
      UsageError: they are the same point; the message names the time.
    """
    distance = float(np.linalg.norm(target - eye))
    if distance < SAME_POINT:
        raise UsageError(f"{where}: at {at.time:.9g} s the camera is at the very point that it looks at")
    return Pose(eye, rotation(*heading(target - eye)), frustum, distance)
