"""Formats of datasets of episodes: a module for each, which writes episodes as plain values.

A module has two functions:

- `check(layout)` raises UsageError for a layout that the format does not support.
- `write(stack, folder, layout, episodes, before)` reads the episodes one after the other, and returns the finished
  writers of all files, to be published together; `stack` discards them. The first `before` episodes of the dataset that
  is in the folder are kept. Memory does not grow with the number of episodes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field
from fractions import Fraction
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.formats.codecs import Encoding
from mjrun.model.table_column import Column


@dataclass(frozen=True)
class CameraVideos:
    """The videos of a camera, one for each episode.

    Attributes:
      name: name of the camera: letters, digits, `-` and `_`.
      size: width and height [pixels].
    """

    name: str
    size: tuple[int, int]
    encoding: Encoding


@dataclass(frozen=True)
class EpisodeLayout:
    """Everything that the episodes of a dataset share.

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
    cameras: Sequence[CameraVideos] = ()
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

    def at_end(self, value: bool) -> np.ndarray:
        """Returns `value` for the last row, and false for all others `(T,)` bool."""
        rows = np.zeros(len(self), bool)
        rows[-1:] = value
        return rows
