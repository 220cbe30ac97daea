"""Worlds of a task side by side: any number of episodes at once, stepped in C on all cores.

An episode is a function of the task, its seed and the actions: neither the number of worlds nor that of threads changes
a bit of it. At control instant k a policy observes and acts; the action holds for a control period; rewards and
terminations are computed at instant k+1, with the action and the commands of that period.
"""

import copy
import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch
from mujoco.batch import SimulationError as BatchError

from mjrun.errors import BadValueError, ModelError, UsageError, clean, described_type, option
from mjrun.file_version import file_version
from mjrun.model import state
from mjrun.model.mujoco_globals import without_timers
from mjrun.model.source import ModelSource, model_fingerprint
from mjrun.model.variants import VariantLoader, model_bytes
from mjrun.options.task import CURRENT, LAGGED
from mjrun.physics.control import NEVER, ControlNoise, PushForces
from mjrun.physics.engine import AUTORESET, ENERGY
from mjrun.physics.stepper import BAD, RK4, SLEEP
from mjrun.platform.cores import available_cores
from mjrun.probe.task_expression import TaskVocabulary
from mjrun.task.action_map import ActionMap, TargetTorques
from mjrun.task.batch_columns import (
    ACCELERATION,
    ALL,
    NONE,
    POSITION,
    BatchColumns,
    MeasurementPlan,
    MjDataBatch,
    Rows,
    SourceWithSensors,
    can_sense,
)
from mjrun.task.episode import Ending, PossibleEndings
from mjrun.task.episode_start import EpisodeModels, EpisodeStarts
from mjrun.task.expressions import ACTION, COMMAND, NOTHING, RUNNING, ExpressionInputs, TaskExpressions
from mjrun.task.observation_plan import BatchObservations, ObservationPlan, ObservedNumber
from mjrun.task.random_streams import CommandSignals
from mjrun.task.task import Task
from mjrun.timeline import rational

Ids = Sequence[int] | np.ndarray
LARGEST_SEED = 2**63 - 1


class TaskStep(NamedTuple):
    """The results of a control period in k worlds; in a single world where the axis of worlds is missing.

    Attributes:
      observations: the observations at its end `(k, nobs)`; those at its start for a world that became unstable.
      rewards: the sums of the terms over the period `(k,)`; 0 where the world became unstable.
      reward_terms: weighted `(k, nterms)`.
      codes: the index in `endings` of the ending of each episode `(k,)`; −1 where it continues.
      endings: all possible endings.
    """

    observations: np.ndarray
    rewards: Any
    reward_terms: Any
    codes: Any
    endings: PossibleEndings

    @property
    def ended(self) -> tuple[Ending | None, ...]:
        """The ending of the episode in each world; None where it continues."""
        return _endings_of(self.codes, self.endings)

    @property
    def over(self) -> Any:
        """The worlds whose episode has ended, as a mask `(k,)`."""
        return self.codes != RUNNING

    @property
    def terminated(self) -> Any:
        """The worlds in which a termination ended the episode, as a mask `(k,)`."""
        return self.endings.terminated[self.codes]

    @property
    def truncated(self) -> Any:
        """The worlds in which the time limit ended the episode, as a mask `(k,)`."""
        return self.endings.truncated[self.codes]


class TaskWorlds:
    """`count` worlds of a task.

    Args:
      task: a task with its model.
      count: the number of worlds.
      threads: one for each core when 0.

    Attributes:
      observed: the source and the processing of each number of an observation.
      actions: the actuator of each number of an action.
      commands: their names and values.
      control_steps: physics steps in a control period.
      disturbances: noise on the controls, and pushes.

    Raises:
      UsageError: a part of the task does not fit its model; the error's path locates it.
      ModelError: the model cannot be loaded.
      FileError: a table of commands cannot be read.
    """

    def __init__(self, task: Task, count: int, threads: int = 0) -> None:
        if count < 1:
            raise ValueError("the number of worlds must be at least 1")
        self.task, self.count = task, count
        with task.located():
            self._prepare(threads)
        self._periods = task.periods
        self._threads, self._process = threads, os.getpid()
        self._seeds = np.zeros(count, np.int64)
        self._begun = np.zeros(count, bool)
        self._instants = np.zeros(count, int)  # control instants since the reset
        self._latest = 0  # none of them is later
        self._actions = np.zeros((count, len(self.action_names)))  # in force, as returned by the policy
        self._targets = np.zeros_like(self._actions)
        self._returned = np.zeros((count, int(self.actions.delays.max(initial=0)) + 1, len(self.action_names)))
        self._observed = np.zeros((count, len(self.observed)))
        self._start_codes = np.full(count, RUNNING)
        self._over = np.ones(count, bool)  # not yet reset
        self._failed = np.zeros(count, bool)
        self._has_failed = False

    @property
    def observation_names(self) -> list[str]:
        """The names of the numbers of an observation."""
        return [number.name for number in self.observed]

    @property
    def action_names(self) -> list[str]:
        """The names of the numbers of an action: actuators or joints."""
        return self.actions.names

    @property
    def reward_names(self) -> list[str]:
        """The names of the terms of the reward."""
        return [*self.task.rewards]

    @property
    def endings(self) -> PossibleEndings:
        """All possible endings of episodes."""
        return self._expressions.endings

    @property
    def ended_at_start(self) -> tuple[Ending | None, ...]:
        """The termination that held in each world right after its last reset; None where none did."""
        return _endings_of(self._start_codes, self.endings)

    @property
    def observations(self) -> np.ndarray:
        """The last observations of all worlds `(count, nobs)`, as a new array."""
        return self._observed.copy()

    @property
    def world_bytes(self) -> int:
        """The approximate memory of a world [bytes]: its own model, if any, and its MjData in a persistent batch."""
        model = 0 if self._models.is_one else model_bytes(self._first)
        data = mujoco.MjData(self._first).nbuffer if self._has_datas else 0
        return model + data

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are built from the task, and continue from the current instant, to the last bit."""
        return type(self), (self.task, self.count, self._threads), self._saved()

    def __setstate__(self, saved: Mapping[str, Any]) -> None:
        """Continues from the instant of other worlds of the task.

        Raises:
          ModelError: their model is a different one.
        """
        if model_fingerprint(self._first) != saved["model"]:
            what = clean(self.task.model_source.text) or "the model"
            raise ModelError(f"{what} is not the model of the copied environment: its file has changed since")
        for array, values in zip(self._memory, saved["memory"], strict=True):
            array[...] = values
        self._observations.noise[:] = saved["noise"]
        self._has_failed = bool(self._failed.any())
        self._latest = int(self._instants.max())
        for world in np.flatnonzero(self._begun).tolist():
            if not self._models.is_one:
                self._each[world] = self._models.variant(int(self._seeds[world]))
            self._torques.begin(world, self._each[world].model)
            self.disturbances.resume(world, int(self._seeds[world]), self._each[world].model)
        self._set_models()

    def model(self, world: int) -> mujoco.MjModel:
        """Returns the model of a world, valid until its next episode begins; it must not be changed."""
        if self._own is self._models:
            return self._each[world].model
        return self._own.model(int(self._seeds[world]))

    @property
    def nominal_model(self) -> mujoco.MjModel:
        """The model before the variations of episodes, if there are any."""
        return self.model(0) if self._models.is_one else self.task.load()

    def state(self, world: int) -> np.ndarray:
        """Returns the integration state `(nstate,)` of a world, as a new array."""
        return self._state[world].copy()

    # --- episodes ----------------------------------------------------------------------------------

    def reset(self, seeds: Sequence[int] | np.ndarray, ids: Ids | None = None) -> np.ndarray:
        """Begins an episode in each of the worlds `ids`, or in all.

        Args:
          seeds: the seeds of the episodes `(k,)`, non-negative integers.

        Returns:
          The first observations `(k, nobs)`.
        """
        self._require_threads()
        worlds = self._all if ids is None else np.asarray(ids, int)
        if len(seeds) != len(worlds):
            raise ValueError(f"{len(seeds)} seeds for {len(worlds)} worlds")
        with self.task.located():
            for seed, world in zip(seeds, worlds.tolist(), strict=True):
                self._load(int(seed), world)
            self._set_models()
        rows, some = (ALL, None) if ids is None else (worlds, worlds)
        chosen = _sorted(ids)
        self._instants[worlds], self._actions[worlds] = 0, 0
        self._over[worlds] = self._failed[worlds] = False
        self._counters[worlds] = 0
        self._call(lambda: self._batch.forward(chosen, self._stage_at_start))
        self._measurement.begin(rows)

        measured, inputs = self._measure(rows), self._inputs(rows)
        columns = self._expressions.columns(measured[:, self._of_terms :], inputs)
        self._start_codes[worlds] = self._expressions.begin(columns, some, len(worlds))
        values = self._expressions.values(columns, some, first=True) if self._expressions.has_values else NOTHING
        observed = self._observations.observe(measured[:, : self._of_terms], inputs, values, worlds, first=True)
        self._observed[worlds] = observed
        return observed

    def step(self, actions: np.ndarray, ids: Ids | None = None) -> TaskStep:
        """Steps the worlds `ids`, or all, by a control period.

        Raises:
          ValueError: an action is not finite or has the wrong shape, or an episode is over or has not begun.
        """
        self._require_threads()
        self._begin(actions, ids)
        self._advance(self.control_steps, ids, self._stage)
        return self._finish(ids)

    def _require_threads(self) -> None:
        """Raises UsageError in a fork of the process that created several worlds: it would wait for missing threads."""
        if self.count > 1 and self._process != os.getpid():
            raise UsageError(
                "this process is a fork of the one that created these worlds, and lacks their threads\n"
                "create them here, or continue a copy: copy.deepcopy(env)"
            )

    def _begin(self, actions: np.ndarray, ids: Ids | None) -> None:
        """Applies actions `(k, nact)`; raises the errors of `step`."""
        rows = ALL if ids is None else np.asarray(ids, int)
        actions = action_array(actions, (self.count if ids is None else len(ids), *self._actions.shape[1:]))
        if self._over[rows].any():
            raise ValueError("an episode is over, or has not begun: reset it")
        self._require_finite(actions, rows)
        self._actions[rows] = actions
        targets = self._targets[rows] = self.actions.targets(self._arrived(actions, rows))
        self._torques.apply(targets, self.disturbances.controls, rows)

    def _arrived(self, actions: np.ndarray, rows: Rows) -> np.ndarray:
        """Returns the actions `(k, nact)` that arrive as the policies return `actions`: earlier ones, if delayed."""
        if not self._has_delays:
            return actions
        self._returned[rows, 1:] = self._returned[rows, :-1]
        self._returned[rows, 0] = actions
        return self._returned[rows][:, self.actions.delays, np.arange(actions.shape[1])]

    # --- copies ------------------------------------------------------------------------------------

    @property
    def _memory(self) -> list[np.ndarray]:
        """All arrays that steps change; the generators of noise are separate."""
        own = [self._seeds, self._begun, self._instants, self._actions, self._targets, self._observed]
        own += [self._start_codes, self._over, self._failed, self._state, self._counters, self._returned]
        parts = self.commands, self._expressions, self._observations, self._measurement, self.disturbances
        return [*own, *(array for part in parts for array in part.memory)]

    def _saved(self) -> dict[str, Any]:
        if self._first.opt.enableflags & SLEEP and not self._over.all():
            raise UsageError(
                "an environment with sleeping bodies cannot be copied within an episode: MuJoCo's state does not "
                "include which bodies sleep\ncopy it before reset() or after the end of the episode"
            )
        memory = [array.copy() for array in self._memory]
        noise = copy.deepcopy(self._observations.noise)
        return {"model": model_fingerprint(self._first), "memory": memory, "noise": noise}

    # --- within ------------------------------------------------------------------------------------

    def _prepare(self, threads: int) -> None:
        """Looks up every name of the task, and creates the worlds."""
        task, count = self.task, self.count
        spec, model = task.compile()
        self.control_steps = task.control_steps(model)
        self.actions = ActionMap(task.actions, model)
        self.commands = CommandSignals(task.commands, task.control_dt, task.periods, count)
        names = self.actions.names, self.commands.names
        others = [*(f"{ACTION}{name}" for name in names[0]), *(f"{COMMAND}{name}" for name in names[1])]
        columns = TaskVocabulary(model, others, float(task.control_dt))
        plan = ObservationPlan(task.observations, model, columns, names[0], self.commands)
        self.observed: Sequence[ObservedNumber] = plan.numbers
        self._expressions = TaskExpressions(task, columns, plan.expressions, names, count)

        self._of_terms = len(plan.measured)
        # RK4: a step computes sensors before its stages, and leaves everything else as of the last stage.
        is_rk4 = model.opt.integrator == RK4 or any(path == "opt.integrator" for path, _ in task.reset.vary)
        sensible = can_sense(spec, model) and not (is_rk4 and task.derived == LAGGED)
        measured = self._plan = MeasurementPlan(model, [*plan.measured, *self._expressions.measured], sensible)
        self._batch = self._open(model, measured, threads)
        if state.sizes(self._first) != {**state.sizes(model), "nhistory": self._first.nhistory}:
            raise self._models.layout_error()
        self._starts = EpisodeStarts(task.reset, self._first)
        each = self._each  # a bound method would be a reference cycle, which only Python's collector frees
        self._measurement = BatchColumns(self._batch, measured, lambda world: each[world].model)
        self._measured = np.empty((count, self._measurement.count))  # in the step at hand
        self._state = self._batch.state
        self._numbers = self._state.reshape(-1)  # contiguous, unlike the motion in them
        self._ctrl, self._qpos, self._qvel = (self._batch.bind(name) for name in ("ctrl", "qpos", "qvel"))
        self._counters = self._batch.warning
        self._warnings = self._counters[:, min(BAD) : max(BAD) + 1, 1]
        self._motion = self._state[:, 1 : 1 + model.nq + model.nv]  # qpos and qvel, after the time
        self._rotations = self._batch.bind("xmat") if plan.rotated_terms else None
        self._stage_of_frames = POSITION if plan.rotated_terms else NONE
        stage = max(measured.stage, self._stage_of_frames)
        self._stage, at_start = (stage, stage) if task.derived == CURRENT else (NONE, ACCELERATION)
        self._stage_at_start = max(at_start, POSITION)
        self._observations = BatchObservations(plan, count, task.control_dt, self._rotations)
        self._torques = TargetTorques(self.actions, model, count)
        self.disturbances = WorldDisturbances(task, model, self._state, self._ctrl, self._batch.bind("xfrc_applied"))
        self._has_delays = bool(self.actions.delays.any())
        self._are_steps_alike = not (self._torques.is_needed or self.disturbances)  # of a control period
        self._all = np.arange(count)

    def _open(self, model: mujoco.MjModel, plan: MeasurementPlan, threads: int) -> Batch | MjDataBatch:
        """Creates the worlds, on models that compute all measured quantities."""
        task, source = self.task, self.task.model_source
        versions = {path: file_version(str(path)) for path in source.files} if task.reset.vary else {}

        def prepare(model: mujoco.MjModel) -> None:
            for path, version in versions.items():  # variations may compile the model again
                if file_version(str(path)) != version:
                    raise ModelError(f"{clean(str(path))} has changed since the task was loaded")
            model.opt.disableflags |= AUTORESET  # an unstable world ends its episode instead
            model.opt.enableflags |= ENERGY if plan.needs_energy else 0

        sensing: ModelSource = SourceWithSensors(source, plan.sensed) if plan.sensed else source
        self._models = EpisodeModels(sensing, task.reset.vary, VariantLoader(prepare))
        self._own = EpisodeModels(source, task.reset.vary, VariantLoader(prepare)) if plan.sensed else self._models
        first = self._models.variant(0)
        self._first = first.model
        self._each = [first] * self.count
        # Which bodies sleep is known to an MjData alone; so may be what models and plugins have in addition.
        sleeps = bool(model.opt.enableflags & SLEEP)
        self._has_datas = sleeps or (plan.needs_data and (model.nplugin > 0 or not self._models.is_one))
        if plan.needs_data and not sleeps:
            is_lagged = task.derived == LAGGED
            return MjDataBatch(self._first, self.count, threads or available_cores(), self._has_datas, is_lagged)
        return Batch(self._first, self.count, threads if self.count > 1 else 1, self._has_datas)

    def _load(self, seed: int, world: int) -> None:
        """Puts the initial state of an episode into a world, and draws its model, commands and noise."""
        if not 0 <= seed <= LARGEST_SEED:
            raise BadValueError(option("seed"), seed, f"a whole number from 0 to {LARGEST_SEED}")
        variant = self._each[world]
        if not self._models.is_one:
            if variant.model is not self._first:
                self._models.reuse(variant)
            variant = self._each[world] = self._models.variant(seed)
        if state.size(variant.model) != self._state.shape[1]:
            raise self._models.layout_error()
        self._seeds[world], self._begun[world] = seed, True
        self._state[world] = self._starts.state(variant, seed)
        self._returned[world] = 0
        self._torques.begin(world, variant.model)
        self.disturbances.begin(world, seed, variant.model)
        self.commands.begin(world, seed)
        self._observations.begin(world, seed)

    def _set_models(self) -> None:
        """Steps each world with the model of its episode.

        Raises:
          UsageError: the models have different layouts.
        """
        if self._models.is_one:
            return
        try:
            self._batch.set_models([variant.model for variant in self._each])
        except mujoco.FatalError:
            raise self._models.layout_error() from None

    def _advance(self, steps: int, ids: Ids | None, stage: int) -> None:
        """Takes steps, and computes derived quantities up to `stage`."""
        some = _sorted(ids)
        if self._are_steps_alike:
            self._call(lambda: self._batch.step(some, steps, stage))
            return
        rows = ALL if ids is None else np.asarray(ids, int)
        targets, worlds, first = self._targets[rows], self._all[rows], self._instants[rows] * self.control_steps
        step = 0
        while step < steps:
            count = steps - step
            if self._torques.is_needed:
                self._torques.hold(targets, self._qpos, self._qvel, self.disturbances.controls, rows)
                count = 1
            if self.disturbances:
                count = min(count, self.disturbances.apply(worlds, first + step))
            step += count
            until = stage if step == steps else NONE
            self._call(lambda count=count, until=until: self._batch.step(some, count, until))

    def _call(self, call: Callable[[], None]) -> None:
        """Calls the batch; worlds in which MuJoCo raises an error are marked as failed."""
        try:
            with without_timers():
                call()
        except BatchError as error:
            self._failed[error.ids] = self._has_failed = True

    def _finish(self, ids: Ids | None) -> TaskStep:
        rows, some = (ALL, None) if ids is None else (np.asarray(ids, int), np.asarray(ids, int))
        worlds = self._all[rows]
        measured = self._measure(rows)
        in_force = self.commands.at(worlds, self._instants[rows]) if self.commands.names else None
        self._instants[rows] += 1
        self._latest += 1
        inputs = after = self._inputs(rows)
        if in_force is not None:
            inputs = after._replace(commands=in_force)
        columns = self._expressions.columns(measured[:, self._of_terms :], inputs)
        terms, codes = self._expressions.advance(columns, some, len(worlds))
        if self._latest >= self._periods:
            self._latest = int(self._instants.max())
            codes[(codes == RUNNING) & (after.instants >= self._periods)] = self.endings.timeout

        values = NOTHING
        if self._expressions.has_values:
            if in_force is not None:
                columns = self._expressions.columns(measured[:, self._of_terms :], after)
            values = self._expressions.values(columns, some, first=False)
        observed = self._observations.observe(measured[:, : self._of_terms], after, values, worlds, first=False)
        if not self._is_surely_stable(rows):
            unstable = self._unstable(rows)
            codes[unstable], terms[:, unstable] = self.endings.unstable, 0
            observed[unstable] = self._observed[worlds[unstable]]
        self._observed[rows] = observed
        self._over[rows] = codes != RUNNING
        return TaskStep(observed, _sum(terms, len(worlds)), terms.T, codes, self.endings)

    def _is_surely_stable(self, rows: Rows) -> bool:
        """Returns True only if all of these worlds are stable; where False, `_unstable` decides for each."""
        is_bounded = mujoco.mju_norm(self._numbers) <= mujoco.mjMAXVAL
        return is_bounded and not self._has_failed and not self._warnings[rows].any()

    def _unstable(self, rows: Rows) -> np.ndarray:
        """Returns, as a mask `(k,)`, the worlds that MuJoCo reported, or whose numbers exceed its limit."""
        stable = (np.abs(self._motion[rows]) <= mujoco.mjMAXVAL).all(axis=-1)
        return self._failed[rows] | self._warnings[rows].any(axis=-1) | ~stable

    def _measure(self, rows: Rows) -> np.ndarray:
        """Returns all columns of the model that terms and expressions read `(k, columns)`."""
        measured = self._measured[: len(self._all[rows])]
        self._measurement.read(rows, measured)
        return measured

    def _inputs(self, rows: Rows) -> ExpressionInputs:
        instants = self._instants[rows]
        return ExpressionInputs(instants, self._actions[rows], self.commands.at(self._all[rows], instants))

    def _require_finite(self, actions: np.ndarray, rows: Rows) -> None:
        if math.isfinite(mujoco.mju_norm(actions.reshape(-1))):  # not if the squares overflow
            return
        finite = np.isfinite(actions)
        if finite.all():
            return
        row = int(np.argmin(finite.all(axis=1)))
        name = next(name for name, good in zip(self.action_names, finite[row], strict=True) if not good)
        value = actions[row, self.action_names.index(name)]
        where = f" in world {self._all[rows][row]}" if self.count > 1 else ""
        raise ValueError(f"actions must be finite: {name} is {value}{where}")


def action_array(actions: object, shape: tuple[int, ...]) -> np.ndarray:
    """Returns actions as an array of float64.

    Raises:
      ValueError: they are not numbers, or have another shape.
    """
    try:
        values = np.asarray(actions, float)
    except (TypeError, ValueError):
        raise ValueError(f"actions must be numbers of the shape {shape}, not {described_type(actions)}") from None
    if values.shape != shape:
        raise ValueError(f"actions must have the shape {shape}, not {values.shape}")
    return values


def _sorted(ids: Ids | None) -> np.ndarray | None:
    """Returns the ids in ascending order, as a batch requires."""
    return None if ids is None else np.sort(np.asarray(ids, int))


def _endings_of(codes: np.ndarray, endings: PossibleEndings) -> tuple[Ending | None, ...]:
    return tuple(None if code == RUNNING else endings[code] for code in codes.tolist())


def _sum(terms: np.ndarray, count: int) -> np.ndarray:
    """Returns the sum of `(nterms, k)`, term by term, so that it is the same for every k."""
    if not len(terms):
        return np.zeros(count)
    total = terms[0] + 0.0
    for term in terms[1:]:
        total += term
    return total


class WorldDisturbances:
    """Noise on the controls of n worlds, and forces on their bodies.

    Args:
      model: model of which those of the worlds are variants.
      states: integration states of the worlds `(n, nstate)`.
      ctrl: controls in them `(n, nu)`.
      forces: forces in them `(n, nbody, 6)`, as `xfrc_applied`.

    Attributes:
      controls: controls without noise `(n, nu)`; `ctrl` itself if there is no noise.

    Raises:
      UsageError: a push does not fit the model.
    """

    def __init__(
        self, task: Task, model: mujoco.MjModel, states: np.ndarray, ctrl: np.ndarray, forces: np.ndarray
    ) -> None:
        self._task, self._states, self._ctrl, self._forces = task, states, ctrl, forces
        self._timestep = rational(model.opt.timestep)
        PushForces(model, task.push, self._timestep)  # which finds its bodies
        self._is_noisy = bool(task.ctrl_noise)
        self.controls = ctrl.copy() if self._is_noisy else ctrl
        self._noises = dict[int, ControlNoise]()
        self._pushes = dict[int, tuple[PushForces, mujoco.MjData]]()
        self._until = np.zeros(len(states), int)  # step up to which the forces are known

    def __bool__(self) -> bool:
        return self._is_noisy or bool(self._task.push)

    @property
    def memory(self) -> list[np.ndarray]:
        """The controls without noise, if they are separate."""
        return [self.controls] if self._is_noisy else []

    def noise(self, world: int) -> ControlNoise | None:
        """Returns the noise in the episode of a world."""
        return self._noises.get(world)

    def pushes(self, world: int) -> PushForces | None:
        """Returns the pushes in the episode of a world."""
        return self._pushes[world][0] if world in self._pushes else None

    def begin(self, world: int, seed: int, model: mujoco.MjModel) -> None:
        """Begins the episode of `seed` in a world with this model, which is in its initial state."""
        if self._is_noisy:
            self.controls[world] = self._ctrl[world]
        self.resume(world, seed, model)

    def resume(self, world: int, seed: int, model: mujoco.MjModel) -> None:
        """Continues the episode of `seed` in a world with this model."""
        task = self._task
        if self._is_noisy:
            std, correlation = task.ctrl_noise or 0.0, task.ctrl_noise_time or 0.0
            self._noises[world] = ControlNoise(std, correlation, seed, model.opt.timestep, model.nu)
        if task.push:
            self._pushes[world] = PushForces(model, task.push, self._timestep), mujoco.MjData(model)
        self._until[world] = 0

    def apply(self, worlds: np.ndarray, steps: np.ndarray) -> int:
        """Sets controls and forces of `worlds` `(k,)` at `steps` `(k,)`; returns for how many steps they hold."""
        holds = NEVER
        for world, step in zip(worlds.tolist(), steps.tolist(), strict=True):
            if self._is_noisy:
                self._ctrl[world] = self.controls[world] + self._noises[world].rows(step, 1)[0]
                holds = 1
            if self._task.push:
                if step >= self._until[world]:
                    self._push(world, step)
                holds = min(holds, int(self._until[world]) - step)
        return holds

    def _push(self, world: int, step: int) -> None:
        pushes, data = self._pushes[world]
        state.restore(pushes.model, data, self._states[world])
        self._forces[world] = pushes.on_bodies(data, step)
        self._until[world] = pushes.next_change(step)
