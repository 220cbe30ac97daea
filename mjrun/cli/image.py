"""`mjrun image`."""

from mjrun.cli.command import MODEL, Given, command
from mjrun.cli.console import Console
from mjrun.cli.simulating import import_mujoco, make, payload_on_stdout, show, simulation, stem, with_camera_scripts
from mjrun.options.image import ImageOptions
from mjrun.options.output import CommandOptions
from mjrun.options.simulation import SimulationOptions


@command("image", ImageOptions, CommandOptions, SimulationOptions, arguments=[MODEL], without=("duration", "steps"))
def image(console: Console, given: Given) -> None:
    """Draw one instant of MODEL: colours, depth, segmentation, of several cameras.

    \b
    mjrun image scene.xml
    mjrun image scene.xml -t 1.5 --camera top --view depth -o depth.exr
    mjrun image scene.xml --view rgb --view depth --view seg --layout row -o views.png
    """
    payload_on_stdout(given)
    console.guard_stdout()
    import_mujoco()
    from mjrun.job.image import Image

    given = with_camera_scripts(given.otherwise(output=f"{stem(given)}.png"))
    job = given.make(Image, simulation=simulation(given), command=console.command)
    show(console, given, make(console, given, job))
