"""A simulation as a value: which model, from where, with what, for how long."""

from dataclasses import field, replace
from fractions import Fraction
from functools import cached_property
from itertools import chain, repeat
from pathlib import Path

import mujoco

from mjrun.errors import UsageError, clean, concerning, listing, option
from mjrun.formats.recording_reader import RecordingReader
from mjrun.formats.table_reader import read_table
from mjrun.model import known_bugs
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.model.names import control_names, control_slices
from mjrun.model.override import overrides_of
from mjrun.model.source import Source
from mjrun.model.sources import ModelLike, source_of
from mjrun.options.option import options
from mjrun.options.simulation import SimulationOptions
from mjrun.sim.control import ControlSignal
from mjrun.sim.control_noise import ControlNoise
from mjrun.sim.control_table import PREFIX, ControlTable
from mjrun.sim.controller import PeriodicController
from mjrun.sim.initial_state import InitialState
from mjrun.sim.push_forces import PushForces
from mjrun.sim.replay import ReplayStepper
from mjrun.sim.stepper import PhysicsStepper, Stepper
from mjrun.timeline import Timeline, rational

DURATION = Fraction(5)  # [s], when nothing is said


@options
class Simulation(SimulationOptions):
    """A model, its state at time 0, what drives it, and how long to run it.

    Args:
      model: a file, another source such as `scene:dominos`, or a compiled model, which is copied, never changed.

    A controller is called with (model, data) every `control_dt`, at an instant whose fields belong together: it writes
    `data.ctrl`, or other inputs, or returns the controls `(nu,)`. If it has a method `reset`, that is called first.

    Raises:
      UsageError: values that cannot be, or cannot be together.
    """

    model: ModelLike = field(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.control_dt is not None and self.controller is None:
            raise UsageError(f"{option('control_dt')} says how often a {option('controller')} is called; there is none")

    @property
    def start(self) -> InitialState:
        """The state at time 0."""
        return InitialState(self.key, self.qpos, self.qvel, self.ctrl, self.perturb, self.seed)

    @property
    def source(self) -> Source:
        """Where the model comes from, with its overrides."""
        source = source_of(self.model)
        return replace(source, overrides=(*source.overrides, *overrides_of(self)))

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
        return Timeline.lasting(timestep, self.duration or DURATION)

    def stepper(self, model: mujoco.MjModel) -> Stepper:
        """`model` at time 0, ready to step.

        Raises:
          UsageError: the recording to go through is of another model, or not as long.
          FileError: a recording or a table cannot be read.
        """
        if self.replay is not None:
            with concerning("replay"):
                stepper = ReplayStepper(model, self._recorded, self._recorded.facts.get("sizes"))
                stepper.require([self.timeline(model).steps])
                return stepper
        data = self.start.data(model)
        timestep = rational(model.opt.timestep)
        noise = table = controller = None
        if self.ctrl_from is not None:
            with concerning("ctrl_from"):
                table = self._table(model)
        if self.ctrl_noise:
            noise = ControlNoise(self.ctrl_noise, self.ctrl_noise_time, self.seed, model.opt.timestep, model.nu)
        if self.controller is not None:
            period = self.control_dt or timestep
            controller = PeriodicController(self.controller, period, timestep)
        control = ControlSignal(timestep, data.ctrl.copy(), table, noise, controller)
        return PhysicsStepper(model, data, control, PushForces(model, self.push, timestep))

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
        pushes = PushForces(model, self.push, rational(model.opt.timestep)).remarks(self.timeline(model).steps)
        return [*known_bugs.bugs_of_model(model), *self.start.remarks(model), *pushes, *other]

    @cached_property
    def _recorded(self) -> RecordingReader:
        """What is replayed, opened once: all of it is checked then."""
        assert self.replay is not None
        return RecordingReader(self.replay)

    def _table(self, model: mujoco.MjModel) -> ControlTable:
        path = Path(str(self.ctrl_from))
        columns = read_table(path, lambda name: name == "time" or name.startswith(PREFIX)).columns
        names = control_names(model)
        held = {n: [i for part in control_slices(model, n) for i in range(part.start, part.stop)] for n in self.ctrl}
        # `*` means the others.
        twice = [name for name, of in held.items() if name != "*" and any(PREFIX + names[i] in columns for i in of)]
        if twice:
            raise UsageError(f"{option('ctrl')} and {clean(str(path))} both drive {listing(twice)}")
        constant = {i for of in held.values() for i in of}
        return ControlTable(model, columns, str(path), self.ctrl_interpolation == "linear", constant)
