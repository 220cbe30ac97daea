"""View a simulation live, in a window or a browser."""

from typing import TYPE_CHECKING

from mjrun.cli.click_command import MODEL, ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console
from mjrun.cli.simulation_command import import_mujoco, simulation
from mjrun.errors import clean
from mjrun.options.every_command import ConfinementOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.viewer import ViewerOptions

if TYPE_CHECKING:
    from mjrun.viewer.viewer import ViewerResult


@command(
    ViewerOptions,
    SimulationOptions,
    ConfinementOptions,
    arguments=[MODEL],
    python="Viewer",
    is_endless=True,
    reports={"view": "mjrun.viewer.viewer:ViewerResult"},
)
def view(console: Console, command_line: ParsedCommandLine) -> None:
    """View a simulation of MODEL live, in a window or in a browser on this machine.

    \b
    mjrun view scene.xml
    mjrun view scene.xml --speed 0.25 --recording run.npz
    mjrun view scene.xml --replay run.npz
    mjrun view scene.xml --browser --port 8090

    Pause, step, reset, and pull bodies with the mouse. Without interaction, the simulation is identical, bit for bit,
    to that of the other commands. It ends when the window is closed, with Ctrl-C, or after --duration or --steps.
    """
    import_mujoco()
    from mjrun.viewer.viewer import Viewer

    request = command_line.make(Viewer, simulation=simulation(command_line), command=console.command)
    result = request.run(console)
    console.answer(CommandReport("view", result, summary=lambda: _summary(result)))


def _summary(result: "ViewerResult") -> str:
    if result.recording is None:
        return ""
    return f"{clean(str(result.recording))}: {result.states} states, {result.simulated:.4g} s"
