"""The interface of engines, which step n simulations at once and record them as blocks of rows."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from typing import Protocol
from weakref import WeakKeyDictionary

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import SimulationError
from mjrun.model import state
from mjrun.model.fields import VariedModel

BLOCK_STEPS = 4096  # the most steps in a block
SHORT_BLOCK_STEPS = 256  # the most steps between two instants at which the caller may end simulations
BLOCK_BYTES = 64 * 2**20  # memory for the rows of a block, unless a single row needs more

_rows = WeakKeyDictionary[mujoco.MjModel, dict[tuple[str, ...], int]]()  # bytes of rows, by recorded fields

Fields = Mapping[str, np.ndarray]
Models = mujoco.MjModel | Sequence[mujoco.MjModel] | VariedModel  # one for all simulations, or one for each


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
