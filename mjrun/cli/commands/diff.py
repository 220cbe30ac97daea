"""Tell whether two results agree: tables, recordings, videos, images, models."""

from typing import TYPE_CHECKING, Any

import click

from mjrun.cli.click_command import MODEL, CommandLine, ModelArgument, SectionedCommand, command
from mjrun.cli.console import Console
from mjrun.cli.report import Report
from mjrun.cli.simulation_command import import_mujoco, simulation
from mjrun.errors import Failure, GoldenDifferenceError
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.diff import DiffOptions, DiffReportOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.trace import TraceOptions

if TYPE_CHECKING:
    from mjrun.diff.result import DiffResult

GOLDEN = "--golden"
DIFFERENT = 1  # exit code
PAIR = [ModelArgument("a", metavar="A"), ModelArgument("b", metavar="B")]


class DiffCommand(SectionedCommand):
    """With --golden another command, whose options are those of a trace."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        if any(arg == GOLDEN or arg.startswith(f"{GOLDEN}=") for arg in args):
            asks_for_help = {"-h", "--help"} & {*args}
            return diff_golden.make_context(info_name, ["--help"] if asks_for_help else args, parent, **extra)
        return super().make_context(info_name, args, parent, **extra)


@command(
    DiffOptions,
    DiffReportOptions,
    ConfinementOptions,
    arguments=PAIR,
    cls=DiffCommand,
    python="Diff",
    reports={"diff": "mjrun.diff.result:DiffResult"},
)
def diff(console: Console, command_line: CommandLine) -> None:
    """Tell whether two results agree, A and B: tables, recordings, videos, images or models.

    \b
    mjrun diff yesterday.csv today.parquet
    mjrun diff a.csv b.csv --atol 1e-9 --tol 'qvel/*=1e-6'
    mjrun trace scene.xml --csv | mjrun diff golden.parquet -
    mjrun diff a.mp4 b.mp4 --min-psnr 40 -o worst.png
    mjrun diff arm.xml arm_heavier.xml
    mjrun diff --golden golden.csv scene.xml

    Tables of any formats are aligned by time; one of them may come from standard input. Exits with 1 when the two
    differ. With --golden it tells whether a simulation still is what a table says: mjrun diff --golden --help.
    """
    form = command_line.form("github")
    console.guard_stdout()
    import_mujoco()
    from mjrun.outputs.diff import Diff

    result = command_line.make(Diff, a=command_line.argument("a"), b=command_line.argument("b")).run(console)
    console.answer(_report(console, result), form)
    if not result.equal:
        from mjrun.cli.diff_report import verdict

        console.fail(DIFFERENT, "Difference", verdict(result))


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
    console.answer(_report(console, result.golden), form)


def _report(console: Console, result: "DiffResult") -> Report:
    from mjrun.cli import diff_report

    return Report(
        "diff",
        result,
        summary=lambda: diff_report.text(result, every=console.verbosity > 0),
        forms={"github": lambda: "\n".join(diff_report.annotations(result))},
        remark=lambda: diff_report.verdict(result),
    )
