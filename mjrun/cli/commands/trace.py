"""Measure a simulation as a table with named columns."""

import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from mjrun.cli.click_command import MODEL, ON_FILES, ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console, flag
from mjrun.cli.simulation_command import (
    import_mujoco,
    make_outputs,
    payload_on_stdout,
    show,
    show_columns,
    simulation,
    source,
    stem,
    summary,
)
from mjrun.cli.table_cells import numbers, texts
from mjrun.errors import UsageError, clean, option
from mjrun.options.output import SimulationCommandOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.trace import TraceCommandLineOptions, TraceOptions

if TYPE_CHECKING:
    import numpy as np

    from mjrun.model.table_column import Column
    from mjrun.simulation.verification import StateDifference, VerificationResult

LISTED = 40  # columns of a summary
WRITTEN = ("output", "contacts", "manifest", "recording", "save_key")


@command(
    TraceOptions,
    TraceCommandLineOptions,
    SimulationCommandOptions,
    SimulationOptions,
    *ON_FILES,
    arguments=[MODEL],
    python="Trace",
    key="traces",
    reports={"trace": "mjrun.outputs.trace:TraceResult", "verify": "mjrun.simulation.verification:VerificationResult"},
)
def trace(console: Console, command_line: ParsedCommandLine) -> None:
    """Measure a simulation of MODEL: one row per instant, exact numbers, named columns. A terminal gets the range of
    each column instead.

    \b
    mjrun trace scene.xml --csv | head
    mjrun trace scene.xml -o run.parquet --probe 'qpos,energy,xpos[hand]'
    mjrun trace scene.xml -o run.csv --rate 100 --assert 'max(abs(energy/drift)) < 1e-3'
    """
    import_mujoco()
    options = command_line.make(TraceCommandLineOptions)
    if options.list_:
        _list(console, command_line, groups=not options.all_)
        return
    if options.all_:
        raise UsageError(f"{option('all')} requires {option('list')}")
    if options.verify:
        _verify(console, command_line)
        return
    if _is_for_reading(command_line):
        _summarize(console, command_line)
        return
    piped = payload_on_stdout(command_line, "-")
    from mjrun.outputs.trace import Trace

    if options.csv:
        command_line = _as_csv(command_line)
    if command_line.make(SimulationCommandOptions).print_document:
        command_line = command_line.with_defaults(output=f"{stem(command_line)}.csv")
    request = command_line.make(Trace, simulation=simulation(command_line), command=console.command)
    result = make_outputs(console, command_line, request)
    if not piped or console.document_form:
        show(console, command_line, result)


def _is_for_reading(command_line: ParsedCommandLine) -> bool:
    """Returns whether the rows would only fill the user's terminal."""
    chosen = any(command_line.value(name) for name in ("output", "format", "csv", "print_document"))
    return not chosen and not command_line.document_form and sys.stdout.isatty()


def _summarize(console: Console, command_line: ParsedCommandLine) -> None:
    """Prints the range of each column instead of the rows."""
    from mjrun.cli.terminal_layout import TerminalReport
    from mjrun.outputs.trace import Trace
    from mjrun.plotting.table_statistics import TableStatisticsAccumulator

    measured: list[tuple[TableStatisticsAccumulator, list[str]]] = []

    def begin(columns: "Sequence[Column]") -> "Callable[[np.ndarray], object]":
        counter = TableStatisticsAccumulator([column.name for column in columns])
        measured.append((counter, [column.unit for column in columns]))
        return counter.feed

    request = command_line.make(
        Trace, simulation=simulation(command_line), written=False, rows_to=begin, command=console.command
    )
    result = make_outputs(console, command_line, request)
    ((counter, units),) = measured
    rows = counter.statistics(units)
    page = TerminalReport()
    shown = [
        texts("column", [row.name for row in rows]),
        texts("unit", [row.unit for row in rows]),
        *(
            numbers(name, [getattr(row, field) for row in rows], "")
            for name, field in (("least", "least"), ("largest", "largest"), ("mean", "mean"), ("last", "last"))
        ),
    ]
    page.table("columns", shown, len(rows), LISTED, f"{flag('probe')} selects columns")
    page.note(summary(result))
    page.note(f"{flag('csv')} prints the rows, {flag('output')} FILE writes them")
    console.result(page.text())


def _list(console: Console, command_line: ParsedCommandLine, *, groups: bool) -> None:
    from mjrun.outputs.trace import Trace

    _require_no_output(command_line, f"{option('list')} shows columns on standard output and measures nothing")
    probes = command_line.make(Trace, simulation=simulation(command_line)).probe if command_line.value("probe") else ()
    show_columns(console, source(command_line), probes, command_line.value("policy"), groups=groups and not probes)


def _verify(console: Console, command_line: ParsedCommandLine) -> None:
    _require_no_output(command_line, f"{option('verify')} compares states and measures nothing")
    from mjrun.simulation.verification import verify

    result = verify(simulation(command_line), console)
    report = CommandReport("verify", result, summary=lambda: "\n".join(verification_lines(result)))
    console.answer(report)
    if not result.agrees:
        console.fail(1, "VerificationDifference", report.summary())


def verification_lines(result: "VerificationResult") -> Iterator[str]:
    """Formats the verdict, the differences at the first differing step, and the changed circumstances."""
    path, steps = clean(result.path), f"{result.steps} step{'s' * (result.steps != 1)}"
    if result.agrees:
        every = "" if result.states == result.steps + 1 else f" at its {result.states} states"
        yield f"{path}: stepped again, and the same: {steps}, bit for bit{every}"
    else:
        yield f"{path}: stepped again, and not the same: the first difference is at {_place(result)}"
        yield from map(_difference, result.differences)
    yield from (f"  {text}" for text in result.origins)


def _difference(field: "StateDifference") -> str:
    others = f" (and {field.count - 1} more of {field.field})" if field.count > 1 else ""
    if field.stepped is None:
        values = f"recorded {field.recorded!r}, stepped to what is not finite"
    else:
        apart = abs(field.recorded - field.stepped)
        values = f"recorded {field.recorded!r}, stepped {field.stepped!r}, {apart:.3g} apart"
    return f"  {clean(field.name)}: {values}{others}"


def _place(result: "VerificationResult") -> str:
    return f"step {result.steps}, time {result.time:.9g} s"


def _require_no_output(command_line: ParsedCommandLine, why: str) -> None:
    written = [option(name) for name in WRITTEN if command_line.value(name) not in (None, "-")]
    if written:
        raise UsageError(f"{why}: leave out {', '.join(written)}")


def _as_csv(command_line: ParsedCommandLine) -> ParsedCommandLine:
    written = command_line.value("format")
    if written not in (None, "csv"):
        raise UsageError(
            f"{option('csv')} and {option('format')} {clean(str(written))} exclude each other: "
            f"{option('csv')} is short for {option('format')} csv"
        )
    return command_line.with_defaults(format="csv")
