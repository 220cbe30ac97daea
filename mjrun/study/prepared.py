"""A study that is ready to run: its points and their keys, the known results, and the missing chunks."""

import math
import socket
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import MjrunError, UsageError, clean
from mjrun.experiment.design import Design, design
from mjrun.experiment.results_table import Requirements, check_metric_names, metric_columns, parse_metrics
from mjrun.model.setting_units import setting_unit
from mjrun.model.variants import ModelVariants
from mjrun.options.sweep import ExecutionOptions, StudyOptions, VariationOptions
from mjrun.probe.expression_units import expression_unit
from mjrun.probe.metric import Metric
from mjrun.probe.select import available_columns
from mjrun.reporter import Reporter
from mjrun.simulation.simulation import Simulation
from mjrun.study import executors
from mjrun.study.chunk_files import FINAL, ChunkFiles, PartWriter, point_keys, study_identity
from mjrun.study.episode_spec import EpisodeSpec
from mjrun.study.results import STATUSES, TABLE_COLUMNS, FailureReporter, with_flags
from mjrun.study.simulate import WORLD_BYTES
from mjrun.study.spec import (
    FILES,
    MODEL,
    ChunkResult,
    PointChunk,
    PointResult,
    ShippedStudy,
    StudyPoint,
    StudySpec,
    WorkerVersions,
    require_values,
    simulation_at,
    without_cameras,
)

IN_SECONDS = ("timestep", "duration", "ctrl_noise_time", "control_dt")  # options of simulations
LENGTH = ("timestep", "duration", "steps")  # parameters that determine the number of steps
FIRST_STEPS = 2000  # in a chunk before anything is measured, if points have fewer
FIRST_POINTS = 32  # most points in such a chunk: each may be compiled
CHUNK_STEPS = 50_000  # steps in a chunk whose time is not measured: usually seconds
CHUNK_POINTS = 500  # most points in such a chunk
JOB_SECONDS = 60.0  # wall time of a job of a scheduler, which has to wait for its turn
CHUNK_WORLDS = 4096  # points in a chunk of Warp worlds
NOT_YET = "it is not simulated yet"


class PreparedStudy:
    """A study whose names and numbers are all checked. Nothing is written yet, and only copies of its files are read.

    Args:
      spec: specification, without the names of parameters.
      points: the points to simulate, if they are only a part of the study.

    Attributes:
      spec: specification of the points.
      points: parameters and the values of each point.
      model: base model.
      shipped: the study as processes receive it.
      folder: folder of the study.
      files: files of results.
      known: known results, by the key of their points.
      columns: columns that the metrics read in the base model, except the time.
      units: units of parameters and metrics in the base model; empty where unknown.

    Raises:
      UsageError: a name is unknown, or a value is invalid.
      FileError: a file cannot be read.
    """

    def __init__(self, options: StudyOptions, spec: StudySpec, points: Design | None = None) -> None:
        if not isinstance(spec.product, EpisodeSpec):
            executors.require_extra("sweep")
        base = spec.base.with_snapshot()
        assert base.snapshot
        with base.snapshot.original_names_in_errors():
            source, self.model = base.compile()
            self.points = checked_design(options, spec, source, self.model) if points is None else points
            snapshot = base.snapshot.with_files(varied_files(spec.base, self.points))
            self.spec = replace(spec, names=self.points.names, base=replace(base, snapshot=snapshot))
            self.shipped = ShippedStudy.of(self.spec)
            metrics = self._check(options.require)
            self.columns, self.units = metric_columns(metrics), self._units(metrics)
            self.folder = Path(options.output)
            self.files = ChunkFiles(self.folder, [name for name, _ in spec.metrics])
            self.known = self.files.read()

    @cached_property
    def identity(self) -> Mapping[str, object]:
        """Everything that determines the results, except the values of the points."""
        return study_identity(self.spec, self.model, self.shipped.spec.modules)

    @cached_property
    def keys(self) -> Sequence[str]:
        """The key of each point."""
        return point_keys(self.identity, self.spec, self.points.points)

    @cached_property
    def first(self) -> Simulation:
        """The simulation of the first point, in the base model: any other model might crash this process."""
        return replace(self.spec.simulation(self.points.points[0]), model=self.spec.base.model)

    @cached_property
    def planned_size(self) -> int:
        """Points in a chunk whose time cannot be measured, from the length of the first simulation."""
        steps = max(1, self.first.timeline(self.first.load()).steps)
        return max(1, min(CHUNK_STEPS // steps, CHUNK_POINTS))

    @property
    def _first_size(self) -> int:
        """Points in a chunk before anything is measured: one, unless the first takes few steps."""
        if self.first.episode is not None or isinstance(self.spec.product, EpisodeSpec):
            return 1
        return min(max(1, FIRST_STEPS // max(1, self.first.timeline(self.model).steps)), FIRST_POINTS)

    def warn_of_damaged(self, reporter: Reporter) -> None:
        """Warns of parts that cannot be read, whose points count as not simulated."""
        for path in self.files.damaged:
            reporter.warn(f"{clean(str(path))} is damaged: its points count as not simulated; it can be removed")

    def missing(self, retry_failed: bool = False) -> list[int]:
        """Returns the points without a result, and those with a failure that `retry_failed` repeats."""
        results = [self.known.get(key) for key in self.keys]
        return [
            index
            for index, result in enumerate(results)
            if result is None or (retry_failed and result.status not in FINAL)
        ]

    def results(self) -> list[PointResult]:
        """Returns the result of each point in order; a point without one has the status `missing`."""
        missing = PointResult(-1, "missing", (math.nan,) * len(self.spec.metrics), 0, 0, NOT_YET)
        return [self.known.get(key, missing) for key in self.keys]

    def steps(self, indices: Sequence[int]) -> np.ndarray:
        """Returns the number of steps of points `(n,)`; 0 for a point whose simulation cannot be made, and for episodes
        of a dataset, whose lengths only their simulation shows.
        """
        if isinstance(self.spec.product, EpisodeSpec):
            return np.zeros(len(indices), np.int64)
        names = self.points.names
        deciding = [i for i, name in enumerate(names) if name.rpartition(".")[2].rpartition(":")[2] in LENGTH]
        varying = replace(self.spec, names=tuple(names[i] for i in deciding))
        variants, known, counts = ModelVariants(), dict[tuple[str, ...], int](), list[int]()
        for index in indices:
            values = self.points.points[index]
            key = tuple(values[i] for i in deciding)
            if key not in known:
                try:
                    simulation = varying.simulation(key)
                    known[key] = simulation.timeline(variants.load(simulation.source).model).steps
                except MjrunError:
                    known[key] = 0
            counts.append(known[key])
        return np.array(counts, np.int64)

    def chunk_sizes(self, options: ExecutionOptions, ahead: int) -> executors.ChunkSizes:
        """Returns the sizes of chunks, of which `ahead` are in flight."""
        if self.spec.engine == "warp":
            worlds = min(CHUNK_WORLDS, WORLD_BYTES // mujoco.mj_sizeModel(self.model))
            return executors.ChunkSizes(options.chunk or max(1, worlds), ahead)
        if options.engine == executors.SLURM:
            return executors.ChunkSizes(options.chunk, ahead, JOB_SECONDS, self.planned_size)
        return executors.ChunkSizes(options.chunk, ahead, first=self._first_size)

    def chunks(
        self, indices: Sequence[int], options: ExecutionOptions, sizes: executors.ChunkSizes
    ) -> Iterator[PointChunk]:
        """Yields points in chunks; asks `sizes` for the size of each chunk when it is needed."""
        limit = math.inf if options.time_limit is None else float(options.time_limit)
        steps, start = self.steps(indices), 0
        while start < len(indices):
            part = indices[start : start + sizes.next(steps[start:])]
            start += len(part)
            yield PointChunk(self.shipped, tuple(StudyPoint(index, self.points.points[index]) for index in part), limit)

    def simulate(
        self,
        indices: Sequence[int],
        options: ExecutionOptions,
        reporter: Reporter,
        numbers: Sequence[int] | None = None,
        publish: Callable[[str, PointResult], None] | None = None,
    ) -> Counter[str]:
        """Simulates points in chunks, publishes their results every half second, and adds them to `known`.

        Results of a process with other versions of libraries are refused and not published.

        Args:
          numbers: number of each point in the study, if the points are only a part of it.
          publish: writes the files of a point with its key, before its result is recorded.

        Returns:
          The number of points by status.
        """
        statuses, noun = Counter[str](), "episodes" if isinstance(self.spec.product, EpisodeSpec) else "points"
        failures = FailureReporter(self.points, reporter, numbers)
        with PartWriter(self.files, executors.INTERVAL) as parts:
            for arrived in self._completed(indices, options, reporter):
                for chunk, result in arrived:
                    keys = [self.keys[point.index] for point in chunk.points]
                    if publish and not result.is_refused:
                        for key, each in zip(keys, result.results, strict=True):
                            publish(key, each)
                        result = replace(result, results=[replace(each, files=()) for each in result.results])
                    if not result.is_refused:
                        hosts = {each.host for each in result.worker_versions} or {socket.gethostname()}
                        parts.add(keys, result.results, ", ".join(sorted(hosts)))
                    self.known.update(zip(keys, result.results, strict=True))

                    failures.add(result.results)
                    statuses.update(each.status for each in result.results)
                    failed = statuses.total() - statuses["ok"]
                    label = f"{noun}, {failed} failed" if failed else noun
                    reporter.progress(label, statuses.total(), len(indices))
                parts.write_if_due()
        return statuses

    def _completed(
        self, indices: Sequence[int], options: ExecutionOptions, reporter: Reporter
    ) -> Iterator[Sequence[tuple[PointChunk, ChunkResult]]]:
        """Yields the results of chunks as `executors.completed`; warns of each reason to refuse some."""
        expected = WorkerVersions.here(self.spec.models(self.points.points))
        reported = set[str]()

        def fault(result: ChunkResult) -> str:
            if result.lacks_files:
                return "the machine that was to simulate it cannot store the study's files"
            differences = [(each.host, each.difference(expected)) for each in result.worker_versions]
            reasons = [f"{host} has {difference}" for host, difference in differences if difference]
            for reason in reasons:
                if reason not in reported:
                    reported.add(reason)
                    reporter.warn(f"{reason}: its results are refused, and simulated again")
            return "; ".join(reasons)

        with ExitStack() as stack:
            executor, ahead = executors.open_executor(options.engine, options.jobs, self.folder, stack)
            sizes = self.chunk_sizes(options, ahead)
            for arrived in executors.completed(executor, self.chunks(indices, options, sizes), ahead, fault):
                for _, result in arrived:
                    results = result.results
                    sizes.add(len(results), sum(each.steps for each in results), sum(each.wall for each in results))
                yield arrived

    def _check(self, requirements: Sequence[str]) -> Sequence[Metric]:
        """Raises errors that concern all points before the first is simulated; returns the metrics."""
        episode = self.first.episode
        check_metric_names(self.spec.metrics, (*self.points.names, *STATUSES, *TABLE_COLUMNS))
        metrics = parse_metrics(self.spec.metrics, self.model, episode.columns if episode else None)
        numbers = [*self.points.names, *(name for name, _ in self.spec.metrics)]
        Requirements(requirements, numbers, STATUSES, with_flags)
        if isinstance(self.spec.product, EpisodeSpec):  # whose simulation would take as long as the whole point
            return metrics
        try:
            model = self.first.load()
            self.first.timeline(model)
            self.first.stepper(model)
        except UsageError as error:
            match error.path:
                case ("set", name, *rest) if name in self.points.names:
                    error.path = ("vary", name, *rest)
                case _:
                    pass
            raise
        return metrics

    def _units(self, metrics: Sequence[Metric]) -> Mapping[str, str]:
        episode = self.first.episode
        available = available_columns(self.model, episode.columns if episode else None)
        columns = {"time": "s"} | {each.name: each.unit for each in available}
        named = zip(self.spec.metrics, metrics, strict=True)
        of_metrics = {name: expression_unit(metric.root, columns) for (name, _), metric in named}
        return parameter_units(self.points.names, columns, self.model) | of_metrics


def parameter_units(names: Sequence[str], columns: Mapping[str, str], model: mujoco.MjModel) -> dict[str, str]:
    """Returns the units of parameters; empty where unknown.

    Args:
      columns: the units of the columns of a trace.
    """
    return {
        name: columns.get(name) or (name in IN_SECONDS and "s") or setting_unit(model, name) or "" for name in names
    }


def checked_design(
    options: VariationOptions, spec: StudySpec, source: mujoco.MjSpec | None, model: mujoco.MjModel
) -> Design:
    """Returns the points that `options` describe, with their names and values checked.

    Args:
      source: the specification of the base model, or None if it is compiled already.
      model: the base model.

    Raises:
      UsageError: a name is unknown, or a value is invalid.
    """
    points = design(options, model, spec.base.seed)
    try:
        shared = None if MODEL in points.names else source
        names, values = points.names, points.points
        if spec.product:
            values = [without_cameras(names, point)[1] for point in values]
            names = without_cameras(names, names)[0]
        require_values(names, values, dict(spec.controllers), shared)
    except UsageError as error:
        if options.points is not None:
            error.add_note(f"the columns of {clean(options.points)} are parameters, too")
        raise
    return points


def varied_files(base: Simulation, points: Design) -> Iterator[Path]:
    """Yields the files that values of points name. A value that names no valid model fails at its points."""
    for index, name in enumerate(points.names):
        if name in FILES:
            for text in dict.fromkeys(values[index] for values in points.points):
                with suppress(MjrunError):
                    yield from (path for _, path in simulation_at(base, (name,), (text,)).inputs)
