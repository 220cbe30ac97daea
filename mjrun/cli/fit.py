"""`mjrun fit`."""

from dataclasses import asdict

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import import_mujoco, simulation
from mjrun.options.fit import FitOptions
from mjrun.options.messages import MessageOptions
from mjrun.options.simulation import SimulationOptions

ARGUMENTS = (
    click.Argument(["model"], metavar="MODEL"),
    click.Argument(["data"], nargs=-1, required=True, type=click.Path(), metavar="DATA..."),
)


@command("fit", FitOptions, SimulationOptions, arguments=ARGUMENTS)
def fit(console: Console, command_line: CommandLine) -> None:
    """Find parameters of MODEL from measurements: DATA, tables with columns such as time, qpos/knee and ctrl/motor.

    \b
    mjrun fit arm.xml log.csv --free 'joint/elbow.damping=log:0.01..10' -o fitted.xml
    mjrun fit arm.xml log.csv --free 'scale:joint/*.armature=0.2..5' --map 'qpos/elbow=elbow_deg*pi/180' --json
    mjrun fit arm.xml log.csv --free delay:ctrl/motor=0..0.05 --comparison fit.csv && mjrun plot fit.csv -o fit.png

    The last fifth of the measurements is held out: a fit that does not predict it better than MODEL exits with 1, and
    so does one whose parameters the measurements do not tell.
    """
    console.guard_stdout()
    import_mujoco()
    from mjrun.cli.fit_report import fit_report
    from mjrun.fit.fit import Fit

    job = command_line.make(Fit, simulation=simulation(command_line), data=command_line.arguments("data"))
    result = job.run(console)
    if command_line.make(MessageOptions).json:
        console.document(asdict(result))
    elif console.verbosity >= 0:
        console.result(fit_report(result))
