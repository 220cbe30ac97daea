"""The interface of rigs: settings, which are bound to a model and then give the camera's pose at any time of a shot.

Settings are numbers that change over time, blends, and the shake of a camera.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Protocol

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, Frustum, heading, pose_of, rotation
from mjrun.camera.targets import ObjectOrPoint
from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, suggestion
from mjrun.options.kinds import AnyKind, ChoiceKind, Kind, TextKind
from mjrun.options.number_kinds import POINT, IntegerKind, PointKind, RealKind
from mjrun.options.option import Options, option, options, options_of, positional_options, required
from mjrun.options.schema_validation import TEXT, InvalidValueError, Schema
from mjrun.options.structured_kinds import OneOfKind, OptionsMappingKind

# Rise monotonically from 0 to 1 as u does.
EASINGS: dict[str, Callable[[float], float]] = {
    "linear": lambda u: u,
    "cosine": lambda u: 0.5 - math.cos(math.pi * u) / 2,
    "smooth": lambda u: u * u * (3 - 2 * u),
    "smoother": lambda u: u**3 * (u * (6 * u - 15) + 10),  # K. Perlin, "Improving Noise", 2002
    "in": lambda u: u * u,
    "out": lambda u: u * (2 - u),
}
# Rise from 0 to 1 around 0, in widths of the blend: all but the sigmoid from -1/2 to 1/2.
BLENDS: dict[str, Callable[[float], float]] = {
    "cosine": lambda x: EASINGS["cosine"](min(max(x + 0.5, 0.0), 1.0)),
    "linear": lambda x: min(max(x + 0.5, 0.0), 1.0),
    "smooth": lambda x: EASINGS["smooth"](min(max(x + 0.5, 0.0), 1.0)),
    "sigmoid": lambda x: 1 / (1 + math.exp(-min(max(x, -60.0), 60.0))),
}

NEGLIGIBLE = 1e-12  # a weight without visible effect
SAME_TIME = 1e-9  # [s], difference of times caused by rounding
SINES = 16  # terms in the sum that is the noise on an angle
SAME_POINT = 1e-9  # [m], distance from the camera below which it coincides with its target


@dataclass(frozen=True)
class EasedNumber:
    """A number that changes from `start` to `end` over a shot, by one of `EASINGS`."""

    start: float
    end: float
    ease: str = "linear"

    @classmethod
    def still(cls, value: float) -> "EasedNumber":
        """Returns a ramp that does not change."""
        return cls(value, value)

    def at(self, phase: float) -> float:
        """Returns the value at `phase` of the shot, from 0 to 1."""
        return self.start + (self.end - self.start) * EASINGS[self.ease](phase)


@positional_options
class ShotBlend(Options):
    """The transition from one shot to the next."""

    shape: str = option(converter=ChoiceKind((*BLENDS,)), default="cosine", help="The shape of the transition.")
    width: float = option(
        converter=RealKind(above=0),
        default=0.5,
        help="Duration of the transition [s]; for a sigmoid, the time from 1/2 to 1/(1+e).",
    )


def blend_weight(blend: ShotBlend | None, since: float) -> float:
    """Returns the weight of a shot, `since` it began [s], from 0 to 1; without a blend, a step."""
    if blend is None:
        return float(since >= -SAME_TIME)
    value = BLENDS[blend.shape](since / blend.width)
    return 0.0 if value < NEGLIGIBLE else 1.0 if value > 1 - NEGLIGIBLE else value


@positional_options
class Shake(Options):
    """The shake of a hand-held camera: smooth noise on the direction of view."""

    angle: float = option(converter=RealKind(), default=0.3, help="Standard deviation of each angle [deg].")
    frequency: float = option(
        converter=RealKind(above=0), default=2.0, help="Frequency of the shake [Hz], in video time."
    )
    seed: int = option(converter=IntegerKind(), default=0, help="Seed of the shake.")


class ShakeNoise:
    """The smooth noise of a shake on two angles: sums of sines with random phases, of 0.5 to 1.5 times the frequency.

    Over a long time the standard deviation is exactly `shake.angle`: since frequencies differ, the variances of the
    sines add up.
    """

    def __init__(self, shake: Shake) -> None:
        random = np.random.default_rng(shake.seed).random((2, 2, SINES))
        self._amplitude = shake.angle * math.sqrt(2 / SINES)
        self._frequencies = shake.frequency * (0.5 + (np.arange(SINES) + random[0]) / SINES)
        self._phases = random[1]

    def at(self, video_time: float) -> np.ndarray:
        """Returns pan and tilt `(2,)` [deg] at a time of the video [s]."""
        turns = self._frequencies * video_time + self._phases
        return self._amplitude * np.sin(2 * math.pi * turns).sum(axis=1)


class ObjectNameKind(TextKind):
    """The name of an object, as in `box`, `geom:edge`, `site:tip` or `subtree:torso`; resolved in a model later."""

    metavar = "OBJECT"


class ObjectOrPointKind(Kind[ObjectOrPoint, ObjectOrPoint]):
    """An object or a point."""

    metavar = "PLACE"

    @property
    def form(self) -> Schema:
        return {"anyOf": [TEXT, POINT], "forms": "an object's name or a point [x, y, z]"}

    def __call__(self, value: ObjectOrPoint) -> ObjectOrPoint:
        return value if isinstance(value, str) else PointKind()(value)

    def parse(self, text: str) -> ObjectOrPoint:
        try:
            _, _, _ = map(float, text.split("/"))
        except ValueError:
            return text
        return PointKind().parse(text)

    def plain(self, value: ObjectOrPoint) -> object:
        return value if isinstance(value, str) else [*value]


@options
class RampOptions(Options):
    """A number that changes over the shot."""

    start: float = required(converter=RealKind(least=None), key="from", help="At the beginning of the shot.")
    end: float = required(converter=RealKind(least=None), key="to", help="At the end of the shot.")
    ease: str = option(converter=ChoiceKind((*EASINGS,)), default="linear", help="Easing from one number to the other.")


@options
class PositiveRampOptions(RampOptions):
    """A positive number that changes over the shot."""

    start: float = required(converter=RealKind(above=0), key="from", help="At the beginning of the shot.")
    end: float = required(converter=RealKind(above=0), key="to", help="At the end of the shot.")


class RampKind(OneOfKind["EasedNumber | float", EasedNumber]):
    """A number, or one that changes over the shot: `140..240`.

    Args:
      unit: the plural noun in errors, as in `metres`.
    """

    metavar = "X..Y"

    def __init__(self, unit: str, *, positive: bool = False) -> None:
        mapping = OptionsMappingKind(PositiveRampOptions if positive else RampOptions, EasedNumber)
        number = RealKind(above=0) if positive else RealKind(least=None)
        super().__init__(f"a number of {unit} or {{from, to, ease}}", number=number, object=mapping)
        self.unit, self.positive = unit, positive

    def __call__(self, value: "EasedNumber | float") -> EasedNumber:
        ramp = value if isinstance(value, EasedNumber) else EasedNumber.still(value)
        if ramp.ease not in EASINGS:
            raise InvalidValueError(f"one of {', '.join(EASINGS)}{suggestion(ramp.ease, EASINGS)}", ramp.ease)
        for number in (ramp.start, ramp.end):
            if not math.isfinite(number):
                raise InvalidValueError("finite", f"{number:g}")
            if self.positive and number <= 0:
                raise InvalidValueError(f"a positive number of {self.unit}", f"{number:g}")
        return ramp

    def parse(self, text: str) -> EasedNumber:
        first, dots, last = text.partition("..")
        try:
            ramp = EasedNumber(float(first), float(last if dots else first))
        except ValueError:
            ramp = EasedNumber.still(math.nan)
        if not (math.isfinite(ramp.start) and math.isfinite(ramp.end)):
            raise InvalidValueError(f"a number of {self.unit}, or two as in 140..240")
        return self(ramp)

    def plain(self, value: EasedNumber) -> object:
        if value == EasedNumber.still(value.start):
            return value.start
        ease = {} if value.ease == "linear" else {"ease": value.ease}
        return {"from": value.start, "to": value.end, **ease}


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
