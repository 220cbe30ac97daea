"""Films of episodes, from the one with the lowest return to the one with the highest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.evaluation.table import PlayedEpisodes

WORST, MEDIAN, BEST = "worst", "median", "best"


@dataclass(frozen=True)
class FilmChoice:
    """An episode that is filmed.

    Attributes:
      rank: `worst`, `median`, `best`, or `rank7` for the seventh from below.
      group: the place of its group.
      episode: its place there.
    """

    rank: str
    group: int
    episode: int

    def name(self, groups: Sequence[PlayedEpisodes], *, varies: bool) -> str:
        """The name of its file."""
        group = groups[self.group]
        point = f"_point{group.point}" if varies else ""
        return f"{self.rank}{point}_seed{group.episodes[self.episode].seed}.mp4"


def chosen_films(groups: Sequence[PlayedEpisodes], count: int) -> list[FilmChoice]:
    """The episodes of `count` films, evenly spaced by rank of their returns; all, if there are not more.

    Of one film it is the median. Equal returns are ranked in the order of their seeds. With an even number of
    episodes the median is the lower of the two in the middle.
    """
    where = [(g, e) for g, group in enumerate(groups) for e in range(len(group.episodes))]
    returns = np.array([groups[g].episodes[e].total for g, e in where])
    order = np.argsort(np.where(np.isnan(returns), -np.inf, returns), kind="stable")
    last, middle = len(order) - 1, (len(order) - 1) // 2
    count = min(count, len(order))
    ranks = [middle if 2 * k == count - 1 else round(k * last / (count - 1)) for k in range(count)]
    return [FilmChoice(_word(rank, last, middle), *where[order[rank]]) for rank in dict.fromkeys(ranks)]


def _word(rank: int, last: int, middle: int) -> str:
    if rank == last:
        return BEST
    return WORST if rank == 0 else MEDIAN if rank == middle else f"rank{rank + 1}"
