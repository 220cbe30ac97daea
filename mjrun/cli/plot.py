"""`mjrun plot`."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.result_summary import summary
from mjrun.cli.simulation_command import import_mujoco, payload_on_stdout, results_of_failures
from mjrun.errors import FailedAssertionError
from mjrun.formats.input_file import is_folder
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.console import ConsoleOptions
from mjrun.options.plot import TablePlotOptions

if TYPE_CHECKING:
    from mjrun.plotting.table_plot import TablePlotResult

TABLES = click.Argument(["tables"], nargs=-1, required=True, type=click.Path(), metavar="TABLE...")


@command("plot", TablePlotOptions, ConfinementOptions, arguments=[TABLES])
def plot(console: Console, command_line: CommandLine) -> None:
    """Plot each TABLE, or several in the same panels; - is standard input, as csv or jsonl. A folder is a study.

    \b
    mjrun plot run.parquet -o run.png
    mjrun plot run.csv -o knee.svg --y 'qpos/*knee' --y 'energy/total, energy/drift'
    mjrun plot kick_*.csv -o kicks.pdf --y qpos/root --style print
    mjrun trace scene.xml --csv | mjrun plot - -o scene.png
    mjrun plot study/ -o study.png --y drift
    mjrun plot run.parquet --html run.html --include film.mp4 --include run.json

    Any number of rows is drawn: of what falls on one pixel, the lowest and the highest value are kept.
    """
    console.guard_stdout()
    import_mujoco()
    from mjrun.plotting.study_plot import StudyPlot
    from mjrun.plotting.table_plot import TablePlot

    if command_line.value("output") is None and command_line.value("html") is None:
        raise click.UsageError("Missing option '-o' / '--output' or '--html'.", click.get_current_context())
    payload_on_stdout(command_line)
    tables = command_line.arguments("tables")
    is_study = any(is_folder(table) for table in tables)
    job = command_line.make(StudyPlot if is_study else TablePlot, tables=tables)
    with results_of_failures(console, _document):
        try:
            result = job.run(console)
        except FailedAssertionError as error:
            _show(console, command_line, error.results)
            raise
    if command_line.make(ConsoleOptions).json:
        console.document(_document([result]))
    else:
        _show(console, command_line, [result])


def _show(console: Console, command_line: CommandLine, results: "Sequence[TablePlotResult]") -> None:
    """A line about each result, where standard output is free for it."""
    if console.verbosity >= 0 and not payload_on_stdout(command_line) and not command_line.make(ConsoleOptions).json:
        for result in results:
            console.result(summary(result))


def _document(results: "Sequence[TablePlotResult]") -> dict[str, object]:
    (result,) = results
    return asdict(result)
