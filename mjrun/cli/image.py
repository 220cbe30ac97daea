"""`mjrun image`."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from mjrun.cli import options, summaries, values
from mjrun.cli.console import Console
from mjrun.errors import UsageError

if TYPE_CHECKING:
    from mjrun.job.image import ImageResult


@click.command("image", cls=options.SectionedCommand)
@options.model_argument
@options.image_options
@options.view_options
@options.renderer_options
@options.simulation_options
@options.model_options
@options.output_options
@click.pass_obj
def command(console: Console, /, as_json: bool, **given: Any) -> None:
    """Draw one instant of MODEL: colours, depth, segmentation, of several cameras.

    \b
    mjrun image scene.xml
    mjrun image scene.xml -t 1.5 --camera top --view depth -o depth.exr
    mjrun image scene.xml --view rgb --view depth --view seg --layout row -o views.png
    """
    piped = given["output"] == "-"
    if as_json and piped:
        raise UsageError("--json and -o - both want standard output")
    console.guard_stdout()
    result = _make(console, given)
    if as_json:
        console.document(asdict(result))
    elif piped:
        console.say(summaries.still(result))
    elif console.verbosity >= 0:
        console.result(summaries.still(result))


def _make(console: Console, given: dict[str, Any]) -> "ImageResult":
    values.import_mujoco()
    from mjrun.job.image import Image

    simulation = values.simulation(given)
    job = Image(
        simulation=simulation,
        output=given["output"] or f"{simulation.source.stem}.png",
        at=given["at"],
        step=given["step"],
        format=given["format_"],
        legend=given["legend"],
        pointcloud=given["pointcloud"],
        command=console.command,
        **values.drawing(given),
    )
    return values.perform(console, given, job)
