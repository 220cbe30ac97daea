"""What every rig is: settings, which are bound to a model and then give the camera's pose at any time of a shot."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, cast

import mujoco
import numpy as np

from mjrun.camera.curve import SAME_POINT
from mjrun.camera.easing import EASINGS, Ramp
from mjrun.camera.pose import Frustum, Pose, heading, pose_of, rotation
from mjrun.camera.rigs.settings import Declared, DeclaredField, ErrorPath, Setting, declared_fields, written_values
from mjrun.errors import BadValueError, UnknownNameError, UsageError


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
        """What is wrong with the combination of values, as of `Declared.conflicts`."""
        return iter(())

    def check(self, where: str) -> None:
        """Raises an error for the first setting that is not as its declaration says, or does not go with others."""
        check_declared(self, where)


def check_declared(declared: Declared, where: str) -> None:
    """Raises an error for the first field that is not as its declaration says, or does not go with others."""
    for path, message in declared.conflicts(written_values(declared)):
        raise UsageError(f"{located(where, path)}: {message}")
    for field in declared_fields(type(declared)):
        value = getattr(declared, field.name)
        if value is not None:
            _check_field(value, field, where)


def _check_field(value: object, field: DeclaredField, where: str) -> None:
    setting, place = field.setting, f"{where}: {field.key}"
    match setting.kind:
        case "ramp":
            low, expected = (0.0, f"a positive number of {setting.unit}") if setting.positive else (-np.inf, "finite")
            check_ramp(cast("Ramp", value), place, low, expected=expected)
        case "number":
            _check_number(cast("float", value), setting, place)
        case "point":
            point = cast("Sequence[float]", value)
            if not np.isfinite(point).all():
                raise BadValueError(place, ", ".join(f"{number:g}" for number in point), "made of finite numbers")
        case "choice":
            if value not in setting.choices:
                raise UnknownNameError(field.key, str(value), list(setting.choices), where=where)
        case "records":
            records = cast("Sequence[Declared]", value)
            if len(records) < setting.length:
                raise UsageError(f"{place}: at least {setting.length} are needed, not {len(records)}")
            for index, record in enumerate(records):
                check_declared(record, located(where, (field.key, index)))
        case "object" | "place" | "flag":
            pass  # names and points are looked up in the model


def _check_number(number: float, setting: Setting, where: str) -> None:
    if not np.isfinite(number):
        raise BadValueError(where, f"{number:g}", "finite")
    if setting.positive and number <= 0:
        raise BadValueError(where, f"{number:g}", f"a positive number of {setting.unit}")
    if setting.least is not None and number < setting.least:
        raise BadValueError(where, f"{number:g}", f"{setting.least:g} or more")


def located(where: str, path: ErrorPath) -> str:
    """Returns the place of a value in what errors call `where`: `camera a: waypoint 2: at`."""
    names = [where]
    for part in path:
        if isinstance(part, int):
            names[-1] = f"{names[-1].removesuffix('s')} {part + 1}"
        else:
            names.append(part)
    return ": ".join(names)


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
