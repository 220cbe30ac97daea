"""A study: many simulations, their metrics, and a folder that holds what is known of them."""

import dataclasses
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import FailedAssertionError, FailedPointsError, FileError, LostFilesError, clean
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import Requirements, manifest_writer
from mjrun.formats.atomic_output import OutputWriter
from mjrun.options.option import options
from mjrun.options.sweep import MANIFEST, ExecutionOptions, StudyOptions
from mjrun.probe.verdict import Verdict
from mjrun.reporter import Reporter, WarningReporter
from mjrun.simulation.simulation import Simulation, require_simulation
from mjrun.study.executors import WARP, check_engine
from mjrun.study.keep import KeptFiles, PointKeeper
from mjrun.study.prepared import PreparedStudy
from mjrun.study.preview import StudyPreview, preview
from mjrun.study.results import STATUSES, FailureNotes, PointFailure, point_failures, study_table, with_flags
from mjrun.study.spec import StudySpec
from mjrun.version import __version__

SCHEMA = "mjrun-sweep-1"
QUANTILES = (0, 0.05, 0.25, 0.5, 0.75, 0.95, 1)


@options
class Study(StudyOptions, ExecutionOptions):
    """Many simulations: `simulation` with the values of each point. Its options are keywords.

    Args:
      command: the command line, for the manifest.
      controllers: where the controller varies, what each of its values stands for.
      document: the study as a document holds it, for the manifest; paths are relative to the folder of the study.
    """

    simulation: Simulation = field(kw_only=False)
    command: str = ""
    controllers: Mapping[str, Callable[..., object]] = field(default_factory=dict[str, Callable[..., object]])
    document: Mapping[str, object] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require_simulation(self.simulation)

    @property
    def spec(self) -> StudySpec:
        """What its points have in common, but for what varies."""
        engine = "warp" if self.engine == WARP else "c"
        return StudySpec(self.simulation, (), self.metric, self.every, engine, tuple(self.controllers.items()))

    def run(self, reporter: Reporter | None = None) -> "StudyResult":
        """Simulates what is not known yet, and writes the table of all points.

        Raises:
          FailedAssertionError: what is required of the points does not hold.
          FailedPointsError: points failed; the table is written all the same.
          MjrunError: nothing could be simulated.
        """
        return _Run(self, reporter or WarningReporter()).all()

    def write_manifest(self, facts: Mapping[str, object]) -> None:
        """Writes the manifest, which holds the study and `facts`, into the folder.

        Raises:
          FileError: it cannot be written.
        """
        with self.manifest_writer(facts) as output:
            output.publish()

    def manifest_writer(self, facts: Mapping[str, object]) -> OutputWriter:
        """The manifest, written and still to be published."""
        document = {"command": self.command, **({"study": self.document} if self.document else {}), **facts}
        return manifest_writer(Path(self.output) / MANIFEST, document)

    def collect(self, reporter: Reporter | None = None) -> "StudyResult":
        """Writes the table of all points from the results that are there, and simulates nothing.

        Raises:
          FileError: there are no results.
          FailedAssertionError: what is required of the points does not hold.
          FailedPointsError: points failed, or are not simulated yet.
        """
        return _Run(self, reporter or WarningReporter()).collected()

    def preview(self) -> StudyPreview:
        """What `run` would do, and how long it would take; one point is simulated to know, and nothing is written.

        Raises:
          MjrunError: nothing could be simulated.
        """
        prepared = PreparedStudy.of(self, self.spec)
        PointKeeper(self, prepared)  # checks what is to be kept of which points
        return preview(prepared, self)


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
      assertions: what was required, and whether it holds; nothing while points are missing.
      files: what was written.
      wall: wall time [s].
      names: what varies.
      kept: the files of single points.
      schema: of this document.
    """

    path: str
    points: int
    simulated: int
    statuses: Mapping[str, int]
    metrics: Mapping[str, "MetricSummary"]
    failures: Sequence[PointFailure]
    assertions: Sequence[Verdict]
    files: Sequence[str]
    wall: float
    names: Sequence[str]
    kept: KeptFiles = field(default_factory=KeptFiles)
    schema: str = SCHEMA


@dataclass(frozen=True)
class MetricSummary:
    """A metric over all points that have it.

    Attributes:
      count: of these points.
      mean, std: over them.
      quantiles: 0, 5, 25, 50, 75, 95 and 100 % of the values, interpolated linearly.
      lowest, highest: the points with the extreme values; None without any.
      lowest_values, highest_values: what varies, at these points.
    """

    count: int
    mean: float
    std: float
    quantiles: Sequence[float]
    lowest: int | None
    highest: int | None
    lowest_values: Mapping[str, str] = field(default_factory=dict)
    highest_values: Mapping[str, str] = field(default_factory=dict)


class _Run:
    """One run of a study."""

    def __init__(self, study: Study, reporter: Reporter) -> None:
        self.study, self.reporter = study, reporter
        self.start = time.perf_counter()
        self.folder = Path(study.output)

    def all(self) -> StudyResult:
        study = self.study
        prepared = PreparedStudy.of(study, study.spec)
        keeper = PointKeeper(study, prepared)
        check_engine(study.engine)
        prepared.files.create()
        prepared.warn_of_damaged(self.reporter)
        self._tell_what_changed()
        study.write_manifest({"points": len(prepared.keys), "schema": SCHEMA})  # by which an interrupted one continues
        missing = prepared.missing(study.retry_failed)
        if len(missing) < len(prepared.keys):
            self.reporter.note(f"{len(prepared.keys) - len(missing)} of {len(prepared.keys)} points are known already")
        if missing:
            done = failed = 0
            notes = FailureNotes(prepared.points, self.reporter)
            for results in prepared.simulate(missing, study, self.reporter):
                done, failed = done + len(results), failed + sum(result.status != "ok" for result in results)
                notes.add(results)
                self.reporter.progress(f"points{f', {failed} failed' if failed else ''}", done, len(missing))
        return self._conclude(prepared, keeper, len(missing))

    def _tell_what_changed(self) -> None:
        """Names the keys of the document that are not what they were in the last run."""
        try:
            before = json.loads((self.folder / MANIFEST).read_text("utf-8"))["study"]
        except (OSError, ValueError, KeyError, TypeError):
            return
        now = json.loads(json.dumps(self.study.document, default=str))
        if isinstance(before, dict) and isinstance(now, dict):
            changed = [key for key in dict.fromkeys([*before, *now]) if before.get(key) != now.get(key)]
            if changed:
                self.reporter.note(f"changed since the last run: {clean(', '.join(changed))}")

    def collected(self) -> StudyResult:
        prepared = PreparedStudy.of(self.study, self.study.spec)
        if not prepared.files.exist():
            raise FileError(self.folder, "there are no results of a study")
        prepared.warn_of_damaged(self.reporter)
        return self._conclude(prepared, PointKeeper(self.study, prepared), 0)

    def _conclude(self, prepared: PreparedStudy, keeper: PointKeeper, simulated: int) -> StudyResult:
        study, points, results = self.study, prepared.points, prepared.results()
        names = [name for name, _ in study.metric]
        table = study_table(points, names, results)
        facts: dict[str, object] = {"mjrun": __version__, "mujoco": mujoco.mj_versionString()}
        facts |= {"metrics": dict(study.metric), "columns": prepared.columns}
        files = table.write(self.folder, facts)  # the same for all runs, unlike the manifest

        complete = all(result.status != "missing" for result in results)
        numbers = table.numbers
        verdicts = list[Verdict]()
        if complete:
            requirements = Requirements(study.require, [*numbers], STATUSES, with_flags)
            verdicts = requirements.verdicts(numbers | table.flags("status", STATUSES))
        kept = keeper.keep(numbers, results, study.jobs, self.reporter) if complete else KeptFiles()
        statuses = {status: sum(r.status == status for r in results) for status in STATUSES}
        result = StudyResult(
            path=str(self.folder),
            points=len(results),
            simulated=simulated,
            statuses={status: count for status, count in statuses.items() if count},
            metrics={name: _summary(points, [r.metrics[i] for r in results]) for i, name in enumerate(names)},
            failures=point_failures(points, results),
            assertions=verdicts,
            files=[*map(str, files), str(self.folder / MANIFEST)],
            wall=time.perf_counter() - self.start,
            names=points.names,
            kept=kept,
        )
        study.write_manifest(dataclasses.asdict(result))
        failed = [verdict.message for verdict in verdicts if not verdict.passed]
        error = FailedAssertionError(failed) if failed else None
        if error is None and any(r.status != "ok" for r in results):
            error = FailedPointsError(result.statuses)
        if error is None and kept.failures:
            error = LostFilesError(kept.failures)
        if error:
            error.results = [result]
            raise error
        return result


def _summary(points: Design, values: Sequence[float]) -> MetricSummary:
    numbers = np.array(values)
    having = np.flatnonzero(np.isfinite(numbers))
    if not len(having):
        return MetricSummary(0, math.nan, math.nan, [math.nan] * len(QUANTILES), None, None)
    good = numbers[having]
    quantiles = np.quantile(good, QUANTILES).tolist()
    extremes = int(having[good.argmin()]), int(having[good.argmax()])
    where = (points.values(index) for index in extremes)
    return MetricSummary(len(good), float(good.mean()), float(good.std()), quantiles, *extremes, *where)
