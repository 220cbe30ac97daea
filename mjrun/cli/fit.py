"""`mjrun fit`."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from mjrun.cli.click_command import CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import import_mujoco, simulation
from mjrun.errors import UsageError, clean, option
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.console import ConsoleOptions
from mjrun.options.fit import FitOptions
from mjrun.options.option import options_of
from mjrun.options.simulation import SimulationOptions
from mjrun.suffixes import is_yaml

if TYPE_CHECKING:
    from mjrun.fit.fit import Fit
    from mjrun.fit.result import FitResult

ARGUMENTS = (
    click.Argument(["model"], metavar="MODEL|FIT.yaml"),
    click.Argument(["tables"], nargs=-1, type=click.Path(), metavar="DATA...|[KEY=VALUE]..."),
)


@command("fit", FitOptions, SimulationOptions, ConfinementOptions, arguments=ARGUMENTS)
def fit(console: Console, command_line: CommandLine) -> None:
    """Find parameters of MODEL from measurements: DATA, tables with columns such as time, qpos/knee and ctrl/motor.

    \b
    mjrun fit arm.xml log.csv --free 'joint/elbow.damping=log:0.01..10' -o fitted.xml
    mjrun fit arm.xml log.csv --free 'scale:joint/*.armature=0.2..5' --map 'qpos/elbow=elbow_deg*pi/180' --json
    mjrun fit arm.xml log.csv --free delay:ctrl/motor=0..0.05 --comparison fit.csv && mjrun plot fit.csv -o fit.png
    mjrun fit arm_fit.yaml starts=8 -o fitted.xml
    mjrun fit arm.xml --free 'joint/*.damping=0.1..10' --excite chirp.csv && mjrun video arm.xml --ctrl-from chirp.csv

    FIT.yaml is a document that says all of it; KEY=VALUE changes a value of it.

    The last fifth of the measurements is held out: a fit that does not predict it better than MODEL exits with 1, and
    so does one whose parameters the measurements do not tell.
    """
    console.guard_stdout()
    import_mujoco()
    from mjrun.cli.fit_report import excitation_report, fit_report
    from mjrun.fit.excitation import ExcitationResult, excite

    job, located = _fit(command_line)

    def show(result: "FitResult | ExcitationResult") -> None:
        if command_line.make(ConsoleOptions).json:
            console.document(asdict(result))
        elif console.verbosity >= 0:
            is_input = isinstance(result, ExcitationResult)
            console.result(excitation_report(result) if is_input else fit_report(result))

    with located:
        result = job.run(console, show) if job.excite is None else excite(job, console)
    show(result)


def _fit(command_line: CommandLine) -> "tuple[Fit, AbstractContextManager[None]]":
    """The fit of a command line, or of the document that it names; and what locates its errors there."""
    from mjrun.fit.fit import Fit

    model, data = command_line.argument("model"), command_line.arguments("tables")
    if not is_yaml(model):
        if not data and command_line.value("excite") is None:
            raise click.UsageError("Missing argument 'DATA...'.", click.get_current_context())
        return command_line.make(Fit, simulation=simulation(command_line), data=data), nullcontext()
    from mjrun.document.fit import read_fit

    for each in options_of(SimulationOptions):
        if each.attribute in command_line.explicit(SimulationOptions):
            raise UsageError(f"{option(each.name)}: {clean(model)} says that; change it as in {each.key}=VALUE")
    request = read_fit(model, data, values=command_line.explicit(FitOptions))
    return request.made, request.located()
