"""`mjrun video`."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from mjrun.cli import options, summaries, values
from mjrun.cli.console import Console
from mjrun.errors import UsageError

if TYPE_CHECKING:
    from mjrun.job.video import VideoResult


@click.command("video", cls=options.SectionedCommand)
@options.model_argument
@options.film_options
@options.view_options
@options.renderer_options
@options.simulation_options
@options.duration_options
@options.model_options
@options.output_options
@click.pass_obj
def command(console: Console, /, as_json: bool, **given: Any) -> None:
    """Make a film of MODEL.

    \b
    mjrun video scene.xml
    mjrun video scene.xml -o slow.gif --speed 0.25 --camera track:box,distance=.5
    mjrun video scene.xml --key spinning --duration 7 --camera closeup -o top.webm
    """
    piped = given["output"] == "-"
    if as_json and piped:
        raise UsageError("--json and -o - both want standard output")
    console.guard_stdout()
    result = _make(console, given)
    if as_json:
        console.document(asdict(result))
    elif piped:
        console.say(summaries.film(result))
    elif console.verbosity >= 0:
        console.result(summaries.film(result))
    if console.verbosity > 0:
        console.note(f"simulated in {result.simulation_wall:.3f} s, drawn and encoded in {result.draw_wall:.3f} s")


def _make(console: Console, given: dict[str, Any]) -> "VideoResult":
    values.import_mujoco()
    from mjrun.job.video import Video

    simulation = values.simulation(given)
    job = Video(
        simulation=simulation,
        output=given["output"] or f"{simulation.source.stem}.mp4",
        fps=given["fps"],
        speed=given["speed"],
        format=given["format_"],
        codec=given["codec"],
        crf=given["crf"],
        preset=given["preset"],
        plot=given["plots"],
        plot_side=given["plot_side"],
        jobs=given["jobs"],
        command=console.command,
        **values.drawing(given),
    )
    return values.perform(console, given, job)
