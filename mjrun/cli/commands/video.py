"""Make a video of a simulation."""

from mjrun.cli.click_command import MODEL, ON_FILES, ParsedCommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.simulation_command import (
    import_mujoco,
    make_outputs,
    payload_on_stdout,
    show,
    simulation,
    stem,
    try_backend_early,
    with_camera_scripts,
)
from mjrun.options.output import SimulationCommandOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.video import VideoOptions


@command(
    VideoOptions,
    SimulationCommandOptions,
    SimulationOptions,
    *ON_FILES,
    arguments=[MODEL],
    python="Video",
    key="videos",
    reports={"video": "mjrun.outputs.video:VideoResult"},
)
def video(console: Console, command_line: ParsedCommandLine) -> None:
    """Make a video of MODEL.

    \b
    mjrun video scene.xml
    mjrun video scene.xml -o slow.gif --speed 0.25 --camera track:box,distance=.5
    mjrun video scene.xml --key spinning --duration 7 --camera closeup -o top.webm
    """
    payload_on_stdout(command_line)
    try_backend_early(command_line)
    import_mujoco()
    from mjrun.outputs.video import Video

    command_line = with_camera_scripts(command_line.with_defaults(output=f"{stem(command_line)}.mp4"))
    request = command_line.make(Video, simulation=simulation(command_line), command=console.command)
    result = make_outputs(console, command_line, request)
    show(console, command_line, result)
    if console.verbosity > 0:
        console.note(f"simulated in {result.simulation_wall:.3f} s, drawn and encoded in {result.draw_wall:.3f} s")
