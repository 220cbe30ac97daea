"""The columns that a trace of a model can have, as `trace --list` and `info --columns` show them."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from mjrun.cli.console import Console
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.model.source import Source


def show_columns(console: Console, source: "Source", as_json: bool, probes: Sequence[str] = ()) -> None:
    """Lists them, or those of `probes`, a line each, or as one document."""
    from mjrun.job.simulation import Simulation
    from mjrun.job.trace import columns

    listed = columns(Simulation(source), probes)
    if as_json:
        console.document({"columns": [asdict(column) for column in listed]})
        return
    width = max(len(clean(column.name)) for column in listed)
    for column in listed:
        owner = f"{column.kind} {column.id}" if column.kind else ""
        console.result(f"{clean(column.name):{width}}  {column.unit:8}  {owner:12}  {column.meaning}".rstrip())
