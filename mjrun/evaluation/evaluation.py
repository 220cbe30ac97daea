"""An evaluation: seeded episodes of a task under one policy or two, and a folder with the results and videos."""

import dataclasses
import re
import shutil
import time
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import (
    FailedEpisodesError,
    MjrunError,
    PartlyDoneError,
    UsageError,
    clean,
    counted,
    listing,
    option,
)
from mjrun.evaluation.episode import FAILURE, EpisodeGroupSpec, PlayedEpisodes
from mjrun.evaluation.prepared import PreparedEvaluation, Rewritten, forget_code, play_all
from mjrun.evaluation.summaries import (
    FILES,
    PointSummary,
    PolicyComparison,
    PolicySummary,
    episode_table,
    point_table,
    summaries,
)
from mjrun.experiment.results_table import check_runs, manifest_writer, raise_failures, write_runs
from mjrun.formats.input_file import is_file
from mjrun.formats.local_and_remote_folders import LocalFolder, require_own_folder
from mjrun.formats.output_writer import OutputWriter, publish_together
from mjrun.formats.study_reader import check_result_folder, read_results
from mjrun.formats.temporary_output import scratch_folder
from mjrun.model.source import ModelSource
from mjrun.options.evaluation import FAILURES, MANIFEST, WORST, EpisodeVideoOptions, EvaluationOptions
from mjrun.options.option import options, values_of
from mjrun.options.sweep import PARTS, ExecutionOptions
from mjrun.options.video import PointOrEpisodeVideoOptions
from mjrun.outputs.perform import perform, rehearse
from mjrun.outputs.video import Video
from mjrun.plotting.table_figure import Table
from mjrun.probe.verdict import Verdict
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.study.executors import WARP, check_engine
from mjrun.study.part_files import kept_results_in_errors
from mjrun.version import __version__

NAMES = re.compile(r"(worst|median|best|failure|rank\d+)(_point\d+)?_seed\d+\.mp4")
SCHEMA = "mjrun-eval-1"


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
class _VideoChoice:
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


def chosen_videos(groups: Sequence[PlayedEpisodes], count: int | str) -> list[_VideoChoice]:
    """Chooses the episodes of `count` videos, evenly spaced by rank of their returns; at most all that did not fail.

    One video shows the median. Equal returns are ranked in the order of their seeds. The median of an even number of
    episodes is the lower of the two in the middle.

    Args:
      count: number of videos; `worst:3` for the three lowest returns; or `failures` for all episodes that end in a
        failure, by group and seed.
    """
    where = [(g, e) for g, group in enumerate(groups) for e, each in enumerate(group.episodes) if each.status == "ok"]
    if count == FAILURES:
        is_failure = [groups[g].episodes[e].outcome == FAILURE for g, e in where]
        return [_VideoChoice(FAILURE, g, e) for (g, e), fails in zip(where, is_failure, strict=True) if fails]
    returns = np.array([groups[g].episodes[e].total for g, e in where])
    order: list[int] = np.argsort(np.where(np.isnan(returns), -np.inf, returns), kind="stable").tolist()
    last, middle = len(order) - 1, (len(order) - 1) // 2
    if isinstance(count, str):
        ranks = range(min(int(count.removeprefix(WORST)), len(order)))
    else:
        count = min(count, len(order))
        ranks = [middle if 2 * k == count - 1 else round(k * last / (count - 1)) for k in range(count)]
    words = {middle: "median", 0: "worst", last: "best"}  # of a lone episode: best
    return [_VideoChoice(words.get(rank, f"rank{rank + 1}"), *where[order[rank]]) for rank in dict.fromkeys(ranks)]


class _VideoMaker:
    """A maker of the videos that `options` request.

    Args:
      seed: seed of the first episode.

    Raises:
      MjrunError: a camera is unknown, the size is not supported, or this machine cannot make videos.
    """

    def __init__(self, options: EpisodeVideoOptions, prepared: PreparedEvaluation, seed: int) -> None:
        self._options, self._prepared = options, prepared
        if options.videos:
            with scratch_folder() as folder:
                video = self._video(prepared.groups[0].spec, seed, str(folder / "video.mp4"))
                rehearse([replace(video, jobs=1)])

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

    def _video(self, spec: EpisodeGroupSpec, seed: int, path: str) -> Video:
        return Video(spec.simulation(seed), path, **values_of(self._options, PointOrEpisodeVideoOptions))


class _DistinctWarnings(PythonApiReporter):
    """A reporter that forwards each kind of warning once, and nothing else, since videos are reported together."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter, self._kinds = reporter, set[str]()

    def warn(self, text: str) -> None:
        kind = text.partition(":")[0]
        if kind not in self._kinds:
            self._kinds.add(kind)
            self._reporter.warn(text)


def remove_old_videos(folder: Path, names: Collection[str]) -> list[str]:
    """Removes videos of an earlier evaluation, which could be mistaken for those of this one, called `names`.

    Returns:
      the names of the removed files.
    """
    old = sorted(path.name for path in folder.iterdir() if NAMES.fullmatch(path.name) and path.name not in names)
    for name in old:
        (folder / name).unlink(missing_ok=True)
    return old


@options
class Evaluation(EvaluationOptions, ExecutionOptions):
    """Seeded episodes of `task` under a policy. Its options are keywords.

    Args:
      command: command line, for the manifest.
      rewritten: function that creates the task with other values of its document, if something there varies.
    """

    task: ModelSource = field(kw_only=False)
    command: str = ""
    rewritten: Rewritten | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.engine == WARP:
            raise UsageError(f"{option('engine')} warp plays no policies; {option('engine')} local does", ("engine",))

    def run(self, reporter: Reporter | None = None) -> "EvaluationResult":
        """Plays the episodes that the folder does not have yet, and writes their table and all requested files.

        Raises:
          FailedAssertionError: a requirement does not hold; all files are written nevertheless.
          FailedEpisodesError: episodes failed or are left; the tables have the others, or are not written if there are
            none.
          PartlyDoneError: videos could not be made; the tables are written nevertheless.
          MjrunError: no episode could be played.
        """
        reporter, start = reporter or PythonApiReporter(), time.perf_counter()
        if self.html is not None:
            from mjrun.experiment.results_page_parts import check_page  # which imports matplotlib

            check_page(self.html)
        prepared = PreparedEvaluation(self, self.task, self.rewritten)
        if self.export_to is not None:
            check_runs(self.export_to, len(prepared.points.points), self.output)
        maker = _VideoMaker(self, prepared, self.seed)
        folder = Path(self.output)
        require_own_folder(LocalFolder(folder), MANIFEST, "evaluation")
        check_engine(self.engine)

        played = self._play(prepared, folder, reporter)
        if not played.failed:
            for text in prepared.remarks(self.seed):
                reporter.warn(text)
        count = len(prepared.points.points)
        policies = [played.groups[first : first + count] for first in range(0, len(played.groups), count)]
        outcome = summaries(prepared.points, prepared.player, prepared.metrics, policies, self.confidence)
        _warn_of_returns(outcome.policies, reporter)
        table = episode_table(
            played.groups,
            prepared.points,
            prepared.player.rewards,
            prepared.metrics,
            prepared.units,
            compared=outcome.comparison is not None,
        )
        verdicts = list[Verdict]()
        if not played.missing:
            own = self.episodes * count
            verdicts = prepared.criteria.verdicts(table, own, outcome.policies[0], outcome.comparison)

        facts: dict[str, object] = {"mjrun": __version__, "mujoco": mujoco.mj_versionString()}  # the same in all runs
        with kept_results_in_errors(folder, "episode"), ExitStack() as stack:
            writers: list[OutputWriter] = [*table.open(stack, folder, facts, FILES)]
            if outcome.points:
                points, meanings = point_table(prepared.points, outcome.points, prepared.units)
                writers += points.open(stack, folder, {**facts, "metrics": meanings})
            videos, failures = maker.make(policies[0], folder, reporter)
            paths = [video.path for video in videos]
            files = [*(str(each.destination.shown) for each in writers), *paths, str(folder / MANIFEST)]
            result = EvaluationResult(
                path=self.output,
                task=self.task.text,
                episodes=self.episodes,
                seed=self.seed,
                confidence=self.confidence,
                policies=outcome.policies,
                comparison=outcome.comparison,
                names=prepared.points.names,
                points=outcome.points,
                units=prepared.units,
                videos=videos,
                assertions=verdicts,
                failures=failure_groups(played.groups),
                simulated=played.simulated,
                files=files,
                steps=sum(episode.steps for group in played.groups for episode in group.episodes),
                wall=time.perf_counter() - start,
            )
            facts = {"command": self.command, **facts, **dataclasses.asdict(result)}
            writers.append(stack.enter_context(manifest_writer(folder / MANIFEST, facts)))
            _publish(writers, folder, paths)

        if removed := remove_old_videos(folder, [Path(path).name for path in paths]):
            videos_removed = f"removed {counted(len(removed), 'video')} of an earlier run: {listing(removed)}"
            reporter.note(f"{clean(self.output)}: {videos_removed}; {option('output')} selects another folder")
        forget_code(played.groups, prepared, folder)
        if self.html is not None:
            from mjrun.evaluation.evaluation_page import write_evaluation_page

            write_evaluation_page(self, result, prepared.points, facts)
        if self.export_to is not None:
            everything = [PointSummary(0, {}, outcome.policies, outcome.comparison)]
            points, _ = point_table(prepared.points, outcome.points or everything, prepared.units)
            tags = {"task": self.task.text, "policy": outcome.policies[0].policy}
            write_runs(self.export_to, str(folder), points, prepared.points.names, tags)
        raise_failures(result, verdicts, _error(played, failures, result))
        return result

    def _play(self, prepared: PreparedEvaluation, folder: Path, reporter: Reporter) -> "_Played":
        """Plays the episodes that the folder does not have yet.

        Raises:
          FailedEpisodesError: no episode could be played.
        """
        is_new = self._begin(folder)
        seeds = range(self.seed, self.seed + self.episodes)
        played = _Played(*play_all(prepared, self, seeds, folder, reporter))
        if len(played.failed) + played.missing == len(played.groups) * self.episodes:
            if is_new and not played.missing:
                _remove(folder)
            raise _error_of_all(played)
        return played

    def _begin(self, folder: Path) -> bool:
        """Returns whether the evaluation is new; if so, writes a manifest, without which it could not be continued."""
        if is_file(folder / MANIFEST):
            return False
        with manifest_writer(folder / MANIFEST, {"command": self.command, "schema": SCHEMA}) as output:
            output.publish()
        return True


@dataclass(frozen=True)
class EvaluationResult:
    """The result of an evaluation.

    Attributes:
      path: folder of the results.
      task: task that was played.
      episodes: number of episodes of each policy at each point.
      seed: seed of the first episode.
      confidence: confidence of all intervals.
      policies: summary of all episodes of each policy, beginning with the evaluated one.
      comparison: comparison of two policies.
      names: parameters that vary.
      points: summary of each point, if something varies.
      units: units of parameters and metrics, by name; empty where unknown.
      videos: videos of episodes.
      assertions: requirements and whether they hold; empty while episodes are missing.
      failures: reasons of failures, the most frequent first.
      simulated: number of episodes that were played now; the others were known.
      files: files that were written.
      steps: number of control periods of all episodes.
      wall: wall time [s].
      schema: name of this schema.
    """

    path: str
    task: str
    episodes: int
    seed: int
    confidence: float
    policies: Sequence[PolicySummary]
    comparison: PolicyComparison | None
    names: Sequence[str]
    points: Sequence[PointSummary]
    units: Mapping[str, str]
    videos: Sequence[EpisodeVideo]
    assertions: Sequence[Verdict]
    failures: Sequence["EpisodeFailureGroup"]
    simulated: int
    files: Sequence[str]
    steps: int
    wall: float
    schema: str = field(default=SCHEMA)

    @property
    def table(self) -> Table:
        """The numbers of the episodes, a row for each: seed, return, length, terms of the reward and metrics.

        Raises:
          FileError: the folder has been removed or moved.
        """
        check_result_folder(self.path)
        numbers, _, _, _, units = read_results(Path(self.path) / FILES[0])
        return Table(dict(numbers), dict(units))

    def _repr_html_(self) -> str:
        """Returns the table of episodes for a notebook."""
        return self.table.to_html()


@dataclass(frozen=True)
class EpisodeFailureGroup:
    """Episodes that failed for one reason.

    Attributes:
      status: how they failed: failed, timeout or crashed.
      message: first line of the reason.
      count: number of episodes.
      policy, point, seed: the first of them.
    """

    status: str
    message: str
    count: int
    policy: str
    point: int
    seed: int


def failure_groups(groups: Sequence[PlayedEpisodes]) -> list[EpisodeFailureGroup]:
    """Groups failed episodes by reason, the most frequent first."""
    failures = dict[tuple[str, str], EpisodeFailureGroup]()
    for group in groups:
        for episode in group.episodes:
            if episode.status != "ok":
                reason = episode.status, episode.message.partition("\n")[0]
                known = failures.get(reason) or EpisodeFailureGroup(*reason, 0, group.policy, group.point, episode.seed)
                failures[reason] = replace(known, count=known.count + 1)
    return sorted(failures.values(), key=lambda each: -each.count)


@dataclass(frozen=True)
class _Played:
    """The episodes of every policy at every point, and how many of them were simulated rather than read."""

    groups: Sequence[PlayedEpisodes]
    simulated: int

    @cached_property
    def failed(self) -> Mapping[str, str]:
        """The message of each failed episode, by what identifies the episode."""
        several = len({group.policy for group in self.groups}) > 1
        varies = len({group.point for group in self.groups}) > 1
        return {
            f"seed {episode.seed}"
            + (f" at point {group.point}" if varies else "")
            + (f" of {group.policy}" if several else ""): episode.message
            for group in self.groups
            for episode in group.episodes
            if episode.status not in ("ok", "missing")
        }

    @cached_property
    def missing(self) -> int:
        """The number of episodes that are left."""
        return sum(episode.status == "missing" for group in self.groups for episode in group.episodes)


def _error_of_all(played: _Played) -> FailedEpisodesError:
    """Returns the error of an evaluation without results; its exit code is that of its episodes if they agree."""
    error = FailedEpisodesError(played.failed, len(played.failed) + played.missing, "table", played.missing)
    endings = {(episode.status, episode.exit_code) for group in played.groups for episode in group.episodes}
    (status, code), *others = endings
    if status == "failed" and not others:
        error.exit_code = code
    return error


def _remove(folder: Path) -> None:
    """Removes a folder in which nothing but an evaluation without episodes was written."""
    shutil.rmtree(folder / PARTS, ignore_errors=True)
    (folder / MANIFEST).unlink(missing_ok=True)
    with suppress(OSError):  # which has other files by now
        folder.rmdir()


def _error(played: _Played, videos: Sequence[tuple[str, MjrunError]], result: EvaluationResult) -> MjrunError | None:
    """Returns the error of an evaluation that is written, but lacks episodes or videos."""
    lacking = PartlyDoneError(result.files, videos) if videos else None
    if not played.failed and not played.missing:
        return lacking
    error = FailedEpisodesError(played.failed, len(played.groups) * result.episodes, "table", played.missing)
    if lacking:
        error.add_note(str(lacking))
    return error


def _publish(writers: Sequence[OutputWriter], folder: Path, videos: Sequence[str]) -> None:
    """Publishes the results, whose `videos` exist already.

    Raises:
      PartlyDoneError: the results cannot be published, and there are videos.
      MjrunError: the results cannot be published.
    """
    try:
        publish_together(writers)
    except MjrunError as error:
        if videos and not isinstance(error, PartlyDoneError):
            raise PartlyDoneError(videos, [(str(folder), error)]) from None
        raise


def _warn_of_returns(policies: Sequence[PolicySummary], reporter: Reporter) -> None:
    """Warns of returns that are not finite, which the summaries exclude."""
    for policy in policies:
        if missing := policy.episodes - policy.returns.count:
            terms = [name for name, numbers in policy.rewards.items() if numbers.count < policy.episodes]
            cause = f", because of {listing(terms)}" if terms else ""
            reporter.warn(
                f"{clean(policy.policy)}: {missing:,} of {counted(policy.episodes, 'return')} not finite{cause}; the "
                "summaries exclude them, and a check of the task finds their origin"
            )
