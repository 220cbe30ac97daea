"""Options of datasets: labelled images of many variations of a model, and episodes with their numbers and images."""

from dataclasses import field
from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import (
    CameraKind,
    ChoiceKind,
    FlagKind,
    Kind,
    NameOrIndexKind,
    OneOrMoreKind,
    PathKind,
    TextKind,
    optional,
)
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind, SizeKind
from mjrun.options.option import OptionRequirement, Options, option, options, required
from mjrun.options.rendering import STAGE, RendererOptions, SceneOptions, geoms_option
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.sweep import VariationOptions
from mjrun.timeline import rational

FORMATS = {
    "folder": "images, depths, masks and a JSON record for each image",
    "coco": "annotations/instances_SPLIT.json",
    "yolo": "labels of boxes, masks or keypoints, and data.yaml",
    "nerfstudio": "transforms.json",
    "bop": "scenes of 6D object poses",
}
CAMERA = "camera."  # precedes the settings of the camera that vary
SPLIT = "train=0.8,val=0.2"
# Extras of images and of the formats of episodes: the libraries that each installs, and what needs them.
EXTRAS: dict[str, tuple[tuple[str, ...], str]] = {
    "dataset": (("scipy", "pyarrow", "contourpy"), "mjrun dataset"),
    "lerobot": (("pyarrow",), "--format lerobot"),
    "minari": (("pyarrow", "h5py"), "--format minari"),
}
EPISODE_FORMATS = ("lerobot", "minari")
CODECS = ("h264", "h265", "av1")
KEYFRAMES = 2  # frames from one keyframe to the next: readers need frames in any order


class NamedSharesKind(Kind["str | tuple[tuple[str, Fraction], ...]", tuple[tuple[str, Fraction], ...]]):
    """Names with their shares, which sum to 1: `train=0.8,val=0.2`."""

    metavar = "NAME=SHARE,…"
    expected = "a list of names with shares that sum to 1, as in train=0.8,val=0.2"

    def __call__(self, value: "str | tuple[tuple[str, Fraction], ...]") -> tuple[tuple[str, Fraction], ...]:
        pairs = [part.partition("=")[::2] for part in value.split(",")] if isinstance(value, str) else value
        try:
            shares = tuple((name.strip(), rational(share)) for name, share in pairs)
        except (AttributeError, TypeError, ValueError):
            raise InvalidValueError(self.expected) from None
        names = [name for name, _ in shares]
        numbers = [share for _, share in shares]
        if not all(name.isidentifier() for name in names) or len({*names}) < len(names):
            raise InvalidValueError(self.expected)
        if min(numbers) < 0 or sum(numbers) != 1:
            raise InvalidValueError(self.expected)
        return shares


@options
class LabelledImageOptions(RendererOptions):
    """Content of the images and of their labels."""

    section: ClassVar[str] = "Images"

    size: tuple[int, int] = option(
        converter=SizeKind(), default=(640, 480), help="Width and height of an image [pixels]."
    )
    camera: tuple[object, ...] = option(
        converter=OneOrMoreKind(CameraKind()),
        default="auto",
        help="Cameras and rigs, as for mjrun video, but no camera scripts. The settings of a rig can vary: "
        "--vary 'camera.azimuth=uniform(0,360)', camera.distance, camera.lookat, camera.fovy, …",
    )
    times: tuple[Fraction, ...] = option(
        converter=OneOrMoreKind(ExactNumberKind("SECONDS", zero=True), commas=True),
        default=(Fraction(0),),
        help="Simulated times of the images of each point [s].",
    )
    objects: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("BODY[=CATEGORY]"), commas=True),
        default=(),
        usual="all bodies and flexes in the world, each a category",
        help="Bodies, each with everything attached to it, and flexes to label, by name or wildcard, and their "
        "category: 'mug*=mug,robot'.",
    )
    keypoints: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("SITE"), commas=True),
        default=(),
        help="Sites to label as keypoints of the object that they belong to, by name or wildcard.",
    )
    accept: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("EXPR")),
        default=(),
        help="Include only images for which this condition holds: visible/mug > 0.3 and pixels/mug > 200. "
        "The values are pixels/OBJECT, visible/OBJECT and truncated/OBJECT (shares of its silhouette), and objects, "
        "the number of objects in view.",
    )
    stage: tuple[str, ...] = option(
        converter=OneOrMoreKind(ChoiceKind(STAGE), commas=True),
        default="auto",
        help="Surroundings to add: a floor that nothing collides with, light, sky, or none; auto adds the light and "
        "the sky that a model lacks.",
    )
    geoms: str | None = geoms_option()


@options
class DatasetOptions(LabelledImageOptions, VariationOptions):
    """A dataset.

    Args:
      simulation: the simulation that the points vary.
    """

    section: ClassVar[str] = "Dataset"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        OptionRequirement("polygons", "format", "whose masks it writes", value="coco"),
        OptionRequirement("yolo_task", "format", "whose labels it chooses", value="yolo"),
    )

    simulation: object = field(kw_only=False)
    output: str = required(
        converter=PathKind("DIR", written=True),
        kw_only=False,
        short="-o",
        usual="MODEL_dataset",
        help="Folder for the dataset; running again with the same folder continues it.",
    )
    format: tuple[str, ...] = option(
        converter=OneOrMoreKind(ChoiceKind(tuple(FORMATS)), commas=True),
        default="folder",
        help="Formats: " + "; ".join(f"{name} writes {what}" for name, what in FORMATS.items()) + ".",
    )
    split: tuple[tuple[str, Fraction], ...] = option(
        converter=NamedSharesKind(),
        default=SPLIT,
        usual=SPLIT,
        help="Parts of the dataset and their shares. Points keep their part when samples are added.",
    )
    polygons: bool = option(
        converter=FlagKind(),
        default=False,
        help="Write masks in COCO as polygons, which cannot have holes, instead of run lengths, which are exact.",
    )
    yolo_task: str = option(
        converter=ChoiceKind(("detect", "segment", "pose")),
        default="detect",
        help="Labels of YOLO: boxes, polygons of masks, or keypoints.",
    )


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
        converter=ChoiceKind(EPISODE_FORMATS),
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
