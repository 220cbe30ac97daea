"""The command `mjrun diff --golden`, which compares a simulation with a golden table."""

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
    """Compare a simulation of MODEL with a golden table: a regression test in one line.

    \b
    mjrun diff --golden golden.csv scene.xml --update
    mjrun diff --golden golden.csv scene.xml
    mjrun diff --golden golden.parquet scene.xml --probe qpos,energy --rate 100 --rtol 1e-9

    Accepts the options of mjrun trace. Writes only the golden table, and only with --update. Exits with 1 if the two
    differ, and with 7 if the golden table does not exist.
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
