"""`mjrun diff`."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from mjrun.cli.click_command import CommandLine, SectionedCommand, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import import_mujoco
from mjrun.errors import UsageError, option
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.console import ConsoleOptions
from mjrun.options.diff import DiffOptions, DiffReportOptions

if TYPE_CHECKING:
    from mjrun.diff.result import DiffResult

GOLDEN = "--golden"
DIFFERENT = 1  # exit code
PAIR = [click.Argument(["a"], metavar="A"), click.Argument(["b"], metavar="B")]


class DiffCommand(SectionedCommand):
    """With --golden another command, whose options are those of a trace."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        if any(arg == GOLDEN or arg.startswith(f"{GOLDEN}=") for arg in args):
            from mjrun.cli.diff_golden import diff_golden

            asks_for_help = {"-h", "--help"} & {*args}
            return diff_golden.make_context(info_name, ["--help"] if asks_for_help else args, parent, **extra)
        return super().make_context(info_name, args, parent, **extra)


@command("diff", DiffOptions, DiffReportOptions, ConfinementOptions, arguments=PAIR, cls=DiffCommand)
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
    check_report_options(command_line)
    console.guard_stdout()
    import_mujoco()
    from mjrun.outputs.diff import Diff

    result = command_line.make(Diff, a=command_line.argument("a"), b=command_line.argument("b")).run(console)
    show(console, command_line, result)
    if not result.equal:
        from mjrun.cli.diff_report import verdict

        console.fail(DIFFERENT, "Difference", verdict(result))


def check_report_options(command_line: CommandLine) -> None:
    """Raises UsageError if two options want standard output."""
    if command_line.make(ConsoleOptions).json and command_line.make(DiffReportOptions).github:
        raise UsageError(f"{option('json')} and {option('github')} exclude each other: both want standard output")


def show(console: Console, command_line: CommandLine, result: "DiffResult") -> None:
    """Prints what a comparison finds."""
    from mjrun.cli import diff_report

    if command_line.make(ConsoleOptions).json:
        console.document(asdict(result))
    elif command_line.make(DiffReportOptions).github:
        for line in diff_report.annotations(result):
            console.result(line)
        console.say(diff_report.verdict(result))
    elif console.verbosity >= 0:
        console.result(diff_report.text(result, every=console.verbosity > 0))
