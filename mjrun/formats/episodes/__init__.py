"""Formats of datasets of episodes: a module for each, which writes episodes as plain values.

A module has `PRECISION`, the type of the numbers in its files, and two functions:

- `check(layout)` raises UsageError for a layout that the format does not support.
- `write(stack, folder, layout, episodes, before)` reads the episodes one after the other, and returns the finished
  writers of all files, to be published together; `stack` discards them. The first `before` episodes of the dataset that
  is in the folder are kept. Memory does not grow with the number of episodes.
"""

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import field
from fractions import Fraction
from pathlib import Path
from typing import Self

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, clean
from mjrun.formats.codecs import VideoEncoding
from mjrun.model.table_column import Column

NUMBERS = "numbers.npz"  # the archive of an episode that is stored before it joins a dataset
FACTS, INFO, COLORS = "facts", "info/", "colors/"  # entries of the archive, and what precedes names in it
FIELDS = ("observations", "actions", "rewards")


@dataclass(frozen=True)
class CameraVideoLayout:
    """The layout of the videos of a camera, one for each episode: their size and encoding.

    Attributes:
      name: name of the camera: letters, digits, `-` and `_`.
      size: width and height [pixels].
    """

    name: str
    size: tuple[int, int]
    encoding: VideoEncoding


@dataclass(frozen=True)
class EpisodeLayout:
    """The layout of the episodes of a dataset: everything that they share.

    Attributes:
      fps: rows per second.
      observations, actions: the numbers of an observation and of an action.
      action_low, action_high: bounds of an action `(nact,)`, in its units; infinite for none.
      cameras: cameras of which each episode has a video.
      has_rewards: true if the episodes have rewards and endings.
      robot: name of the robot or the model.
      environment: the environment as Gymnasium specifies it, in JSON; empty if nothing can create it again.
      origin: facts about the making of the dataset: the command line, and the versions of programs.
    """

    fps: Fraction
    observations: Sequence[Column]
    actions: Sequence[Column]
    action_low: Sequence[float]
    action_high: Sequence[float]
    cameras: Sequence[CameraVideoLayout] = ()
    has_rewards: bool = True
    robot: str = ""
    environment: str = ""
    origin: Mapping[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True)
class EpisodeRows:
    """An episode of T rows. In row t, the action t follows the observation t, and leads to the observation t + 1.

    Attributes:
      task: a sentence or a name that describes the task.
      seed: seed of the episode, if it has one.
      observations: `(T + 1, nobs)`; the last one follows the last action.
      actions: `(T, nact)`.
      rewards: reward of each action `(T,)`; zeros where the layout has none.
      terminated, truncated: true if the episode ended by itself, or at a limit of time.
      success: true if it ended in success.
      infos: further numbers at each observation `(T + 1, …)`, by name.
      videos: the video of each camera, with T frames, in an MP4 file without B-frames; it must exist until all files
        are written.
      colors: the number of pixels with each value of each channel, in the images of each camera `(3, 256)`.
    """

    task: str
    seed: int | None
    observations: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    terminated: bool = False
    truncated: bool = False
    success: bool = False
    infos: Mapping[str, np.ndarray] = field(default_factory=dict[str, np.ndarray])
    videos: Mapping[str, Path] = field(default_factory=dict[str, Path])
    colors: Mapping[str, np.ndarray] = field(default_factory=dict[str, np.ndarray])

    def __len__(self) -> int:
        return len(self.actions)

    @property
    def done(self) -> np.ndarray:
        """The flag of the end for each action `(T,)` bool."""
        return self.at_end(self.terminated or self.truncated)

    @classmethod
    def read(cls, folder: Path, cameras: Sequence[str]) -> Self:
        """Reads an episode from a folder with its `files`.

        Raises:
          FileError: a file is missing or damaged.
        """
        path = folder / NUMBERS
        try:
            with np.load(path, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
            facts = json.loads(str(arrays.pop(FACTS)))
            return cls(
                **facts,
                **{name: arrays[name] for name in FIELDS},
                infos={name.removeprefix(INFO): values for name, values in arrays.items() if name.startswith(INFO)},
                videos={name: folder / f"{name}.mp4" for name in cameras},
                colors={name: arrays[COLORS + name] for name in cameras},
            )
        except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
            raise FileError(path, f"cannot be read: {clean(str(error))}") from None

    def files(self, videos: Mapping[str, bytes]) -> list[tuple[str, bytes]]:
        """Returns the files that hold this episode until it joins a dataset, by their names in its folder.

        Args:
          videos: the contents of the video of each camera, instead of those in `videos`.
        """
        facts = {name: getattr(self, name) for name in ("task", "seed", "terminated", "truncated", "success")}
        arrays = {name: getattr(self, name) for name in FIELDS}
        arrays |= {f"{INFO}{name}": values for name, values in self.infos.items()}
        arrays |= {f"{COLORS}{name}": values for name, values in self.colors.items()}
        archive = io.BytesIO()
        np.savez(archive, allow_pickle=False, **arrays, **{FACTS: np.array(json.dumps(facts))})
        return [(NUMBERS, archive.getvalue()), *((f"{name}.mp4", content) for name, content in videos.items())]

    def at_end(self, value: bool) -> np.ndarray:
        """Returns `value` for the last row, and false for all others `(T,)` bool."""
        rows = np.zeros(len(self), bool)
        rows[-1:] = value
        return rows
