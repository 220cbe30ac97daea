"""The columns that a trace of a model can have, as `trace --list` and `info --columns` show them."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from mjrun.cli.console import Console
from mjrun.errors import clean
from mjrun.options.policy import ZERO

if TYPE_CHECKING:
    from mjrun.model.source import Source


def show_columns(
    console: Console, source: "Source", as_json: bool, probes: Sequence[str] = (), policy: object = None
) -> None:
    """Lists them, or those of `probes`, a line each, or as one document.

    Those of a task do not depend on the policy.
    """
    from mjrun.outputs.trace import columns
    from mjrun.simulation.simulation import Simulation
    from mjrun.task.task import Task

    listed = columns(Simulation(source, policy=ZERO if isinstance(source, Task) else policy), probes)
    if as_json:
        console.document({"columns": [asdict(column) for column in listed]})
        return
    width = max(len(clean(column.name)) for column in listed)
    for column in listed:
        owner = f"{column.kind} {column.id}" if column.kind else ""
        console.result(f"{clean(column.name):{width}}  {column.unit:8}  {owner:12}  {column.meaning}".rstrip())
