"""A study that can run: its points with their keys, what is known of them, and the chunks that are missing."""

import math
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import MjrunError, UsageError, clean, concerning, option
from mjrun.experiment.design import Design, design
from mjrun.experiment.results_table import Requirements, check_metric_names
from mjrun.model.variants import ModelVariants
from mjrun.options.sweep import ExecutionOptions, StudyOptions
from mjrun.probe.available import AvailableProbes
from mjrun.probe.metric import parse_metric
from mjrun.probe.select import TIME
from mjrun.reporter import Reporter
from mjrun.simulation.simulation import Simulation
from mjrun.study.chunk_files import ChunkFiles, point_keys, study_identity
from mjrun.study.executors import SLURM, ChunkSizes, completed, open_executor, require_extra
from mjrun.study.point_simulation import FILES, MODEL, require_values, simulation_at
from mjrun.study.results import STATUSES, TABLE_COLUMNS, with_flags
from mjrun.study.simulate import WORLD_BYTES
from mjrun.study.spec import Chunk, ChunkResult, PointResult, Proof, ShippedStudy, StudyPoint, StudySpec

LENGTH = ("timestep", "duration", "steps")  # decide how many steps a simulation takes
CHUNK_STEPS = 50_000  # steps in a chunk that is not measured: seconds, as a rule
CHUNK_POINTS = 500  # points in it, at most
JOB_SECONDS = 60.0  # that a job of a scheduler takes, which waits for its turn
CHUNK_WORLDS = 4096  # points in a chunk of worlds, which a GPU steps at once
FINAL = ("ok", "unstable")  # which another try would not change
NOT_YET = "it is not simulated yet"


class PreparedStudy:
    """A study whose names and numbers are all checked; nothing is written yet.

    Attributes:
      spec: what its points have in common.
      points: their values.
      model: the base model.
      shipped: what processes need of it.
      folder: of the study.
      files: where results are.
      known: the results that are there, by the key of their points.
      columns: those that the metrics read, in the base model, but for the time.

    Raises:
      UsageError: a name that nothing has, or a value that cannot be.
      FileError: a file cannot be read.
    """

    def __init__(self, options: StudyOptions, spec: StudySpec, points: Design, model: mujoco.MjModel) -> None:
        self.spec, self.points, self.model = spec, points, model
        self.shipped = ShippedStudy.of(spec)
        self.columns = self._check(options.require)
        self.folder = Path(options.output)
        self.files = ChunkFiles(self.folder, [name for name, _ in spec.metrics])
        self.known = self.files.read()

    @classmethod
    def of(cls, options: StudyOptions, spec: StudySpec, points: Design | None = None) -> "PreparedStudy":
        """The study that `options` describe. From here on it reads nothing but copies of its files.

        Args:
          spec: of its simulations; what varies is not known yet.
          points: those of them that are to be simulated, where the others are known already.
        """
        require_extra("sweep")
        original, base = spec.base, spec.base.with_snapshot()
        assert base.snapshot
        with base.snapshot.original_names_in_errors():
            source, model = base.compile()
            if points is None:
                points = _design(options, spec, source, model)
            snapshot = base.snapshot.with_files(_varied_files(original, points))
            spec = replace(spec.varying(points.names), base=replace(base, snapshot=snapshot))
            return cls(options, spec, points, model)

    @cached_property
    def identity(self) -> Mapping[str, object]:
        """All that decides the results, but for the values of the points."""
        return study_identity(self.spec, self.model, self.shipped.spec.modules)

    @cached_property
    def keys(self) -> Sequence[str]:
        """The key of each point."""
        return point_keys(self.identity, self.spec, self.points.points)

    def warn_of_damaged(self, reporter: Reporter) -> None:
        """Names the parts that cannot be read, whose points count as not simulated."""
        for path in self.files.damaged:
            reporter.warn(f"{clean(str(path))} is damaged: its points count as not simulated; it can be removed")

    def missing(self, retry_failed: bool = False) -> list[int]:
        """The points without a result, or with one that should be tried again."""

        def is_missing(result: PointResult | None) -> bool:
            return result is None or (retry_failed and result.status not in FINAL)

        return [index for index, key in enumerate(self.keys) if is_missing(self.known.get(key))]

    def chunk_sizes(self, options: ExecutionOptions, ahead: int) -> ChunkSizes:
        """How many points make a chunk.

        Args:
          ahead: chunks in flight.
        """
        if self.spec.engine == "warp":
            worlds = min(CHUNK_WORLDS, WORLD_BYTES // mujoco.mj_sizeModel(self.model))
            return ChunkSizes(options.chunk or max(1, worlds), ahead)
        if options.engine == SLURM:
            return ChunkSizes(options.chunk, ahead, JOB_SECONDS, self.planned_size)
        return ChunkSizes(options.chunk, ahead)

    @cached_property
    def planned_size(self) -> int:
        """How many points make a chunk where nothing can be measured, by the length of the first simulation."""
        steps = max(1, self.first.timeline(self.first.load()).steps)
        return max(1, min(CHUNK_STEPS // steps, CHUNK_POINTS))

    def steps(self, indices: Sequence[int]) -> np.ndarray:
        """How many steps these points take `(n,)`; those whose simulation cannot be made take none."""
        names = self.points.names
        deciding = [i for i, name in enumerate(names) if name.rpartition(".")[2].rpartition(":")[2] in LENGTH]
        varying = self.spec.varying(tuple(names[i] for i in deciding))
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

    def chunks(self, indices: Sequence[int], options: ExecutionOptions, sizes: ChunkSizes) -> Iterator[Chunk]:
        """These points, as many together as `sizes` says when a chunk is taken."""
        limit = math.inf if options.time_limit is None else float(options.time_limit)
        steps, start = self.steps(indices), 0
        while start < len(indices):
            part = indices[start : start + sizes.next(steps[start:])]
            start += len(part)
            yield Chunk(self.shipped, tuple(StudyPoint(index, self.points.points[index]) for index in part), limit)

    def simulate(
        self, indices: Sequence[int], options: ExecutionOptions, reporter: Reporter
    ) -> Iterator[Sequence[PointResult]]:
        """Simulates points in chunks, publishes each as it is done, and adds its results to what is known.

        Results of a process whose libraries are of other versions than this one's are refused and not published.
        """
        expected = Proof.here(self.spec.models(self.points.points))
        refused = dict[str, None]()

        def fault(result: ChunkResult) -> str:
            if result.lacks_files:
                return "the machine that was to simulate it cannot store the study's files"
            reasons = [f"{p.host} has {difference}" for p in result.proofs if (difference := p.difference(expected))]
            for reason in reasons:
                if reason not in refused:
                    refused[reason] = None
                    reporter.warn(f"{reason}: its results are refused, and simulated again")
            return "; ".join(reasons)

        with ExitStack() as stack:
            executor, ahead = open_executor(options.engine, options.jobs, self.folder, stack)
            sizes = self.chunk_sizes(options, ahead)
            for chunk, result in completed(executor, self.chunks(indices, options, sizes), ahead, fault):
                results = result.results
                sizes.add(len(results), sum(each.steps for each in results), sum(each.wall for each in results))
                keys = [self.keys[point.index] for point in chunk.points]
                hosts = {proof.host for proof in result.proofs}
                if not result.is_refused:
                    self.files.write(keys, result.results, ", ".join(sorted(hosts)) or socket.gethostname())
                self.known.update(zip(keys, result.results, strict=True))
                yield result.results

    def results(self) -> list[PointResult]:
        """What is known of each point, in order; what is not says so."""
        nothing = (math.nan,) * len(self.spec.metrics)
        missing = PointResult(-1, "missing", nothing, 0, 0, NOT_YET)
        return [self.known.get(key, missing) for key in self.keys]

    def _check(self, requirements: Sequence[str]) -> Sequence[str]:
        """Finds what is wrong with all points before the first is simulated. Returns the columns of the metrics."""
        episode = self.first.episode
        others = episode.columns.names if episode else ()
        available = AvailableProbes(self.model, others) if self.spec.metrics else None
        columns = dict[str, None]()
        check_metric_names(self.spec.metrics, (*self.points.names, *STATUSES, *TABLE_COLUMNS))
        for name, text in self.spec.metrics:
            with concerning("metric", name):
                assert available
                metric = parse_metric(text, available, f"{option('metric')} {name}")
                columns |= dict.fromkeys(column for column in metric.columns if column != TIME)
        metrics = [name for name, _ in self.spec.metrics]
        Requirements(requirements, [*self.points.names, *metrics], STATUSES, with_flags)
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
        return [*columns]

    @cached_property
    def first(self) -> Simulation:
        """The simulation of the first point; with the base model, since any other might crash this process."""
        return replace(self.spec.simulation(self.points.points[0]), model=self.spec.base.model)


def _design(options: StudyOptions, spec: StudySpec, source: mujoco.MjSpec | None, model: mujoco.MjModel) -> Design:
    points = design(options, model, spec.base.seed)
    try:
        shared = None if MODEL in points.names else source
        require_values(points.names, points.points, dict(spec.controllers), shared)
    except UsageError as error:
        if options.points is not None:
            error.add_note(f"the columns of {clean(options.points)} are parameters, too")
        raise
    return points


def _varied_files(base: Simulation, points: Design) -> Iterator[Path]:
    """The files that the values of points name. A value that names none, or no model, fails at its points."""
    for index, name in enumerate(points.names):
        if name in FILES:
            for text in dict.fromkeys(values[index] for values in points.points):
                with suppress(MjrunError):
                    yield from (path for _, path in simulation_at(base, (name,), (text,)).inputs)
