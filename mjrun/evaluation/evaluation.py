"""An evaluation: seeded episodes of a task under one policy or two, and a folder that holds what comes of them."""

import dataclasses
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import field
from pathlib import Path

import mujoco

from mjrun.errors import (
    FailedAssertionError,
    FileError,
    MjrunError,
    PartlyDoneError,
    clean,
    counted,
    listing,
    option,
)
from mjrun.evaluation.episode import PlayedEpisodes
from mjrun.evaluation.prepared import PreparedEvaluation, Rewritten
from mjrun.evaluation.result import EpisodeSummary, EpisodeVideo, EvaluationResult
from mjrun.evaluation.schedule import play_all
from mjrun.evaluation.summaries import Summaries, summaries
from mjrun.evaluation.table import FILES, episode_table, point_table
from mjrun.evaluation.videos import Failures, VideoMaker, remove_old_videos
from mjrun.experiment.results_table import manifest_writer
from mjrun.formats.atomic_output import OutputWriter, publish_together
from mjrun.formats.destinations import StagedFile
from mjrun.formats.input_file import exists, is_file, is_folder
from mjrun.model.source import Source
from mjrun.options.evaluation import MANIFEST, EvaluationExecutionOptions, EvaluationOptions
from mjrun.options.option import options
from mjrun.probe.verdict import Verdict
from mjrun.reporter import Reporter, WarningReporter
from mjrun.version import __version__


@options
class Evaluation(EvaluationOptions, EvaluationExecutionOptions):
    """Seeded episodes of `task` under a policy. Its options are keywords.

    Args:
      command: the command line, for the manifest.
      rewritten: makes the task of other values of its document, where something of that varies.
    """

    task: Source = field(kw_only=False)
    command: str = ""
    rewritten: Rewritten | None = None

    def run(self, reporter: Reporter | None = None) -> EvaluationResult:
        """Plays the episodes, and writes their table and all that is asked for.

        Raises:
          FailedAssertionError: what is required of the episodes does not hold; everything is written all the same.
          PartlyDoneError: videos could not be made; the tables are written all the same.
          SimulationError: a policy answered what is not a number; nothing is written.
          MjrunError: nothing could be played.
        """
        return _Run(self, reporter or WarningReporter()).all()


class _Run:
    """One run of an evaluation."""

    def __init__(self, evaluation: Evaluation, reporter: Reporter) -> None:
        self.evaluation, self.reporter = evaluation, reporter
        self.start = time.perf_counter()
        self.prepared = PreparedEvaluation(evaluation, evaluation.task, evaluation.rewritten)
        self.maker = VideoMaker(evaluation, self.prepared, evaluation.seed)
        self.folder = Path(evaluation.output)
        _require_ours(self.folder)
        StagedFile(self.folder / MANIFEST).discard()  # which proves that it can be written
        self.facts = {"command": evaluation.command, "mjrun": __version__, "mujoco": mujoco.mj_versionString()}

    def all(self) -> EvaluationResult:
        groups = self._played()
        count = len(self.prepared.points.points)
        policies = [groups[first : first + count] for first in range(0, len(groups), count)]
        outcome = summaries(self.prepared, policies, self.evaluation.confidence)
        _warn_of_returns(outcome.policies, self.reporter)

        with ExitStack() as stack:
            writers, verdicts = self._tables(groups, outcome, stack)
            videos, failures = self.maker.make(policies[0], self.folder, self.reporter)
            paths = [video.path for video in videos]
            files = [*(str(each.destination.shown) for each in writers), *paths, str(self.folder / MANIFEST)]
            steps = sum(episode.steps for group in groups for episode in group.episodes)
            result = self._result(outcome, videos, verdicts, files, steps)
            manifest = manifest_writer(self.folder / MANIFEST, {**self.facts, **dataclasses.asdict(result)})
            writers.append(stack.enter_context(manifest))
            _publish(writers, self.folder, paths)
        remove_old_videos(self.folder, [Path(path).name for path in paths])
        _raise_failures(result, failures)
        return result

    def _played(self) -> list[PlayedEpisodes]:
        """The episodes of each policy at each point."""
        evaluation = self.evaluation
        seeds = range(evaluation.seed, evaluation.seed + evaluation.episodes)
        return play_all(self.prepared.groups, seeds, evaluation.jobs, self.reporter)

    def _tables(
        self, groups: Sequence[PlayedEpisodes], outcome: Summaries, stack: ExitStack
    ) -> tuple[list[OutputWriter], list[Verdict]]:
        """The tables, written and still to be published, and what was required of them."""
        prepared = self.prepared
        is_compared = outcome.comparison is not None
        table = episode_table(groups, prepared.points, prepared.player.rewards, prepared.metrics, compared=is_compared)
        own = self.evaluation.episodes * len(prepared.points.points)
        verdicts = prepared.criteria.verdicts(table, own, outcome.policies[0], outcome.comparison)
        writers: list[OutputWriter] = [*table.open(stack, self.folder, self.facts, FILES)]
        if outcome.points:
            points, metrics = point_table(prepared.points, outcome.points)
            writers += points.open(stack, self.folder, {**self.facts, "metrics": metrics})
        return writers, verdicts

    def _result(
        self,
        outcome: Summaries,
        videos: Sequence[EpisodeVideo],
        verdicts: Sequence[Verdict],
        files: list[str],
        steps: int,
    ) -> EvaluationResult:
        evaluation = self.evaluation
        return EvaluationResult(
            path=evaluation.output,
            task=evaluation.task.text,
            episodes=evaluation.episodes,
            seed=evaluation.seed,
            confidence=evaluation.confidence,
            policies=outcome.policies,
            comparison=outcome.comparison,
            names=self.prepared.points.names,
            points=outcome.points,
            films=videos,
            assertions=verdicts,
            files=files,
            steps=steps,
            wall=time.perf_counter() - self.start,
        )


def _publish(writers: Sequence[OutputWriter], folder: Path, videos: Sequence[str]) -> None:
    """Publishes the results of which `videos` are made already.

    Raises:
      PartlyDoneError: they cannot be published, and there are videos.
      MjrunError: they cannot be published.
    """
    try:
        publish_together(writers)
    except MjrunError as error:
        if videos and not isinstance(error, PartlyDoneError):
            raise PartlyDoneError(videos, [(str(folder), error)]) from None
        raise


def _warn_of_returns(policies: Sequence[EpisodeSummary], reporter: Reporter) -> None:
    """Warns of returns that are not finite, which the figures leave out."""
    for policy in policies:
        if missing := policy.episodes - policy.returns.count:
            terms = [name for name, numbers in policy.rewards.items() if numbers.count < policy.episodes]
            cause = f", because of {listing(terms)}" if terms else ""
            reporter.warn(
                f"{clean(policy.policy)}: {missing:,} of {counted(policy.episodes, 'return')} not finite{cause}; the "
                "figures leave such numbers out, and a check of the task says where they come from"
            )


def _raise_failures(result: EvaluationResult, failures: Failures) -> None:
    """Raises what is wrong with a result that is written, if anything is."""
    failed = [verdict.message for verdict in result.assertions if not verdict.passed]
    error: MjrunError | None = None
    if failed:
        error = FailedAssertionError(failed)
    elif failures:
        error = PartlyDoneError(result.files, failures)
    if error:
        error.results = [result]
        raise error


def _require_ours(path: Path) -> None:
    """Refuses a folder that holds something else than an evaluation, of which alone anything is replaced."""
    if not exists(path):
        return
    if not is_folder(path):
        raise FileError(path, "is no folder", f"{option('output')} names the folder of the results")
    if any(path.iterdir()) and not is_file(path / MANIFEST):
        hint = f"{option('output')} names a folder that is new, empty, or of an evaluation before"
        raise FileError(path, f"holds other things than an evaluation: it has no {clean(MANIFEST)}", hint)
