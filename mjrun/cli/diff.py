"""`mjrun diff`."""

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import import_mujoco
from mjrun.errors import UsageError, option
from mjrun.options.diff import DiffOptions, DiffReportOptions
from mjrun.options.messages import MessageOptions

if TYPE_CHECKING:
    from mjrun.diff.result import DiffResult

DIFFERENT = 1  # exit code
PAIR = [click.Argument(["a"], metavar="A"), click.Argument(["b"], metavar="B")]


@command("diff", DiffOptions, DiffReportOptions, arguments=PAIR)
def diff(console: Console, command_line: CommandLine) -> None:
    """Tell whether two results agree, A and B: tables, recordings, videos, images or models.

    \b
    mjrun diff yesterday.csv today.parquet
    mjrun diff a.csv b.csv --atol 1e-9 --tol 'qvel/*=1e-6'
    mjrun trace scene.xml --csv | mjrun diff golden.parquet -
    mjrun diff a.mp4 b.mp4 --min-psnr 40 -o worst.png

    Tables of any formats are aligned by time; one of them may come from standard input. Exits with 1 when the two
    differ.
    """
    as_json, github = command_line.make(MessageOptions).json, command_line.make(DiffReportOptions).github
    if as_json and github:
        raise UsageError(f"{option('json')} and {option('github')} exclude each other: both want standard output")
    console.guard_stdout()
    import_mujoco()
    from mjrun.job.diff import Diff

    result = command_line.make(Diff, a=command_line.argument("a"), b=command_line.argument("b")).run(console)
    _show(console, result, as_json, github)
    console.code = 0 if result.equal else DIFFERENT


def _show(console: Console, result: "DiffResult", as_json: bool, github: bool) -> None:
    from mjrun.cli import diff_report

    if as_json:
        console.document(asdict(result))
    elif github:
        for line in diff_report.annotations(result):
            console.result(line)
        console.say(diff_report.verdict(result))
    elif console.verbosity >= 0:
        console.result(diff_report.text(result, every=console.verbosity > 0))
