"""Videos of episodes, from the one with the lowest return to the one with the highest.

Each shows that very episode, as `mjrun video TASK --policy P --seed S` does.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjrun.errors import MjrunError
from mjrun.evaluation.episode import EpisodeSpec, PlayedEpisodes
from mjrun.evaluation.prepared import PreparedEvaluation
from mjrun.evaluation.result import EpisodeVideo
from mjrun.options.evaluation import FilmOptions
from mjrun.outputs.perform import perform, preview
from mjrun.outputs.video import Video
from mjrun.reporter import Reporter, WarningReporter
from mjrun.simulation.simulation import Simulation

WORST, MEDIAN, BEST = "worst", "median", "best"
NAMES = re.compile(r"(worst|median|best|rank\d+)(_point\d+)?_seed\d+\.mp4")

Failures = list[tuple[str, MjrunError]]


@dataclass(frozen=True)
class VideoChoice:
    """An episode that is recorded.

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


def chosen_videos(groups: Sequence[PlayedEpisodes], count: int) -> list[VideoChoice]:
    """The episodes of `count` videos, evenly spaced by rank of their returns; all, if there are not more.

    Of one video it is the median. Equal returns are ranked in the order of their seeds. With an even number of
    episodes the median is the lower of the two in the middle.
    """
    where = [(g, e) for g, group in enumerate(groups) for e in range(len(group.episodes))]
    returns = np.array([groups[g].episodes[e].total for g, e in where])
    order = np.argsort(np.where(np.isnan(returns), -np.inf, returns), kind="stable")
    last, middle = len(order) - 1, (len(order) - 1) // 2
    count = min(count, len(order))
    ranks = [middle if 2 * k == count - 1 else round(k * last / (count - 1)) for k in range(count)]
    return [VideoChoice(_word(rank, last, middle), *where[order[rank]]) for rank in dict.fromkeys(ranks)]


def _word(rank: int, last: int, middle: int) -> str:
    if rank == last:
        return BEST
    return WORST if rank == 0 else MEDIAN if rank == middle else f"rank{rank + 1}"


class VideoMaker:
    """Makes the videos that `options` ask for.

    Args:
      seed: of the first episode.

    Raises:
      UsageError: there is no such camera, or a size that cannot be.
    """

    def __init__(self, options: FilmOptions, prepared: PreparedEvaluation, seed: int) -> None:
        self._options, self._prepared = options, prepared
        if options.films:
            preview([self._video(prepared.groups[0].spec, seed, "video.mp4")], WarningReporter())

    def make(
        self, groups: Sequence[PlayedEpisodes], folder: Path, reporter: Reporter
    ) -> tuple[list[EpisodeVideo], Failures]:
        """The videos of episodes of `groups`, which are the first of those prepared; and which could not be made."""
        videos, failures, warnings = list[EpisodeVideo](), Failures(), _Warnings(reporter)
        chosen = chosen_videos(groups, self._options.films) if self._options.films else []
        for done, choice in enumerate(chosen, 1):
            path = str(folder / choice.name(groups, varies=bool(self._prepared.points.names)))
            try:
                video = self._video(self._prepared.groups[choice.group].spec, self._seed(groups, choice), path)
                perform([video], warnings)
                videos.append(self._made(groups, choice, path))
            except MjrunError as error:
                failures.append((path, error))
            reporter.progress("films", done, len(chosen))
        return videos, failures

    def _made(self, groups: Sequence[PlayedEpisodes], choice: VideoChoice, path: str) -> EpisodeVideo:
        group = groups[choice.group]
        episode = group.episodes[choice.episode]
        point = group.point if self._prepared.points.names else None
        return EpisodeVideo(choice.rank, path, episode.seed, point, episode.total, episode.ending)

    def _seed(self, groups: Sequence[PlayedEpisodes], choice: VideoChoice) -> int:
        return groups[choice.group].episodes[choice.episode].seed

    def _video(self, spec: EpisodeSpec, seed: int, path: str) -> Video:
        options, chosen = self._options, spec.chosen
        return Video(
            Simulation(
                spec.task,
                policy=chosen.policy,
                normalize=chosen.normalize,
                trust=chosen.trust,
                seed=seed,
                snapshot=chosen.snapshot,
            ),
            path,
            camera=options.camera,
            size=options.size,
            quality=options.quality,
            fps=options.fps,
            speed=options.speed,
        )


class _Warnings(WarningReporter):
    """Passes on each warning once, and nothing else: videos are reported together."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter, self._told = reporter, set[str]()

    def warn(self, text: str) -> None:
        kind = text.partition(":")[0]
        if kind not in self._told:
            self._told.add(kind)
            self._reporter.warn(text)


def remove_old_videos(folder: Path, names: Collection[str]) -> None:
    """Removes the videos of an earlier evaluation, which would be taken for those with these names, the new ones."""
    for path in folder.iterdir():
        if NAMES.fullmatch(path.name) and path.name not in names:
            path.unlink(missing_ok=True)
