"""Plot tables as png, svg or pdf."""

from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.report_forms import Report
from mjrun.cli.result_summary import summary
from mjrun.cli.simulation_command import import_mujoco, payload_on_stdout, reported_failures
from mjrun.errors import FailedAssertionError
from mjrun.formats.input_file import is_folder
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.plot import TablePlotOptions

if TYPE_CHECKING:
    from mjrun.plotting.table_and_study_plot import TablePlotResult

TABLES = click.Argument(["tables"], nargs=-1, required=True, type=click.Path(), metavar="TABLE...")


@command(
    TablePlotOptions,
    ConfinementOptions,
    arguments=[TABLES],
    python="TablePlot",
    reports={"plot": "mjrun.plotting.table_and_study_plot:TablePlotResult"},
)
def plot(console: Console, command_line: CommandLine) -> None:
    """Plot each TABLE, or several tables in the same panels. - is standard input, as csv or jsonl; a folder is a
    study.

    \b
    mjrun plot run.parquet -o run.png
    mjrun plot run.csv -o knee.svg --y 'qpos/*knee' --y 'energy/total, energy/drift'
    mjrun plot kick_*.csv -o kicks.pdf --y qpos/root --style print
    mjrun trace scene.xml --csv | mjrun plot - -o scene.png
    mjrun plot study/ -o study.png --y drift
    mjrun plot run.parquet --html run.html --include run.mp4 --include run.json

    Tables may have any number of rows: for each pixel, the lowest and the highest value are drawn.
    """
    console.guard_stdout()
    import_mujoco()
    from mjrun.plotting.table_and_study_plot import StudyPlot, TablePlot

    if command_line.value("output") is None and command_line.value("html") is None:
        raise click.UsageError("Missing option '-o' / '--output' or '--html'.", click.get_current_context())
    is_piped = payload_on_stdout(command_line)
    tables = command_line.arguments("tables")
    is_study = any(is_folder(table) for table in tables)
    job = command_line.make(StudyPlot if is_study else TablePlot, tables=tables)
    with reported_failures(console, lambda results: _report(results[0], is_piped), FailedAssertionError):
        result = job.run(console)
    console.answer(_report(result, is_piped))


def _report(result: "TablePlotResult", is_piped: bool) -> Report:
    return Report("plot", result, summary=lambda: "" if is_piped else summary(result))
