"""`mjrun diff --golden`: a simulation against a golden table, with the options of `mjrun trace`."""

from mjrun.cli.click_command import MODEL, CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import import_mujoco, simulation
from mjrun.errors import Failure, GoldenDifferenceError
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.diff import DiffReportOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.trace import TraceOptions

UNWRITTEN = ("output", "format", "contacts", "keep_partial", "manifest")  # of a trace that is only compared


@command(
    TraceOptions,
    DiffReportOptions,
    SimulationOptions,
    ConfinementOptions,
    name="diff --golden",
    arguments=[MODEL],
    without=UNWRITTEN,
)
def diff_golden(console: Console, command_line: CommandLine) -> None:
    """Tell whether a simulation of MODEL still is what a golden table says: a regression test in one line.

    \b
    mjrun diff --golden golden.csv scene.xml --update
    mjrun diff --golden golden.csv scene.xml
    mjrun diff --golden golden.parquet scene.xml --probe qpos,energy --rate 100 --rtol 1e-9

    The options are those of mjrun trace; nothing is written but the golden table, and that with --update only. Exits
    with 1 when the two differ, with 7 when there is no golden table.
    """
    form = command_line.form("github")
    console.guard_stdout()
    import_mujoco()
    from mjrun.cli.diff_report import diff_report
    from mjrun.outputs.trace import Trace, TraceResult

    job = command_line.make(Trace, simulation=simulation(command_line), written=False, command=console.command)
    try:
        result = job.run(console)
    except GoldenDifferenceError as difference:
        (result,) = difference.results
        console.code = difference.exit_code
        console.report_failure(Failure.of(difference))
    assert isinstance(result, TraceResult)
    assert result.golden
    console.answer(diff_report(result.golden, every=console.verbosity > 0), form)
