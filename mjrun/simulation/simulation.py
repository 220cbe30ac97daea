"""A simulation as a value: which model, from where, with what, for how long."""

from collections.abc import Sequence
from dataclasses import field, fields, replace
from fractions import Fraction
from functools import cached_property
from itertools import chain, repeat
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco

from mjrun.errors import ModelError, UsageError, clean, concerning, listing, option, quoted
from mjrun.formats.manifest import fingerprint
from mjrun.formats.recording import RecordingReader, is_recording
from mjrun.formats.table_reader import STDIN, read_table
from mjrun.model import known_bugs, state
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.model.names import control_names, control_slices
from mjrun.model.override import overrides_of
from mjrun.model.source import Source
from mjrun.model.sources import ModelLike, source_of
from mjrun.options.option import Exclusion, is_given, options
from mjrun.options.policy import is_code
from mjrun.options.simulation import CONTROLS, START, TABLE_READING, SimulationOptions
from mjrun.physics.control import PREFIX, ControlNoise, ControlSignal, ControlTable, PeriodicController
from mjrun.physics.initial_state import InitialState
from mjrun.physics.push_forces import PushForces
from mjrun.physics.replay import RecordedInputs, ReplayStepper, require_model, require_timestep
from mjrun.physics.stepper import PhysicsStepper, Stepper
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.task.task import Task
from mjrun.timeline import EXACT, Timeline, rational

if TYPE_CHECKING:
    from mjrun.physics.motion import Motion
    from mjrun.simulation.episode import Episode

DURATION = Fraction(5)  # [s], where no option decides
LONG = 10**9  # steps of a replay that nobody can want without saying so


@options
class Simulation(SimulationOptions):
    """A model, its state at time 0, what drives it, and how long to run it.

    Args:
      model: a file, another source such as `scene:dominos`, or a compiled model, which is copied, never changed.
      snapshot: copies of the files that it reads, which are read instead.

    A controller is called with (model, data) every `control_dt`, at an instant whose fields belong together: it writes
    `data.ctrl`, or other inputs, or returns the controls `(nu,)`. If it has a method `reset`, that is called first.

    Raises:
      UsageError: values that cannot be, or cannot be together.
    """

    model: ModelLike = field(kw_only=False)
    snapshot: InputSnapshot | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.normalize is not None and self.policy is None:
            raise UsageError(f"{option('normalize')} is about what a {option('policy')} observes; there is none")

    @property
    def start(self) -> InitialState:
        """The state at time 0."""
        return InitialState(self.key, self.qpos, self.qvel, self.ctrl, self.perturb, self.seed)

    def initial_data(self, model: mujoco.MjModel) -> mujoco.MjData:
        """The state at time 0 in `model`.

        Raises:
          UsageError: a name that nothing has, or a value that cannot be.
          ModelError: what the model itself says of its start cannot be.
        """
        with self.source.named_in_errors():
            return self.start.data(model)

    @property
    def source(self) -> Source:
        """Where the model comes from, with its overrides."""
        source = source_of(self.model)
        source = replace(source, overrides=(*source.overrides, *overrides_of(self)))
        return source.stored_at(self.snapshot.place) if self.snapshot else source

    def _stored(self, path: str | Path) -> Path:
        """Returns where a file is read: where it is, or its copy."""
        return self.snapshot.place(path) if self.snapshot and str(path) != STDIN else Path(path)

    @cached_property
    def episode(self) -> "Episode | None":
        """What its policy does; None without a policy.

        Raises:
          UsageError: the policy does not fit, or is not trusted.
          FileError: a file of the policy cannot be read.
        """
        if self.policy is None:
            return None
        from mjrun.simulation.episode import episode_of, remembered_policy

        policy = remembered_policy(self.policy, self.trust, self.normalize, self._stored)
        return episode_of(self.source, policy, self.seed, self.push, self.control_dt, self.duration)

    def __getstate__(self) -> dict[str, object]:
        """What is pickled: what it is made of, and nothing that follows from that."""
        return {each.name: vars(self)[each.name] for each in fields(self)}

    def with_snapshot(self) -> "Simulation":
        """Returns the same simulation of copies of its files as they are now, whatever becomes of the files.

        Raises:
          FileError: a file cannot be read or copied.
        """
        if self.snapshot:
            return self
        snapshot = InputSnapshot.empty().with_files(path for _, path in self.inputs)
        model = source_of(self.model) if self.model == STDIN else self.model  # which holds its text when it is pickled
        return replace(self, model=model, snapshot=snapshot)

    @property
    def code(self) -> list[object]:
        """What is written by the user in it: the controller, and a policy in Python."""
        policy = self.policy
        has_code = policy is not None and (not isinstance(policy, str) or is_code(policy))
        return [*([self.controller] if self.controller is not None else []), *([policy] if has_code else [])]

    @property
    def has_end(self) -> bool:
        """Whether it ends by itself, without a usual duration."""
        return not (self.duration is self.steps is self.replay is self.policy is None)

    @property
    def inputs(self) -> list[tuple[str, Path]]:
        """The files that it reads, with what they are, as far as that is known without reading them."""
        model_files = zip(chain(["model"], repeat("file of the model")), self.source.files, strict=False)
        return [*model_files, *self.tables]

    @property
    def tables(self) -> list[tuple[str, Path]]:
        """The files that it reads besides the model, with what they are."""
        replay = "table" if self.replay is not None and not is_recording(self._stored(self.replay)) else "recording"
        tables = (("table of controls", self.ctrl_from), (replay, self.replay))
        files = [(what, Path(file)) for what, file in tables if file is not None]
        if self.map:
            from mjrun.simulation.column_map import map_files

            files += [("file of columns", Path(file)) for file in map_files(self.map)]
        if self.policy is not None:
            from mjrun.simulation.episode import policy_files

            files += [("policy", file) for file in policy_files(self.policy, self.normalize)]
        return files

    @cached_property
    def fingerprints(self) -> list[dict[str, object]]:
        """Path, size and hash of the document of a task, and of each of `tables`."""
        document = self.source.path if isinstance(self.source, Task) else None
        paths = [*([document] if document else []), *(path for _, path in self.tables)]
        return [{**fingerprint(self._stored(path)), "path": str(path)} for path in paths]

    def load(self) -> mujoco.MjModel:
        """The compiled model; with a policy, that of its episode."""
        return self.compile()[1] if self.episode is None else self.episode.model()

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        """The specification, None where there is only a compiled model, and the model; see `Source.compile`."""
        try:
            return self.source.compile()
        except ModelError:
            if self.snapshot:
                replace(self, snapshot=None).source.compile()  # whose error names the files that the user knows
            raise

    def timeline(self, model: mujoco.MjModel) -> Timeline:
        """How this simulation falls on the timesteps of `model`."""
        timestep, requested = rational(model.opt.timestep), self._requested_timeline(model)
        if self.episode is not None:
            return self.episode.timeline(timestep, requested)
        if requested is None and self.replay is not None:
            steps = int(self.replayed(model).steps[-1])
            if steps > LONG:
                advice = f"{option('duration')} says how much of it is wanted; {option('map')} what its times are"
                raise UsageError(f"{option('replay')} lasts {steps:,} steps of {float(timestep):g} s\n{advice}")
            return Timeline.of_steps(timestep, steps)
        return requested or Timeline.lasting(timestep, DURATION)

    def _requested_timeline(self, model: mujoco.MjModel) -> Timeline | None:
        """Returns the timeline that the options ask for; None if they leave the length open."""
        timestep = rational(model.opt.timestep)
        if self.steps is not None:
            timeline = Timeline.of_steps(timestep, self.steps)
        elif self.duration is not None:
            timeline = Timeline.lasting(timestep, self.duration)
        else:
            return None
        require_countable(timeline.steps, "duration" if self.steps is None else "steps")
        return timeline

    def stepper(self, model: mujoco.MjModel) -> Stepper:
        """`model` at time 0, ready to step.

        Raises:
          UsageError: the recording to go through is of another model, or not as long; an option is about something
            that is missing.
          FileError: a recording or a table cannot be read.
        """
        if self.control_dt is not None and self.controller is self.policy is None:
            raise UsageError(f"{option('control_dt')} says how often a {option('controller')} is called; there is none")
        if self.episode is not None:
            return self.episode.stepper(model.opt.enableflags)
        if self.replay is None and isinstance(self.source, Task):
            text = clean(self.source.text)
            raise UsageError(f"{text} is a task: say which {option('policy')} acts on it, a file, zero or random")
        if self.replay is not None:
            return self._replay_controls(model) if self.replay_mode == CONTROLS else self._replay_states(model)
        if not self._motions:  # no ghost has read a table either
            for name in filter(lambda name: is_given(self, name), TABLE_READING):
                raise UsageError(f"{option(name)} says how a table is read; there is none to {option('replay')}")
        if is_given(self, "replay_mode"):
            raise UsageError(f"{option('replay_mode')} says what is done with a {option('replay')}; there is none")
        data = self.initial_data(model)
        timestep = rational(model.opt.timestep)
        table = controller = None
        if self.ctrl_from is not None:
            with concerning("ctrl_from"):
                table = self._table(model)
        if self.controller is not None:
            period = self.control_dt or timestep
            controller = PeriodicController(self.controller, period, timestep)
        control = ControlSignal(timestep, data.ctrl.copy(), table, self._noise(model), controller)
        return PhysicsStepper(model, data, control, PushForces(model, self.push, timestep))

    def remarks(self, model: mujoco.MjModel) -> list[str]:
        """What the user should know of this simulation before it runs."""
        pushes = PushForces(model, self.push, rational(model.opt.timestep)).remarks(self.timeline(model).steps)
        replay = self.replay_remarks(model)
        episode = self.episode.remarks(self._requested_timeline(model)) if self.episode else []
        return [*known_bugs.bugs_of_model(model), *self.start.remarks(model), *pushes, *replay, *episode]

    def replayed(self, model: mujoco.MjModel) -> "RecordingReader | Motion":
        """What is replayed: a recording, or a table as a motion of `model`; opened once, and all of it checked then.

        Raises:
          UsageError: a recording and a start of its own; a table that is no motion of `model`.
          FileError: it cannot be read.
        """
        assert self.replay is not None
        path = self._stored(self.replay)
        if self.replay == STDIN:
            raise UsageError(f"{option('replay')}: what is replayed is read more than once, and standard input is not")
        if not is_recording(path):
            try:
                return self.motion(path, model)
            except UsageError as error:
                if error.path[:1] != ("map",) or len(error.path) == 1:  # a hint, not a fault of the map
                    error.path = ("replay",)
                raise
        for name in (*START, "map", "replay_rate"):
            if is_given(self, name):
                raise UsageError(Exclusion(("replay", name), "a recording holds all of the state").message(), (name,))
        return self._recording

    def motion(self, path: Path, model: mujoco.MjModel, texts: Sequence[str] | None = None) -> "Motion":
        """The motion of `model` in a table, read once; what it lacks is as this simulation starts.

        Args:
          texts: the map, instead of the simulation's own.

        Raises:
          UsageError: the table is no motion of `model`.
          FileError: it cannot be read.
        """
        from mjrun.physics.motion_samples import Interpolation
        from mjrun.simulation.column_map import with_files
        from mjrun.simulation.mapped_table import read_motion

        texts = with_files(self.map, self._stored) if texts is None else texts
        key = (path, tuple(texts), model.opt.timestep, *state.sizes(model).values())
        if key not in self._motions:
            hold, hold_controls = self.replay_interpolation == "hold", self.ctrl_interpolation == "hold"
            interpolation = Interpolation(hold, hold_controls, self.replay_unwrap)
            start = self.initial_data(model)
            self._motions[key] = read_motion(path, model, start, texts, self.quat, self.replay_rate, interpolation)
        return self._motions[key]

    @cached_property
    def _recording(self) -> RecordingReader:
        return RecordingReader(str(self._stored(str(self.replay))))

    @cached_property
    def _motions(self) -> "dict[tuple[object, ...], Motion]":
        """The motions that were read."""
        return {}

    def _replay_states(self, model: mujoco.MjModel) -> ReplayStepper:
        states = self.replayed(model)
        with concerning("replay"):
            if isinstance(states, RecordingReader):
                stepper = ReplayStepper(model, states, states.facts.get("sizes"))
            else:
                stepper = ReplayStepper(model, states, simulated=False)
            stepper.require([self.timeline(model).steps])
            return stepper

    def _replay_controls(self, model: mujoco.MjModel) -> PhysicsStepper:
        """Physics from the first state on, under the controls and other inputs that were recorded."""
        states = self.replayed(model)
        with concerning("replay"):
            if isinstance(states, RecordingReader):
                require_model(model, states, states.facts.get("sizes"))
                require_timestep(model, states)
            elif not states.has_controls:
                expected = listing([f"{PREFIX}{name}" for name in control_names(model)]) or "nothing: no actuators"
                raise UsageError(f"{clean(str(self.replay))} has no controls to replay; the model takes {expected}")
        data = mujoco.MjData(model)
        state.restore(model, data, states.state(0))
        timestep = rational(model.opt.timestep)
        inputs = RecordedInputs(model, states)
        control = ControlSignal(timestep, data.ctrl.copy(), inputs, self._noise(model), inputs=inputs)
        return PhysicsStepper(model, data, control, PushForces(model, self.push, timestep))

    def replay_remarks(self, model: mujoco.MjModel) -> list[str]:
        """What the user should know of what is replayed, if anything is."""
        if self.replay is None:
            return []
        states = self.replayed(model)
        again = self.replay_mode == CONTROLS
        held = self._held_inputs(model, int(states.steps[-1])) if again else []
        if not isinstance(states, RecordingReader):
            derived = "forces and energies are what this model makes of the positions in the table"
            return [*states.remarks, *(held if again else [derived])]
        if states.facts.get("physics", physics := physics_fingerprint(model)) == physics:
            return held
        shown = "positions are as recorded, forces and energies are what this model makes of them"
        meaning = "the motion is what its inputs make of this model" if again else shown
        return [f"the recording was made with other physics: {meaning}", *held]

    def _held_inputs(self, model: mujoco.MjModel, last: int) -> list[str]:
        """What to know where physics goes on after the `last` recorded step."""
        timeline = self.timeline(model)
        if timeline.steps <= last:
            return []
        end = f"{clean(str(self.replay))} ends at {float(timeline.time(last)):g} s"
        return [f"{end}: from then on its last controls, applied forces and mocap poses hold"]

    def _noise(self, model: mujoco.MjModel) -> ControlNoise | None:
        if not self.ctrl_noise:
            return None
        return ControlNoise(self.ctrl_noise, self.ctrl_noise_time, self.seed, model.opt.timestep, model.nu)

    def _table(self, model: mujoco.MjModel) -> ControlTable:
        path = Path(str(self.ctrl_from))
        columns = read_table(self._stored(path), lambda name: name == "time" or name.startswith(PREFIX)).columns
        names = control_names(model)
        held = {n: [i for part in control_slices(model, n) for i in range(part.start, part.stop)] for n in self.ctrl}
        # `*` means the others.
        twice = [name for name, of in held.items() if name != "*" and any(PREFIX + names[i] in columns for i in of)]
        if twice:
            raise UsageError(f"{option('ctrl')} and {clean(str(path))} both drive {listing(twice)}")
        constant = {i for of in held.values() for i in of}
        return ControlTable(model, columns, str(path), self.ctrl_interpolation == "linear", constant)


def require_simulation(value: object) -> None:
    """Raises UsageError if `value` is something else than a simulation, such as its model."""
    if not isinstance(value, Simulation):
        example = f"mjrun.Simulation({value!r})" if isinstance(value, str) else "mjrun.Simulation(…)"
        raise UsageError(f"simulation: {quoted(str(value))} is not a simulation; write {clean(example)}")


def require_countable(steps: int, name: str) -> None:
    """Raises UsageError if the option `name` asks for more steps than numbers can tell apart."""
    if steps > EXACT:
        raise UsageError(f"{option(name)}: more steps than {EXACT:.1g}, which could not be told apart")
