"""A study that can run: its points with their keys, what is known of them, and the chunks that are missing."""

import math
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import MjrunError, UsageError, clean, concerning, option
from mjrun.job.simulation import Simulation
from mjrun.model.variants import ModelVariants
from mjrun.options.sweep import ExecutionOptions, StudyOptions
from mjrun.probe.assertion import parse
from mjrun.probe.available import AvailableProbes
from mjrun.probe.metric import parse_metric
from mjrun.probe.scanner import Vocabulary
from mjrun.probe.select import TIME
from mjrun.reporter import Reporter
from mjrun.study.chunk_sizes import ChunkSizes
from mjrun.study.design import Design, design
from mjrun.study.executors import SLURM, completed, open_executor, require_extra
from mjrun.study.isolation import Chunk
from mjrun.study.parameters import MODEL, require_values
from mjrun.study.parts import PartFiles, point_keys, study_identity
from mjrun.study.results import STATUSES, TABLE_COLUMNS, with_flags
from mjrun.study.simulate import WORLD_BYTES, PointResult, StudyPoint, StudySpec

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
        self.columns = self._check(options.require)
        self.folder = Path(options.output)
        self.files = PartFiles(self.folder, [name for name, _ in spec.metrics])
        self.known = self.files.read()

    @classmethod
    def of(cls, options: StudyOptions, spec: StudySpec) -> "PreparedStudy":
        """The study that `options` describe.

        Args:
          spec: of its simulations; what varies is not known yet.
        """
        require_extra("sweep")
        source, model = spec.base.source.compile()
        points = design(options, model, spec.base.seed)
        try:
            shared = None if MODEL in points.names else source
            require_values(points.names, points.points, dict(spec.controllers), shared)
        except UsageError as error:
            if options.points is not None:
                error.add_note(f"the columns of {clean(options.points)} are parameters, too")
            raise
        return cls(options, spec.varying(points.names), points, model)

    @cached_property
    def identity(self) -> Mapping[str, object]:
        """All that decides the results, but for the values of the points."""
        return study_identity(self.spec, self.model)

    @cached_property
    def keys(self) -> Sequence[str]:
        """The key of each point."""
        return point_keys(self.identity, self.points.names, self.points.points)

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
            yield Chunk(self.spec, tuple(StudyPoint(index, self.points.points[index]) for index in part), limit)

    def simulate(self, indices: Sequence[int], options: ExecutionOptions) -> Iterator[Sequence[PointResult]]:
        """Simulates points in chunks, publishes each as it is done, and adds its results to what is known."""
        with ExitStack() as stack:
            executor, ahead = open_executor(options.engine, options.jobs, self.folder, stack)
            sizes = self.chunk_sizes(options, ahead)
            for chunk, results in completed(executor, self.chunks(indices, options, sizes), ahead):
                sizes.add(len(results), sum(each.steps for each in results), sum(each.wall for each in results))
                keys = [self.keys[point.index] for point in chunk.points]
                self.files.write(keys, results, socket.gethostname())
                self.known.update(zip(keys, results, strict=True))
                yield results

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
        names, columns = [name for name, _ in self.spec.metrics], dict[str, None]()
        for name, text in self.spec.metrics:
            with concerning("metric", name):
                if not name.isidentifier() or name in (*self.points.names, *STATUSES, *TABLE_COLUMNS):
                    reason = "it takes letters, digits and _, and no other column may have it"
                    raise UsageError(f"{option('metric')}: {name!r} cannot be the name of a metric: {reason}")
                if names.count(name) > 1:
                    raise UsageError(f"{option('metric')}: {name} is given twice")
                assert available
                metric = parse_metric(text, available, f"{option('metric')} {name}")
                columns |= dict.fromkeys(column for column in metric.columns if column != TIME)
        for index, text in enumerate(requirements):
            with concerning("require", index):
                parse(with_flags(text), RequirementNames([*self.points.names, *names]), "require")
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


class RequirementNames(Vocabulary):
    """The columns of the table of a study, and each status as what holds or does not: `share(ok) > 0.95`."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__([*names, *STATUSES])

    def is_count(self, column: str) -> bool:
        return column in STATUSES
