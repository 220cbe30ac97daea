"""Traces in memory: the table that `mjrun trace` writes, as arrays."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mjrun.errors import suggestion
from mjrun.formats.table import Table
from mjrun.model.sources import ModelLike
from mjrun.model.table_column import Column
from mjrun.options.option import options_of
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation
from mjrun.task.task import Task


def trace(model: ModelLike | Task | Simulation, **options: object) -> Table:
    """Simulates a model, and returns the table that `mjrun trace` writes, with the same numbers.

    Args:
      model: a model as in `mjrun.Simulation`, or a simulation.
      options: the options of `mjrun.Simulation` and `mjrun.Trace`; with `output`, the table is also written.

    Raises:
      TypeError: an option is unknown.
      MjrunError: as `mjrun.Trace(…).run()` raises.
    """
    simulated, measured = ({each.attribute for each in options_of(cls)} for cls in (Simulation, Trace))
    for name in options.keys() - simulated - measured:
        raise TypeError(f"trace: unknown option {name!r}{suggestion(name, sorted(simulated | measured))}")
    if isinstance(model, Simulation):
        if given := options.keys() - measured:
            raise TypeError(f"trace: the simulation has these options: {', '.join(sorted(given))}")
        simulation = model
    else:
        described: dict[str, Any] = {name: options[name] for name in options.keys() & simulated}
        simulation = Simulation(model, **described)
    rows = _Rows()
    chosen: dict[str, Any] = {name: options[name] for name in options.keys() & measured}
    Trace(simulation, written="output" in options, rows_to=rows.begin, **chosen).run()
    return rows.table()


class _Rows:
    """The rows of a trace, collected block by block."""

    def __init__(self) -> None:
        self._columns: Sequence[Column] = ()
        self._blocks: list[np.ndarray] = []

    def begin(self, columns: Sequence[Column]) -> Callable[[np.ndarray], object]:
        self._columns = columns
        return lambda block: self._blocks.append(block.copy())

    def table(self) -> Table:
        numbers = np.concatenate(self._blocks).T.copy()
        units = {column.name: column.unit for column in self._columns}
        return Table(dict(zip(units, numbers, strict=True)), units)
