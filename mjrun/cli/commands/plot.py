"""Plot tables, studies and simulations as png, svg or pdf."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import ON_FILES, ModelArgument, ParsedCommandLine, command, further_value_hint
from mjrun.cli.console import CommandReport, Console
from mjrun.cli.simulation_command import (
    import_mujoco,
    make_outputs,
    payload_on_stdout,
    reported_failures,
    simulation,
    stem,
    summary,
    varied_controllers,
)
from mjrun.errors import FailedAssertionError, FileError, UsageError, listing, option, quoted
from mjrun.formats.input_file import exists, is_folder
from mjrun.formats.tables import format_of_suffix
from mjrun.options.option import options_of
from mjrun.options.output import SimulationCommandOptions
from mjrun.options.plot import PlotOptions, TablePlotOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.sweep import VariationOptions
from mjrun.suffixes import is_url

if TYPE_CHECKING:
    from mjrun.outputs.plot import Plot, PlotResult
    from mjrun.plotting.table_and_study_plot import TablePlotResult

TABLES = ModelArgument(
    "tables", tables=True, nargs=-1, required=True, type=click.Path(readable=False), metavar="TABLE...|MODEL"
)
OF_TABLES = ("html", "include", "assert", "label")
OF_MODELS = ("probe", "every", "rate", "manifest")
OF_ONE = ("recording", "save_key", "print_document")  # options that do not apply if parameters vary


@command(
    PlotOptions,
    TablePlotOptions,
    VariationOptions,
    SimulationCommandOptions,
    SimulationOptions,
    *ON_FILES,
    arguments=[TABLES],
    python="TablePlot",
    classes={PlotOptions: "Plot", VariationOptions: "VariedPlot"},
    reports={"plot": "mjrun.plotting.table_and_study_plot:TablePlotResult"},
)
def plot(console: Console, command_line: ParsedCommandLine) -> None:
    """Plot one TABLE, or several in the same panels; or simulate MODEL and plot what is measured, once or for several
    values of its parameters. - is standard input, as csv or jsonl; a folder is a study.

    \b
    mjrun plot run.parquet -o run.png
    mjrun plot scene.xml --duration 3 --y 'energy/*' --y qpos/root/z
    mjrun plot scene.xml --vary opt.timestep=0.01,0.005,0.002 --y energy/total
    mjrun plot run.csv -o knee.svg --y 'qpos/*knee' --y 'energy/total, energy/drift'
    mjrun plot kick_*.csv -o kicks.pdf --y qpos/root --style print
    mjrun trace scene.xml --csv | mjrun plot - -o scene.png
    mjrun plot study/ -o study.png --y drift
    mjrun plot run.parquet --html run.html --include run.mp4 --include run.json

    Tables may have any number of rows: for each pixel, the lowest and the highest value are drawn.
    """
    import_mujoco()
    from mjrun.model.sources import is_model_name

    tables = command_line.arguments("tables")
    if any(map(is_model_name, tables)):
        _plot_simulation(console, command_line, tables)
    else:
        _plot_tables(console, command_line, tables)


def _plot_simulation(console: Console, command_line: ParsedCommandLine, models: Sequence[str]) -> None:
    from mjrun.plotting.table_and_study_plot import TablePlotResult

    if len(models) > 1:
        raise UsageError(f"a plot shows one model, or tables that `mjrun trace` writes, not {listing(models)}")
    _require_none(
        command_line, OF_TABLES, f"applies to tables, which `mjrun trace` writes, and {quoted(models[0])} is a model"
    )
    command_line = command_line.with_defaults(model=models[0])
    command_line = command_line.with_defaults(output=f"{stem(command_line)}.png")
    is_piped = payload_on_stdout(command_line)
    request = _plot_request(console, command_line)

    def report(made: "PlotResult") -> CommandReport:
        tables, rows = ([*made.points], [*made.points.values()]) if made.points else (models, [made.samples])
        form, curves = request.figure_format, made.curves
        result = TablePlotResult(made.path, form, made.size, tables, rows, made.panels, curves, notes=())
        return _report(result, is_piped)

    console.answer(report(make_outputs(console, command_line, request, report=report)))


def _plot_request(console: Console, command_line: ParsedCommandLine) -> "Plot":
    """Returns the plot of a simulation, or of several if parameters vary."""
    from mjrun.outputs.plot import Plot

    facts = {"simulation": simulation(command_line), "command": console.command}
    if not command_line.explicit(VariationOptions):
        return command_line.make(Plot, **facts)
    from mjrun.study.varied_plot import VariedPlot

    _require_none(command_line, OF_ONE, f"applies to one simulation, and {option('vary')} requests several")
    return command_line.make(VariedPlot, controllers=varied_controllers(command_line), **facts)


def _plot_tables(console: Console, command_line: ParsedCommandLine, tables: Sequence[str]) -> None:
    from mjrun.formats.study_reader import folder_of_results
    from mjrun.plotting.table_and_study_plot import StudyPlot, TablePlot

    classes = (SimulationOptions, SimulationCommandOptions, VariationOptions)
    names = (*OF_MODELS, *(each.name for cls in classes for each in options_of(cls)))
    _require_none(command_line, names, f"applies to models, and {quoted(tables[0])} is not one")
    if command_line.value("output") is None and command_line.value("html") is None:
        raise click.UsageError("Missing option '-o' / '--output' or '--html'.", click.get_current_context())
    is_piped = payload_on_stdout(command_line)
    if command_line.value("y") is None:  # a study's table, which has texts, means the study
        tables = [folder_of_results(table) or table for table in tables]
    for table in tables:
        if not exists(table) and (hint := further_value_hint(table, click.get_current_context())):
            raise FileError(table, f"no such file{hint}")
    is_study = any(is_folder(table) or (is_url(table) and not format_of_suffix(Path(table).suffix)) for table in tables)
    request = command_line.make(StudyPlot if is_study else TablePlot, tables=tables, command=console.command)
    with reported_failures(console, lambda results: _report(results[0], is_piped), FailedAssertionError):
        result = request.run(console)
    console.answer(_report(result, is_piped))


def _require_none(command_line: ParsedCommandLine, names: Iterable[str], reason: str) -> None:
    """Checks that options which do not apply are left out."""
    for name in names:
        if command_line.value(name) is not None:
            raise UsageError(f"{option(name)} {reason}")


def _report(result: "TablePlotResult", is_piped: bool) -> CommandReport:
    return CommandReport("plot", result, summary=lambda: "" if is_piped else summary(result))
