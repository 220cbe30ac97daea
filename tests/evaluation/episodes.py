"""Episodes for tests, without a simulation."""

from collections.abc import Sequence

import numpy as np

from mjrun.evaluation.episode import EpisodeRecord, PlayedEpisodes

ENDINGS = (("arrived", "success"), ("fallen", "failure"), ("timeout", "timeout"))


def episodes(count: int, generator: np.random.Generator, *, seed: int = 0, metrics: int = 1) -> list[EpisodeRecord]:
    """Random episodes of successive seeds, with terms `near` and `cost`."""
    made: list[EpisodeRecord] = []
    for index in range(count):
        near, cost = (float(number) for number in generator.normal(2, 1, 2))
        steps = int(generator.integers(1, 200))
        ending, outcome = ENDINGS[int(generator.integers(3))]
        measured = tuple(generator.normal(size=metrics).tolist())
        terms, sums = ("near", "cost"), (near, -cost)
        made.append(
            EpisodeRecord(seed + index, near - cost, steps, steps * 0.02, ending, outcome, terms, sums, measured)
        )
    return made


def played(*returns: float, policy: str = "p", point: int = 0, seed: int = 0) -> PlayedEpisodes:
    """Episodes with these returns; positive ones are successes."""
    made = [
        EpisodeRecord(seed + i, value, 1, 0.02, *(ENDINGS[0] if value > 0 else ENDINGS[1]), (), ())
        for i, value in enumerate(returns)
    ]
    return PlayedEpisodes(policy, point, made)


def totals(groups: Sequence[PlayedEpisodes]) -> list[float]:
    """The returns of all episodes, in order."""
    return [episode.total for group in groups for episode in group.episodes]
