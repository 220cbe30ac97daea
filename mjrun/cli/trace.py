"""`mjrun trace`."""

from mjrun.cli.column_list import show_columns
from mjrun.cli.command import MODEL, Given, command
from mjrun.cli.console import Console
from mjrun.cli.simulating import import_mujoco, make, payload_on_stdout, show, simulation, source, stem
from mjrun.errors import UsageError, clean, option
from mjrun.options.messages import MessageOptions
from mjrun.options.output import CommandOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.trace import TraceCommandOptions, TraceOptions

WRITTEN = ("output", "contacts", "manifest", "recording")


@command("trace", TraceOptions, TraceCommandOptions, CommandOptions, SimulationOptions, arguments=[MODEL])
def trace(console: Console, given: Given) -> None:
    """Measure a simulation of MODEL: one row per instant, exact numbers, named columns.

    \b
    mjrun trace scene.xml --csv | head
    mjrun trace scene.xml -o run.parquet --probe qpos,energy,xpos[hand]
    mjrun trace scene.xml -o run.csv --rate 100 --assert 'max(abs(energy/drift)) < 1e-3'
    """
    console.guard_stdout()
    import_mujoco()
    options = given.make(TraceCommandOptions)
    if options.list_:
        _list(console, given)
        return
    piped = payload_on_stdout(given, "-")
    from mjrun.job.trace import Trace

    if options.csv:
        given = _as_csv(given)
    if given.make(CommandOptions).print_document:
        given = given.otherwise(output=f"{stem(given)}.csv")
    result = make(console, given, given.make(Trace, simulation=simulation(given), command=console.command))
    if not piped or given.make(MessageOptions).json:
        show(console, given, result)


def _list(console: Console, given: Given) -> None:
    from mjrun.job.trace import Trace

    written = [option(name) for name in WRITTEN if given.value(name) not in (None, "-")]
    if written:
        raise UsageError(
            f"{option('list')} shows columns on standard output and measures nothing: leave out {', '.join(written)}"
        )
    probes = given.make(Trace, simulation=simulation(given)).probe if given.value("probe") else ()
    show_columns(console, source(given), given.make(MessageOptions).json, probes)


def _as_csv(given: Given) -> Given:
    written = given.value("format")
    if written not in (None, "csv"):
        raise UsageError(
            f"{option('csv')} and {option('format')} {clean(str(written))} exclude each other: "
            f"{option('csv')} is short for {option('format')} csv"
        )
    return given.otherwise(format="csv")
