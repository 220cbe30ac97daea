"""A simulation as a value: which model, from where, with what, for how long."""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from fractions import Fraction
from pathlib import Path

import mujoco

from mjrun.errors import BadValueError, UsageError
from mjrun.model.load import load
from mjrun.model.override import Setting
from mjrun.sim.start import Start, Values
from mjrun.sim.stepper import PhysicsStepper
from mjrun.timeline import Timeline, rational

DURATION = Fraction(5)  # [s], when nothing is said


@dataclass(frozen=True)
class Source:
    """A model file and the overrides to load it with."""

    path: Path
    settings: tuple[Setting, ...] = ()

    def load(self) -> mujoco.MjModel:
        """The compiled model."""
        return load(self.path, overrides=self.settings)


@dataclass(frozen=True)
class Simulation:
    """A model, its state at time 0, and how long to run it.

    Args:
      model: a compiled model, or the path of one. It is copied, never changed.
      key: keyframe to start from, by name or index.
      qpos, qvel: initial joint positions and velocities by name: `{"root": 0.1, "free/z": 1}`.
      ctrl: constant controls by actuator name; `*` means all.
      perturb: standard deviation of noise on the initial velocities; `seed` makes it repeatable.
      duration: simulated time [s]; 5 when neither it nor `steps` is given.
      steps: number of steps, instead of `duration`.

    Raises:
      UsageError: a duration or a number of steps that cannot be.
    """

    model: mujoco.MjModel | Source | str | Path
    _: KW_ONLY
    key: str | int | None = None
    qpos: Mapping[str, Values] = field(default_factory=dict)
    qvel: Mapping[str, Values] = field(default_factory=dict)
    ctrl: Mapping[str, Values] = field(default_factory=dict)
    perturb: float = 0.0
    seed: int = 0
    duration: float | str | Fraction | None = None
    steps: int | None = None

    def __post_init__(self) -> None:
        if self.duration is not None and self.steps is not None:
            raise UsageError("--duration and --steps exclude each other: both say how long")
        if self.duration is not None:
            positive("--duration", self.duration)
        if self.steps is not None and not (isinstance(self.steps, int) and self.steps > 0):
            raise BadValueError("--steps", self.steps, "a positive whole number")

    @property
    def start(self) -> Start:
        """The state at time 0."""
        key = None if self.key is None else str(self.key)
        return Start(key, self.qpos, self.qvel, self.ctrl, self.perturb, self.seed)

    def load(self) -> mujoco.MjModel:
        """The compiled model."""
        if isinstance(self.model, mujoco.MjModel):
            return self.model
        return (self.model if isinstance(self.model, Source) else Source(Path(self.model))).load()

    def timeline(self, model: mujoco.MjModel) -> Timeline:
        """How this simulation falls on the timesteps of `model`."""
        timestep = rational(model.opt.timestep)
        if self.steps is not None:
            return Timeline.of_steps(timestep, self.steps)
        return Timeline.lasting(timestep, DURATION if self.duration is None else rational(self.duration))

    def stepper(self, model: mujoco.MjModel) -> PhysicsStepper:
        """`model` at time 0, ready to step."""
        return PhysicsStepper(model, self.start.data(model))


def positive(what: str, value: float | str | Fraction) -> Fraction:
    """`value` as an exact number above zero.

    Raises:
      BadValueError: it is none.
    """
    try:
        number = rational(value)
    except ValueError:
        number = Fraction(0)
    if number <= 0:
        raise BadValueError(what, value, "a positive number")
    return number
