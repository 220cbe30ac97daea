"""Points that are ready to be simulated: their keys, their known results, and the chunks of those that are missing."""

import hashlib
import math
import time
from abc import ABC, abstractmethod
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from mjrun.errors import clean, counted, listing, option
from mjrun.experiment.design import Design
from mjrun.formats.local_and_remote_folders import folder_at
from mjrun.options.sweep import ExecutionOptions
from mjrun.reporter import Reporter
from mjrun.study import executors
from mjrun.study.clusters import LostJobError
from mjrun.study.isolation import PointChunk
from mjrun.study.leases import Leases, PointLeaser
from mjrun.study.part_files import PartFiles, PartPublisher, PartWriter, kept_results_in_errors
from mjrun.study.range_folders import PointRange
from mjrun.study.results import FailureReporter, ResultColumns, ResultRows
from mjrun.study.spec import ChunkResult, PointResult, ShippedStudy, SimulatorSpec, StudyPoint, WorkerVersions

JOB_SECONDS = 60.0  # wall time of a job of a scheduler, which has to wait for its turn
LEAST_JOB = 4.0  # [s] of the last jobs
SHARED = 64  # least points of a chunk whose results its process publishes: this one writes those of many chunks at once
ADOPTED = 2**16  # results in a part that are adopted from other designs


class RunLimits:
    """The limits of a run, after which no more points are started: its wall time, from now, and its failures.

    Attributes:
      failed: number of points that have failed in this run.
      ending: reason why the engine executes no more; empty while it does.
    """

    def __init__(self, options: ExecutionOptions) -> None:
        self._time, self._failures = options.time_budget, options.max_failures
        self._start, self.failed, self.ending = time.perf_counter(), 0, ""

    @property
    def reached(self) -> str:
        """The limit that is reached; empty if none is."""
        if self._failures is not None and self.failed >= self._failures:
            return f"{self.failed} failed in this run"
        if self._time is not None and time.perf_counter() - self._start >= self._time:
            return f"the time budget of {float(self._time):g} s is spent"
        return self.ending


class PreparedPoints(ABC):
    """Points that are ready to be simulated in processes and on machines, with the results of earlier runs.

    Args:
      spec: specification of the points.
      points: parameters and the values of each point.
      shipped: the specification as processes receive it.
      folder: folder of the results, or its URL.
      metrics: names of the numbers of each result.

    Attributes:
      folder: folder of the results.
      files: files of results.
    """

    def __init__(
        self, spec: SimulatorSpec, points: Design, shipped: ShippedStudy, folder: str | Path, metrics: Sequence[str]
    ) -> None:
        self._spec, self.points, self.shipped, self.folder = spec, points, shipped, folder_at(folder)
        self.files = PartFiles(self.folder, metrics, self._digest(), len(points.points))

    @cached_property
    def numbers(self) -> np.ndarray:
        """The points that this process works on, ascending; all of them unless it is assigned before it is read."""
        return np.arange(len(self.points.points))

    @cached_property
    def known(self) -> ResultColumns:
        """The known results of the points `numbers`.

        Raises:
          FileError: a file of results cannot be read for lack of permission.
        """
        return self.files.read(self.numbers, self.keys_of)

    @cached_property
    def keys(self) -> Sequence[str]:
        """The key of each point."""
        return self.keys_of(range(len(self.points.points)))

    @abstractmethod
    def keys_of(self, indices: Sequence[int] | np.ndarray) -> Sequence[str]:
        """Returns the keys of points: hashes of everything that determines their results, 32 hexadecimal digits."""

    def _digest(self) -> str:
        """Returns a hash of everything that determines the results of all points, and of their order."""
        return hashlib.sha256("".join(self.keys).encode()).hexdigest()

    @property
    def noun(self) -> str:
        """The word for a point in messages."""
        return "point"

    def warn(self, reporter: Reporter) -> None:
        """Warns of parts that cannot be read, whose points count as not simulated, and of code that shares memory."""
        assert self.known
        for name in self.files.damaged:
            path = self.files.folder.path(name)
            reporter.warn(f"{clean(path)} is damaged: its points count as not simulated; it can be removed")

    def adopt(self) -> int:
        """Publishes results of other designs of the study as those of this one, which will be read without keys.

        Returns:
          Their number.

        Raises:
          FileError: they cannot be written.
        """
        adopted = self.files.adopted
        for start in range(0, len(adopted), ADOPTED):
            some = adopted[start : start + ADOPTED]
            points = self.known.points[some]
            self.files.write(points, self.keys_of(points), self.known.rows(some))
        return len(adopted)

    def missing(self, retry_failed: bool = False) -> Sequence[int]:
        """Returns the points without a result, and those with a failure that `retry_failed` repeats."""
        known = self.known
        points = known.points[~known.is_final if retry_failed else known.is_missing]
        return array("q", points.tobytes())  # a list would take five times the memory

    def note_known(self, missing: Sequence[int] | np.ndarray, reporter: Reporter, origin: str = "") -> None:
        """Reports the number of points whose results are known already, if there are any."""
        if known := len(self.keys) - len(missing):
            reporter.note(f"{known} of {counted(len(self.keys), self.noun)} are known already{origin}")
        if not len(missing):
            self._remove_left_leases(Leases(self.files.ranges))

    def _remove_left_leases(self, leases: Leases) -> None:
        """Removes the leases that processes of this machine have left of known points when they were killed."""
        numbers, is_missing = self.known.points, self.known.is_missing

        def is_known(points: PointRange) -> bool:
            first, stop = np.searchsorted(numbers, [points.first, points.last + 1]).tolist()
            return points.first > points.last or (first < stop and not is_missing[first:stop].any())

        leases.others(is_known)

    def steps(self, indices: Sequence[int] | np.ndarray) -> np.ndarray:
        """Returns the number of steps of points `(n,)`; 0 where only their simulation shows it."""
        return np.broadcast_to(np.int64(0), len(indices))

    def chunk_sizes(self, options: ExecutionOptions, ahead: int) -> executors.ChunkSizes:
        """Returns the sizes of chunks, of which `ahead` are in flight."""
        if options.engine == executors.SLURM:
            return executors.ChunkSizes(options.chunk, ahead, JOB_SECONDS, least=LEAST_JOB)
        return executors.ChunkSizes(options.chunk, ahead)

    def chunks(
        self,
        leased: PointLeaser,
        options: ExecutionOptions,
        sizes: executors.ChunkSizes,
        shared: Callable[[Sequence[int]], PartPublisher | None] = lambda _: None,
    ) -> Iterator[PointChunk | None]:
        """Returns an iterator of points in chunks; asks `sizes` for the size of each chunk when it is needed.

        It yields None while other processes have leased all points that are left, and after its end the points that
        are given back.

        Args:
          shared: returns where the results of points are published by the process that simulates them.
        """
        limit = math.inf if options.time_limit is None else float(options.time_limit)
        steps = self.steps(leased.points)

        def size(places: np.ndarray) -> int:
            return sizes.next(steps[places[: executors.MOST]], leased.share)

        def next_chunk() -> PointChunk | None:
            part = leased.take(size).tolist()
            if not part:
                return None
            points = tuple(map(StudyPoint, part, self.points.at(part)))
            return PointChunk(self.shipped, points, limit, parts=shared(part))

        return _Chunks(leased, next_chunk)

    def simulate(
        self,
        indices: Sequence[int],
        options: ExecutionOptions,
        reporter: Reporter,
        publish: Callable[[str, PointResult], None] | None = None,
    ) -> Counter[str]:
        """Simulates points in chunks, publishes their results every half second, and adds them to `known`.

        Other processes that simulate the same study in this folder share the points; their results are added, too.
        Results of a process with other versions of libraries are refused and not published. When the time budget is
        spent, or too many points have failed, those that are running finish, and the others stay missing, as do those
        in flight when the engine ends.

        Args:
          publish: writes the files of a point with its key, before its result is recorded.

        Returns:
          The number of points by status.
        """
        statuses, limits = Counter[str](), RunLimits(options)
        failures = FailureReporter(self.points, reporter, self.noun)
        is_waiting, unread = False, 0
        with (
            kept_results_in_errors(self.folder, self.noun),
            Leases(self.files.ranges) as leases,
            PartWriter(self.files, executors.INTERVAL, leases.publish) as parts,
            ExitStack() as stack,
        ):
            executor, ahead = executors.open_executor(
                options.engine, options.jobs, Path(self.folder.path()), stack, options.slurm, reporter.note
            )
            leased = PointLeaser(indices, self.known, self.files, leases, ahead)
            is_shared = not isinstance(executor, ThreadPoolExecutor) and publish is None
            for arrived in self._completed(executor, leased, leases, ahead, options, limits, reporter, is_shared):
                for chunk, result in arrived:
                    places = [point.index for point in chunk.points]
                    if result.is_refused:
                        leases.publish(places)
                    elif result.part:
                        parts.adopt(result.part, places)
                        unread += len(places) - len(result.results)
                    else:
                        keys = self.keys_of(places)
                        if publish:
                            for key, each in zip(keys, result.results, strict=True):
                                publish(key, each)
                            result = replace(result, results=[replace(each, files=()) for each in result.results])
                        parts.add(places, keys, result.results, result.hosts)
                    returned = np.array([each.index for each in result.results], np.int64)
                    self.known.put_points(returned, ResultRows.of(result.results, self.files.width))

                    failures.add(result.results)
                    statuses.update(each.status for each in result.results)
                    statuses.update(["ok"] * (len(places) - len(result.results)))
                    limits.failed = statuses.total() - statuses["ok"]
                    label = f"{self.noun}s, {limits.failed} failed" if limits.failed else f"{self.noun}s"
                    reporter.progress(label, statuses.total() + leased.elsewhere, len(indices))
                parts.write_if_due()
                if leased.is_waiting and not is_waiting:
                    is_waiting = True
                    some = counted(leased.left, self.noun)
                    reporter.note(f"waiting for {some} that other processes simulate on {listing(leases.hosts())}")
            self._remove_left_leases(leases)
        if is_shared and len(indices):  # also of workers that have died since they published them
            missing = int(self.known.is_missing.sum())
            self.files.update(self.known, min(indices), max(indices))
            leased.elsewhere += missing - int(self.known.is_missing.sum()) - unread
        if leases.losses > 1:
            reporter.note(f"{counted(leases.losses, 'Slurm job')} lost; their points were submitted again")
        if leased.elsewhere:
            reporter.note(f"other processes simulated {counted(leased.elsewhere, self.noun)} in the meantime")
        if left := len(indices) - statuses.total() - leased.elsewhere:
            reporter.note(f"{limits.reached}: {counted(left, self.noun)} left; repeat the command to continue")
        return statuses

    def _completed(
        self,
        executor: Executor,
        leased: PointLeaser,
        leases: Leases,
        ahead: int,
        options: ExecutionOptions,
        limits: RunLimits,
        reporter: Reporter,
        is_shared: bool,
    ) -> Iterator[Sequence[tuple[PointChunk, ChunkResult]]]:
        """Yields the results of chunks as `executors.completed`; warns of each reason to refuse or to repeat some.

        Args:
          is_shared: whether other processes that see the folder publish results in it.
        """
        expected = WorkerVersions.here(self._spec.models(self.points.points), self._spec.packages)
        reported = set[str]()

        def fault(result: ChunkResult) -> str:
            if result.lacks_files:
                return "the machine that was to simulate it cannot store the study's files"
            if result.part and not self.files.folder.has(result.part):
                return "the machine that has simulated it has published its results in another folder"
            differences = [(each.host, each.difference(expected)) for each in result.worker_versions]
            reasons = [f"{host} has {difference}" for host, difference in differences if difference]
            for reason in reasons:
                if reason not in reported:
                    reported.add(reason)
                    reporter.warn(f"{reason}: its results are refused, and simulated again")
            return "; ".join(reasons)

        def shared(points: Sequence[int]) -> PartPublisher | None:
            if not is_shared or len(points) < SHARED:
                return None
            return self.files.shared(leases.name_of(points[0]), self.keys_of(points), expected)

        sizes = self.chunk_sizes(options, ahead)
        chunks = self.chunks(leased, options, sizes, shared)

        def give_back(chunks: Sequence[PointChunk]) -> None:
            leased.give_back([point.index for chunk in chunks for point in chunk.points])

        def lost(chunk: PointChunk, error: LostJobError) -> None:
            leases.losses += 1
            if error.state not in reported:
                reported.add(error.state)
                reporter.warn(f"{counted(len(chunk.points), self.noun)} submitted again: {clean(str(error))}")

        is_over, is_wanted = lambda: bool(limits.reached), lambda: leased.is_wanted
        try:
            for arrived in executors.completed(executor, chunks, ahead, fault, is_over, is_wanted, give_back, lost):
                for chunk, result in arrived:
                    results = result.results
                    steps = result.steps + sum(each.steps for each in results)
                    sizes.add(len(chunk.points), steps, result.wall + sum(each.wall for each in results))
                yield arrived
        except executors.ExecutorEndedError as error:
            limits.ending = f"{option('engine')} {clean(options.engine)} has ended ({clean(str(error))})"


class _Chunks(Iterator[PointChunk | None]):
    """Chunks of leased points; it ends while none is left."""

    def __init__(self, leased: PointLeaser, next_chunk: Callable[[], PointChunk | None]) -> None:
        self._leased, self._next_chunk = leased, next_chunk

    def __next__(self) -> PointChunk | None:
        if not self._leased.left:
            raise StopIteration
        return self._next_chunk()
