"""`mjrun plot`."""

from dataclasses import asdict

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.result_summary import summary
from mjrun.cli.simulation_command import import_mujoco, payload_on_stdout
from mjrun.options.messages import MessageOptions
from mjrun.options.plot import TablePlotOptions

TABLES = click.Argument(["tables"], nargs=-1, required=True, type=click.Path(), metavar="TABLE...")


@command("plot", TablePlotOptions, arguments=[TABLES])
def plot(console: Console, command_line: CommandLine) -> None:
    """Plot each TABLE, or several in the same panels; - is standard input, as csv or jsonl.

    \b
    mjrun plot run.parquet -o run.png
    mjrun plot run.csv -o knee.svg --y 'qpos/*knee' --y 'energy/total, energy/drift'
    mjrun plot kick_*.csv -o kicks.pdf --y qpos/root --style print
    mjrun trace scene.xml --csv | mjrun plot - -o scene.png

    Any number of rows is drawn: of what falls on one pixel, the lowest and the highest value are kept.
    """
    console.guard_stdout()
    import_mujoco()
    from mjrun.plotting.table_plot import TablePlot

    if command_line.value("output") is None:
        raise click.UsageError("Missing option '-o' / '--output'.", click.get_current_context())
    piped = payload_on_stdout(command_line)
    job = command_line.make(TablePlot, tables=command_line.arguments("tables"))
    result = job.run(console)
    if command_line.make(MessageOptions).json:
        console.document(asdict(result))
    elif not piped and console.verbosity >= 0:
        console.result(summary(result))
