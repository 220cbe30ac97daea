"""The end of a simulation at the first step at which its condition `until` holds."""

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mjrun.errors import SimulationError, concerning, option
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline

if TYPE_CHECKING:
    from mjrun.probe.row_expression import Condition


class EndCondition:
    """A condition that ends simulations at the first row on which it holds.

    Attributes:
      columns: columns that it reads, except the time.
    """

    def __init__(self, condition: "Condition") -> None:
        self._condition = condition
        self.columns = [name for name in condition.columns if name != "time"]

    @classmethod
    def of(cls, simulation: Simulation, model: mujoco.MjModel) -> "EndCondition | None":
        """Returns the condition of a simulation in the names of `model`; None if it has none.

        Raises:
          UsageError: the condition is malformed, or contains an unknown name.
        """
        if simulation.until is None:
            return None
        from mjrun.probe.row_expression import parse_condition  # which few simulations need
        from mjrun.probe.vocabularies import AvailableProbes

        available = AvailableProbes(model, simulation.episode.columns.names if simulation.episode else ())
        with concerning("until"):
            return cls(parse_condition(simulation.until, available, option("until")))

    def counts(self, names: Sequence[str], tables: np.ndarray, valid: np.ndarray) -> np.ndarray:
        """Returns the number of rows `(n,)` of each table up to the first on which it holds; 0 if it holds on none.

        Args:
          names: names of the columns.
          tables: rows `(n, rows, columns)`.
          valid: number of valid rows of each table, `(n,)`.
        """
        count, rows = len(tables), int(tables.shape[1])
        columns = dict(zip(names, np.ascontiguousarray(tables.reshape(count * rows, -1).T), strict=True))
        is_valid = np.arange(rows) < valid.reshape(count, 1)
        holds = is_valid & np.broadcast_to(self._condition.holds(columns), count * rows).reshape(count, rows)
        return np.where(holds.any(axis=1), holds.argmax(axis=1) + 1, 0)


def final_timeline(simulation: Simulation, model: mujoco.MjModel) -> Timeline:
    """Returns the timeline of a simulation with its real end; with a condition, the simulation runs up to there.

    Raises:
      UsageError: the condition is malformed, or contains an unknown name.
    """
    timeline, condition = simulation.timeline(model), EndCondition.of(simulation, model)
    if condition is None:
        return timeline
    episode = simulation.episode.columns if simulation.episode else None
    sampler, done = ProbeSampler(model, condition.columns, timeline, episode), 0
    with collected_warnings(), suppress(SimulationError):  # which the outputs report if they precede the end
        stepper = simulation.with_controller_copies.stepper(sampler.model)
        for block in sampler.blocks(stepper, range(timeline.steps + 1)):
            table = block().values
            if count := int(condition.counts(sampler.names, table[None], np.array([len(table)]))[0]):
                return Timeline.of_steps(timeline.timestep, done + count - 1)
            done += len(table)
    return timeline
