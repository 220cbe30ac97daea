"""A stepper's simulation in C: blocks of rows between the calls of its controller, each row one instant."""

from collections.abc import Iterator, Sequence

import numpy as np

from mjrun.errors import SimulationError
from mjrun.physics.c_engine import SLEEP, RecordingBatch
from mjrun.physics.engine import BLOCK_STEPS, Fields
from mjrun.physics.stepper import PhysicsStepper, Stepper

FULL = 256  # rows that are worth handing on


def blocks(
    stepper: PhysicsStepper, record: Sequence[str], steps: int, size: int = BLOCK_STEPS
) -> Iterator[tuple[int, int, Fields]]:
    """Runs `steps` steps from where `stepper` stands, and yields every instant on the way, the last included.

    The numbers are bit for bit those of a bare loop that calls `mj_forward` on a copy at every step.

    Args:
      stepper: at the first instant; moved along as the blocks are taken.
      record: names of MjData fields.
      size: steps in a block, at most.

    Yields:
      The step of the first row, the number of rows, and `{field: (1, rows, …)}` of instants a step apart.

    Raises:
      SimulationError: after every instant that was good.
    """
    first, count, waiting = stepper.step, 0, list[Fields]()
    failure: SimulationError | None = None
    try:
        for length, fields in _pieces(stepper, record, stepper.step + steps, size):
            waiting.append(fields)
            count += length
            if count >= min(FULL, size):
                yield first, count, _joined(waiting)
                first, count, waiting = first + count, 0, []
    except SimulationError as error:
        failure = error
    if count:
        yield first, count, _joined(waiting)
    if failure:
        raise failure


def instant(stepper: Stepper, record: Sequence[str]) -> Fields:
    """The fields of the instant where `stepper` stands: `{field: (1, 1, …)}`."""
    data = stepper.instant()
    return {name: np.array(getattr(data, name))[None, None] for name in record}


def _pieces(stepper: PhysicsStepper, record: Sequence[str], end: int, size: int) -> Iterator[tuple[int, Fields]]:
    """The same in pieces of any length, and their lengths."""
    batch = None if stepper.model.opt.enableflags & SLEEP else RecordingBatch([stepper.model], record, size)
    while stepper.step < end:
        at = stepper.step
        count = min(size, end - at, stepper.steps_alike())
        fields = _in_c(batch, stepper, count) if batch else None
        if fields is not None:
            yield count, fields
            continue
        for step in range(at, at + count):  # something is amiss: step by step names it, or gets past it
            stepper.advance(step)
            yield 1, instant(stepper, record)
        stepper.advance(at + count)
    yield 1, instant(stepper, record)


def _in_c(batch: RecordingBatch, stepper: PhysicsStepper, count: int) -> Fields | None:
    """The next `count` instants, with `stepper` moved past them; None, and no move, when MuJoCo warns."""
    controls = stepper.control.rows(stepper.step, count)[None] if stepper.control.varies else None
    recorded = batch.run(stepper.state()[None], count, controls)
    if not recorded.completed.all():
        return None
    stepper.jump(stepper.step + count, recorded.states[0])
    return recorded.fields


def _joined(pieces: Sequence[Fields]) -> Fields:
    if len(pieces) == 1:
        return pieces[0]
    return {name: np.concatenate([piece[name] for piece in pieces], axis=1) for name in pieces[0]}
