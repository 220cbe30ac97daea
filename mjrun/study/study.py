"""A study: many simulations, their metrics, and a folder with the results."""

import dataclasses
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import field, replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FailedPointsError, FileError, UnmadeFilesError, clean, option
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import (
    FILES,
    Requirements,
    ResultsTable,
    check_runs,
    manifest_writer,
    plain_metrics,
    raise_failures,
    write_runs,
)
from mjrun.experiment.samplers import SAMPLES
from mjrun.experiment.statistics import (
    CONFIDENCE,
    SENSITIVITY_FILES,
    MetricSensitivity,
    sensitivities,
    sensitivity_table,
)
from mjrun.formats.local_and_remote_folders import folder_at, require_own_folder
from mjrun.formats.output_writer import OutputWriter, publish_together
from mjrun.formats.study_reader import check_result_folder, read_study, study_manifest
from mjrun.formats.table_writer import TableWriter
from mjrun.model.mujoco_globals import reported_warnings
from mjrun.options.evaluation import MANIFEST as EVALUATION
from mjrun.options.option import is_given, options
from mjrun.options.sweep import MANIFEST, MOST_IN_CSV, ExecutionOptions, StudyOptions
from mjrun.physics.warp_device import COMPILES
from mjrun.platform.cores import available_cores
from mjrun.probe.verdict import Verdict
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.simulation.simulation import Simulation, require_simulation
from mjrun.study.executors import INTERVAL, QUEUED, WARP, check_engine, process_count
from mjrun.study.isolation import IsolatedSimulator
from mjrun.study.leases import EXPIRY, running_leases
from mjrun.study.part_files import kept_results_in_errors, part_bytes
from mjrun.study.point_files import KeptFiles, PointFileMaker
from mjrun.study.prepared import PreparedStudy
from mjrun.study.range_folders import RangeFolders
from mjrun.study.results import (
    REPEAT_FILES,
    SEED,
    STATUSES,
    PointFailureGroup,
    RepeatMeans,
    RepeatSummary,
    point_failures,
    study_table,
    table_bytes,
    with_flags,
)
from mjrun.study.spec import PointResult, StudyPoint, StudySpec, with_end
from mjrun.version import __version__

if TYPE_CHECKING:
    from mjrun.plotting.table_figure import Table

SCHEMA = "mjrun-sweep-1"
TABLES = (*FILES, *REPEAT_FILES, *SENSITIVITY_FILES)
FOREIGN = (*TABLES, EVALUATION)  # files that a folder without a study must not have
OPTIONS = ("simulation", "metrics", "every", "engine", "task", "product")  # parts of an identity; the others are read
QUANTILES = (0, 0.05, 0.25, 0.5, 0.75, 0.95, 1)
SHOWN = 3  # points at each end of the study
OTHER_RUN = (
    "another run uses this folder for a different version of the study: the tables are those of the run that ends last"
)
NO_INTERVALS = (
    f"{option('confidence')} has no effect: without {option('repeats')}, or a {option('sampler')} of sensitivities, "
    "there are no intervals"
)
PATIENCE = 60.0  # [s] for the point that is measured
START = 1.0  # [s] before processes simulate


@options
class Study(StudyOptions, ExecutionOptions):
    """Many simulations: `simulation` with the values of each point. Its options are keywords.

    Args:
      command: command line, for the manifest.
      controllers: functions by the values of `controller`, where the controller varies.
      document: the study as a document, for the manifest; paths are relative to the folder of the study.
      with_csv: writes results.csv whatever the number of points.
    """

    simulation: Simulation = field(kw_only=False)
    command: str = ""
    controllers: Mapping[str, Callable[..., object]] = field(default_factory=dict[str, Callable[..., object]])
    document: Mapping[str, object] | None = None
    with_csv: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        require_simulation(self.simulation)

    @property
    def spec(self) -> StudySpec:
        """Specification of the points, without the names of parameters."""
        engine = "warp" if self.engine == WARP else "c"
        controllers = tuple(self.controllers.items())
        metrics = plain_metrics(with_end(self.metric, self.simulation))
        return StudySpec(self.simulation, (), metrics, self.every, engine, controllers)

    def run(self, reporter: Reporter | None = None) -> "StudyResult":
        """Simulates the points without a result, and writes the table of all points.

        Raises:
          FailedAssertionError: a requirement does not hold.
          FailedPointsError: points failed; the table is written nevertheless.
          MjrunError: nothing could be simulated.
        """
        reporter, start = reporter or PythonApiReporter(), time.perf_counter()
        with reported_warnings(reporter):
            if self.html is not None:
                from mjrun.experiment.results_page_parts import check_page  # which imports matplotlib

                check_page(self.html)
            prepared = PreparedStudy(self, self.spec)
            keeper = PointFileMaker(self, prepared, simulates=True)
            if self.export_to is not None:
                check_runs(self.export_to, len(prepared.points.points), self.output)
            check_engine(self.engine, prepared.folder)
            self.compare_with_last_run(prepared, reporter, SCHEMA)
            prepared.files.create()
            keeper.remove_left_behind()
            prepared.warn(reporter)
            has_intervals = SEED in prepared.points.names or self.sampler in SAMPLES
            if is_given(self, "confidence") and not has_intervals:
                reporter.warn(NO_INTERVALS)
            count = len(prepared.points.points)
            facts = {"points": count, "schema": SCHEMA, "metrics": dict(prepared.spec.metrics)}
            # Lets an interrupted study continue, and others see its progress.
            self.write_manifest({**facts, **prepared.identities})
            missing = prepared.missing(self.retry_failed)
            adopted = prepared.adopt()
            origin = f", {adopted} of them from an earlier design" if adopted else ""
            prepared.note_known(missing, reporter, origin)
            simulated = 0
            if missing:
                if self.engine == WARP:
                    reporter.note(COMPILES)
                simulated = prepared.simulate(missing, self, reporter).total()
            del missing  # which take memory
            digest = prepared.files.study
            if simulated and study_manifest(prepared.folder).get("digest", digest) != digest:
                reporter.warn(OTHER_RUN)
            with kept_results_in_errors(prepared.folder, prepared.noun):
                if simulated:
                    prepared.files.merge_all()
                return self._conclude(prepared, keeper, simulated, reporter, start)

    def collect(self, reporter: Reporter | None = None) -> "StudyResult":
        """Writes the table of all points from the existing results without simulating any.

        Raises:
          FileError: the folder contains no results.
          FailedAssertionError: a requirement does not hold.
          FailedPointsError: points failed, or are not simulated yet.
        """
        reporter, start = reporter or PythonApiReporter(), time.perf_counter()
        prepared = PreparedStudy(self, self.spec)
        if not prepared.files.exist():
            raise FileError(self.output, "contains no results of a study")
        prepared.warn(reporter)
        with kept_results_in_errors(prepared.folder, prepared.noun):
            return self._conclude(prepared, PointFileMaker(self, prepared), 0, reporter, start)

    def preview(self) -> "StudyPreview":
        """Previews `run` and estimates its duration by simulating one point; writes nothing.

        Raises:
          MjrunError: nothing could be simulated.
        """
        prepared = PreparedStudy(self, self.spec)
        PointFileMaker(self, prepared)  # which checks the options of kept files
        return preview(prepared, self)

    def write_manifest(self, facts: Mapping[str, object]) -> None:
        """Writes the manifest, with the study and `facts`, to the folder.

        Raises:
          FileError: the manifest cannot be written.
        """
        with self.manifest_writer(facts) as output:
            output.publish()

    def manifest_writer(self, facts: Mapping[str, object]) -> OutputWriter:
        """Writes the manifest, to be published by the caller."""
        document = {"command": self.command, **({"study": self.document} if self.document else {}), **facts}
        return manifest_writer(folder_at(self.output).path(MANIFEST), document)

    def compare_with_last_run(self, prepared: PreparedStudy, reporter: Reporter, schema: str) -> None:
        """Reports the keys of the document, files, code and versions that have changed since the last run.

        Raises:
          FileError: the folder has tables and no manifest, or the results of another command, whose manifest has
            another `schema`.
        """
        ours = _command_of(schema)
        require_own_folder(prepared.folder, MANIFEST, f"run of `{ours}`", FOREIGN)  # logs and plans may be there
        before = study_manifest(prepared.folder)
        theirs = _command_of(before.get("schema"))
        if theirs and theirs != ours:
            hint = f"{option('output')} names a folder that is new, or one of `{ours}`"
            raise FileError(self.output, f"contains the results of `{clean(theirs)}`", hint)
        now = json.loads(json.dumps({"study": self.document, "identity": prepared.identity_hashes}, default=str))
        # A document lists the options; a study in Python, or with code that is given by name, has none.
        hidden = OPTIONS if self.document and before.get("study") else ("product",)
        changed = [
            *_changed(before, now, "study"),
            *(name for name in _changed(before, now, "identity") if name not in hidden),
        ]
        if changed:
            reporter.note(f"changed since the last run: {clean(', '.join(dict.fromkeys(changed)))}")
        digest = str(before.get("digest", ""))
        leases = running_leases(RangeFolders(prepared.files.folder, digest, 0))
        if digest != prepared.files.study and any(silent <= EXPIRY for _, _, silent in leases):
            reporter.warn(OTHER_RUN)

    def _tables(self, files: Sequence[str], rows: int) -> Sequence[str]:
        """Returns the files of a table of `rows` rows."""
        return files if self.with_csv or rows <= MOST_IN_CSV else files[:1]

    def _conclude(
        self, prepared: PreparedStudy, keeper: PointFileMaker, simulated: int, reporter: Reporter, start: float
    ) -> "StudyResult":
        """Writes the table, the kept files and the manifest; raises errors of a finished study with its result."""
        points, results = prepared.points, prepared.known
        names = [name for name, _ in prepared.spec.metrics]
        table = study_table(points, names, results, prepared.units, is_single=prepared.spec.engine == "warp")
        facts: dict[str, object] = {"mjrun": __version__, "mujoco": mujoco.mj_versionString()}
        facts |= {"metrics": dict(prepared.spec.metrics), "columns": prepared.columns}
        values = {name: results.metrics[:, index] for index, name in enumerate(names)}
        means = RepeatMeans(points, values, self.confidence)
        tables: dict[tuple[str, ...], ResultsTable] = {FILES: table}
        if means.design.points:
            tables[REPEAT_FILES] = means.table(prepared.units)
        indices = list[MetricSensitivity]()
        if self.sampler in SAMPLES:
            seed = self.simulation.seed
            indices = sensitivities(self.sampler, points.names, values, self.confidence, seed)
        if indices:
            tables[SENSITIVITY_FILES] = sensitivity_table(indices)
        files = list[str]()
        with ExitStack() as stack:
            writers = list[TableWriter]()
            for names_of_files, each in tables.items():
                chosen = self._tables(names_of_files, len(each))
                writers += each.open(stack, prepared.folder, facts, chosen)  # the same in all runs
                files += chosen
            publish_together(writers)
        of_other_points = {*TABLES}.difference(files)
        for name in of_other_points:
            prepared.folder.remove(name)

        verdicts, kept = list[Verdict](), KeptFiles()
        if not results.is_missing.any() and (self.require or keeper.kinds):
            numbers = table.numbers
            requirements = Requirements(self.require, [*numbers], STATUSES, with_flags)
            verdicts = requirements.verdicts(numbers | table.flags("status", STATUSES))
            kept = keeper.keep(numbers, results, self.processes, reporter)
        result = StudyResult(
            path=prepared.folder.path(),
            points=len(results),
            simulated=simulated,
            statuses=results.counts,
            metrics={name: replace(_summary(points, values[name]), unit=prepared.units[name]) for name in names},
            failures=point_failures(points, results),
            assertions=verdicts,
            files=[prepared.folder.path(name) for name in (*files, MANIFEST)],
            wall=time.perf_counter() - start,
            names=points.names,
            kept=kept,
            repeats=means.summaries(),
            sensitivities=indices,
            confidence=self.confidence,
        )
        with_files = keeper.points_with_files()
        self.write_manifest({**dataclasses.asdict(result), **prepared.identities, "with_files": with_files})
        if self.html is not None:
            from mjrun.study.study_page import write_study_page

            known = {**prepared.identity, "command": self.command, "wall": result.wall}
            write_study_page(self, result, points, prepared.units, known, self.simulation.source.text)

        if self.export_to is not None:
            write_runs(self.export_to, prepared.folder.path(), table, points.names, {})

        error: FailedPointsError | UnmadeFilesError | None = None
        if results.status.any():
            error = FailedPointsError(result.statuses)
        elif kept.failures:
            error = UnmadeFilesError(kept.failures)
        raise_failures(result, verdicts, error)
        return result


def _command_of(schema: object) -> str:
    """Returns the command whose manifests have a schema: `mjrun sweep` for `mjrun-sweep-1`."""
    return str(schema or "").rpartition("-")[0].replace("-", " ")


def _changed(before: object, now: Mapping[str, object], part: str) -> list[str]:
    """Returns the keys whose values differ in a part of two manifests; none if one of them lacks it."""
    old, new = (each.get(part) if isinstance(each, dict) else None for each in (before, now))
    if not isinstance(old, dict) or not isinstance(new, dict):
        return []
    return [key for key in dict.fromkeys([*old, *new]) if old.get(key) != new.get(key)]


@dataclass(frozen=True)
class StudyResult:
    """The result of a study.

    Attributes:
      path: folder of the study.
      points: number of points.
      simulated: number of points that were simulated now; the others were known.
      statuses: number of points by status.
      metrics: summary of each metric.
      failures: reasons of failures, with the number of points and the first of them.
      assertions: requirements and whether they hold; empty while points are missing.
      files: files that were written.
      wall: wall time [s].
      names: parameters that vary.
      kept: files of single points.
      repeats: means over points that differ in their seed only, for the first 100 of the other parameters' values;
        `repeats.csv` has all.
      sensitivities: sensitivity of each metric to each parameter, with the samplers `saltelli` and `morris`.
      confidence: confidence of all intervals.
      schema: name of this schema.
    """

    path: str
    points: int
    simulated: int
    statuses: Mapping[str, int]
    metrics: Mapping[str, "MetricSummary"]
    failures: Sequence[PointFailureGroup]
    assertions: Sequence[Verdict]
    files: Sequence[str]
    wall: float
    names: Sequence[str]
    kept: KeptFiles = field(default_factory=KeptFiles)
    repeats: Sequence[RepeatSummary] = ()
    sensitivities: Sequence[MetricSensitivity] = ()
    confidence: float = CONFIDENCE
    schema: str = SCHEMA

    @property
    def table(self) -> "Table":
        """The numbers of the points, a row for each: its parameters and metrics.

        Raises:
          FileError: the folder has been removed or moved.
        """
        from mjrun.plotting.table_figure import Table

        check_result_folder(self.path)
        results = read_study(self.path)
        return Table(dict(results.numbers), dict(results.units))

    def _repr_html_(self) -> str:
        """Returns the table of points for a notebook."""
        return self.table.to_html()


@dataclass(frozen=True)
class MetricSummary:
    """Summary of a metric over the points where it is finite.

    Attributes:
      count: number of these points.
      mean, std: mean and standard deviation over these points; `std` estimates that of the population, with n − 1, and
        is NaN for one point.
      quantiles: 0, 5, 25, 50, 75, 95 and 100 % of the values, interpolated linearly.
      lowest, highest: points with the extreme values; None if no point has a value.
      lowest_values, highest_values: parameters of these points.
      unit: the unit of the values; empty for pure numbers and where it is unknown.
    """

    count: int
    mean: float
    std: float
    quantiles: Sequence[float]
    lowest: int | None
    highest: int | None
    lowest_values: Mapping[str, str] = field(default_factory=dict)
    highest_values: Mapping[str, str] = field(default_factory=dict)
    unit: str = ""


def _summary(points: Design, numbers: np.ndarray) -> MetricSummary:
    is_finite = np.isfinite(numbers)
    good = numbers[is_finite]
    if not len(good):
        return MetricSummary(0, math.nan, math.nan, [math.nan] * len(QUANTILES), None, None)
    lowest, highest = np.flatnonzero(is_finite)[[good.argmin(), good.argmax()]].tolist()
    mean, std = float(good.mean()), float(good.std(ddof=1)) if len(good) > 1 else math.nan
    good.sort()
    places = np.array(QUANTILES) * (len(good) - 1)
    around = np.array(sorted({*np.floor(places), *np.ceil(places)})).astype(int)
    return MetricSummary(
        count=len(good),
        mean=mean,
        std=std,
        quantiles=np.interp(places, around, good[around]).tolist(),
        lowest=lowest,
        highest=highest,
        lowest_values=points.values(lowest),
        highest_values=points.values(highest),
    )


@dataclass(frozen=True)
class StudyPreview:
    """The points and steps that a study would simulate, and their estimated cost.

    Attributes:
      path: folder of the study.
      points: number of points.
      known: number of points that have a result already.
      missing: number of points that would be simulated.
      chunks: approximate number of chunks, whose sizes are measured while they run.
      steps: steps of all missing simulations; where models vary, with the timestep of the base model.
      processes: number of processes that simulate; None where the engine has its own.
      point_wall: wall time of the measured point [s]; None if it failed.
      wall: estimated wall time of all points [s]; None if unknown.
      disk: estimated size of the study's files [bytes].
      names: parameters that vary.
      sample: first and last points.
      message: reason why the wall time is unknown; empty if it is known.
    """

    path: str
    points: int
    known: int
    missing: int
    chunks: int
    steps: int
    processes: int | None
    point_wall: float | None
    wall: float | None
    disk: int
    names: Sequence[str]
    sample: Sequence["PreviewPoint"]
    message: str = ""


@dataclass(frozen=True)
class PreviewPoint:
    """A point in a preview.

    Attributes:
      point: number of the point.
      values: values of the point, by parameter.
    """

    point: int
    values: Mapping[str, str]


def preview(prepared: PreparedStudy, options: ExecutionOptions) -> StudyPreview:
    """Previews the missing points of a study.

    Raises:
      UsageError: the engine is unknown.
    """
    missing = prepared.missing(options.retry_failed)
    steps = prepared.steps(missing)
    processes = process_count(options.engine, options.jobs, options.slurm)
    result, seconds = _measured(prepared, missing, options)
    of_step = seconds / result.steps if result and result.steps else 0.0
    sizes = _chunk_sizes(prepared, options, steps, processes or available_cores(), of_step)
    point_wall = wall = None
    if not missing:
        wall = 0.0
    elif result and result.steps:
        point_wall = seconds
        if processes:
            wall = START + seconds * int(steps.sum()) / result.steps / min(processes, len(sizes))

    count, design = len(prepared.points.points), prepared.points
    ends = sorted({*range(min(SHOWN, count)), *range(max(0, count - SHOWN), count)})
    parts = len(sizes) if wall is None else min(len(sizes), 1 + int(wall / INTERVAL))
    part = part_bytes([name for name, _ in prepared.spec.metrics], len(missing) // parts) if parts else 0
    return StudyPreview(
        path=prepared.folder.path(),
        points=count,
        known=count - len(missing),
        missing=len(missing),
        chunks=len(sizes),
        steps=int(steps.sum()),
        processes=processes,
        point_wall=point_wall,
        wall=wall,
        disk=prepared.files.size() + parts * part + table_bytes(design, len(prepared.spec.metrics)),
        names=design.names,
        sample=[PreviewPoint(index, design.values(index)) for index in ends],
        message=result.message if result and point_wall is None else "",
    )


def _chunk_sizes(
    prepared: PreparedStudy, options: ExecutionOptions, steps: np.ndarray, processes: int, of_step: float
) -> list[int]:
    """Returns the sizes of chunks if each step took `of_step` seconds."""
    ahead, start = processes * QUEUED, 0
    sizes, ends = prepared.chunk_sizes(options, ahead), list[int]()
    while start < len(steps):
        start += sizes.next(steps[start:])
        ends.append(start)
        if len(ends) > ahead:
            first, last = ([0, *ends][place - ahead] for place in (-2, -1))
            taken = int(steps[first:last].sum())
            sizes.add(last - first, taken, taken * of_step)
    return np.diff([0, *ends]).tolist()


def _measured(
    prepared: PreparedStudy, indices: Sequence[int], options: ExecutionOptions
) -> tuple[PointResult | None, float]:
    """Returns the result of the first of these points, and its wall time in a process that has started [s]."""
    if not indices:
        return None, math.nan
    point = StudyPoint(indices[0], prepared.points.points[indices[0]])
    limit = PATIENCE if options.time_limit is None else min(float(options.time_limit), PATIENCE)
    with closing(IsolatedSimulator(prepared.shipped)) as simulator:
        (result,) = simulator.run([point], limit)
        start = time.perf_counter()
        if result.status == "ok" and result.wall < PATIENCE / 10:  # now that the process is warm
            (result,) = simulator.run([point], limit)
            return result, time.perf_counter() - start
        return result, result.wall
