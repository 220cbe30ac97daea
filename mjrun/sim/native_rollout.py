"""Open-loop runs in C: blocks of rows, each row one instant.

`mujoco.batch` steps and records with the GIL released. Each of its records is taken after a step: the
state is then one step ahead of what was derived from it, so states are shifted back by one. With RK4 the
derived fields belong to an intermediate stage, and are computed anew from the recorded states instead.
"""

import copy
from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch
from mujoco.batch import SimulationError as BatchError

from mjrun.errors import SimulationError
from mjrun.model import state
from mjrun.sim.stepper import PhysicsStepper, Stepper

CHUNK = 4096  # steps of one block
FULL = 256  # rows that are worth handing on
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
# Fields that are part of the integration state, but for the inputs, which do not change by a step.
STATES = ("qpos", "qvel", "act", "history", "qacc_warmstart", "plugin_state", "plastic")

Block = Mapping[str, np.ndarray]


def blocks(
    stepper: PhysicsStepper, fields: Sequence[str], steps: int, chunk: int = CHUNK
) -> Iterator[tuple[int, int, Block]]:
    """Runs `steps` steps from where `stepper` stands, and yields every instant on the way, the last included.

    The numbers are bit for bit those of a bare loop that calls `mj_forward` on a copy at every step.

    Args:
      stepper: at the first instant; moved along as the blocks are taken.
      fields: names of MjData fields.
      chunk: steps per block.

    Yields:
      The step of the first row, the number n of rows, and `{field: (n, …)}` of instants a step apart.

    Raises:
      SimulationError: after every instant that was good.
    """
    first, count, waiting = stepper.step, 0, []
    failure: SimulationError | None = None
    try:
        for size, part in _parts(stepper, fields, stepper.step + steps, chunk):
            waiting.append(part)
            count += size
            if count >= min(FULL, chunk):
                yield first, count, _joined(waiting)
                first, count, waiting = first + count, 0, []
    except SimulationError as error:
        failure = error
    if count:
        yield first, count, _joined(waiting)
    if failure:
        raise failure


def _parts(stepper: PhysicsStepper, fields: Sequence[str], end: int, chunk: int) -> Iterator[tuple[int, Block]]:
    """The same in pieces of any length, and their lengths."""
    runner = None if stepper.model.opt.enableflags & SLEEP else Runner(stepper.model, fields, chunk)
    while stepper.step < end:
        at = stepper.step
        count = min(chunk, end - at, stepper.control.next(at) - at)
        block = runner.run(stepper, count) if runner else None
        if block is not None:
            yield count, block
            continue
        for step in range(at, at + count):  # something is amiss: step by step names it, or gets past it
            stepper.advance(step)
            yield 1, instant(stepper, fields)
        stepper.advance(at + count)
    yield 1, instant(stepper, fields)


def _joined(parts: Sequence[Block]) -> Block:
    return parts[0] if len(parts) == 1 else {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def instant(stepper: Stepper, fields: Sequence[str]) -> Block:
    """The fields of the instant where `stepper` stands: `{field: (1, …)}`."""
    data = stepper.instant()
    return {field: np.array(getattr(data, field))[None] for field in fields}


class Runner:
    """Steps a model in C, and records fields of every instant."""

    def __init__(self, model: mujoco.MjModel, fields: Sequence[str], size: int) -> None:
        self._derive = Derive(model, fields, size) if model.opt.integrator == RK4 else None
        self._fields, self._batch = fields, Batch(_bare(model) if self._derive else model, 1, 1)
        self._states = {field: self._batch.bind(field) for field in fields if field in STATES}
        self._record = [state.STATE] if self._derive else [*fields]
        self._controls = state.controls(model)

    def run(self, stepper: PhysicsStepper, count: int) -> Block | None:
        """The next `count` instants, with `stepper` moved past them; None, and no move, when MuJoCo warns."""
        start = stepper.state()
        self._batch.state[0] = start
        before = {field: values.copy() for field, values in self._states.items()}
        warned = self._batch.warning[0].copy()
        try:
            control = stepper.control.rows(stepper.step, count) if stepper.control.varies else None
            out = self._batch.rollout(count, None if control is None else control[None], record=self._record)
        except BatchError:
            return None
        if (self._batch.warning[0] != warned).any() or not self._is_good():
            return None
        stepper.jump(stepper.step + count, self._batch.state[0])
        if self._derive:
            states = np.concatenate([start[None], out[state.STATE][0, :-1]])
            if control is not None:  # a record holds the controls that led to it
                states[:, self._controls] = control
            return self._derive(states)
        shifted: Block = {field: np.concatenate([values, out[field][0, :-1]]) for field, values in before.items()}
        return {**{field: out[field][0] for field in self._fields}, **shifted}

    def _is_good(self) -> bool:
        # MuJoCo would warn of the last state only at the start of the next step.
        vectors = (self._batch.bind("qpos"), self._batch.bind("qvel"))
        return all((abs(vector) < mujoco.mjMAXVAL).all() for vector in vectors)


def _bare(model: mujoco.MjModel) -> mujoco.MjModel:
    """`model` as it is stepped when everything derived is computed afterwards."""
    bare = copy.copy(model)
    bare.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    return bare


class Derive:
    """Derived fields of recorded states, computed by `mj_forward` in C, many at a time."""

    def __init__(self, model: mujoco.MjModel, fields: Sequence[str], size: int) -> None:
        self._batch = Batch(model, size)
        self._fields = {field: self._batch.bind(field) for field in fields}

    def __call__(self, states: np.ndarray) -> Block:
        """The fields of `states` `(n, nstate)`."""
        count = len(states)
        self._batch.state[:count] = states
        self._batch.forward(np.arange(count))
        return {field: np.array(values[:count]) for field, values in self._fields.items()}
