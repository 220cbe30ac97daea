"""Render one instant of a simulation."""

from fractions import Fraction
from typing import cast

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
from mjrun.options.video import ImageOptions


@command(
    ImageOptions,
    SimulationCommandOptions,
    SimulationOptions,
    *ON_FILES,
    arguments=[MODEL],
    without=("duration", "steps"),
    python="Image",
    key="images",
    reports={"image": "mjrun.outputs.image:ImageResult"},
)
def image(console: Console, command_line: ParsedCommandLine) -> None:
    """Render one instant of MODEL: colours, depth or segmentation, from one or several cameras.

    \b
    mjrun image scene.xml
    mjrun image scene.xml -t 1.5 --camera top --view depth -o depth.exr
    mjrun image scene.xml --view rgb --view depth --view seg --layout row -o views.png
    """
    payload_on_stdout(command_line)
    try_backend_early(command_line)
    import_mujoco()
    from mjrun.outputs.image import Image

    command_line = with_camera_scripts(command_line.with_defaults(output=f"{stem(command_line)}.png"))
    request = command_line.make(Image, simulation=simulation(command_line), command=console.command)
    time = cast("Fraction | None", request.time)  # events are for documents
    at = None if request.step is not None else time or Fraction(0)
    show(console, command_line, make_outputs(console, command_line, request, at, request.step))
