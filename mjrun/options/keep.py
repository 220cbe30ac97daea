"""Options of what a study keeps of its points besides their metrics."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import Camera, Choice, ExactNumber, File, Optional, Several, Size, Text
from mjrun.options.option import Options, option, options
from mjrun.options.output import VIDEOS
from mjrun.options.trace import PROBES
from mjrun.options.view import QUALITIES

KEPT = ("trace", "recording", "video")


@options
class KeepOptions(Options):
    """Files of single points. They are simulated once more, bit for bit, when the metrics of all are known."""

    section: ClassVar[str] = "Files of points"

    keep: tuple[str, ...] = option(
        converter=Several(Choice(KEPT), commas=True, expected="trace, recording or video"),
        default=(),
        help="What to keep of points, in points/NUMBER of the study: trace.parquet, recording.npz, video.mp4.",
    )
    keep_where: tuple[str, ...] = option(
        converter=Several(Text("EXPR")),
        default=(),
        help="Of points for which this holds, over what varies, metrics and statuses: unstable, drift > 1.",
    )
    keep_lowest: tuple[str, ...] = option(
        converter=Several(Text("N:METRIC")), default=(), help="Of the N points with the lowest values: 4:drift."
    )
    keep_highest: tuple[str, ...] = option(
        converter=Several(Text("N:METRIC")), default=(), help="Of the N points with the highest values: 4:drift."
    )
    contact_sheet: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help=f"A video of the points whose videos are kept, side by side with their values: {VIDEOS}.",
    )
    probe: tuple[str, ...] = option(
        converter=Several(Text("NAME"), commas=True, expected="the name of something to measure"),
        default=PROBES,
        usual=",".join(PROBES),
        help="What the traces measure, besides the columns that the metrics read.",
    )
    camera: tuple[object, ...] = option(
        converter=Several(Camera()), default="free", help="What the videos show: a camera of the model, or a rig."
    )
    size: tuple[int, int] = option(
        converter=Size(), default=(640, 360), help="Width and height of the videos [pixels]."
    )
    quality: str = option(converter=Choice(QUALITIES), default="model", help="How well the videos are drawn.")
    fps: Fraction = option(converter=ExactNumber("FPS"), default=30, help="Frames per second of the videos [Hz].")
    speed: Fraction = option(
        converter=ExactNumber("FACTOR"), default=1, help="Simulated seconds per second of the videos."
    )
