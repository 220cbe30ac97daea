"""Videos of episodes, evenly spaced by return from the lowest to the highest, or of all failures.

Each video shows the very episode, as `mjrun video TASK --policy P --seed S` does.
"""

import re
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import MjrunError, option
from mjrun.evaluation.episode import FAILURE, GroupSpec, PlayedEpisodes
from mjrun.evaluation.prepared import PreparedEvaluation
from mjrun.options.evaluation import FAILURES, EpisodeVideoOptions
from mjrun.options.option import values_of
from mjrun.options.video import SelectedVideoOptions
from mjrun.outputs.perform import perform, preview
from mjrun.outputs.video import Video
from mjrun.reporter import Reporter, WarningReporter

NAMES = re.compile(r"(worst|median|best|failure|rank\d+)(_point\d+)?_seed\d+\.mp4")


@dataclass(frozen=True)
class EpisodeVideo:
    """A video of an episode.

    Attributes:
      rank: `worst`, `median`, `best`, or `rank7` for the seventh lowest return; `failure` of all failures.
      path: path of the file.
      seed: seed of the episode.
      point: point of the episode, if something varies.
      returned: return of the episode.
      ending: name of the termination.
    """

    rank: str
    path: str
    seed: int
    point: int | None
    returned: float
    ending: str


@dataclass(frozen=True)
class VideoChoice:
    """An episode that is chosen for a video.

    Attributes:
      rank: see `EpisodeVideo`.
      group: index of its group.
      episode: index in the group.
    """

    rank: str
    group: int
    episode: int

    def name(self, groups: Sequence[PlayedEpisodes], *, varies: bool) -> str:
        """Returns the name of the file."""
        group = groups[self.group]
        point = f"_point{group.point}" if varies else ""
        return f"{self.rank}{point}_seed{group.episodes[self.episode].seed}.mp4"


def chosen_videos(groups: Sequence[PlayedEpisodes], count: int | str) -> list[VideoChoice]:
    """Chooses the episodes of `count` videos, evenly spaced by rank of their returns; at most all that did not fail.

    One video shows the median. Equal returns are ranked in the order of their seeds. The median of an even number of
    episodes is the lower of the two in the middle.

    Args:
      count: number of videos, or `failures` for all episodes that end in a failure, by group and seed.
    """
    where = [(g, e) for g, group in enumerate(groups) for e, each in enumerate(group.episodes) if each.status == "ok"]
    if isinstance(count, str):
        is_failure = [groups[g].episodes[e].outcome == FAILURE for g, e in where]
        return [VideoChoice(FAILURE, g, e) for (g, e), fails in zip(where, is_failure, strict=True) if fails]
    returns = np.array([groups[g].episodes[e].total for g, e in where])
    order: list[int] = np.argsort(np.where(np.isnan(returns), -np.inf, returns), kind="stable").tolist()
    last, middle = len(order) - 1, (len(order) - 1) // 2
    count = min(count, len(order))
    ranks = [middle if 2 * k == count - 1 else round(k * last / (count - 1)) for k in range(count)]
    words = {middle: "median", 0: "worst", last: "best"}  # of a lone episode: best
    return [VideoChoice(words.get(rank, f"rank{rank + 1}"), *where[order[rank]]) for rank in dict.fromkeys(ranks)]


class VideoMaker:
    """A maker of the videos that `options` request.

    Args:
      seed: seed of the first episode.

    Raises:
      UsageError: a camera is unknown, or the size is not supported.
    """

    def __init__(self, options: EpisodeVideoOptions, prepared: PreparedEvaluation, seed: int) -> None:
        self._options, self._prepared = options, prepared
        if options.videos:
            preview([self._video(prepared.groups[0].spec, seed, "video.mp4")], WarningReporter())

    def make(
        self, groups: Sequence[PlayedEpisodes], folder: Path, reporter: Reporter
    ) -> tuple[list[EpisodeVideo], list[tuple[str, MjrunError]]]:
        """Makes videos of episodes of `groups`, the first of those prepared; returns them and the paths that failed."""
        videos, failures = list[EpisodeVideo](), list[tuple[str, MjrunError]]()
        warnings = _DistinctWarnings(reporter)
        varies = bool(self._prepared.points.names)
        choices = chosen_videos(groups, self._options.videos) if self._options.videos else []
        if self._options.videos == FAILURES and not choices:
            reporter.note(f"{option('videos')} {FAILURES}: no episode ended in a failure")
        for done, choice in enumerate(choices, 1):
            group, path = groups[choice.group], str(folder / choice.name(groups, varies=varies))
            episode = group.episodes[choice.episode]
            try:
                perform([self._video(self._prepared.groups[choice.group].spec, episode.seed, path)], warnings)
                point = group.point if varies else None
                videos.append(EpisodeVideo(choice.rank, path, episode.seed, point, episode.total, episode.ending))
            except MjrunError as error:
                failures.append((path, error))
            reporter.progress("videos", done, len(choices))
        return videos, failures

    def _video(self, spec: GroupSpec, seed: int, path: str) -> Video:
        return Video(spec.simulation(seed), path, **values_of(self._options, SelectedVideoOptions))


class _DistinctWarnings(WarningReporter):
    """A reporter that forwards each kind of warning once, and nothing else, since videos are reported together."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter, self._kinds = reporter, set[str]()

    def warn(self, text: str) -> None:
        kind = text.partition(":")[0]
        if kind not in self._kinds:
            self._kinds.add(kind)
            self._reporter.warn(text)


def remove_old_videos(folder: Path, names: Collection[str]) -> None:
    """Removes videos of an earlier evaluation, which could be mistaken for the new ones, called `names`."""
    for path in folder.iterdir():
        if NAMES.fullmatch(path.name) and path.name not in names:
            path.unlink(missing_ok=True)
