"""Options of videos."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import AUTO, Choice, ExactNumber, File, Integer, Key, Optional, Processes, Several, Text
from mjrun.options.option import Exclusion, option, options, required
from mjrun.options.output import CODECS, VIDEOS, OutputOptions
from mjrun.options.view import ViewOptions

PLOT_SIDES = ("under", "beside")


@options
class VideoOptions(ViewOptions, OutputOptions):
    """A video."""

    section: ClassVar[str] = "Video"
    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Exclusion(("plot", "separate"), "a plot stands beside one frame, and separate views make several"),
    )

    output: str = required(
        converter=File(written=True),
        kw_only=False,
        short="-o",
        usual="MODEL.mp4",
        help=f"{VIDEOS}, a folder or pattern of PNGs (frames/, frame_%04d.png), or - for standard output.",
    )
    fps: Fraction | None = option(
        converter=Optional(ExactNumber("FPS")),
        default=None,
        usual="30; 25 in a GIF",
        help="Frames per second of the video [Hz], as in 60 or 30000/1001.",
    )
    speed: Fraction = option(
        converter=ExactNumber("FACTOR"), default=1, help="Simulated seconds per second of video; 0.25 is slow motion."
    )
    format: str | None = option(
        converter=Optional(Text("NAME")), default=None, usual="the output's suffix; mp4 in a pipe", help="The format."
    )
    codec: str | None = option(
        converter=Optional(Text("NAME")), default=None, help=f"{CODECS}; each format holds some of them."
    )
    crf: int | None = option(
        converter=Optional(Integer(least=None)), default=None, help="Constant rate factor: lower is better and larger."
    )
    preset: str | None = option(
        converter=Optional(Key("NAME", "the name of a preset")),
        default=None,
        help="The codec's preset, from fast to thorough.",
    )
    plot: tuple[str, ...] = option(
        converter=Several(Text("PROBE,…")),
        default=(),
        help="A live plot of what a trace would measure: energy, qpos[left_*]. Several make a plot each.",
    )
    plot_side: str = option(converter=Choice(PLOT_SIDES), default="under", help="Where plots stand.")
    jobs: int | str = option(
        converter=Processes(),
        default=AUTO,
        help="Processes that draw; auto is one per core where a CPU draws a long video.",
    )
