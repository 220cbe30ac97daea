"""A simulation as a value: model, initial state, inputs and length. It compiles its model and starts its steppers."""

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, fields, replace
from fractions import Fraction
from functools import cache, cached_property
from itertools import chain, repeat
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mjrun.errors import FileError, ModelError, UsageError, clean, concerning, listing, option, quoted
from mjrun.file_version import file_version
from mjrun.formats.manifest import fingerprint
from mjrun.formats.recording import RecordingReader, is_recording
from mjrun.formats.table_reader import STDIN
from mjrun.model import state
from mjrun.model.additions import servo_sentence
from mjrun.model.names import control_names, control_slices
from mjrun.model.override import overrides_of
from mjrun.model.source import ModelSource, bugs_of_model, physics_fingerprint
from mjrun.model.sources import ModelLike, demonstration_in, source_of
from mjrun.options.kinds import AnyKind
from mjrun.options.model import GAINS, parse_gains
from mjrun.options.option import OptionExclusion, exclusions_of, is_given, options, options_of
from mjrun.options.policy import is_code
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.simulation import CONTROLS, RUN_REQUIREMENTS, START, TABLE_READING, SimulationOptions
from mjrun.physics.control import ControlNoise, ControlSources, ControlTable, PeriodicController, PushForces
from mjrun.physics.initial_state import InitialState
from mjrun.physics.recorded_states import RecordedInputs, require_model, require_timestep
from mjrun.physics.replay_stepper import ReplayStepper
from mjrun.physics.stepper import PhysicsStepper, Stepper
from mjrun.python_code import RedirectedFunction, edit_remarks, module_sources, own_copy
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.suffixes import is_url, split_episode
from mjrun.task.task import Task
from mjrun.timeline import EXACT, Timeline, rational

if TYPE_CHECKING:
    from mjrun.physics.kinematic_samples import KinematicMotion
    from mjrun.simulation.demonstration import DemonstratedEpisode
    from mjrun.simulation.policy_episode import Episode

DURATION = Fraction(5)  # [s] without an option for it
LONG = 10**9  # steps of a replay that must be requested explicitly


@options
class Simulation(SimulationOptions):
    """A model, its state at time 0, its inputs, and its duration.

    Args:
      model: a file, another source such as `scene:dominos`, or a compiled model, of which a copy is made at once.
      snapshot: copies of its input files, which are read instead.

    A controller is called with (model, data) every `control_dt`, at an instant whose fields are consistent: it writes
    `data.ctrl` or other inputs, or returns the controls `(nu,)`. If it has a method `reset`, that is called first.

    Raises:
      UsageError: a value is invalid, or values contradict each other.
    """

    model: ModelLike = field(kw_only=False)
    snapshot: InputSnapshot | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if isinstance(self.model, mujoco.MjModel):
            object.__setattr__(self, "model", copy.copy(self.model))
        demonstration = demonstration_in(self.model) if self.replay is None else None
        if demonstration:
            object.__setattr__(self, "replay", demonstration)
        try:
            super().__post_init__()
        except UsageError as error:
            if demonstration and option("replay") in error.args[0]:
                error.add_note(f"{clean(demonstration)} is a demonstration, whose states are replayed")
            raise

    @property
    def start(self) -> InitialState:
        """State at time 0."""
        return InitialState(self.key, self.qpos, self.qvel, self.ctrl, self.perturb, self.seed, self.position_control)

    def initial_data(self, model: mujoco.MjModel) -> mujoco.MjData:
        """Returns the state of `model` at time 0.

        Raises:
          UsageError: a name is unknown, or a value is invalid.
          ModelError: the initial state of the model is invalid.
        """
        with self.source.named_in_errors():
            return self.start.data(model)

    @property
    def source(self) -> ModelSource:
        """Source of the model, with overrides."""
        source, overrides = self._plain_source, overrides_of(self)
        return replace(source, overrides=(*source.overrides, *overrides)) if overrides else source

    @cached_property
    def _plain_source(self) -> ModelSource:
        """Source of the model, without the overrides of the simulation."""
        source = source_of(self.model)
        return source.stored_at(self.snapshot.place) if self.snapshot else source

    def with_overrides(self, overrides: Sequence[tuple[str, str]]) -> "Simulation":
        """Returns the same simulation with more overrides of the model, by path; many times faster than `replace`."""
        return self._with_valid({"set": (*self.set, *overrides)})

    @property
    def with_controller_copies(self) -> "Simulation":
        """The same simulation, each stepper of which gets its own copy of the controller."""
        controller = self.controller
        if controller is None or isinstance(controller, RedirectedFunction):
            return self
        return self.with_values({"controller": RedirectedFunction(controller)})

    def with_values(self, values: Mapping[str, object]) -> "Simulation":
        """Returns the same simulation with other values of options; many times faster than `replace`.

        Raises:
          UsageError: a value is invalid, or values contradict each other.
        """
        names = frozenset(values)
        if names not in self._freedoms:
            self._freedoms[names] = self._is_free(names)
        if not self._freedoms[names]:
            return replace(self, **values)
        try:
            return self._with_valid({name: _kinds()[name](value) for name, value in values.items()})
        except (InvalidValueError, AttributeError, TypeError, ValueError):
            return replace(self, **values)  # whose error names the option

    @cached_property
    def _freedoms(self) -> dict[frozenset[str], bool]:
        return {}

    def _is_free(self, names: frozenset[str]) -> bool:
        """Returns whether any valid values of these options are valid together in this simulation."""
        partners = [pair for each in exclusions_of(type(self)) for pair in (each.names, each.names[::-1])]
        is_limited = any(one in names and (other in names or is_given(self, other)) for one, other in partners)
        return not is_limited and _kinds().keys() - {"replay", "policy", "normalize"} >= names

    def _with_valid(self, values: Mapping[str, object]) -> "Simulation":
        """Returns the same simulation with other values that are checked, and do not decide where its model is."""
        changed = object.__new__(type(self))
        vars(changed).update(self.__getstate__(), _plain_source=self._plain_source)
        vars(changed).update(values)
        return changed

    def _stored(self, path: str | Path) -> Path:
        """Returns the path where a file is read: its own, or that of its copy."""
        return self.snapshot.place(path) if self.snapshot and str(path) != STDIN else Path(path)

    @cached_property
    def episode(self) -> "Episode | None":
        """Episode of its policy; None if there is no policy.

        Raises:
          UsageError: the policy does not fit, or is not trusted.
          FileError: a file of the policy cannot be read.
        """
        if self.policy is None:
            return None
        from mjrun.simulation.policy_episode import cached_policy, episode_of

        policy = cached_policy(self.policy, self.trust, self.normalize, self._stored)
        return episode_of(self.source, policy, self.seed, self.disturbances, self.control_dt, self.duration)

    def __getstate__(self) -> dict[str, object]:
        """Returns the fields to pickle, without cached values."""
        values = vars(self)
        return {name: values[name] for name in _field_names()}

    def with_snapshot(self) -> "Simulation":
        """Returns the same simulation with copies of the present input files.

        Raises:
          ModelNotFoundError: a file of the model cannot be read.
          FileError: another file cannot be read, or a file cannot be copied.
        """
        if self.snapshot:
            return self
        snapshot = InputSnapshot.empty().with_files((path for _, path in self.tables), of_models=self.source.files)
        model = source_of(self.model) if self.model == STDIN else self.model  # whose text is pickled with it
        return replace(self, model=model, snapshot=snapshot)

    @property
    def code(self) -> list[object]:
        """Functions and objects that the user has written: the controller, and a policy in Python."""
        policy = self.policy
        has_code = policy is not None and (not isinstance(policy, str) or is_code(policy))
        return [*([self.controller] if self.controller is not None else []), *([policy] if has_code else [])]

    @property
    def has_end(self) -> bool:
        """True if an option determines its end, rather than the default duration."""
        return not (self.duration is self.steps is self.replay is self.policy is None)

    @property
    def inputs(self) -> list[tuple[str, Path]]:
        """Kind and path of each input file that is known without reading the others."""
        model_files = zip(chain(["model"], repeat("file of the model")), self.source.files, strict=False)
        return [*model_files, *self.tables]

    @property
    def tables(self) -> list[tuple[str, Path]]:
        """Kind and path of each input file except those of the model."""
        files = list[tuple[str, Path]]()
        if self.ctrl_from is not None:
            files.append(("table of controls", Path(self.ctrl_from)))
        if self.replay is not None:
            file, episode = split_episode(self.replay)
            is_table = not episode and not is_recording(self._stored(self.replay))
            files.append(("demonstration" if episode else "table" if is_table else "recording", Path(file)))
        if self.map:
            from mjrun.simulation.mapped_table import map_files

            files += [("file of columns", Path(file)) for file in map_files(self.map)]
        if self.policy is not None:
            from mjrun.simulation.policy_episode import policy_files

            files += [("policy", file) for file in policy_files(self.policy, self.normalize)]
        return files

    @cached_property
    def fingerprints(self) -> list[dict[str, object]]:
        """Path, size and hash of the document of a task and of each of `tables` at its first use."""
        return [{**fingerprint(self._stored(path)), "path": str(path)} for path in self._listed]

    def file_versions(self) -> dict[Path, list[int] | None]:
        """Returns the present version of each file of `fingerprints`."""
        return {path: file_version(str(self._stored(path))) for path in self._listed}

    def require_unchanged_files(self, versions: Mapping[Path, list[int] | None]) -> None:
        """Requires that no file of `fingerprints`, which are determined now, has changed since it had these versions.

        Raises:
          FileError: a file has changed; it is unknown which of its contents was read.
        """
        _ = self.fingerprints
        for path, version in self.file_versions().items():
            if versions.get(path) != version:
                raise FileError(path, "has changed while it was read", hint="run the command again")

    @property
    def _listed(self) -> list[Path]:
        """The document of a task, and `tables`."""
        document = self.source.path if isinstance(self.source, Task) else None
        return [*([document] if document else []), *(path for _, path in self.tables)]

    def load(self) -> mujoco.MjModel:
        """Returns the compiled model; with a policy, that of its episode."""
        return self.compile()[1] if self.episode is None else self.episode.model()

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        """Returns the specification, None for a compiled model, and the model; see `ModelSource.compile`."""
        try:
            return self.source.compile()
        except ModelError:
            if self.snapshot:
                replace(self, snapshot=None).source.compile()  # whose error names the original files
            raise

    def timeline(self, model: mujoco.MjModel, timestep: Fraction | None = None) -> Timeline:
        """Returns the timeline of this simulation.

        Args:
          timestep: the timestep if it is not that of `model` [s]; a replay depends on the model's own.
        """
        timestep = rational(model.opt.timestep) if timestep is None else timestep
        requested = self._requested_timeline(timestep)
        if self.episode is not None:
            return self.episode.timeline(timestep, requested)
        if requested is None and self.replay is not None:
            steps = int(self.replayed(model).steps[-1])
            if steps > LONG:
                advice = f"limit it with {option('duration')}, or correct its times with {option('map')}"
                raise UsageError(f"{option('replay')} lasts {steps:,} steps of {float(timestep):g} s\n{advice}")
            return Timeline.of_steps(timestep, steps)
        if requested is not None:
            return requested
        usual = Timeline.lasting(timestep, DURATION)
        require_countable(usual.steps, "duration")
        return usual

    def _requested_timeline(self, timestep: Fraction) -> Timeline | None:
        """Returns the timeline that the options request; None if they do not specify a length."""
        if self.steps is not None:
            timeline = Timeline.of_steps(timestep, self.steps)
        elif self.duration is not None:
            timeline = Timeline.lasting(timestep, self.duration)
        else:
            return None
        require_countable(timeline.steps, "duration" if self.steps is None else "steps")
        return timeline

    def stepper(self, model: mujoco.MjModel) -> Stepper:
        """Starts the simulation of `model`.

        Raises:
          UsageError: the recording was made with another model, or too short; an option requires one that is missing.
          FileError: a recording or a table cannot be read.
        """
        if self.control_dt is not None and self.controller is self.policy is None:
            raise UsageError(f"{option('control_dt')} requires {option('controller')}, which it calls periodically")
        self._require_partners()
        if self.episode is not None:
            return self.episode.stepper(model.opt.enableflags)
        if self.replay is None and isinstance(self.source, Task):
            text = clean(self.source.text)
            raise UsageError(f"{text} is a task: select a {option('policy')} for it: a file, zero or random")
        if self.replay is not None:
            return self._replay_controls(model) if self.replay_mode == CONTROLS else self._replay_states(model)
        data = self.initial_data(model)
        timestep = rational(model.opt.timestep)
        table = controller = None
        if self.ctrl_from is not None:
            with concerning("ctrl_from"):
                table = self._table(model)
        if self.controller is not None:
            is_loaded = isinstance(self.controller, RedirectedFunction)  # or else the caller may look at it afterwards
            function = own_copy(self.controller) if is_loaded else self.controller
            controller = PeriodicController(function, self.control_dt or timestep, timestep)
        control = ControlSources(timestep, data.ctrl.copy(), table, self._noise(model), controller)
        return PhysicsStepper(model, data, control, self._pushes(model))

    def _require_partners(self) -> None:
        """Raises UsageError if an option is given that has no effect without another one.

        Tables may be those of `replay` or of ghosts, which are read before.
        """
        replays_table = self.replay is not None and not is_recording(self._stored(self.replay))
        if not (replays_table or self._motions):
            for name in filter(lambda name: is_given(self, name), TABLE_READING):
                shown = f"{option(name)} requires a table for {option('replay')}"
                raise UsageError(
                    shown if self.replay is None else f"{shown}; a recording holds all of the state", (name,)
                )
        others = set[str]()  # whose partners are elsewhere
        if replays_table:
            others.add("ctrl_interpolation")  # of its columns ctrl/…
        if self.episode is not None:
            others.add("ctrl_noise_time")  # of the noise of the task, which checks it
        for each in RUN_REQUIREMENTS:
            if each.name not in others and is_given(self, each.name) and not is_given(self, each.partner):
                raise UsageError(each.message(), (each.name,))

    def notes(self, model: mujoco.MjModel) -> list[str]:
        """Returns information for the user before the simulation runs."""
        gains = self.position_control
        servos = [] if gains is None or {*parse_gains(gains)} == {*GAINS} else [servo_sentence(model)]
        states = None if self.replay is None else self.replayed(model)
        if states is None or isinstance(states, RecordingReader) or not states.note:
            return servos
        return [*servos, states.note]

    def remarks(self, model: mujoco.MjModel) -> list[str]:
        """Returns remarks for the user before the simulation runs."""
        pushes = self._pushes(model)
        useless = pushes.remarks(self.timeline(model).steps) if pushes else []
        replay = self.replay_remarks(model)
        episode = self.episode.remarks(self._requested_timeline(rational(model.opt.timestep))) if self.episode else []
        edited = edit_remarks(module_sources(self.code))
        return [*bugs_of_model(model), *self.start.remarks(model), *useless, *replay, *episode, *edited]

    def replayed(self, model: mujoco.MjModel) -> "RecordingReader | KinematicMotion":
        """Returns the recording, or the motion of `model` in a table or a demonstration.

        The file is opened once, and checked completely.

        Raises:
          UsageError: a recording is combined with another initial state; a table is not a motion of `model`.
          FileError: the file cannot be read.
        """
        assert self.replay is not None
        path = self._stored(self.replay)
        require_file_of("replay", self.replay)
        if not is_recording(path):
            try:
                return self.motion(path, model)
            except UsageError as error:
                is_of_map = error.path[:1] == ("map",) and len(error.path) > 1  # otherwise a hint
                is_of_rate = error.path == ("replay_rate",) and self.replay_rate is not None
                if not (is_of_map or is_of_rate):
                    error.path = ("replay",)
                raise
        for name in START:
            if is_given(self, name):
                raise UsageError(
                    OptionExclusion(("replay", name), "a recording holds all of the state").message(), (name,)
                )
        return self._recording

    @cached_property
    def demonstration(self) -> "DemonstratedEpisode | None":
        """States and actions of the demonstration that is replayed; None if it replays none.

        Raises:
          FileError: the demonstration cannot be read.
        """
        if self.replay is None:
            return None
        from mjrun.simulation.demonstration import names_demonstration, read_demonstration

        path = self._stored(self.replay)
        return read_demonstration(path, self.replay_rate) if names_demonstration(path) else None

    def motion(self, path: Path, model: mujoco.MjModel, texts: Sequence[str] | None = None) -> "KinematicMotion":
        """Reads the motion of `model` from a table or a demonstration, once.

        Fields that it lacks keep their initial values.

        Args:
          texts: map, instead of that of the simulation.

        Raises:
          UsageError: the table is not a motion of `model`.
          FileError: the table cannot be read.
        """
        from mjrun.physics.kinematic_samples import Interpolation
        from mjrun.simulation.demonstration import names_demonstration, read_demonstrated_motion
        from mjrun.simulation.mapped_table import read_motion, with_files

        texts = with_files(self.map, self._stored) if texts is None else texts
        key = (path, tuple(texts), model.opt.timestep, *state.sizes(model).values())
        if key not in self._motions:
            hold, hold_controls = self.replay_interpolation == "hold", self.ctrl_interpolation == "hold"
            interpolation = Interpolation(hold, hold_controls, self.replay_unwrap)
            start = self.initial_data(model)
            if names_demonstration(path):
                for name in filter(lambda name: texts if name == "map" else is_given(self, name), ("map", "quat")):
                    raise UsageError(f"{option(name)} applies to tables, not to the states of a demonstration")
                self._motions[key] = read_demonstrated_motion(path, model, start, self.replay_rate, interpolation)
            else:
                self._motions[key] = read_motion(path, model, start, texts, self.quat, self.replay_rate, interpolation)
        return self._motions[key]

    @cached_property
    def _recording(self) -> RecordingReader:
        return RecordingReader(str(self._stored(str(self.replay))))

    @cached_property
    def _motions(self) -> "dict[tuple[object, ...], KinematicMotion]":
        """Motions that have been read."""
        return {}

    def _replay_states(self, model: mujoco.MjModel) -> ReplayStepper:
        states = self.replayed(model)
        with concerning("replay"):
            if isinstance(states, RecordingReader):
                stepper = ReplayStepper(model, states, states.facts)
            else:
                stepper = ReplayStepper(model, states, simulated=False)
            stepper.require([self.timeline(model).steps])
            return stepper

    def _replay_controls(self, model: mujoco.MjModel) -> PhysicsStepper:
        """Starts physics from the first state, under the recorded controls and other inputs."""
        states = self.replayed(model)
        with concerning("replay"):
            if isinstance(states, RecordingReader):
                require_model(model, states, states.facts)
                require_timestep(model, states)
            elif not states.has_controls:
                expected = listing([f"ctrl/{name}" for name in control_names(model)]) or "none: it has no actuators"
                raise UsageError(
                    f"{clean(str(self.replay))} has no controls to replay; those of the model are {expected}"
                )
        data = mujoco.MjData(model)
        state.restore(model, data, states.state(0))
        timestep = rational(model.opt.timestep)
        inputs = RecordedInputs(model, states)
        control = ControlSources(timestep, data.ctrl.copy(), inputs, self._noise(model), inputs=inputs)
        return PhysicsStepper(model, data, control, self._pushes(model))

    def remarks_on_end(self, model: mujoco.MjModel) -> list[str]:
        """Returns remarks for the user on inputs that outlast the default duration."""
        if self.ctrl_from is None or self.has_end or self.until is not None:
            return []
        end, duration = self._table(model).end, float(self.timeline(model).duration)
        text = f"{clean(self.ctrl_from)} has controls until {end:g} s, of which {duration:g} s are simulated"
        return [f"{text}; {option('duration')} {end:g} simulates all"] if end > duration else []

    def replay_remarks(self, model: mujoco.MjModel) -> list[str]:
        """Returns remarks on the replay, if any."""
        if self.replay is None:
            return []
        states = self.replayed(model)
        again = self.replay_mode == CONTROLS
        held = self._held_inputs(model, int(states.steps[-1])) if again else []
        if not isinstance(states, RecordingReader):
            return [*states.remarks, *self._replaced_values(model, states.state(0)), *held]
        if states.facts.get("physics", physics := physics_fingerprint(model)) == physics:
            return held
        shown = "positions are the recorded ones, forces and energies are computed by this model"
        meaning = "the motion is computed by this model from the recorded inputs" if again else shown
        return [f"the recording was made with other physics: {meaning}", *held]

    def _replaced_values(self, model: mujoco.MjModel, first: np.ndarray) -> list[str]:
        """Returns remarks on initial positions and velocities that the `first` state of a replayed table replaces."""
        initial = state.save(model, self.start.data(model))
        texts = list[str]()
        for name, key, without in self.start.without_each(model):
            changed = initial != without
            if changed.any() and not (initial == first)[changed].any():
                texts.append(f"{option(name)} {clean(key)} does nothing: {clean(str(self.replay))} sets it")
        return texts

    def _held_inputs(self, model: mujoco.MjModel, last: int) -> list[str]:
        """Returns remarks on physics that continues after the `last` recorded step."""
        timeline = self.timeline(model)
        if timeline.steps <= last:
            return []
        end = f"{clean(str(self.replay))} ends at {float(timeline.time(last)):g} s"
        return [f"{end}; its last controls, applied forces and mocap poses hold from then on"]

    def _pushes(self, model: mujoco.MjModel) -> PushForces | None:
        return PushForces(model, self.push, rational(model.opt.timestep)) if self.push else None

    def _noise(self, model: mujoco.MjModel) -> ControlNoise | None:
        if not self.ctrl_noise:
            return None
        correlation = self.ctrl_noise_time or 0.0
        return ControlNoise(self.ctrl_noise, correlation, self.seed, model.opt.timestep, model.nu)

    def _table(self, model: mujoco.MjModel) -> ControlTable:
        from mjrun.simulation.mapped_table import read_controls

        path, linear = str(self.ctrl_from), self.ctrl_interpolation == "linear"
        require_file_of("ctrl_from", path)
        held = {n: [i for part in control_slices(model, n) for i in range(part.start, part.stop)] for n in self.ctrl}
        return read_controls(self._stored(path), model, path, held, linear=linear)


def require_simulation(value: object) -> None:
    """Raises UsageError if `value` is not a simulation but, for example, a model."""
    if not isinstance(value, Simulation):
        example = f"mjrun.Simulation({value!r})" if isinstance(value, str) else "mjrun.Simulation(…)"
        raise UsageError(f"simulation: {quoted(str(value))} is not a simulation; write {clean(example)}")


def require_file_of(name: str, path: str) -> None:
    """Raises UsageError if the value `path` of the option `name` is standard input, which can be read only once, or a
    URL.
    """
    if is_url(path):
        raise UsageError(f"{option(name)}: {clean(path)} is a URL; copy the file to this machine first")
    if path == STDIN:
        raise UsageError(f"{option(name)}: this file is read more than once, which standard input does not allow")


def require_whole(simulation: Simulation, product: str) -> None:
    """Raises UsageError if a condition ends `simulation`, which `product` does not support: "a view"."""
    require_without(simulation, ("until",), product)


def require_without(simulation: Simulation, names: Iterable[str], product: str) -> None:
    """Raises UsageError if one of these options of `simulation` is given, which `product` does not support."""
    for name in names:
        if is_given(simulation, name):
            raise UsageError(f"{option(name)} does not apply to {product}", (name,))


def require_countable(steps: int, name: str) -> None:
    """Raises UsageError if the option `name` requests more steps than floats can distinguish."""
    if steps > EXACT:
        raise UsageError(f"{option(name)}: more than {EXACT:.1g} steps, too many to count exactly in floating point")


@cache
def _kinds() -> Mapping[str, AnyKind]:
    return {each.attribute: each.kind for each in options_of(SimulationOptions)}


@cache
def _field_names() -> list[str]:
    return [each.name for each in fields(Simulation)]
