"""Options of images."""

from typing import ClassVar

from mjrun.options.kinds import File, Flag, Instant, Integer, Optional, Text
from mjrun.options.option import Exclusion, option, options, required
from mjrun.options.output import DEPTH_IMAGES, RGB_IMAGES, SEGMENTATION_IMAGES, OutputOptions
from mjrun.options.view import ViewOptions


@options
class ImageOptions(ViewOptions, OutputOptions):
    """An image of one instant."""

    section: ClassVar[str] = "Image"
    exclusions: ClassVar[tuple[Exclusion, ...]] = (Exclusion(("time", "step"), "both say when"),)

    output: str = required(
        converter=File(written=True),
        kw_only=False,
        short="-o",
        usual="MODEL.png",
        help=f"{RGB_IMAGES}; depth as {DEPTH_IMAGES}; segmentation as {SEGMENTATION_IMAGES} (COCO); "
        "or - for standard output.",
    )
    time: object = option(
        converter=Optional(Instant()),
        default=None,
        usual="0",
        short="-t",
        help="The instant to draw [s]; in documents also an event.",
    )
    step: int | None = option(converter=Optional(Integer()), default=None, help="The instant, by step.")
    format: str | None = option(
        converter=Optional(Text("NAME")),
        default=None,
        usual="the output's suffix; png in a pipe",
        help="The format; palette for a segmentation in colours.",
    )
    legend: bool = option(converter=Flag(negatable=True), default=True, help="List what a coloured segmentation shows.")
    pointcloud: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help="A .ply file of all that the cameras see, as coloured points in the world [m]; labelled by the view seg.",
    )
