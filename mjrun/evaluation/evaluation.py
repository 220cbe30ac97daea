"""An evaluation: seeded episodes of a task under one policy or two, and a folder that holds what comes of them."""

import dataclasses
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import field
from pathlib import Path

import mujoco

from mjrun.errors import FailedAssertionError, MjrunError, PartlyDoneError, clean, counted, listing
from mjrun.evaluation.film_maker import Failures, FilmMaker
from mjrun.evaluation.findings import Findings, findings, map_columns
from mjrun.evaluation.folder import ResultsFolder
from mjrun.evaluation.points import Rewritten
from mjrun.evaluation.prepared import PreparedEvaluation
from mjrun.evaluation.result import EvaluationResult, Film
from mjrun.evaluation.schedule import play_all
from mjrun.evaluation.summary import EpisodeSummary
from mjrun.evaluation.table import FILES, PlayedEpisodes, episode_columns
from mjrun.formats.atomic_output import OutputWriter, publish_together
from mjrun.model.source import Source
from mjrun.options.evaluation import MANIFEST, EvaluationExecutionOptions, EvaluationOptions
from mjrun.options.option import options
from mjrun.probe.verdict import Verdict
from mjrun.reporter import Reporter, WarningReporter
from mjrun.study.results import open_results
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
          PartlyDoneError: films could not be made; the tables are written all the same.
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
        self.maker = FilmMaker(evaluation, self.prepared, evaluation.seed)
        self.folder = ResultsFolder(Path(evaluation.output))
        self.facts = {"command": evaluation.command, "mjrun": __version__, "mujoco": mujoco.mj_versionString()}

    def all(self) -> EvaluationResult:
        groups = self._played()
        count = len(self.prepared.points.points)
        policies = [groups[first : first + count] for first in range(0, len(groups), count)]
        summaries = findings(self.prepared, policies, self.evaluation.confidence)
        _warn_of_returns(summaries.policies, self.reporter)

        with ExitStack() as stack:
            writers, verdicts = self._tables(groups, summaries, stack)
            films, failures = self.maker.make(policies[0], self.folder, self.reporter)
            paths = [film.path for film in films]
            files = [*(str(each.destination.shown) for each in writers), *paths, str(self.folder.path / MANIFEST)]
            steps = sum(episode.steps for group in groups for episode in group.episodes)
            result = self._result(summaries, films, verdicts, files, steps)
            writers.append(self.folder.write_manifest(stack, {**self.facts, **dataclasses.asdict(result)}))
            _publish(writers, self.folder, paths)
        self.folder.remove_old_films([Path(path).name for path in paths])
        _raise_failures(result, failures)
        return result

    def _played(self) -> list[PlayedEpisodes]:
        """The episodes of each policy at each point."""
        evaluation = self.evaluation
        seeds = range(evaluation.seed, evaluation.seed + evaluation.episodes)
        return play_all(self.prepared.groups, seeds, evaluation.jobs, self.reporter)

    def _tables(
        self, groups: Sequence[PlayedEpisodes], summaries: Findings, stack: ExitStack
    ) -> tuple[list[OutputWriter], list[Verdict]]:
        """The tables, written and still to be published, and what was required of them."""
        prepared, path = self.prepared, self.folder.path
        columns, rows = episode_columns(
            groups,
            prepared.points,
            prepared.player.rewards,
            prepared.metrics,
            compared=summaries.comparison is not None,
        )
        own = rows[: self.evaluation.episodes * len(prepared.points.points)]
        verdicts = prepared.criteria.verdicts(columns, own, summaries.policies[0], summaries.comparison)
        writers: list[OutputWriter] = [*open_results(stack, path, columns, rows, self.facts, FILES)]
        if summaries.points:
            columns, rows, metrics = map_columns(prepared.points, summaries.points)
            writers += open_results(stack, path, columns, rows, {**self.facts, "metrics": metrics})
        return writers, verdicts

    def _result(
        self, summaries: Findings, films: Sequence[Film], verdicts: Sequence[Verdict], files: list[str], steps: int
    ) -> EvaluationResult:
        evaluation = self.evaluation
        return EvaluationResult(
            path=evaluation.output,
            task=evaluation.task.text,
            episodes=evaluation.episodes,
            seed=evaluation.seed,
            confidence=evaluation.confidence,
            policies=summaries.policies,
            comparison=summaries.comparison,
            names=self.prepared.points.names,
            points=summaries.points,
            films=films,
            assertions=verdicts,
            files=files,
            steps=steps,
            wall=time.perf_counter() - self.start,
        )


def _publish(writers: Sequence[OutputWriter], folder: ResultsFolder, films: Sequence[str]) -> None:
    """Publishes the results of which `films` are made already.

    Raises:
      PartlyDoneError: they cannot be published, and there are films.
      MjrunError: they cannot be published.
    """
    try:
        publish_together(writers)
    except MjrunError as error:
        if films and not isinstance(error, PartlyDoneError):
            raise PartlyDoneError(films, [(str(folder.path), error)]) from None
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
