"""A study: many simulations, their metrics, and a folder that holds what is known of them."""

import dataclasses
import json
import math
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import FailedAssertionError, FailedPointsError, MjrunError, UsageError, concerning, option
from mjrun.formats.atomic_output import OutputWriter, StagedFile
from mjrun.job.simulation import Simulation
from mjrun.model.column import Column
from mjrun.options.option import options
from mjrun.options.sweep import ExecutionOptions, StudyOptions
from mjrun.probe.assertion import Verdict, parse
from mjrun.probe.available import AvailableProbes
from mjrun.probe.metric import parse_metric
from mjrun.probe.scanner import Vocabulary
from mjrun.reporter import Reporter, WarningReporter
from mjrun.study.design import Design, design
from mjrun.study.executors import open_executor, require_extra
from mjrun.study.isolation import Chunk, run_chunk
from mjrun.study.parts import PartFiles, point_keys, study_identity
from mjrun.study.results import STATUSES, result_columns, write_results
from mjrun.study.simulate import PointResult, StudyPoint, StudySpec
from mjrun.version import __version__

SCHEMA = "mjrun-sweep-1"
MANIFEST = "study.json"
CHUNK_STEPS = 50_000  # steps in a chunk: seconds, as a rule
CHUNK_POINTS = 500  # and so many points at most
QUANTILES = (0, 0.05, 0.25, 0.5, 0.75, 0.95, 1)
FINAL = ("ok", "unstable")  # which another try would not change


@options
class Study(StudyOptions, ExecutionOptions):
    """Many simulations: `simulation` with the values of each point. Its options are keywords."""

    simulation: Simulation = field(kw_only=False)
    command: str = ""

    def run(self, reporter: Reporter | None = None) -> "StudyResult":
        """Simulates what is not known yet, and writes the table of all points.

        Raises:
          FailedAssertionError: what is required of the points does not hold.
          FailedPointsError: points failed; the table is written all the same.
          MjrunError: nothing could be simulated.
        """
        return _Run(self, reporter or WarningReporter()).all()


@dataclass(frozen=True)
class StudyResult:
    """What has come of a study.

    Attributes:
      path: its folder.
      points: how many there are.
      simulated: how many were simulated now; the others were known.
      statuses: how many points ended in which way.
      metrics: a summary of each.
      failures: of each message, how many points failed with it, and the first of them.
      assertions: what was required, and whether it holds.
      files: what was written.
      wall: wall time [s].
      names: what varies.
      schema: of this document.
    """

    path: str
    points: int
    simulated: int
    statuses: Mapping[str, int]
    metrics: Mapping[str, "MetricSummary"]
    failures: Sequence["PointFailure"]
    assertions: Sequence[Verdict]
    files: Sequence[str]
    wall: float
    names: Sequence[str]
    schema: str = SCHEMA


@dataclass(frozen=True)
class MetricSummary:
    """A metric over all points that have it.

    Attributes:
      count: of these points.
      mean, std: over them.
      quantiles: 0, 5, 25, 50, 75, 95 and 100 % of the values, interpolated linearly.
      lowest, highest: the points with the extreme values; None without any.
    """

    count: int
    mean: float
    std: float
    quantiles: Sequence[float]
    lowest: int | None
    highest: int | None


@dataclass(frozen=True)
class PointFailure:
    """Why points failed.

    Attributes:
      status: how they ended.
      message: the first line that MuJoCo or mjrun has to say.
      count: how many.
      point: the first of them.
      values: its values.
    """

    status: str
    message: str
    count: int
    point: int
    values: Mapping[str, str]


class _Run:
    """One run of a study."""

    def __init__(self, study: Study, reporter: Reporter) -> None:
        self.study, self.reporter = study, reporter
        self.start = time.perf_counter()
        self.folder = Path(study.output)

    def all(self) -> StudyResult:
        require_extra("sweep")
        study = self.study
        model = study.simulation.load()
        points = design(study, model, study.simulation.seed)
        spec = StudySpec(study.simulation, points.names, study.metric, study.every)
        self._check(spec, points, model)

        files = PartFiles(self.folder, [name for name, _ in study.metric])
        files.create()
        keys = point_keys(study_identity(spec, model), points.names, points.points)
        known = files.read()
        missing = [i for i, key in enumerate(keys) if self._is_missing(known.get(key))]
        if len(missing) < len(keys):
            self.reporter.note(f"{len(keys) - len(missing)} of {len(keys)} points are known already")
        self._simulate(spec, points, keys, missing, files, known)
        return self._conclude(points, [known[key] for key in keys], len(missing))

    def _check(self, spec: StudySpec, points: Design, model: mujoco.MjModel) -> None:
        """Finds what is wrong with all points before the first is simulated."""
        available = AvailableProbes(model) if spec.metrics else None
        names = [name for name, _ in spec.metrics]
        for name, text in spec.metrics:
            with concerning("metric", name):
                if not name.isidentifier() or name in (
                    *points.names,
                    *STATUSES,
                    "point",
                    "status",
                    "steps",
                    "exit_code",
                ):
                    raise UsageError(f"{option('metric')}: {name!r} cannot be the name of a metric")
                if names.count(name) > 1:
                    raise UsageError(f"{option('metric')}: {name} is given twice")
                assert available
                parse_metric(text, available, f"{option('metric')} {name}")
        for index, text in enumerate(self.study.require):
            with concerning("require", index):
                parse(text, RequirementNames([*points.names, *names]), "require")
        first = spec.simulation(points.points[0])
        first.stepper(first.load())

    def _is_missing(self, result: PointResult | None) -> bool:
        return result is None or (self.study.retry_failed and result.status not in FINAL)

    def _simulate(
        self,
        spec: StudySpec,
        points: Design,
        keys: Sequence[str],
        missing: Sequence[int],
        files: PartFiles,
        known: dict[str, PointResult],
    ) -> None:
        """Simulates the missing points, publishes each chunk as it is done, and adds the results to `known`."""
        if not missing:
            return
        study = self.study
        limit = math.inf if study.time_limit is None else float(study.time_limit)
        chunks = (
            Chunk(spec, tuple(StudyPoint(index, points.points[index]) for index in part), limit)
            for part in _parts(missing, study.chunk or self._chunk_size(spec, points, len(missing)))
        )
        done = failed = 0
        with ExitStack() as stack:
            executor, ahead = open_executor(study.engine, study.jobs, self.folder, stack)
            for chunk, results in _completed(executor, chunks, ahead):
                part_keys = [keys[point.index] for point in chunk.points]
                files.write(part_keys, results, socket.gethostname())
                known.update(zip(part_keys, results, strict=True))
                done, failed = done + len(results), failed + sum(result.status != "ok" for result in results)
                self.reporter.progress(f"points{f', {failed} failed' if failed else ''}", done, len(missing))

    def _chunk_size(self, spec: StudySpec, points: Design, count: int) -> int:
        first = spec.simulation(points.points[0])
        steps = max(1, first.timeline(first.load()).steps)
        return max(1, min(CHUNK_STEPS // steps, CHUNK_POINTS, -(-count // 8)))

    def _conclude(self, points: Design, results: Sequence[PointResult], simulated: int) -> StudyResult:
        study = self.study
        names = [name for name, _ in study.metric]
        columns, rows = result_columns(points, names, results)
        facts = {"mjrun": __version__, "mujoco": mujoco.mj_versionString(), "metrics": dict(study.metric)}
        files = write_results(self.folder, columns, rows, facts)  # the same for all runs, unlike the manifest

        verdicts = [_judge(text, columns, rows, results) for text in study.require]
        statuses = {status: sum(r.status == status for r in results) for status in STATUSES}
        result = StudyResult(
            path=str(self.folder),
            points=len(results),
            simulated=simulated,
            statuses={status: count for status, count in statuses.items() if count},
            metrics={name: _summary([r.metrics[i] for r in results]) for i, name in enumerate(names)},
            failures=_failures(points, results),
            assertions=verdicts,
            files=[*map(str, files), str(self.folder / MANIFEST)],
            wall=time.perf_counter() - self.start,
            names=points.names,
        )
        self._write_manifest(result)
        failed = [verdict.message for verdict in verdicts if not verdict.passed]
        error = FailedAssertionError(failed) if failed else None
        if error is None and any(r.status != "ok" for r in results):
            error = FailedPointsError(result.statuses)
        if error:
            error.results = [result]
            raise error
        return result

    def _write_manifest(self, result: StudyResult) -> None:
        document = {"command": self.study.command, **dataclasses.asdict(result)}
        with OutputWriter(StagedFile(self.folder / MANIFEST)) as output:
            output.write_file(f"{json.dumps(document, indent=2, default=str)}\n".encode())
            output.publish()


class RequirementNames(Vocabulary):
    """The columns of the table of a study, and each status as what holds or does not: `share(ok) > 0.95`."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__([*names, *STATUSES])

    def is_count(self, column: str) -> bool:
        return column in STATUSES


def _judge(text: str, columns: Sequence[Column], rows: np.ndarray, results: Sequence[PointResult]) -> Verdict:
    """Whether a requirement holds over all points."""
    usable = [(column.name, rows[:, i]) for i, column in enumerate(columns) if not column.labels]
    flags = [(status, np.array([r.status == status for r in results], float)) for status in STATUSES]
    table = dict([*usable, *flags])
    checker = parse(text, RequirementNames([name for name, _ in usable]), "require").checker()
    checker.feed(np.stack(list(table.values()), axis=1), 0)
    return checker.verdict()


def _completed(
    executor: Executor, chunks: Iterator[Chunk], ahead: int
) -> Iterator[tuple[Chunk, Sequence[PointResult]]]:
    """The results of chunks as they come, while at most `ahead` of them are in flight."""
    running: dict[Future[list[PointResult]], Chunk] = {}
    while True:
        for chunk in islice(chunks, ahead - len(running)):
            running[executor.submit(run_chunk, chunk)] = chunk
        if not running:
            return
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            chunk = running.pop(future)
            yield chunk, _results(future, chunk)


def _results(future: Future[list[PointResult]], chunk: Chunk) -> Sequence[PointResult]:
    """The results of a chunk; where an engine has lost it, each of its points has failed."""
    try:
        return future.result()
    except MjrunError:
        raise
    except Exception as error:
        message = f"the engine lost it: {type(error).__name__}: {error}"
        nothing = (math.nan,) * len(chunk.spec.metrics)
        return [PointResult(point.index, "failed", nothing, 0, 70, message) for point in chunk.points]


def _parts(indices: Sequence[int], size: int) -> Iterator[Sequence[int]]:
    for start in range(0, len(indices), size):
        yield indices[start : start + size]


def _summary(values: Sequence[float]) -> MetricSummary:
    numbers = np.array(values)
    having = np.flatnonzero(np.isfinite(numbers))
    if not len(having):
        return MetricSummary(0, math.nan, math.nan, [math.nan] * len(QUANTILES), None, None)
    good = numbers[having]
    quantiles = np.quantile(good, QUANTILES).tolist()
    extremes = int(having[good.argmin()]), int(having[good.argmax()])
    return MetricSummary(len(good), float(good.mean()), float(good.std()), quantiles, *extremes)


def _failures(points: Design, results: Sequence[PointResult]) -> list[PointFailure]:
    """The reasons of failures, the most frequent first."""
    groups: dict[tuple[str, str], list[int]] = {}
    for index, result in enumerate(results):
        if result.status != "ok":
            reason = "" if result.status == "unstable" else result.message.partition("\n")[0]
            groups.setdefault((result.status, reason), []).append(index)
    ordered = sorted(groups.items(), key=lambda item: -len(item[1]))
    return [
        PointFailure(
            status,
            results[found[0]].message,
            len(found),
            found[0],
            dict(zip(points.names, points.points[found[0]], strict=True)),
        )
        for (status, _), found in ordered
    ]
