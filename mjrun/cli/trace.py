"""`mjrun trace`."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjrun.cli import options, summaries, values
from mjrun.cli.column_list import show_columns
from mjrun.cli.console import Console
from mjrun.errors import BadValueError, UsageError, clean, listing

if TYPE_CHECKING:
    from mjrun.job.trace import TraceResult

FILES = ("output", "contacts", "manifest", "recording")  # options that name what is written


@click.command("trace", cls=options.SectionedCommand)
@options.model_argument
@options.table_options
@options.simulation_options
@options.duration_options
@options.model_options
@options.output_options
@click.pass_obj
def command(console: Console, /, as_json: bool, **given: Any) -> None:
    """Measure a simulation of MODEL: one row per instant, exact numbers, named columns.

    \b
    mjrun trace scene.xml --csv | head
    mjrun trace scene.xml -o run.parquet --probe qpos,energy,xpos[hand]
    mjrun trace scene.xml -o run.csv --rate 100 --assert 'max(abs(energy/drift)) < 1e-3'
    """
    console.guard_stdout()
    values.import_mujoco()
    if given["list_"]:
        _list(console, given, as_json)
        return
    piped = (given["output"] or "-") == "-"
    if as_json and piped:
        raise UsageError("--json and a table on standard output both want it; give -o FILE")
    result = _make(console, given)
    if as_json:
        console.document(asdict(result))
    elif not piped and console.verbosity >= 0:
        console.result(summaries.trace(result))


def _list(console: Console, given: dict[str, Any], as_json: bool) -> None:
    written = [f"--{name}" for name in FILES if given[name] not in (None, "-")]
    if written:
        raise UsageError(f"--list shows columns on standard output and measures nothing: leave out {listing(written)}")
    show_columns(console, values.source(given), as_json, _probes(given))


def _probes(given: dict[str, Any]) -> list[str]:
    """The names that --probe gives, each of which names something."""
    from mjrun.probe.select import split

    found = [split(text) for text in given["probes"]]
    for text, names in zip(given["probes"], found, strict=True):
        if not names:
            raise BadValueError("--probe", text, "a name of something to measure; --list shows what there is")
    return [name for names in found for name in names]


def _format(given: dict[str, Any]) -> str | None:
    if given["csv"] and given["format_"] not in (None, "csv"):
        raise UsageError(f"--csv and --format {clean(given['format_'])} exclude each other: --csv is --format csv")
    return "csv" if given["csv"] else given["format_"]


def _make(console: Console, given: dict[str, Any]) -> "TraceResult":
    from mjrun.job.trace import Trace
    from mjrun.probe.select import DEFAULT

    job = Trace(
        simulation=values.simulation(given),
        output=given["output"] or (f"{Path(given['model']).stem}.csv" if given["print_document"] else "-"),
        format=_format(given),
        probes=_probes(given) or DEFAULT,
        every=given["every"],
        rate=given["rate"],
        asserts=given["asserts"],
        keep_partial=given["keep_partial"],
        contacts=given["contacts"],
        manifest=given["manifest"],
        command=console.command,
    )
    return values.perform(console, given, job)
