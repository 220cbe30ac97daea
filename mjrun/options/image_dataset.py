"""Options of the command `dataset`: labelled images of many variations of a model."""

from dataclasses import field
from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import CameraKind, ChoiceKind, FlagKind, Kind, OneOrMoreKind, PathKind, TextKind
from mjrun.options.number_kinds import ExactNumberKind, SizeKind
from mjrun.options.option import OptionRequirement, option, options, required
from mjrun.options.rendering import STAGE, RendererOptions, geoms_option
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.sweep import VariationOptions

FORMATS = {
    "folder": "images, depths, masks and a JSON record for each image",
    "coco": "annotations/instances_SPLIT.json",
    "yolo": "labels of boxes, masks or keypoints, and data.yaml",
    "nerfstudio": "transforms.json",
    "bop": "scenes of 6D object poses",
}
# The extra of datasets, with the libraries that it installs and what needs them.
EXTRAS: dict[str, tuple[tuple[str, ...], str]] = {"dataset": (("scipy", "pyarrow", "contourpy"), "mjrun dataset")}
CAMERA = "camera."  # precedes the settings of the camera that vary
SPLIT = "train=0.8,val=0.2"
YOLO_TASKS = ("detect", "segment", "pose")


class NamedSharesKind(Kind["str | tuple[tuple[str, Fraction], ...]", tuple[tuple[str, Fraction], ...]]):
    """Names with their shares, which sum to 1: `train=0.8,val=0.2`."""

    metavar = "NAME=SHARE,…"
    expected = "a list of names with shares that sum to 1, as in train=0.8,val=0.2"

    def __call__(self, value: "str | tuple[tuple[str, Fraction], ...]") -> tuple[tuple[str, Fraction], ...]:
        if not isinstance(value, str):
            return value
        pairs = [part.partition("=") for part in value.split(",")]
        try:
            shares = tuple((name.strip(), Fraction(share.strip())) for name, _, share in pairs)
        except (ValueError, ZeroDivisionError):
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
        converter=ChoiceKind(YOLO_TASKS),
        default="detect",
        help="Labels of YOLO: boxes, polygons of masks, or keypoints.",
    )
