"""Options of datasets of episodes: their number, their numbers and images, and their format."""

from dataclasses import field
from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import CameraKind, ChoiceKind, NameOrIndexKind, OneOrMoreKind, PathKind, TextKind, optional
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind, SizeKind
from mjrun.options.option import Options, option, options, required
from mjrun.options.rendering import SceneOptions

# Extras of the formats: the libraries that each installs, and what needs them.
EXTRAS: dict[str, tuple[tuple[str, ...], str]] = {
    "lerobot": (("pyarrow",), "--format lerobot"),
    "minari": (("pyarrow", "h5py"), "--format minari"),
}
CODECS = ("h264", "h265", "av1")
KEYFRAMES = 2  # frames from one keyframe to the next: readers need frames in any order
UNUSED = ("trail", "trail_span", "ghost")  # additions to a scene that no policy sees


@options
class EpisodeOptions(Options):
    """Episodes of a dataset."""

    section: ClassVar[str] = "Episodes (lerobot, minari)"

    episodes: int | None = option(
        converter=optional(IntegerKind(1)),
        default=None,
        usual="10 of a policy, all in a file of demonstrations, otherwise 1",
        help="Number of episodes, with consecutive seeds from --seed on, as in mjrun eval; or of demonstrations.",
    )
    instruction: str | None = option(
        converter=optional(TextKind("TEXT")),
        default=None,
        usual="that of each demonstration, otherwise the name of the task",
        help="The task in words, which language-conditioned policies are trained with: 'put the cube into the box'.",
    )
    codec: str = option(
        converter=ChoiceKind(CODECS),
        default="h264",
        help="Video codec of the images: h264 plays everywhere; h265 and av1 give smaller files. Every second frame is "
        "a keyframe, so that readers find any frame fast.",
    )
    crf: int | None = option(
        converter=optional(IntegerKind(least=None)),
        default=None,
        usual="18; 20 with h265, 26 with av1",
        help="Constant rate factor of the encoder: lower values give better quality and larger files.",
    )
    preset: str | None = option(
        converter=optional(NameOrIndexKind("NAME", "the name of a preset")),
        default=None,
        usual="veryfast; 8 with av1",
        help="Encoder preset, a trade-off between encoding speed and compression.",
    )


@options
class EpisodeDatasetOptions(EpisodeOptions, SceneOptions):
    """A dataset of episodes.

    Args:
      simulation: the simulation, whose seed varies.
    """

    section: ClassVar[str] = "Dataset"

    simulation: object = field(kw_only=False)
    output: str = required(
        converter=PathKind("DIR", written=True),
        kw_only=False,
        short="-o",
        help="Folder for the dataset; running again with the same folder continues it.",
    )
    format: str = option(
        converter=ChoiceKind(tuple(EXTRAS)),
        default="lerobot",
        help="Format: lerobot, LeRobot v3 with a video for each camera; or minari, for offline reinforcement learning, "
        "without images.",
    )
    fps: Fraction | None = option(
        converter=optional(ExactNumberKind("FPS")),
        default=None,
        usual="one row for each action of a policy or a demonstration, otherwise 30",
        help="Rows and images per simulated second [Hz]. With a policy, the number of actions per second, or that "
        "divided by a whole number.",
    )
    probe: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("NAME"), commas=True, expected="the name of something to measure"),
        default=(),
        usual="what the policy observes, otherwise qpos and qvel",
        help="Values to observe, as in a trace: qpos, sensor/imu, xpos[hand], …",
    )
    camera: tuple[object, ...] = option(
        converter=OneOrMoreKind(CameraKind()),
        default=(),
        usual="none: a dataset without images",
        help="Camera of the images, as in a video; each use adds a camera.",
    )
    size: tuple[int, int] = option(
        converter=SizeKind(), default=(640, 480), help="Width and height of an image [pixels]."
    )
