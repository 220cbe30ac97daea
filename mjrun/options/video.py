"""Options of videos, and of images, which are videos of one frame."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import (
    CameraKind,
    ChoiceKind,
    FlagKind,
    NameOrIndexKind,
    OneOrMoreKind,
    PathKind,
    TextKind,
    optional,
)
from mjrun.options.number_kinds import AUTO, ExactNumberKind, InstantKind, IntegerKind, ProcessCountKind, SizeKind
from mjrun.options.option import OptionExclusion, OptionRequirement, Options, option, options, required
from mjrun.options.output import CODECS, DEPTH_IMAGES, RGB_IMAGES, SEGMENTATION_IMAGES, VIDEOS, OutputOptions
from mjrun.options.rendering import QUALITIES, ViewOptions

PLOT_SIDES = ("under", "beside")
FPS, GIF_FPS = Fraction(30), Fraction(25)  # by default


@options
class VideoOptions(ViewOptions, OutputOptions):
    """A video."""

    section: ClassVar[str] = "Video"
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (
        OptionExclusion(("plot", "separate"), "separate views make several frames, and a plot belongs to one"),
    )
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        OptionRequirement("plot_side", "plot", "whose position it sets"),
    )

    output: str = required(
        converter=PathKind(written=True, streamed=True),
        kw_only=False,
        short="-o",
        usual="MODEL.mp4",
        help=f"{VIDEOS}, a folder or pattern of PNGs (frames/, frame_%04d.png), or - for standard output.",
    )
    fps: Fraction | None = option(
        converter=optional(ExactNumberKind("FPS")),
        default=None,
        usual=f"{FPS}; {GIF_FPS} in a GIF",
        help="Frames per second of the video [Hz], such as 60 or 30000/1001.",
    )
    speed: Fraction = option(
        converter=ExactNumberKind("FACTOR"),
        default=1,
        help="Simulated seconds per second of video; 0.25 is slow motion.",
    )
    format: str | None = option(
        converter=optional(TextKind("NAME")),
        default=None,
        usual="the output's suffix; mp4 in a pipe",
        help="File format.",
    )
    codec: str | None = option(
        converter=optional(TextKind("NAME")),
        default=None,
        help=f"Video codec: {CODECS}; each format supports some of them.",
    )
    crf: int | None = option(
        converter=optional(IntegerKind(least=None)),
        default=None,
        help="Constant rate factor of the encoder: lower values give better quality and larger files.",
    )
    preset: str | None = option(
        converter=optional(NameOrIndexKind("NAME", "the name of a preset")),
        default=None,
        help="Encoder preset, a trade-off between encoding speed and compression.",
    )
    plot: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("PROBE,…")),
        default=(),
        help="Live plot of measured values under or beside the frame: energy, qpos[left_*]. Each use adds a plot.",
    )
    plot_side: str = option(
        converter=ChoiceKind(PLOT_SIDES), default="under", help="Position of the plots relative to the frame."
    )
    jobs: int | str = option(
        converter=ProcessCountKind(),
        default=AUTO,
        help="Number of rendering processes; auto uses one per core for long videos that are rendered on the CPU.",
    )


# What options of videos of selected simulations set, by name: clauses of requirements.
VIDEO_CLAUSES = {
    "camera": "which it records",
    "size": "whose size it sets",
    "quality": "whose rendering quality it sets",
    "fps": "whose frame rate it sets",
    "speed": "whose speed it sets",
}


@options
class PointOrEpisodeVideoOptions(Options):
    """Videos of selected simulations: points of a study, or episodes."""

    section: ClassVar[str] = "Videos"

    camera: tuple[object, ...] = option(
        converter=OneOrMoreKind(CameraKind()),
        default="auto",
        help="Camera of the videos: a camera of the model, or a rig.",
    )
    size: tuple[int, int] = option(
        converter=SizeKind(), default=(640, 360), help="Width and height of the videos [pixels]."
    )
    quality: str = option(converter=ChoiceKind(QUALITIES), default="model", help="Rendering quality of the videos.")
    fps: Fraction = option(converter=ExactNumberKind("FPS"), default=FPS, help="Frames per second of the videos [Hz].")
    speed: Fraction = option(
        converter=ExactNumberKind("FACTOR"), default=1, help="Simulated seconds per second of video."
    )


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
