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
from mjrun.evaluation.findings import findings, map_columns
from mjrun.evaluation.folder import ResultsFolder
from mjrun.evaluation.points import Rewritten
from mjrun.evaluation.prepared import PreparedEvaluation
from mjrun.evaluation.result import EvaluationResult
from mjrun.evaluation.schedule import play_all
from mjrun.evaluation.summary import EpisodeSummary
from mjrun.evaluation.table import FILES, episode_columns
from mjrun.formats.atomic_output import OutputWriter, publish_together
from mjrun.model.source import Source
from mjrun.options.evaluation import MANIFEST, EvaluationExecutionOptions, EvaluationOptions
from mjrun.options.option import options
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
        start, reporter = time.perf_counter(), reporter or WarningReporter()
        prepared = PreparedEvaluation(self, self.task, self.rewritten)
        maker = FilmMaker(self, prepared, self.seed)
        folder = ResultsFolder(Path(self.output))
        try:
            seeds = range(self.seed, self.seed + self.episodes)
            groups = play_all(prepared.groups, seeds, self.jobs, reporter)
        except BaseException:
            folder.abandon()
            raise

        count = len(prepared.points.points)
        policies = [groups[first : first + count] for first in range(0, len(groups), count)]
        found = findings(prepared, policies, self.confidence)
        _warn_of_returns(found.policies, reporter)
        columns, rows = episode_columns(
            groups, prepared.points, prepared.player.rewards, prepared.metrics, compared=len(policies) > 1
        )
        own = rows[: self.episodes * count]
        verdicts = prepared.criteria.verdicts(columns, own, found.policies[0], found.comparison)

        facts = {"command": self.command, "mjrun": __version__, "mujoco": mujoco.mj_versionString()}
        with ExitStack() as stack:
            writers: list[OutputWriter] = [*open_results(stack, folder.path, columns, rows, facts, FILES)]
            if found.points:
                point_columns, point_rows, metrics = map_columns(prepared.points, found.points)
                writers += open_results(stack, folder.path, point_columns, point_rows, {**facts, "metrics": metrics})
            films, failures = maker.make(policies[0], folder, reporter)
            result = EvaluationResult(
                path=self.output,
                task=self.task.text,
                episodes=self.episodes,
                seed=self.seed,
                confidence=self.confidence,
                policies=found.policies,
                comparison=found.comparison,
                names=prepared.points.names,
                points=found.points,
                films=films,
                assertions=verdicts,
                files=[
                    *(str(each.destination.shown) for each in writers),
                    *(film.path for film in films),
                    str(folder.path / MANIFEST),
                ],
                steps=sum(episode.steps for group in groups for episode in group.episodes),
                wall=time.perf_counter() - start,
            )
            writers.append(folder.write_manifest(stack, {**facts, **dataclasses.asdict(result)}))
            _publish(writers, folder, [film.path for film in films])
        folder.remove_old_films([Path(film.path).name for film in films])
        _raise_failures(result, failures)
        return result


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
