"""The table of episodes: a row for each, in the order of policies, points and seeds, whatever played them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.evaluation.episode import Episode
from mjrun.model.column import Column
from mjrun.study.design import Design, numbers

OUTCOMES = ("success", "failure", "timeout")
FILES = ("episodes.parquet", "episodes.csv")
REWARD = "reward/"  # before the name of each term
OWN = ("policy", "point", "episode", "seed", "return", "length", "steps", "ending", "outcome")


@dataclass(frozen=True)
class PlayedEpisodes:
    """The episodes of one policy at one point.

    Attributes:
      policy: its name.
      point: the number of the point.
      episodes: in the order of their seeds.
    """

    policy: str
    point: int
    episodes: Sequence[Episode]

    @property
    def returns(self) -> np.ndarray:
        """`(n,)`."""
        return np.array([episode.total for episode in self.episodes])

    @property
    def successes(self) -> np.ndarray:
        """Bool `(n,)`."""
        return np.array([episode.outcome == OUTCOMES[0] for episode in self.episodes])


def episode_columns(
    groups: Sequence[PlayedEpisodes], points: Design, rewards: Sequence[str], metrics: Sequence[str], *, compared: bool
) -> tuple[list[Column], np.ndarray]:
    """The columns of the table, and its rows `(n, columns)`; texts are indices into the labels of their columns.

    Args:
      points: what varies; of one point without values where nothing does.
      rewards, metrics: their names.
      compared: whether there are several policies to be told apart.
    """
    columns, values = list[Column](), list[np.ndarray]()
    all_episodes = [episode for group in groups for episode in group.episodes]
    where = [group.point for group in groups for _ in group.episodes]

    def add(name: str, cells: Sequence[float], meaning: str, unit: str = "", *, integer: bool = False) -> None:
        columns.append(Column(name, unit, meaning, integer=integer))
        values.append(np.array(cells, float))

    def add_texts(name: str, texts: Sequence[str], meaning: str) -> None:
        labels = tuple(dict.fromkeys(texts))
        columns.append(Column(name, meaning=meaning, labels=labels))
        values.append(np.array([labels.index(text) for text in texts], float))

    if compared:
        add_texts("policy", [group.policy for group in groups for _ in group.episodes], "who played")
    if points.names:
        add("point", where, "number of the point", integer=True)
    for index, name in enumerate(points.names):
        texts = [points.points[point][index] for point in where]
        as_numbers = numbers(name, texts)
        if as_numbers is None:
            add_texts(name, texts, "what varies")
        else:
            add(name, as_numbers.tolist(), "what varies")

    order = [index for group in groups for index in range(len(group.episodes))]
    add("episode", order, "number of the episode", integer=True)
    add("seed", [episode.seed for episode in all_episodes], "of all that is random in it", integer=True)
    add("return", [episode.total for episode in all_episodes], "sum of all rewards")
    add("length", [episode.length for episode in all_episodes], "simulated time", "s")
    add("steps", [episode.steps for episode in all_episodes], "control periods", integer=True)
    add_texts("ending", [episode.ending for episode in all_episodes], "how it ended")
    add_texts("outcome", [episode.outcome for episode in all_episodes], "what that means")
    for name in rewards:
        sums = [episode.rewards.get(name, math.nan) for episode in all_episodes]
        add(f"{REWARD}{name}", sums, "sum of a term of the reward")
    for index, name in enumerate(metrics):
        add(name, [episode.metrics[index] for episode in all_episodes], "metric")
    return columns, np.stack(values, axis=1)
