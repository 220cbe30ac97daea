"""The episodes of a dataset as values: how they are measured and rendered."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from mjrun.dataclass import dataclass
from mjrun.formats.codecs import Encoding
from mjrun.options.rendering import ViewOptions
from mjrun.simulation.manifest import plain

if TYPE_CHECKING:
    from mjrun.study.point_episodes import EpisodeFileMaker

NEARLY = 0.01  # relative difference of a rate that a dataset may round
FOLDER = "episodes"  # of the episodes that have not joined the dataset


@dataclass(frozen=True)
class EpisodeSpec:
    """Everything that determines the files of an episode, except its simulation.

    Attributes:
      view: cameras, and what they show.
      cameras: names of the cameras in the dataset.
      encoding: encoding of the videos.
      probe: names of the observed columns; empty for the observation of the policy.
      fps: rows per second, as the dataset states them.
      every: control periods from one row to the next; 0 without a policy.
      task: the task in words; empty if each episode has its own.
      observed, acted: names of the numbers of an observation and of an action, which all episodes share.
      processes: number of processes that render an episode.
    """

    view: ViewOptions
    cameras: tuple[str, ...]
    encoding: Encoding
    probe: tuple[str, ...]
    fps: str
    every: int
    task: str
    observed: tuple[str, ...]
    acted: tuple[str, ...]
    processes: int = 1

    @property
    def identity(self) -> object:
        """Everything that determines the files, whatever renders them."""
        return plain(replace(self, view=replace(self.view, gl=None, require_gpu=False), processes=1))

    def maker(self) -> "EpisodeFileMaker":
        """Returns what makes the files."""
        from mjrun.study.point_episodes import EpisodeFileMaker  # which imports the renderer

        return EpisodeFileMaker(self)


def camera_keys(cameras: Sequence[object]) -> tuple[str, ...]:
    """Returns a name for each camera that paths and names of features can contain, each only once."""
    from mjrun.camera.script import CameraScript  # which only datasets need

    names = [each.name if isinstance(each, CameraScript) else str(each).partition(",")[0] for each in cameras]
    plain_names = [re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "camera" for name in names]
    keys = list[str]()
    for name in plain_names:
        key, number = name, 2
        while key in keys:
            key, number = f"{name}_{number}", number + 1
        keys.append(key)
    return tuple(keys)
