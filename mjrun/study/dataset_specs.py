"""The images and the episodes of datasets as values: what each point shows, and where its files are."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean, option
from mjrun.formats.codecs import VideoEncoding
from mjrun.model.names import distinct
from mjrun.options.datasets import CAMERA, LabelledImageOptions
from mjrun.options.rendering import RIG_EXAMPLES, ViewOptions
from mjrun.simulation.origin import plain

if TYPE_CHECKING:
    from mjrun.study.episode_files import EpisodeFileMaker
    from mjrun.study.point_images import PointImageMaker

VECTORS = ("lookat", "offset", "from", "at")  # settings of rigs that are points x/y/z
RATIO = (5**0.5 - 1) / 2  # whose multiples are spread evenly between 0 and 1
RECORDS = "records"

Split = tuple[tuple[str, Fraction], ...]
NEARLY = 0.01  # relative difference of a rate that a dataset may round
FOLDER = "episodes"  # of the episodes that have not joined the dataset


@dataclass(frozen=True)
class ImageSpec:
    """The specification of the images of each point of a dataset.

    Attributes:
      options: their content and labels.
      split: parts of the dataset and their shares, if the places of files depend on them.
      objects: names of the objects, which all points share.
      layout: `flat`, a folder for each kind of image; or `bop`, a folder for each part of the dataset and kind.
    """

    options: LabelledImageOptions
    split: Split
    objects: tuple[str, ...]
    layout: Literal["flat", "bop"] = "flat"

    @property
    def identity(self) -> object:
        """Everything that determines the images, whatever renders them."""
        return plain(replace(self, options=replace(self.options, gl=None, require_gpu=False)))

    def maker(self) -> "PointImageMaker":
        """Returns what makes the files."""
        from mjrun.study.point_images import PointImageMaker  # which imports the renderer

        return PointImageMaker(self)

    @property
    def per_point(self) -> int:
        """The number of images of each point."""
        return len(self.options.times) * len(self.options.camera)


def part_of(index: int, split: Split) -> str:
    """Returns the part of the dataset that a point belongs to, whatever the number of points."""
    place, end = (index * RATIO) % 1, 0.0
    for name, share in split:
        end += float(share)
        if place < end:
            return name
    return split[-1][0]


def camera_argument(text: str, values: Mapping[str, str]) -> str:
    """Returns the argument of a rig with other settings, `lookat`, or `lookat[0]` for one coordinate.

    Cameras of the model have no settings.

    Raises:
      UsageError: a coordinate is not one.
    """
    kind, _, rest = text.partition(":")
    if not values or kind not in RIG_EXAMPLES:
        return text
    parts = [part for part in rest.split(",") if part]
    target = [part for part in parts if "=" not in part]
    settings = dict(part.split("=", 1) for part in parts if "=" in part)
    vectors: dict[str, list[str]] = {}
    for key, value in values.items():
        name, bracket, place = key.partition("[")
        if not bracket:
            settings[key] = value
            continue
        if name not in VECTORS or place not in ("0]", "1]", "2]"):
            valid = ", ".join(f"{CAMERA}{each}[0]" for each in VECTORS)
            raise UsageError(f"{option('vary')} {clean(CAMERA + key)}: only points have coordinates, as in {valid}")
        given = settings.get(name, "0/0/0").split("/")
        vectors.setdefault(name, given if len(given) == 3 else ["0"] * 3)[int(place[0])] = value
    settings |= {name: "/".join(numbers) for name, numbers in vectors.items()}
    kind = "free" if kind == "auto" and not {*settings} <= {"azimuth", "elevation", "roll", "fovy"} else kind
    return f"{kind}:{','.join([*target, *(f'{name}={value}' for name, value in settings.items())])}"


def record_path(index: int) -> str:
    """Returns the path of the record of a point in its dataset."""
    return f"{RECORDS}/{index:06d}.json"


@dataclass(frozen=True)
class EpisodeSpec:
    """The specification of the files of an episode: everything that determines them, except its simulation.

    Attributes:
      view: cameras, and what they show.
      cameras: names of the cameras in the dataset.
      encoding: encoding of the videos.
      probe: names of the observed columns; empty for the observation of the policy.
      fps: rows per second, as the dataset states them.
      every: control periods from one row to the next; 0 without a policy.
      task: the task in words; empty if each episode has its own.
      observed, acted: names of the numbers of an observation and of an action, which all episodes share.
      precision: the type of the numbers in the format.
      processes: number of processes that render an episode.
    """

    view: ViewOptions
    cameras: tuple[str, ...]
    encoding: VideoEncoding
    probe: tuple[str, ...]
    fps: str
    every: int
    task: str
    observed: tuple[str, ...]
    acted: tuple[str, ...]
    precision: Literal["float32", "float64"] = "float64"
    processes: int = 1

    @property
    def identity(self) -> object:
        """Everything that determines the files, whatever renders them."""
        return plain(replace(self, view=replace(self.view, gl=None, require_gpu=False), processes=1))

    def maker(self) -> "EpisodeFileMaker":
        """Returns what makes the files."""
        from mjrun.study.episode_files import EpisodeFileMaker  # which imports the renderer

        return EpisodeFileMaker(self)


def camera_keys(cameras: Sequence[object]) -> tuple[str, ...]:
    """Returns a name for each camera that paths and names of features can contain, each only once."""
    from mjrun.camera.script import short_name  # which only datasets need

    names = map(short_name, cameras)
    return tuple(distinct(re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "camera" for name in names))
