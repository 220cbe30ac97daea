"""A simulation as a value: which model, from where, with what, for how long."""

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import mujoco

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, listing
from mjrun.formats.recording_reader import RecordingReader
from mjrun.formats.table_reader import read_table
from mjrun.model import mujoco_bugs
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.model.names import control_names, control_slices
from mjrun.model.source import Source
from mjrun.model.sources import ModelLike, source_of
from mjrun.sim.control import ControlSignal
from mjrun.sim.control_noise import ControlNoise
from mjrun.sim.control_table import PREFIX, ControlTable
from mjrun.sim.controller import Controller, PeriodicController
from mjrun.sim.initial_state import InitialState, Values
from mjrun.sim.replay import ReplayStepper
from mjrun.sim.stepper import PhysicsStepper, Stepper
from mjrun.timeline import Timeline, rational

INTERPOLATIONS = ("hold", "linear")
DURATION = Fraction(5)  # [s], when nothing is said
# What only physics knows, unset.
DRIVING = {**dict.fromkeys(("key", "ctrl_from", "controller")), **dict.fromkeys(("ctrl_noise", "perturb"), 0.0)}
DRIVING |= {name: {} for name in ("qpos", "qvel", "ctrl")}


@dataclass(frozen=True)
class Simulation:
    """A model, its state at time 0, and how long to run it.

    Args:
      model: a compiled model, or the path of one. It is copied, never changed.
      key: keyframe to start from, by name or index.
      qpos, qvel: initial joint positions and velocities by name: `{"root": 0.1, "free/z": 1}`.
      ctrl: constant controls by actuator name; `*` means all.
      ctrl_from: a table of controls in time, with columns `time` and `ctrl/ACTUATOR`, such as a trace.
      ctrl_interpolation: between its rows: `hold` or `linear`.
      ctrl_noise: standard deviation of noise on every control, in the actuators' own units.
      ctrl_noise_time: time in which that noise forgets [s]; 0 is white, new at every step.
      controller: called with (model, data) every `control_dt`, at an instant whose fields belong together: it
        writes `data.ctrl`, or other inputs, or returns the controls `(nu,)`. If it has a method `reset`, that
        is called first.
      control_dt: time between two calls [s]; every step when None.
      perturb: standard deviation of noise on the initial velocities; `seed` makes it repeatable.
      replay: a recording to go through, instead of simulating.
      duration: simulated time [s]; when neither it nor `steps` is given 5, or that of the recording.
      steps: number of steps, instead of `duration`.

    Raises:
      UsageError: a duration or a number of steps that cannot be.
    """

    model: ModelLike
    _: KW_ONLY
    key: str | int | None = None
    qpos: Mapping[str, Values] = field(default_factory=dict)
    qvel: Mapping[str, Values] = field(default_factory=dict)
    ctrl: Mapping[str, Values] = field(default_factory=dict)
    ctrl_from: str | Path | None = None
    ctrl_interpolation: str = "hold"
    ctrl_noise: float = 0.0
    ctrl_noise_time: float = 0.0
    controller: Controller | None = None
    control_dt: float | str | Fraction | None = None
    perturb: float = 0.0
    seed: int = 0
    replay: str | Path | None = None
    duration: float | str | Fraction | None = None
    steps: int | None = None

    def __post_init__(self) -> None:
        if self.duration is not None and self.steps is not None:
            raise UsageError("--duration and --steps exclude each other: both say how long")
        if self.duration is not None:
            positive("--duration", self.duration)
        if self.steps is not None and not (isinstance(self.steps, int) and self.steps > 0):
            raise BadValueError("--steps", self.steps, "a positive whole number")
        if self.controller is not None and self.ctrl_from is not None:
            raise UsageError("--controller and --ctrl-from exclude each other: both drive the actuators")
        if self.control_dt is not None:
            positive("--control-dt", self.control_dt)
            if self.controller is None:
                raise UsageError("--control-dt says how often a --controller is called, and there is none")
        if self.replay is not None and (driven := self._driven()):
            raise UsageError(f"--replay goes through a recording, and {listing(driven)} would change it")
        if self.ctrl_interpolation not in INTERPOLATIONS:
            raise UnknownNameError("interpolation", self.ctrl_interpolation, INTERPOLATIONS)
        for flag, value in (("--ctrl-noise", self.ctrl_noise), ("--ctrl-noise-time", self.ctrl_noise_time)):
            if not 0 <= value < math.inf:
                raise BadValueError(flag, value, "a number from 0 on")

    @property
    def start(self) -> InitialState:
        """The state at time 0."""
        key = None if self.key is None else str(self.key)
        return InitialState(key, self.qpos, self.qvel, self.ctrl, self.perturb, self.seed)

    @property
    def source(self) -> Source:
        """Where the model comes from."""
        return source_of(self.model)

    @property
    def inputs(self) -> list[tuple[str, Path]]:
        """The files that it reads, with what they are, as far as that is known without reading them."""
        model_files = zip(chain(["model"], repeat("file of the model")), self.source.files, strict=False)
        tables = (("table of controls", self.ctrl_from), ("recording", self.replay))
        return [*model_files, *((what, Path(file)) for what, file in tables if file is not None)]

    def load(self) -> mujoco.MjModel:
        """The compiled model."""
        return self.source.load()

    def timeline(self, model: mujoco.MjModel) -> Timeline:
        """How this simulation falls on the timesteps of `model`."""
        timestep = rational(model.opt.timestep)
        if self.steps is not None:
            return Timeline.of_steps(timestep, self.steps)
        if self.duration is None and self.replay is not None:
            return Timeline.of_steps(timestep, int(self._recorded.steps[-1]))
        return Timeline.lasting(timestep, DURATION if self.duration is None else rational(self.duration))

    def stepper(self, model: mujoco.MjModel) -> Stepper:
        """`model` at time 0, ready to step.

        Raises:
          UsageError: the recording to go through is of another model, or not as long.
          FileError: a recording or a table cannot be read.
        """
        if self.replay is not None:
            stepper = ReplayStepper(model, self._recorded, self._recorded.facts.get("sizes"))
            stepper.require([self.timeline(model).steps])
            return stepper
        data = self.start.data(model)
        timestep = rational(model.opt.timestep)
        noise = table = controller = None
        if self.ctrl_from is not None:
            table = self._table(model)
        if self.ctrl_noise:
            noise = ControlNoise(self.ctrl_noise, self.ctrl_noise_time, self.seed, model.opt.timestep, model.nu)
        if self.controller is not None:
            period = timestep if self.control_dt is None else rational(self.control_dt)
            controller = PeriodicController(self.controller, period, timestep)
        return PhysicsStepper(model, data, ControlSignal(timestep, data.ctrl.copy(), table, noise, controller))

    def remarks(self, model: mujoco.MjModel) -> list[str]:
        """What the user should know of this simulation before it runs."""
        other = []
        if (
            self.replay is not None
            and self._recorded.facts.get("physics", physics := physics_fingerprint(model)) != physics
        ):
            other = [
                "the recording was made with other physics: positions are as recorded, "
                "forces and energies are what this model makes of them"
            ]
        return [*mujoco_bugs.bugs_of_model(model), *self.start.remarks(model), *other]

    @cached_property
    def _recorded(self) -> RecordingReader:
        """What is replayed, opened once: all of it is checked then."""
        assert self.replay is not None
        return RecordingReader(self.replay)

    def _driven(self) -> list[str]:
        """The options given that only physics knows."""
        return [f"--{name.replace('_', '-')}" for name, unset in DRIVING.items() if getattr(self, name) != unset]

    def _table(self, model: mujoco.MjModel) -> ControlTable:
        path = Path(str(self.ctrl_from))
        columns = read_table(path, lambda name: name == "time" or name.startswith(PREFIX)).columns
        names = control_names(model)
        held = {n: [i for part in control_slices(model, n) for i in range(part.start, part.stop)] for n in self.ctrl}
        # `*` means the others.
        twice = [name for name, of in held.items() if name != "*" and any(PREFIX + names[i] in columns for i in of)]
        if twice:
            raise UsageError(f"--ctrl and {clean(str(path))} both drive {listing(twice)}")
        constant = {i for of in held.values() for i in of}
        return ControlTable(model, columns, str(path), self.ctrl_interpolation == "linear", constant)


def lone(job: Any, *names: str) -> None:
    """Makes a lone text in these fields of a frozen dataclass a list of one: it is a sequence too, of its letters."""
    for name in names:
        if isinstance(given := getattr(job, name), str):
            object.__setattr__(job, name, (given,))


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
