"""Worlds of a task side by side: any number of episodes at once, stepped in C on all cores.

An episode is a function of the task, its seed and the actions: neither the number of worlds nor that of threads changes
a bit of it. At control instant k a policy observes and acts; the action is held for a control period; at instant k+1
rewards and terminations follow from what holds there, with the action and the commands that were in force.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch
from mujoco.batch import SimulationError as BatchError

from mjrun.errors import ModelError, UsageError, clean
from mjrun.model import state
from mjrun.model.fingerprint import model_fingerprint
from mjrun.model.mujoco_globals import without_timers
from mjrun.model.source import Source
from mjrun.model.variants import ModelVariants
from mjrun.options.task import CURRENT, LAGGED
from mjrun.physics.c_engine import AUTORESET, ENERGY, RK4, SLEEP
from mjrun.physics.stepper import BAD
from mjrun.probe.task_expression import TaskColumns
from mjrun.task.action_map import ActionMap, TargetTorques
from mjrun.task.command_signals import CommandSignals
from mjrun.task.episode import Ending, Endings
from mjrun.task.episode_start import EpisodeModels, EpisodeStarts
from mjrun.task.expressions import ACTION, COMMAND, NOTHING, RUNNING, Inputs, TaskExpressions
from mjrun.task.measurement import (
    ACCELERATION,
    ALL,
    NONE,
    POSITION,
    Measurement,
    MeasurementPlan,
    Rows,
    SensingSource,
    can_sense,
)
from mjrun.task.observation_vector import ObservationPlan, ObservationVector, ObservedNumber
from mjrun.task.task import Task

Ids = Sequence[int] | np.ndarray
SQUARE = mujoco.mjMAXVAL**2  # while the sum of squares is below, every number is below MuJoCo's limit


class TaskStep(NamedTuple):
    """What has come of a control period in k worlds; in one world alone where the axis of worlds is missing.

    Attributes:
      observations: at its end `(k, nobs)`. Those of a world that has become unstable are of its start.
      rewards: for it `(k,)`, the sums of the terms; 0 where the world has become unstable.
      reward_terms: weighted `(k, nterms)`.
      codes: which of `endings` ended each episode `(k,)`; −1 where it goes on.
      endings: all that there can be.
    """

    observations: np.ndarray
    rewards: Any
    reward_terms: Any
    codes: Any
    endings: "Endings"

    @property
    def ended(self) -> tuple[Ending | None, ...]:
        """How the episode ended in each world; None where it goes on."""
        if not self.over.any():
            return (None,) * len(self.codes)
        return tuple(None if code == RUNNING else self.endings[code] for code in self.codes.tolist())

    @property
    def over(self) -> Any:
        """Where the episode has ended `(k,)` bool."""
        return self.codes != RUNNING

    @property
    def terminated(self) -> Any:
        """Where it ended by what happened in it `(k,)` bool."""
        return self.endings.terminated[self.codes]

    @property
    def truncated(self) -> Any:
        """Where it was cut short `(k,)` bool."""
        return self.endings.truncated[self.codes]


class TaskWorlds:
    """`count` worlds of a task.

    Args:
      task: with its model.
      count: how many.
      threads: as many as there are cores when 0.

    Attributes:
      observation_names, action_names, reward_names: of the numbers that go in and out.
      observed: all about each number of the observations.
      actions: what each number of the action drives.
      commands: their names and values.
      endings: how episodes can end.
      control_steps: physics steps in a control period.

    Raises:
      UsageError: something in the task does not fit its model; the path says where it is written.
      ModelError: the model cannot be had.
      FileError: a table of commands cannot be read.
    """

    def __init__(self, task: Task, count: int, threads: int = 0) -> None:
        if count < 1:
            raise ValueError("there must be a world")
        self.task, self.count = task, count
        with task.located():
            self._prepare(threads)
        self._periods = task.periods
        self._threads = threads
        self._seeds = np.zeros(count, np.int64)
        self._begun = np.zeros(count, bool)
        self._instants = np.zeros(count, int)  # control instants since the reset
        self._actions = np.zeros((count, len(self.action_names)))  # in force, as the policy gave them
        self._targets = np.zeros_like(self._actions)
        self._observed = np.zeros((count, len(self.observed)))
        self._start_codes = np.full(count, RUNNING)
        self._over = np.ones(count, bool)  # not yet reset
        self._failed = np.zeros(count, bool)
        self._has_failed = False

    @property
    def observation_names(self) -> list[str]:
        """Of the numbers of an observation."""
        return [number.name for number in self.observed]

    @property
    def action_names(self) -> list[str]:
        """Of the numbers of an action: actuators or joints."""
        return self.actions.names

    @property
    def reward_names(self) -> list[str]:
        """Of the terms of the reward."""
        return [*self.task.rewards]

    @property
    def endings(self) -> "Endings":
        """How episodes can end."""
        return self._expressions.endings

    @property
    def ended_at_start(self) -> tuple[Ending | None, ...]:
        """Which termination held in each world at its last reset, before anything was done; None where none did."""
        return tuple(None if code == RUNNING else self.endings[code] for code in self._start_codes.tolist())

    @property
    def world_bytes(self) -> int:
        """About how much memory each world takes: its model, if it has one, and its MjData in a persistent batch."""
        model = 0 if self._models.is_one else 2 * mujoco.mj_sizeModel(self._first)  # as compiled, and as varied
        data = mujoco.MjData(self._first).nbuffer if self._is_persistent else 0
        return model + data

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are made again from the task, and go on where these worlds stand, to the last bit."""
        return type(self), (self.task, self.count, self._threads), self._saved()

    def __setstate__(self, saved: Mapping[str, Any]) -> None:
        """Goes on where other worlds of the task stood.

        Raises:
          ModelError: the model is not theirs.
        """
        if model_fingerprint(self._first) != saved["model"]:
            what = clean(self.task.model_source.text) or "the model"
            raise ModelError(f"{what} is not the model of the environment that was copied: its file has changed since")
        for array, values in zip(self._memory, saved["memory"], strict=True):
            array[...] = values
        self._observations.noise[:] = saved["noise"]
        self._has_failed = bool(self._failed.any())
        for world in np.flatnonzero(self._begun).tolist():
            if not self._models.is_one:
                self._each[world] = self._models.variant(int(self._seeds[world]))
            self._torques.begin(world, self._each[world].model)
        if not self._models.is_one:
            self._batch.set_models([variant.model for variant in self._each])

    def model(self, world: int) -> mujoco.MjModel:
        """The model of a world's episode until the next one begins there; not to be changed."""
        if self._own is self._models:
            return self._each[world].model
        return self._own.model(int(self._seeds[world]))

    def state(self, world: int) -> np.ndarray:
        """The integration state `(nstate,)` of a world, as a new array."""
        return self._batch.state[world].copy()

    # --- episodes ----------------------------------------------------------------------------------

    def reset(self, seeds: Sequence[int] | np.ndarray, ids: Ids | None = None) -> np.ndarray:
        """Begins an episode in each of the worlds `ids`, or of all.

        Args:
          seeds: of the episodes `(k,)`, whole numbers from 0 on.

        Returns:
          The first observations `(k, nobs)`.
        """
        worlds = self._all if ids is None else np.asarray(ids, int)
        if len(seeds) != len(worlds):
            raise ValueError(f"{len(seeds)} seeds for {len(worlds)} worlds")
        with self.task.located():
            self._load([int(seed) for seed in seeds], worlds)
        rows, some = (ALL, None) if ids is None else (worlds, worlds)
        chosen = _sorted(ids)
        self._instants[worlds], self._actions[worlds] = 0, 0
        self._over[worlds] = self._failed[worlds] = False
        self._counters[worlds] = 0
        self._call(lambda: self._batch.forward(chosen, self._stage_at_start))
        self._measurement.begin(rows)

        measured, inputs = self._measure(rows), self._inputs(worlds)
        columns = self._expressions.columns(measured[:, self._of_terms :], inputs)
        self._start_codes[worlds] = self._expressions.begin(columns, some, len(worlds))
        values = self._expressions.values(columns, some, first=True) if self._expressions.has_values else NOTHING
        observed = self._observations.observe(measured[:, : self._of_terms], inputs, values, worlds, first=True)
        self._observed[worlds] = observed
        return observed

    def step(self, actions: np.ndarray, ids: Ids | None = None) -> TaskStep:
        """A control period of the worlds `ids`, or of all: `begin`, `advance` and `finish`.

        Raises:
          ValueError: actions are not finite or do not fit, or an episode is over or has not begun.
        """
        self.begin(actions, ids)
        self._advance(self.control_steps, ids, self._stage)
        return self._finish(ids)

    def begin(self, actions: np.ndarray, ids: Ids | None = None) -> None:
        """Puts actions `(k, nact)` in force; raises what `step` does."""
        rows = ALL if ids is None else np.asarray(ids, int)
        actions = np.asarray(actions, float)
        shape = (self.count if ids is None else len(ids), *self._actions.shape[1:])
        if actions.shape != shape:
            raise ValueError(f"actions are {' x '.join(map(str, shape))} numbers, not {actions.shape}")
        if self._over[rows].any():
            raise ValueError("an episode is over, or has not begun: reset it")
        self._require_finite(actions, rows)
        self._actions[rows] = actions
        targets = self._targets[rows] = self.actions.targets(actions)
        self._torques.apply(targets, self._ctrl, rows)

    def advance(self, steps: int, ids: Ids | None = None) -> None:
        """Takes steps of the physics, under the actions in force."""
        self._advance(steps, ids, NONE)

    def finish(self, ids: Ids | None = None) -> TaskStep:
        """What has come of the control period, whose `control_steps` steps are taken."""
        if self._stage != NONE:
            some = _sorted(ids)
            self._call(lambda: self._batch.forward(some, self._stage))
        return self._finish(ids)

    # --- step by step ------------------------------------------------------------------------------

    def hold(self) -> None:
        """Puts the controls in force that the next step takes: those that hold targets follow the state."""
        if self._torques.is_needed:
            self._torques.hold(self._targets, self._qpos, self._qvel, self._ctrl, ALL)

    def put(self, world: int, whole: np.ndarray) -> None:
        """Puts a world into the integration state `whole` `(nstate,)`, whatever it has come from."""
        self._batch.state[world] = whole

    def is_unstable(self, world: int) -> bool:
        """Whether MuJoCo has given up on a world, or should have."""
        return bool(self._unstable(np.array([world]))[0])

    def resume(self) -> None:
        """Lets episodes go on that are over, unless they are unstable: without a reset, as if they were not."""
        self._over[:] = False

    # --- copies ------------------------------------------------------------------------------------

    @property
    def _memory(self) -> list[np.ndarray]:
        """All that steps change, but for the generators of noise."""
        own = [self._seeds, self._begun, self._instants, self._actions, self._targets, self._observed]
        own += [self._start_codes, self._over, self._failed, self._batch.state, self._batch.warning]
        parts = self.commands, self._expressions, self._observations, self._measurement
        return [*own, *(array for part in parts for array in part.memory)]

    def _saved(self) -> dict[str, Any]:
        if self._first.opt.enableflags & SLEEP and not self._over.all():
            raise UsageError(
                "an environment in which bodies sleep cannot be copied within an episode: MuJoCo's state does not hold "
                "which of them do\ncopy it before reset() or after the end of the episode"
            )
        memory = [array.copy() for array in self._memory]
        return {"model": model_fingerprint(self._first), "memory": memory, "noise": [*self._observations.noise]}

    # --- within ------------------------------------------------------------------------------------

    def _prepare(self, threads: int) -> None:
        """Looks up every name of the task, and makes the worlds."""
        task, count = self.task, self.count
        spec, model = task.compile()
        self.control_steps = task.control_steps(model)
        self.actions = ActionMap(task.actions, model)
        self.commands = CommandSignals(task.commands, task.control_dt, task.periods, count)
        names = self.actions.names, self.commands.names
        others = [*(f"{ACTION}{name}" for name in names[0]), *(f"{COMMAND}{name}" for name in names[1])]
        columns = TaskColumns(model, others, float(task.control_dt))
        plan = ObservationPlan(task.observations, model, columns, names[0], self.commands)
        self.observed: Sequence[ObservedNumber] = plan.numbers
        self._expressions = TaskExpressions(task, columns, plan.expressions, names, count)
        self._starts = EpisodeStarts(task.reset, model)

        self._of_terms = len(plan.measured)
        # A sensor's share of a step comes before the stages of RK4, behind which a step leaves everything else.
        is_rk4 = model.opt.integrator == RK4 or any(path == "opt.integrator" for path, _ in task.reset.vary)
        sensible = can_sense(spec, model) and not (is_rk4 and task.derived == LAGGED)
        measured = MeasurementPlan(model, [*plan.measured, *self._expressions.measured], sensible)
        self._batch = self._open(model, measured, threads)
        each = self._each  # no method of these worlds: that would be a cycle, which only Python's collector frees
        self._measurement = Measurement(self._batch, measured, lambda world: each[world].model)
        self._ctrl, self._qpos, self._qvel = (self._batch.bind(name) for name in ("ctrl", "qpos", "qvel"))
        self._counters = self._batch.warning
        self._warnings = self._counters[:, min(BAD) : max(BAD) + 1, 1]
        self._motion = self._batch.state[:, slice(*_ends(model, "qpos", "qvel"))]
        rotations = self._batch.bind("xmat") if plan.frames else None
        stage = max(measured.stage, POSITION if plan.frames else NONE)
        self._stage, at_start = (stage, stage) if task.derived == CURRENT else (NONE, ACCELERATION)
        self._stage_at_start = max(at_start, POSITION)
        self._observations = ObservationVector(plan, count, task.control_dt, rotations)
        self._torques = TargetTorques(self.actions, model, count)
        self._all = np.arange(count)

    def _open(self, model: mujoco.MjModel, plan: MeasurementPlan, threads: int) -> Batch:
        """The worlds, on models that compute all that is measured."""

        def prepare(model: mujoco.MjModel) -> None:
            model.opt.disableflags |= AUTORESET  # an unstable world ends instead
            model.opt.enableflags |= ENERGY if plan.needs_energy else 0

        task, source = self.task, self.task.model_source
        sensing: Source = SensingSource(source, plan.sensed) if plan.sensed else source
        self._models = EpisodeModels(sensing, task.reset.vary, ModelVariants(prepare))
        self._own = EpisodeModels(source, task.reset.vary, ModelVariants(prepare)) if plan.sensed else self._models
        first = self._models.variant(0)
        self._first = first.model
        self._each = [first] * self.count
        self._is_persistent = plan.is_whole or bool(model.opt.enableflags & SLEEP)
        return Batch(self._first, self.count, threads if self.count > 1 else 1, self._is_persistent)

    def _load(self, seeds: Sequence[int], worlds: np.ndarray) -> None:
        """Puts the models and states at the start of episodes into their worlds."""
        for seed, world in zip(seeds, worlds.tolist(), strict=True):
            variant = self._each[world]
            if not self._models.is_one:
                if variant.model is not self._first:
                    self._models.reuse(variant)
                variant = self._each[world] = self._models.variant(seed)
            self._seeds[world], self._begun[world] = seed, True
            self._batch.state[world] = self._starts.state(variant, seed)
            self._torques.begin(world, variant.model)
            self.commands.begin(world, seed)
            self._observations.begin_episode(world, seed)
        if not self._models.is_one:
            self._batch.set_models([variant.model for variant in self._each])

    def _advance(self, steps: int, ids: Ids | None, stage: int) -> None:
        """Takes steps, and computes what is derived of the state up to `stage`."""
        some = _sorted(ids)
        if not self._torques.is_needed:
            self._call(lambda: self._batch.step(some, steps, stage))
            return
        rows = ALL if ids is None else np.asarray(ids, int)
        targets = self._targets[rows]
        for step in range(steps):
            self._torques.hold(targets, self._qpos, self._qvel, self._ctrl, rows)
            last = step == steps - 1
            self._call(lambda last=last: self._batch.step(some, 1, stage if last else NONE))

    def _call(self, call: Callable[[], None]) -> None:
        """Makes a call of the batch; worlds in which MuJoCo gives up have failed."""
        try:
            with without_timers():
                call()
        except BatchError as error:
            self._failed[error.ids] = self._has_failed = True

    def _finish(self, ids: Ids | None) -> TaskStep:
        rows, some = (ALL, None) if ids is None else (np.asarray(ids, int), np.asarray(ids, int))
        worlds = self._all[rows]
        measured = self._measure(rows)
        in_force = self.commands.at(worlds, self._instants[rows])
        self._instants[rows] += 1
        after = self._inputs(worlds)
        columns = self._expressions.columns(measured[:, self._of_terms :], after._replace(commands=in_force))
        terms, codes = self._expressions.advance(columns, some, len(worlds))
        codes[(codes == RUNNING) & (after.instants >= self._periods)] = self.endings.timeout

        values = NOTHING
        if self._expressions.has_values:
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
        """Whether all of these worlds are stable, as far as a glance tells: if it does not, `_unstable` does."""
        motion = self._motion[rows]
        return np.vdot(motion, motion) < SQUARE and not self._has_failed and not self._warnings[rows].any()

    def _unstable(self, rows: Rows) -> np.ndarray:
        """Which worlds MuJoCo has given up on, or should have `(k,)` bool."""
        stable = (np.abs(self._motion[rows]) <= mujoco.mjMAXVAL).all(axis=-1)
        return self._failed[rows] | self._warnings[rows].any(axis=-1) | ~stable

    def _measure(self, rows: Rows) -> np.ndarray:
        """All columns of the model that are needed `(k, …)`."""
        measured = np.empty((len(self._all[rows]), self._measurement.count))
        self._measurement.read(rows, measured)
        return measured

    def _inputs(self, worlds: np.ndarray) -> Inputs:
        instants = self._instants[worlds]
        return Inputs(instants, self._actions[worlds], self.commands.at(worlds, instants))

    def _require_finite(self, actions: np.ndarray, rows: Rows) -> None:
        if math.isfinite(np.vdot(actions, actions)):  # a sum of squares is finite only if all of them are
            return
        finite = np.isfinite(actions)
        if finite.all():
            return
        row = int(np.argmin(finite.all(axis=1)))
        name = next(name for name, good in zip(self.action_names, finite[row], strict=True) if not good)
        value = actions[row, self.action_names.index(name)]
        raise ValueError(f"actions must be finite: {name} is {value} in world {self._all[rows][row]}")


def _sorted(ids: Ids | None) -> np.ndarray | None:
    """The ids as a batch takes them."""
    return None if ids is None else np.sort(np.asarray(ids, int))


def _ends(model: mujoco.MjModel, first: str, last: str) -> tuple[int, int]:
    """Where in an integration state neighbouring fields begin and end."""
    fields = state.fields(state.sizes(model))
    places = [fields[name] for name in (first, last) if name in fields]
    return (places[0].start, places[-1].stop) if places else (0, 0)


def _sum(terms: np.ndarray, count: int) -> np.ndarray:
    """The sum of `(nterms, k)`, term by term, so that it is the same for every k."""
    total = np.zeros(count)
    for term in terms:
        total += term
    return total
