"""`mjrun trace`."""

from dataclasses import asdict

from mjrun.cli.click_command import MODEL, CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.list_columns import show_columns
from mjrun.cli.simulation_command import import_mujoco, make, payload_on_stdout, show, simulation, source, stem
from mjrun.errors import UsageError, clean, option
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.console import ConsoleOptions
from mjrun.options.output import CommandOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.trace import TraceCommandLineOptions, TraceOptions

WRITTEN = ("output", "contacts", "manifest", "recording", "save_key")


@command(
    "trace",
    TraceOptions,
    TraceCommandLineOptions,
    CommandOptions,
    SimulationOptions,
    ConfinementOptions,
    arguments=[MODEL],
)
def trace(console: Console, command_line: CommandLine) -> None:
    """Measure a simulation of MODEL: one row per instant, exact numbers, named columns.

    \b
    mjrun trace scene.xml --csv | head
    mjrun trace scene.xml -o run.parquet --probe 'qpos,energy,xpos[hand]'
    mjrun trace scene.xml -o run.csv --rate 100 --assert 'max(abs(energy/drift)) < 1e-3'
    """
    console.guard_stdout()
    import_mujoco()
    options = command_line.make(TraceCommandLineOptions)
    if options.list_:
        _list(console, command_line)
        return
    if options.verify:
        _verify(console, command_line)
        return
    piped = payload_on_stdout(command_line, "-")
    from mjrun.outputs.trace import Trace

    if options.csv:
        command_line = _as_csv(command_line)
    if command_line.make(CommandOptions).print_document:
        command_line = command_line.with_defaults(output=f"{stem(command_line)}.csv")
    job = command_line.make(Trace, simulation=simulation(command_line), command=console.command)
    result = make(console, command_line, job)
    if not piped or command_line.make(ConsoleOptions).json:
        show(console, command_line, result)


def _list(console: Console, command_line: CommandLine) -> None:
    from mjrun.outputs.trace import Trace

    _require_no_output(command_line, f"{option('list')} shows columns on standard output and measures nothing")
    probes = command_line.make(Trace, simulation=simulation(command_line)).probe if command_line.value("probe") else ()
    as_json, policy = command_line.make(ConsoleOptions).json, command_line.value("policy")
    show_columns(console, source(command_line), as_json, probes, policy)


def _verify(console: Console, command_line: CommandLine) -> None:
    _require_no_output(command_line, f"{option('verify')} compares states and measures nothing")
    from mjrun.cli.verification_report import lines
    from mjrun.simulation.verification import verify

    result = verify(simulation(command_line), console)
    if command_line.make(ConsoleOptions).json:
        console.document(asdict(result))
    elif console.verbosity >= 0:
        for line in lines(result):
            console.result(line)
    if not result.agrees:
        console.fail(1, "VerificationDifference", "\n".join(lines(result)))


def _require_no_output(command_line: CommandLine, why: str) -> None:
    written = [option(name) for name in WRITTEN if command_line.value(name) not in (None, "-")]
    if written:
        raise UsageError(f"{why}: leave out {', '.join(written)}")


def _as_csv(command_line: CommandLine) -> CommandLine:
    written = command_line.value("format")
    if written not in (None, "csv"):
        raise UsageError(
            f"{option('csv')} and {option('format')} {clean(str(written))} exclude each other: "
            f"{option('csv')} is short for {option('format')} csv"
        )
    return command_line.with_defaults(format="csv")
