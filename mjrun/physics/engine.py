"""Engines, which step n simulations at once and record them as blocks of rows: their interface, and MuJoCo as one.

`mujoco.batch` steps and records in C, on all cores, with the GIL released. It records after each step, when the state
is one step ahead of the quantities derived from it; states are therefore shifted back by one. With RK4 the derived
fields belong to an intermediate stage, and are computed from the recorded states instead.
"""

import copy
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from types import MappingProxyType
from typing import Protocol
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from mujoco.batch import Batch, RecordItem  # pyright: ignore[reportMissingTypeStubs]
from mujoco.batch import SimulationError as BatchError  # pyright: ignore[reportMissingTypeStubs]

from mjrun.dataclass import dataclass
from mjrun.errors import FailedStepError, SimulationError, UsageError
from mjrun.model import state
from mjrun.model.fields import VariedModel
from mjrun.model.state import is_bounded
from mjrun.physics.control import ControlArray, ControlSources
from mjrun.physics.stepper import RK4, SLEEP, PhysicsStepper
from mjrun.timeline import rational

BLOCK_STEPS = 4096  # the most steps in a block
SHORT_BLOCK_STEPS = 256  # the most steps between two instants at which the caller may end simulations
BLOCK_BYTES = 64 * 2**20  # memory for the rows of a block, unless a single row needs more

_rows = WeakKeyDictionary[mujoco.MjModel, dict[tuple[str, ...], int]]()  # bytes of rows, by recorded fields

Fields = Mapping[str, np.ndarray]
Models = mujoco.MjModel | Sequence[mujoco.MjModel] | VariedModel  # one for all simulations, or one for each
AUTORESET = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)
# Fields of the integration state that a step changes: all except the inputs.
STATE_FIELDS = ("qpos", "qvel", "act", "history", "qacc_warmstart", "plugin_state", "plastic")


@dataclass(frozen=True)
class RolloutBlock:
    """Consecutive rows of n simulations.

    Each row is one instant: the state at its step, and the derived fields computed from that state with the controls
    applied there.

    Attributes:
      steps: the step of each row, `(rows,)`.
      fields: MjData fields by name, `(n, rows, …)`.
      initial: the same fields at step 0, `(n, 1, …)`, for quantities relative to the start.
      counts: the number of valid rows of each simulation, `(n,)`; a failed simulation has fewer than the block.
      failures: the simulations that failed since the previous block, by index.
    """

    steps: np.ndarray
    fields: Fields
    initial: Fields
    counts: np.ndarray
    failures: Mapping[int, SimulationError] = field(default_factory=dict[int, SimulationError])


class Engine(Protocol):
    """An engine, which steps n simulations at once, for studies, fits and open-loop traces."""

    def rollout(
        self,
        models: Models,
        starts: np.ndarray,
        controls: np.ndarray | None,
        steps: int,
        record: Sequence[str],
        every: int = 1,
        running: np.ndarray | None = None,
    ) -> Iterator[RolloutBlock]:
        """Takes `steps` steps from each start, and yields the rows at steps 0, every, 2·every, … and at the last.

        A simulation that becomes unstable, or in which MuJoCo raises an error, ends there; the others continue. Memory
        does not grow with the number of steps. Energy is recorded where the model enables it.

        Args:
          models: one for each simulation, with the same sizes, or one for all of them; not changed.
          starts: integration states (`mjSTATE_INTEGRATION`), `(n, nstate)`.
          controls: those of every step, `(n, steps, nu)`; the ones in `starts` when None.
          steps: the number of steps.
          record: names of MjData fields that are arrays, `ncon` and `nefc`.
          every: steps from one row to the next.
          running: `(n,)` bool, all true: the engine clears those of failed simulations. The caller may clear others
            between blocks, which are then short; these simulations end there.

        Raises:
          UsageError: the engine cannot simulate these models.
        """
        ...


def joined(blocks: Iterable[RolloutBlock], rows: int) -> Iterator[RolloutBlock]:
    """Joins successive blocks into blocks of at most `rows` rows."""
    waiting: RolloutBlock | None = None
    for block in blocks:
        if waiting and len(waiting.steps) + len(block.steps) > rows:
            yield waiting
            waiting = None
        waiting = _joined(waiting, block) if waiting else block
    if waiting:
        yield waiting


def _joined(one: RolloutBlock, other: RolloutBlock) -> RolloutBlock:
    steps = np.concatenate([one.steps, other.steps])
    fields = {name: np.concatenate([values, other.fields[name]], axis=1) for name, values in one.fields.items()}
    failures = {**one.failures, **other.failures}
    return RolloutBlock(steps, fields, one.initial, one.counts + other.counts, failures)


def models_of(models: Models, count: int) -> Sequence[mujoco.MjModel]:
    """Returns the model of each of `count` simulations.

    Raises:
      ValueError: the number of models differs.
    """
    if isinstance(models, mujoco.MjModel):
        return [models] * count
    if isinstance(models, VariedModel):
        return [models.at(simulation) for simulation in range(count)]
    if len(models) != count:
        raise ValueError(f"{len(models)} models for {count} simulations")
    return models


def block_steps(model: mujoco.MjModel, record: Sequence[str], count: int) -> int:
    """Returns the number of steps of `count` simulations that fit in a block."""
    return int(np.clip(BLOCK_BYTES // max(1, count * _row_bytes(model, tuple(record))), 1, BLOCK_STEPS))


def _row_bytes(model: mujoco.MjModel, record: tuple[str, ...]) -> int:
    """Returns the size of a row of one simulation, and remembers it: an MjData takes longer than a short simulation."""
    sizes = _rows.setdefault(model, {})
    if record not in sizes:
        data = mujoco.MjData(model)
        sizes[record] = 8 * state.size(model) + sum(np.asarray(getattr(data, name)).nbytes for name in record)
    return sizes[record]


class CEngine:
    """An `Engine` in which every simulation is bit for bit that of a bare loop of `mj_step` on its model alone.

    Args:
      threads: the number of simulations stepped at the same time; one for each core when 0.
    """

    def __init__(self, threads: int = 0) -> None:
        self._threads = threads

    def rollout(
        self,
        models: Models,
        starts: np.ndarray,
        controls: np.ndarray | None,
        steps: int,
        record: Sequence[str],
        every: int = 1,
        running: np.ndarray | None = None,
    ) -> Iterator[RolloutBlock]:
        """Implements `Engine.rollout`.

        Raises:
          UsageError: the models have different sizes.
        """
        run = _Run(models, np.array(starts, float), controls, record, self._threads, running)
        longest = block_steps(run.models[0], record, len(starts))
        size = min(longest if running is None else SHORT_BLOCK_STEPS, longest, max(steps, 1))
        for first in range(0, steps, size):
            block = run.block(first, min(size, steps - first), every, size)
            if len(block.steps):
                yield block
            if not run.running.any():
                break
        yield run.last(steps)


@dataclass(frozen=True)
class StepRecords:
    """The records of some steps of n simulations.

    Attributes:
      fields: the fields of every instant, `(n, rows, …)`.
      states: the states after the last step, `(n, nstate)`.
      completed: the simulations without a warning of MuJoCo, `(n,)` bool; the others are still at their start, and
        their rows are invalid.
    """

    fields: dict[str, np.ndarray]
    states: np.ndarray
    completed: np.ndarray


class BatchStepper:
    """A batch of n simulations that steps in C, and records every instant.

    Args:
      models: one for each simulation, with automatic resets off and without sleeping bodies.
      record: names of MjData fields.
      size: maximum number of steps per call.
      threads: as in `CEngine`.
      arrays: arrays of the models that differ between simulations; see `VariedModel`.
    """

    def __init__(
        self,
        models: Sequence[mujoco.MjModel],
        record: Sequence[str],
        size: int,
        threads: int = 0,
        arrays: Mapping[str, np.ndarray] = MappingProxyType({}),
    ) -> None:
        self._models, self._record = models, record
        self._derived: _DerivedFields | None = None
        if any(model.opt.integrator == RK4 for model in models):
            repeated = {name: np.concatenate([values] * size) for name, values in arrays.items()}
            self._derived = _DerivedFields(_batch([*models] * size, threads, repeated), record, len(models))
            models = with_flags(models, leave_out=ENERGY)
        self._batch = _batch(models, threads, arrays)
        self._states = {name: self._batch.bind(name) for name in record if name in STATE_FIELDS}
        self._motion = self._batch.state[:, state.moving(models[0])]  # a view

    def run(
        self,
        states: np.ndarray,
        count: int,
        controls: np.ndarray | None,
        rows: slice = slice(None),
        ids: np.ndarray | None = None,
    ) -> StepRecords:
        """Takes `count` steps from `states` `(n, nstate)`.

        Args:
          controls: `(n, count, nu)`; those in the states when None.
          rows: the instants to return.
          ids: the simulations to step; all when None.
        """
        batch, n = self._batch, len(states)
        ids = np.arange(n) if ids is None else ids
        batch.state[:] = states
        before = {name: values.copy() for name, values in self._states.items()}
        warnings = batch.warning.copy()
        record = [state.STATE] if self._derived else self._record
        try:
            out = batch.rollout(count, None if controls is None else controls[ids], record=record, ids=ids)
        except BatchError as error:  # it discards the records of the other simulations too
            return self.run(states, count, controls, rows, np.setdiff1d(ids, error.ids))
        completed = np.zeros(n, bool)
        completed[ids] = True
        completed &= (batch.warning == warnings).all(axis=(1, 2))
        # MuJoCo checks the last state only at the start of the next step.
        completed &= (abs(self._motion) <= mujoco.mjMAXVAL).all(axis=1)
        if self._derived:
            instants = shifted(states[ids], out[state.STATE])
            if controls is not None:  # a record contains the controls before it
                instants[:, :, state.controls(self._models[0])] = controls[ids]
            fields = self._derived.of(instants[:, rows], ids)
        else:
            moved = {name: shifted(values[ids], out[name]) for name, values in before.items()}
            fields = {name: moved.get(name, out[name])[:, rows] for name in self._record}
        fields = {name: _spread(values, ids, n) for name, values in fields.items()}
        return StepRecords(fields, np.where(completed[:, None], batch.state, states), completed)

    def last(self, states: np.ndarray, ids: np.ndarray) -> dict[str, np.ndarray]:
        """Returns the fields `(k, 1, …)` of the instants at the states `(k, nstate)` of the simulations `ids` `(k,)`.

        Raises:
          mujoco.batch.SimulationError: MuJoCo raised an error on some of them; `error` has its message.
        """
        derived = self._derived or _DerivedFields(self._batch, self._record, len(self._models))
        return derived.of(states[:, None], ids)

    def error(self, simulation: int) -> str:
        """Returns the error message of MuJoCo on the last state of `simulation`."""
        return self._derived.error(simulation) if self._derived else self._batch.error(simulation)

    def extend(
        self, fields: Fields, at: int, start: np.ndarray, count: int, controls: np.ndarray | None
    ) -> np.ndarray | None:
        """Takes `count` steps of the only simulation, and writes the instants before them into `fields`.

        Args:
          fields: every recorded field, `(1, rows, …)`, as of `recorded_fields`.
          at: the row of the first instant; the row after the last one is overwritten.
          start: the state `(nstate,)` at the first instant.
          controls: as in `run`.

        Returns:
          The state after the last step, valid until the next call; None if a step failed or warned, and the rows are
          invalid.
        """
        if self._derived:
            recorded = self.run(start[None], count, controls)
            for name, values in recorded.fields.items():
                fields[name][:, at : at + count] = values
            return recorded.states[0] if recorded.completed[0] else None
        batch = self._batch
        states = batch.state
        states[0], warnings = start, batch.warning.tobytes()
        rows: dict[RecordItem, np.ndarray] = {}
        for name, values in fields.items():
            is_ahead = name in self._states  # of the derived fields in the same record
            if is_ahead:
                values[:, at] = self._states[name]
            rows[name] = values[:, at + is_ahead : at + is_ahead + count]
        try:
            batch.rollout(count, controls, record=self._record, out=rows)
        except BatchError:
            return None
        is_stable = batch.warning.tobytes() == warnings and is_bounded(self._motion[0])
        return states[0] if is_stable else None


def recorded_fields(model: mujoco.MjModel, record: Sequence[str]) -> Fields:
    """Returns an instance of each field, with the type of its records."""
    data = mujoco.MjData(model)
    values = {name: np.asarray(getattr(data, name)) for name in record}
    return {name: value if value.ndim else value.astype(np.int32) for name, value in values.items()}


class _DerivedFields:
    """Fields of recorded states of n simulations, computed by `mj_forward` in C.

    Args:
      batch: n simulations for each state of a simulation that is given per call.
      count: n.
    """

    def __init__(self, batch: Batch, record: Sequence[str], count: int) -> None:
        self._batch, self._count = batch, count
        self._fields = {name: batch.bind(name) for name in record}

    def error(self, simulation: int) -> str:
        """Returns the error message of MuJoCo on the first state of `simulation`."""
        return self._batch.error(simulation)

    def of(self, states: np.ndarray, ids: np.ndarray) -> dict[str, np.ndarray]:
        """Returns the fields `(k, rows, …)` of the states `(k, rows, nstate)` of the simulations `ids` `(k,)`.

        Raises:
          mujoco.batch.SimulationError: MuJoCo raised an error on some of them.
        """
        k, rows, size = states.shape
        slots = np.add.outer(np.arange(0, int(rows) * self._count, self._count), ids).reshape(-1)
        self._batch.state[slots] = states.swapaxes(0, 1).reshape(-1, size)
        self._batch.forward(slots)
        return {
            name: values[slots].reshape(rows, k, *values.shape[1:]).swapaxes(0, 1)
            for name, values in self._fields.items()
        }


class _Run:
    """The simulations of a rollout."""

    def __init__(
        self,
        models: Models,
        starts: np.ndarray,
        controls: np.ndarray | None,
        record: Sequence[str],
        threads: int,
        running: np.ndarray | None,
    ) -> None:
        self._arrays: Mapping[str, np.ndarray] = {}
        if isinstance(models, VariedModel):
            models, self._arrays = models.model, models.arrays
        self.models = with_flags(models_of(models, len(starts)), disable=AUTORESET)
        self._states, self._controls, self._record, self._threads = starts, controls, record, threads
        self.running = np.ones(len(starts), bool) if running is None else running
        self._failures: dict[int, SimulationError] = {}  # since the last block
        self._initial: Fields = {}
        self._batch: BatchStepper | None = None
        # States do not include which bodies sleep: these simulations stay in an MjData each, outside the batch.
        sleepy = [index for index, model in enumerate(self.models) if model.opt.enableflags & SLEEP]
        self._awake = with_flags(self.models, leave_out=SLEEP) if sleepy else self.models
        self._sleepers = {index: self._stepper(index, 0) for index in sleepy}

    def block(self, first: int, count: int, every: int, size: int) -> RolloutBlock:
        """Returns the rows of the `count` steps from `first`, at most `size` of them."""
        batch = self._recording(size)
        rows = slice(-first % every, count, every)
        steps = np.arange(first, first + count)[rows]
        controls = None if self._controls is None else self._controls[:, first : first + count]
        recorded = batch.run(self._states, count, controls, rows, self._ids())
        self._states = recorded.states
        counts = np.where(recorded.completed, len(steps), 0)
        for index in np.flatnonzero(self.running & ~recorded.completed).tolist():
            stepper = self._sleepers.get(index) or self._stepper(index, first)
            try:
                for row, step in enumerate(steps.tolist()):
                    stepper.advance(step)
                    _put(recorded.fields, index, row, stepper.instant())
                    counts[index] += 1
                stepper.advance(first + count)
            except SimulationError as error:
                self._fail(index, error)
            self._states[index] = stepper.state()
        return self._block(steps, recorded.fields, counts)

    def last(self, step: int) -> RolloutBlock:
        """Returns the row at the end, at `step`."""
        ids, batch = self._ids(), self._recording(1)
        try:
            fields = batch.last(self._states[ids], ids)
        except BatchError as error:
            for index in error.ids.tolist():
                time = float(self._states[index, 0])  # the time is first in a state
                self._fail(index, FailedStepError(step, time, batch.error(index)))
            return self.last(step)
        fields = {name: _spread(values, ids, len(self.models)) for name, values in fields.items()}
        for index, stepper in self._sleepers.items():
            if self.running[index]:
                _put(fields, index, 0, stepper.instant())
        return self._block(np.array([step]), fields, self.running.astype(int))

    def _recording(self, size: int) -> BatchStepper:
        """Returns the batch, which takes at most `size` steps per call if it does not exist yet."""
        self._batch = self._batch or BatchStepper(self._awake, self._record, size, self._threads, self._arrays)
        return self._batch

    def _ids(self) -> np.ndarray:
        """Returns the simulations that continue in C."""
        return np.array([index for index in np.flatnonzero(self.running) if index not in self._sleepers], int)

    def _stepper(self, index: int, step: int) -> PhysicsStepper:
        """Returns a stepper for simulation number `index`, from `step`."""
        model = VariedModel(self.models[index], self._arrays).at(index) if self._arrays else self.models[index]
        data = mujoco.MjData(model)
        state.restore(model, data, self._states[index])
        control = None
        if self._controls is not None and self._controls.shape[1]:
            table = ControlArray(self._controls[index])
            control = ControlSources(rational(model.opt.timestep), np.zeros(int(model.nu)), table)
        stepper = PhysicsStepper(model, data, control)
        stepper.jump(step, self._states[index])
        return stepper

    def _fail(self, index: int, error: SimulationError) -> None:
        self._failures[index] = error
        self.running[index] = False

    def _block(self, steps: np.ndarray, fields: dict[str, np.ndarray], counts: np.ndarray) -> RolloutBlock:
        self._initial = self._initial or {name: values[:, :1].copy() for name, values in fields.items()}
        failures = self._failures
        if len(steps):
            self._failures = {}
        return RolloutBlock(steps, fields, self._initial, counts, failures)


def with_flags(models: Sequence[mujoco.MjModel], disable: int = 0, leave_out: int = 0) -> Sequence[mujoco.MjModel]:
    """Returns `models` with `disable` among their disable flags and without `leave_out` among their enable flags.

    Models that change are copied, each once.
    """
    changed: dict[int, mujoco.MjModel] = {}
    for model in models:
        if id(model) not in changed:
            changed[id(model)] = model
            if ~model.opt.disableflags & disable or model.opt.enableflags & leave_out:
                changed[id(model)] = copy.copy(model)
                changed[id(model)].opt.disableflags |= disable
                changed[id(model)].opt.enableflags &= ~leave_out
    return [changed[id(model)] for model in models]


def _batch(
    models: Sequence[mujoco.MjModel], threads: int, arrays: Mapping[str, np.ndarray] = MappingProxyType({})
) -> Batch:
    """Creates a batch with a simulation of each of `models`.

    Args:
      arrays: arrays that differ between simulations of one model; see `VariedModel`.
    """
    batch = Batch(models[0], len(models), threads if len(models) > 1 else 1)
    if any(model is not models[0] for model in models):
        try:
            batch.set_models(models)
        except (ValueError, mujoco.FatalError) as error:
            raise UsageError(f"models of different sizes cannot be simulated side by side: {error}") from None
    for name, values in arrays.items():
        expanded = batch.expand(name)
        expanded[...] = values.reshape(expanded.shape)
    return batch


def shifted(first: np.ndarray, records: np.ndarray) -> np.ndarray:
    """Returns records `(n, rows, …)` taken after each step as records before it, beginning with `first` `(n, …)`."""
    return np.concatenate([first[:, None], records[:, :-1]], axis=1)


def _spread(values: np.ndarray, ids: np.ndarray, count: int) -> np.ndarray:
    """Returns `values` `(k, …)` of the simulations `ids`, with zeros for the others: `(count, …)`."""
    if len(ids) == count:
        return values
    full = np.zeros((count, *values.shape[1:]), values.dtype)
    full[ids] = values
    return full


def _put(fields: Mapping[str, np.ndarray], index: int, row: int, data: mujoco.MjData) -> None:
    """Writes the instant in `data` into a row of a simulation."""
    for name, values in fields.items():
        values[index, row] = getattr(data, name)
