"""Compare two results: tables, recordings, videos, images, models."""

from typing import Any

import click

from mjrun.cli.click_command import MODEL, ON_FILES, DeclaredCommand, ModelArgument, ParsedCommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import import_mujoco, simulation
from mjrun.errors import FailureReport, GoldenDifferenceError
from mjrun.options.diff import DiffOptions
from mjrun.options.every_command import opened_file
from mjrun.options.report import REPORT_FORMATS, ReportFormatOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.trace import TraceOptions

GOLDEN = "--golden"
DIFFERENT = 1  # exit code
UNWRITTEN = ("output", "format", "contacts", "keep_partial", "manifest")  # of a trace that is only compared
PAIR = [ModelArgument("a", metavar="A"), ModelArgument("b", metavar="B")]


class _DiffCommand(DeclaredCommand):
    """The command `diff`; with --golden a different command, with the options of a trace."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        if any(arg == GOLDEN or arg.startswith(f"{GOLDEN}=") for arg in args):
            asks_for_help = {"-h", "--help"} & {*args}
            return diff_golden.make_context(info_name, ["--help"] if asks_for_help else args, parent, **extra)
        return super().make_context(info_name, args, parent, **extra)


@command(
    TraceOptions,
    ReportFormatOptions,
    SimulationOptions,
    *ON_FILES,
    name="diff --golden",
    arguments=[MODEL],
    without=UNWRITTEN,
)
def diff_golden(console: Console, command_line: ParsedCommandLine) -> None:
    """Compare a simulation of MODEL with a golden table: a regression test in one line.

    \b
    mjrun diff --golden golden.csv scene.xml --update
    mjrun diff --golden golden.csv scene.xml
    mjrun diff --golden golden.parquet scene.xml --probe qpos,energy --rate 100 --rtol 1e-9

    Accepts the options of mjrun trace. Writes only the golden table, and only with --update. Exits with 1 if the two
    differ, and with 7 if the golden table does not exist.
    """
    form = command_line.form(*REPORT_FORMATS)
    import_mujoco()
    from mjrun.cli.diff_report import diff_report
    from mjrun.outputs.trace import Trace, TraceResult

    request = command_line.make(Trace, simulation=simulation(command_line), written=False, command=console.command)
    try:
        result = request.run(console)
    except GoldenDifferenceError as difference:
        (result,) = difference.results
        console.code = difference.exit_code
        console.report_failure(FailureReport.of(difference))
    assert isinstance(result, TraceResult)
    assert result.golden
    console.answer(diff_report(result.golden, every=console.verbosity > 0), form)


@command(
    DiffOptions,
    ReportFormatOptions,
    *ON_FILES,
    arguments=PAIR,
    cls=_DiffCommand,
    python="Diff",
    reports={"diff": "mjrun.diff.result:DiffResult"},
)
def diff(console: Console, command_line: ParsedCommandLine) -> None:
    """Compare two results, A and B: tables, recordings, videos, images or models.

    \b
    mjrun diff yesterday.csv today.parquet
    mjrun diff a.csv b.csv --atol 1e-9 --tol 'qvel/*=1e-6'
    mjrun trace scene.xml --csv | mjrun diff golden.parquet -
    mjrun diff a.mp4 b.mp4 --min-psnr 40 -o worst.png
    mjrun diff arm.xml arm_heavier.xml
    mjrun diff --golden golden.csv scene.xml

    Tables may have different formats and are aligned by time; one may come from standard input. Exits with 1
    if A and B differ. --golden compares a simulation with a golden table: see mjrun diff --golden --help.
    """
    form = command_line.form(*REPORT_FORMATS)
    import_mujoco()
    from mjrun.cli.diff_report import diff_report, verdict
    from mjrun.outputs.diff import Diff

    request = command_line.make(
        Diff, a=command_line.argument("a"), b=command_line.argument("b"), command=console.command
    )
    command_line.require(opened_file("output"), request)
    result = request.run(console)
    console.answer(diff_report(result, every=console.verbosity > 0), form)
    if not result.equal:
        console.fail(DIFFERENT, "Difference", verdict(result))
