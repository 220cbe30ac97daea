"""What every rig is: settings, which are bound to a model and then give the camera's pose at any time of a shot."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol, cast

import mujoco
import numpy as np

from mjrun.camera.curve import SAME_POINT
from mjrun.camera.easing import EASINGS, Ramp
from mjrun.camera.pose import Frustum, Pose, heading, pose_of, rotation
from mjrun.camera.rigs.settings import declared_fields
from mjrun.errors import BadValueError, UnknownNameError, UsageError

ErrorPath = tuple[str | int, ...]


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


class Rig(ABC):
    """How a view moves. A rig is a frozen dataclass whose fields are declared as `settings` has it.

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
          BadValueError: a number is out of its range.
          UsageError: settings do not go together.
        """

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[ErrorPath, str]]:
        """What is wrong with the combination of values in a document: where, and the sentence.

        Args:
          values: by key, as they are written, of any type.
        """
        return iter(())

    def check(self, where: str) -> None:
        """Raises an error for the first setting whose value is not as its declaration says."""
        values = vars(self)
        for field in declared_fields(type(self)):
            value, setting = values[field.name], field.setting
            if isinstance(value, Ramp):
                low = 0.0 if setting.positive else -np.inf
                expected = f"a positive number of {setting.unit}" if setting.positive else "finite"
                check_ramp(value, f"{where}: {field.key}", low, expected=expected)
            elif setting.kind == "choice" and value not in setting.choices:
                raise UnknownNameError(field.key, str(value), list(setting.choices), where=where)


def mappings_in(value: object) -> list[dict[str, object]]:
    """The mappings of a list in a document; none if it holds anything else."""
    items = cast("list[object]", value) if isinstance(value, list) else []
    mappings = [cast("dict[str, object]", item) for item in items if isinstance(item, dict)]
    return mappings if len(mappings) == len(items) else []


def check_ramp(ramp: Ramp, where: str, low: float = -np.inf, high: float = np.inf, expected: str = "finite") -> None:
    """Raises unless `ramp` stays between `low` and `high`, both excluded, and has a known ease."""
    if ramp.ease not in EASINGS:
        raise UnknownNameError("ease", ramp.ease, list(EASINGS), where=where)
    for value in (ramp.start, ramp.end):
        if not low < value < high:
            raise BadValueError(where, f"{value:g}", expected)


def looking_at(eye: np.ndarray, target: np.ndarray, frustum: Frustum, where: str, at: ShotTime) -> Pose:
    """An upright pose at `eye` `(3,)` [m] that looks at `target` `(3,)` [m].

    Raises:
      UsageError: they are the same point; the message names the time.
    """
    distance = float(np.linalg.norm(target - eye))
    if distance < SAME_POINT:
        raise UsageError(f"{where}: at {at.time:.9g} s the camera is at the very point that it looks at")
    return Pose(eye, rotation(*heading(target - eye)), frustum, distance)
