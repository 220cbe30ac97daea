"""Options of images."""

from typing import ClassVar

from mjrun.options.kinds import FlagKind, PathKind, TextKind, optional
from mjrun.options.number_kinds import InstantKind, IntegerKind
from mjrun.options.option import OptionExclusion, option, options, required
from mjrun.options.output import DEPTH_IMAGES, RGB_IMAGES, SEGMENTATION_IMAGES, OutputOptions
from mjrun.options.rendering import ViewOptions


@options
class ImageOptions(ViewOptions, OutputOptions):
    """An image of one instant."""

    section: ClassVar[str] = "Image"
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (OptionExclusion(("time", "step"), "both set the instant"),)

    output: str = required(
        converter=PathKind(written=True, streamed=True),
        kw_only=False,
        short="-o",
        usual="MODEL.png",
        help=f"{RGB_IMAGES}; depth as {DEPTH_IMAGES}; segmentation as {SEGMENTATION_IMAGES} (COCO); "
        "or - for standard output.",
    )
    time: object = option(
        converter=optional(InstantKind()),
        default=None,
        usual="0",
        short="-t",
        help="Time of the image [s]; documents also accept an event.",
    )
    step: int | None = option(
        converter=optional(IntegerKind()), default=None, help="Time of the image, as a step number."
    )
    format: str | None = option(
        converter=optional(TextKind("NAME")),
        default=None,
        usual="the output's suffix; png in a pipe",
        help="File format; palette stores a segmentation as colours.",
    )
    legend: bool = option(
        converter=FlagKind(negatable=True), default=True, help="List the objects of a coloured segmentation beside it."
    )
    pointcloud: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Point cloud (.ply) of all visible surfaces, with colours, in world coordinates [m]; --view seg adds "
        "labels.",
    )
