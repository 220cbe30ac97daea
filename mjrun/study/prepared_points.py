"""Points that are ready to be simulated: their keys, their known results, and the chunks of those that are missing."""

import math
import socket
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from mjrun.errors import clean
from mjrun.experiment.design import Design
from mjrun.options.sweep import ExecutionOptions
from mjrun.reporter import Reporter
from mjrun.study import executors
from mjrun.study.chunk_files import FINAL, ChunkFiles, PartWriter
from mjrun.study.results import FailureReporter
from mjrun.study.spec import (
    ChunkResult,
    PointChunk,
    PointResult,
    PointSpec,
    ShippedStudy,
    StudyPoint,
    WorkerVersions,
)

JOB_SECONDS = 60.0  # wall time of a job of a scheduler, which has to wait for its turn
NOT_YET = "it is not simulated yet"


class PreparedPoints(ABC):
    """Points that are ready to be simulated in processes and on machines, with the results of earlier runs.

    Args:
      spec: specification of the points.
      points: parameters and the values of each point.
      shipped: the specification as processes receive it.
      folder: folder of the results.
      metrics: names of the numbers of each result.

    Attributes:
      files: files of results.
      known: known results, by the key of their points.

    Raises:
      FileError: a file of results cannot be read for lack of permission.
    """

    def __init__(
        self, spec: PointSpec, points: Design, shipped: ShippedStudy, folder: Path, metrics: Sequence[str]
    ) -> None:
        self._spec, self.points, self.shipped, self.folder = spec, points, shipped, folder
        self._metrics = len(metrics)
        self.files = ChunkFiles(folder, metrics)
        self.known = self.files.read()

    @cached_property
    def keys(self) -> Sequence[str]:
        """The key of each point."""
        return self._keys()

    @abstractmethod
    def _keys(self) -> Sequence[str]:
        """Returns the key of each point: a hash of everything that determines its result."""

    @property
    def noun(self) -> str:
        """The word for a point in messages."""
        return "point"

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
        missing = self.not_simulated
        return [self.known.get(key, missing) for key in self.keys]

    @property
    def not_simulated(self) -> PointResult:
        """The result of a point without one."""
        return PointResult(-1, "missing", (math.nan,) * self._metrics, 0, 0, NOT_YET)

    def steps(self, indices: Sequence[int]) -> np.ndarray:
        """Returns the number of steps of points `(n,)`; 0 where only their simulation shows it."""
        return np.zeros(len(indices), np.int64)

    def chunk_sizes(self, options: ExecutionOptions, ahead: int) -> executors.ChunkSizes:
        """Returns the sizes of chunks, of which `ahead` are in flight."""
        seconds = JOB_SECONDS if options.engine == executors.SLURM else executors.SECONDS
        return executors.ChunkSizes(options.chunk, ahead, seconds)

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
        statuses = Counter[str]()
        failures = FailureReporter(self.points, reporter, numbers, self.noun)
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
                    label = f"{self.noun}s, {failed} failed" if failed else f"{self.noun}s"
                    reporter.progress(label, statuses.total(), len(indices))
                parts.write_if_due()
        return statuses

    def _completed(
        self, indices: Sequence[int], options: ExecutionOptions, reporter: Reporter
    ) -> Iterator[Sequence[tuple[PointChunk, ChunkResult]]]:
        """Yields the results of chunks as `executors.completed`; warns of each reason to refuse some."""
        expected = WorkerVersions.here(self._spec.models(self.points.points))
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
