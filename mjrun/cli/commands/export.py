"""Export a simulation to a format of other programs."""

from mjrun.cli.click_command import MODEL, CommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import (
    import_mujoco,
    make,
    payload_on_stdout,
    show,
    simulation,
    stem,
    with_camera_scripts,
)
from mjrun.options.confinement import ConfinementOptions
from mjrun.options.console import OpenOptions
from mjrun.options.export import ExportOptions
from mjrun.options.output import CommandOptions
from mjrun.options.simulation import SimulationOptions


@command(
    ExportOptions,
    CommandOptions,
    SimulationOptions,
    OpenOptions,
    ConfinementOptions,
    arguments=[MODEL],
    python="Export",
    key="exports",
    reports={"export": "mjrun.outputs.export:ExportResult"},
)
def export(console: Console, command_line: CommandLine) -> None:
    """Export a simulation of MODEL to a format of other programs, such as glTF or HTML.

    \b
    mjrun export scene.xml
    mjrun export scene.xml -o scene.glb --fps 60 --camera orbit:azimuth=0..90
    mjrun export scene.xml -o pose.glb --key home --steps 1
    mjrun export scene.xml -o replay.html --plot energy --mark-event 'contact(ball, floor) > 0'
    """
    payload_on_stdout(command_line)
    console.guard_stdout()
    import_mujoco()
    from mjrun.outputs.export import Export

    command_line = with_camera_scripts(command_line.with_defaults(output=f"{stem(command_line)}.glb"))
    job = command_line.make(Export, simulation=simulation(command_line), command=console.command)
    show(console, command_line, make(console, command_line, job))
