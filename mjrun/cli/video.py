"""`mjrun video`."""

from mjrun.cli.command import MODEL, Given, command
from mjrun.cli.console import Console
from mjrun.cli.simulating import import_mujoco, make, payload_on_stdout, show, simulation, stem, with_camera_scripts
from mjrun.options.output import CommandOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.video import VideoOptions


@command("video", VideoOptions, CommandOptions, SimulationOptions, arguments=[MODEL])
def video(console: Console, given: Given) -> None:
    """Make a video of MODEL.

    \b
    mjrun video scene.xml
    mjrun video scene.xml -o slow.gif --speed 0.25 --camera track:box,distance=.5
    mjrun video scene.xml --key spinning --duration 7 --camera closeup -o top.webm
    """
    payload_on_stdout(given)
    console.guard_stdout()
    import_mujoco()
    from mjrun.job.video import Video

    given = with_camera_scripts(given.otherwise(output=f"{stem(given)}.mp4"))
    job = given.make(Video, simulation=simulation(given), command=console.command)
    result = make(console, given, job)
    show(console, given, result)
    if console.verbosity > 0:
        console.note(f"simulated in {result.simulation_wall:.3f} s, drawn and encoded in {result.draw_wall:.3f} s")
