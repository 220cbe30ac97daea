"""Options of exports."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import CameraKind, ChoiceKind, FlagKind, OneOrMoreKind, PathKind, TextKind, optional
from mjrun.options.number_kinds import AUTO, ExactNumberKind, ProcessCountKind, SizeKind
from mjrun.options.option import option, options, required
from mjrun.options.output import EXPORT_FOLDERS, EXPORTS, OutputOptions
from mjrun.options.rendering import RIG_EXAMPLES, SceneOptions

H264 = "h264"
IMAGES = (H264, "jpeg", "png")


@options
class ExportOptions(SceneOptions, OutputOptions):
    """An export: a simulation in a format of other programs."""

    section: ClassVar[str] = "Export"

    output: str = required(
        converter=PathKind(written=True, streamed=True),
        kw_only=False,
        short="-o",
        usual="MODEL.glb",
        help=f"{EXPORTS}. With a format of folders: the folder, which a second run continues.",
    )
    format: str | None = option(
        converter=optional(TextKind("NAME")),
        default=None,
        usual="the output's suffix",
        help=f"Format of the file, or of a folder: {EXPORT_FOLDERS}.",
    )
    fps: Fraction = option(
        converter=ExactNumberKind("FPS"),
        default=30,
        usual="30; in episodes of a policy, its actions per second",
        help="Frames per second of the export [Hz], such as 60 or 30000/1001; in episodes of a policy, its actions per "
        "second divided by a whole number.",
    )
    speed: Fraction = option(
        converter=ExactNumberKind("FACTOR"),
        default=1,
        help="Simulated seconds per second of playback; 0.25 is slow motion.",
    )
    keep_partial: bool = option(
        converter=FlagKind(), default=False, help="If the simulation becomes unstable, keep the frames from before."
    )
    plot: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("PROBE,…")),
        default=(),
        help="Curves of measured values beside the scene, in formats that show curves: energy, qpos[left_*]. Each use "
        "adds a plot.",
    )
    mark_event: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("[LABEL=]CONDITION")),
        default=(),
        help="Mark the instants at which a condition becomes true, in formats with a time line: "
        "landed=contact(foot, floor) > 0.",
    )
    assert_: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("EXPR")),
        default=(),
        help="Exit with code 1 unless this condition holds at every step, and mark where it fails, in formats with a "
        "time line: max(abs(energy/drift)) < 1e-3.",
    )
    probe: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("NAME"), commas=True, expected="the name of something to measure"),
        default=(),
        usual="those of a trace; in episodes, what the policy observes",
        help="Values to export with the scene, in formats that hold measured values, or to observe in episodes: qpos, "
        "energy, xpos[hand], … as in a trace.",
    )
    rate: Fraction | None = option(
        converter=optional(ExactNumberKind("HZ")),
        default=None,
        usual="one row per frame",
        help="Rows of measured values per simulated second [Hz], at most one per step.",
    )
    jobs: int | str = option(
        converter=ProcessCountKind(),
        default=AUTO,
        help="Number of processes that render images, in formats that hold them, or that play episodes.",
    )
    images: str | None = option(
        converter=optional(ChoiceKind(IMAGES)),
        default=None,
        usual=H264,
        help="Encoding of the images of cameras, in MCAP: a video in H.264, or separate images.",
    )
    camera: tuple[object, ...] = option(
        converter=OneOrMoreKind(CameraKind()),
        default=(),
        usual="free in glb",
        help=f"Camera to add to those of the model: one of {', '.join(RIG_EXAMPLES)} with settings after a colon: "
        f"{' '.join(RIG_EXAMPLES.values())}; or a camera script, camera.yaml, with a sequence of shots. In formats "
        "with images: a camera of the images, which may be one of the model.",
    )
    size: tuple[int, int] = option(
        converter=SizeKind(),
        default=(1280, 720),
        usual="1280x720; 640x480 in episodes",
        help="Width and height of images [pixels]; their ratio is that of cameras.",
    )
