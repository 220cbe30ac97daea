"""An evaluation: seeded episodes of a task under one policy or two, and a folder with the results."""

import dataclasses
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import field
from pathlib import Path

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, MjrunError, PartlyDoneError, clean, counted, listing, option
from mjrun.evaluation.execution import play_all
from mjrun.evaluation.prepared import PreparedEvaluation, Rewritten
from mjrun.evaluation.summaries import EpisodeSummary, PointSummary, PolicyComparison, summaries
from mjrun.evaluation.table import FILES, episode_table, point_table
from mjrun.evaluation.videos import EpisodeVideo, VideoMaker, remove_old_videos
from mjrun.experiment.results_table import manifest_writer, raise_failures
from mjrun.formats.atomic_output import OutputWriter, publish_together
from mjrun.formats.destinations import StagedFile
from mjrun.formats.input_file import exists, is_file, is_folder
from mjrun.formats.study_reader import read_results
from mjrun.model.source import Source
from mjrun.options.evaluation import MANIFEST, EvaluationExecutionOptions, EvaluationOptions
from mjrun.options.option import options
from mjrun.plotting.table import Table
from mjrun.probe.verdict import Verdict
from mjrun.reporter import Reporter, WarningReporter
from mjrun.version import __version__

SCHEMA = "mjrun-eval-1"


@options
class Evaluation(EvaluationOptions, EvaluationExecutionOptions):
    """Seeded episodes of `task` under a policy. Its options are keywords.

    Args:
      command: command line, for the manifest.
      rewritten: function that creates the task with other values of its document, if something there varies.
    """

    task: Source = field(kw_only=False)
    command: str = ""
    rewritten: Rewritten | None = None

    def run(self, reporter: Reporter | None = None) -> "EvaluationResult":
        """Plays the episodes, and writes their table and all requested files.

        Raises:
          FailedAssertionError: a requirement does not hold; all files are written nevertheless.
          PartlyDoneError: videos could not be made; the tables are written nevertheless.
          SimulationError: a policy returned an action that is not finite; nothing is written.
          MjrunError: no episode could be played.
        """
        reporter, start = reporter or WarningReporter(), time.perf_counter()
        if self.html is not None:
            from mjrun.experiment.results_page import check_page  # which imports matplotlib

            check_page(self.html)
        prepared = PreparedEvaluation(self, self.task, self.rewritten)
        maker = VideoMaker(self, prepared, self.seed)
        folder = Path(self.output)
        _require_ours(folder)
        StagedFile(folder / MANIFEST).discard()  # which proves that it can be written

        groups = play_all(prepared.groups, range(self.seed, self.seed + self.episodes), self.jobs, reporter)
        count = len(prepared.points.points)
        policies = [groups[first : first + count] for first in range(0, len(groups), count)]
        outcome = summaries(prepared.points, prepared.player, prepared.metrics, policies, self.confidence)
        _warn_of_returns(outcome.policies, reporter)

        is_compared = outcome.comparison is not None
        table = episode_table(groups, prepared.points, prepared.player.rewards, prepared.metrics, compared=is_compared)
        own = self.episodes * count
        verdicts = prepared.criteria.verdicts(table, own, outcome.policies[0], outcome.comparison)
        facts: dict[str, object] = {
            "command": self.command,
            "mjrun": __version__,
            "mujoco": mujoco.mj_versionString(),
        }
        with ExitStack() as stack:
            writers: list[OutputWriter] = [*table.open(stack, folder, facts, FILES)]
            if outcome.points:
                points, metrics = point_table(prepared.points, outcome.points)
                writers += points.open(stack, folder, {**facts, "metrics": metrics})
            videos, failures = maker.make(policies[0], folder, reporter)
            paths = [video.path for video in videos]
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
                videos=videos,
                assertions=verdicts,
                files=[*(str(each.destination.shown) for each in writers), *paths, str(folder / MANIFEST)],
                steps=sum(episode.steps for group in groups for episode in group.episodes),
                wall=time.perf_counter() - start,
            )
            manifest = manifest_writer(folder / MANIFEST, {**facts, **dataclasses.asdict(result)})
            writers.append(stack.enter_context(manifest))
            _publish(writers, folder, paths)
        remove_old_videos(folder, [Path(path).name for path in paths])
        if self.html is not None:
            from mjrun.evaluation.evaluation_page import write_evaluation_page

            write_evaluation_page(self, result, prepared.points, {**facts, **dataclasses.asdict(result)})

        raise_failures(result, verdicts, PartlyDoneError(result.files, failures) if failures else None)
        return result


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
      videos: videos of episodes.
      assertions: requirements and whether they hold.
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
    policies: Sequence[EpisodeSummary]
    comparison: PolicyComparison | None
    names: Sequence[str]
    points: Sequence[PointSummary]
    videos: Sequence[EpisodeVideo]
    assertions: Sequence[Verdict]
    files: Sequence[str]
    steps: int
    wall: float
    schema: str = field(default=SCHEMA)

    @property
    def table(self) -> Table:
        """The numbers of the episodes, a row for each: seed, return, length, terms of the reward and metrics.

        Raises:
          FileError: the folder has been removed.
        """
        numbers, _, _, _, units = read_results(Path(self.path) / FILES[0])
        return Table(dict(numbers), dict(units))

    def _repr_html_(self) -> str:
        """Returns the table of episodes for a notebook."""
        return self.table.to_html()


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


def _warn_of_returns(policies: Sequence[EpisodeSummary], reporter: Reporter) -> None:
    """Warns of returns that are not finite, which the summaries exclude."""
    for policy in policies:
        if missing := policy.episodes - policy.returns.count:
            terms = [name for name, numbers in policy.rewards.items() if numbers.count < policy.episodes]
            cause = f", because of {listing(terms)}" if terms else ""
            reporter.warn(
                f"{clean(policy.policy)}: {missing:,} of {counted(policy.episodes, 'return')} not finite{cause}; the "
                "summaries exclude them, and a check of the task finds their origin"
            )


def _require_ours(path: Path) -> None:
    """Refuses a folder that contains anything but an evaluation, whose files may be replaced."""
    if not exists(path):
        return
    if not is_folder(path):
        raise FileError(path, "is not a folder", f"{option('output')} names the folder of the results")
    if any(path.iterdir()) and not is_file(path / MANIFEST):
        hint = f"{option('output')} names a folder that is new, empty, or of an earlier evaluation"
        raise FileError(path, f"contains other files, but no evaluation: it has no {clean(MANIFEST)}", hint)
