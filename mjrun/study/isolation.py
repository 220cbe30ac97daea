"""Simulation of points in separate processes: a point that crashes or hangs MuJoCo is the only one lost."""

import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from pathlib import Path
from typing import cast

from mjrun.dataclass import dataclass
from mjrun.errors import MjrunError, SystemLimitError, UsageError, system_limit
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.study.part_files import PartPublisher
from mjrun.study.point_server import new_worker
from mjrun.study.spec import ChunkResult, PointResult, ShippedStudy, Status, StudyPoint, WorkerVersions
from mjrun.worker import Worker, WorkerEndedError

TIMEOUT_CODE = 124  # exit code of timeout(1)
SIGNALLED = 128  # plus the number of the signal: exit code of shells
START = 120.0  # [s] that a process may take to start


_processes = threading.local()
_copies = dict[str, InputSnapshot]()  # files of studies of other machines, by fingerprint
_copying = threading.Lock()


@dataclass(frozen=True)
class PointChunk:
    """A chunk of points, which one task of an engine simulates, on any machine.

    Attributes:
      time_limit: wall time of a point [s].
      contents: contents of the study's files, for a machine without copies of them.
      parts: files to which the results are published by the process that has them; None to return them.
      refusals: number of times that its results were refused.
      losses: number of times that the engine has lost it.
    """

    study: ShippedStudy
    points: tuple[StudyPoint, ...]
    time_limit: float = math.inf
    contents: Mapping[str, bytes] | None = None
    parts: PartPublisher | None = None
    refusals: int = 0
    losses: int = 0

    def failed(self, message: str) -> ChunkResult:
        """Returns results of points that failed with this message outside of their process."""
        no_metrics = (math.nan,) * self.study.metrics
        return ChunkResult([PointResult(point.index, "failed", no_metrics, 0, 70, message) for point in self.points])


def run_chunk(chunk: PointChunk) -> ChunkResult:
    """Simulates a chunk, on whatever machine; this is the task that engines execute.

    Points are simulated in a process that this thread keeps for its next chunk. When it crashes or times out, every
    point without a result is simulated again by itself; a point that fails again is listed as failed.
    """
    snapshot = _snapshot_here(chunk)
    if snapshot is None:
        return ChunkResult((), lacks_files=True)
    simulator: IsolatedSimulator | None = getattr(_processes, "simulator", None)
    if simulator is None or simulator.study != chunk.study:
        end_process()
        simulator = _processes.simulator = IsolatedSimulator(chunk.study, snapshot.root, process_stop())
    results = {result.index: result for result in simulator.run(chunk.points, chunk.time_limit)}
    worker_versions, simulator.worker_versions = simulator.worker_versions, ()
    result = ChunkResult([results[point.index] for point in chunk.points], worker_versions)
    return chunk.parts.publish(result) if chunk.parts else result


def end_process() -> None:
    """Ends the process that this thread keeps for its next chunk."""
    if simulator := getattr(_processes, "simulator", None):
        simulator.close()
        _processes.simulator = None


def _snapshot_here(chunk: PointChunk) -> InputSnapshot | None:
    """Returns copies of the study's files on this machine: its own, or those written from the chunk's contents."""
    snapshot = chunk.study.snapshot
    if snapshot.root.is_dir():
        return snapshot
    with _copying:
        key = snapshot.fingerprint
        if key not in _copies and chunk.contents is not None:
            _copies.clear()  # of the previous study
            _copies[key] = snapshot.copied_from(chunk.contents)
        return _copies.get(key)


class ProcessStopper:
    """A way to end the process of another thread, which then starts no other."""

    def __init__(self) -> None:
        self._lock, self._worker = threading.Lock(), cast("Worker | None", None)
        self.is_requested = False

    def new_worker(self, start: Callable[[], Worker] | None = None) -> Worker:
        """Returns a new process, made by `start`, or one for points.

        Raises:
          CancelledError: it was to end.
        """
        with self._lock:
            if self.is_requested:
                raise CancelledError
            self._worker = (start or new_worker)()
            return self._worker

    def request(self) -> None:
        """Ends the process, even if it is busy."""
        with self._lock:
            self.is_requested = True
            if self._worker:
                self._worker.kill()

    def close(self) -> None:
        """Frees what the process that has been ended leaves in this one, once its thread has ended, too."""
        if self._worker:
            self._worker.close()


def process_stop() -> ProcessStopper:
    """Returns the stop with which the executor of this thread ends its process; a new one in other threads."""
    return getattr(_processes, "stop", None) or ProcessStopper()


class LocalExecutor(ThreadPoolExecutor):
    """An executor with `count` threads, for functions that start their processes with `process_stop`; the end of its
    `with` block ends the threads and their processes.
    """

    def __init__(self, count: int) -> None:
        self._stops = list[ProcessStopper]()
        super().__init__(count, "study", self._begin_thread)

    def _begin_thread(self) -> None:
        _processes.stop = ProcessStopper()
        self._stops.append(_processes.stop)

    def __exit__(self, *_: object) -> None:
        self.shutdown(wait=False, cancel_futures=True)
        for stop in self._stops:
            stop.request()
        self.shutdown()  # after an error, the files that the threads write are about to be removed
        for stop in self._stops:
            stop.close()


class IsolatedSimulator:
    """A process that simulates points of one study, replaced when it dies. To be closed.

    Args:
      root: folder of the study's files on this machine.
      stop: ends the process from another thread.

    Attributes:
      worker_versions: versions that points were simulated with.
    """

    def __init__(self, study: ShippedStudy, root: Path | None = None, stop: ProcessStopper | None = None) -> None:
        self.study, self._root, self._stop = study, root or study.snapshot.root, stop or ProcessStopper()
        self._worker: Worker | None = None
        self.worker_versions: tuple[WorkerVersions, ...] = ()

    def run(self, points: Sequence[StudyPoint], time_limit: float = math.inf) -> Iterator[PointResult]:
        """Yields the result of each point when it is known.

        Raises:
          UsageError: the process cannot open the study, such as without a library.
          SystemLimitError: the system lets no process simulate a point.
          CancelledError: another thread has ended the process.
        """
        missing = {point.index: point for point in points}
        try:
            for result in self._simulated(points, time_limit):
                del missing[result.index]
                yield result
        except UsageError:  # those of single points are in their results
            self.close()
            raise
        except (WorkerEndedError, MjrunError):
            self.close()
        for point in missing.values():
            yield from self._by_itself(point, time_limit)

    def close(self) -> None:
        """Ends the process."""
        if self._worker:
            self._worker.close()
        self._worker = None

    def _by_itself(self, point: StudyPoint, time_limit: float) -> Iterator[PointResult]:
        start, no_metrics = time.perf_counter(), (math.nan,) * self.study.metrics
        try:
            yield from self._simulated([point], time_limit)
        except (WorkerEndedError, MjrunError) as error:
            self.close()
            if isinstance(limit := system_limit(error), SystemLimitError):
                raise limit from error
            status, code = _ending(error)
            message = f"the process that simulated it {error}" if isinstance(error, WorkerEndedError) else str(error)
            if status == "timeout" and math.isfinite(time_limit):
                message = f"it took longer than the time limit of {time_limit:g} s"
            yield PointResult(point.index, status, no_metrics, 0, code, message, time.perf_counter() - start)

    def _simulated(self, points: Sequence[StudyPoint], time_limit: float) -> Iterator[PointResult]:
        """Yields the results of points.

        Raises:
          WorkerEndedError: the process ended, or took longer than the limit for all remaining points.
          MjrunError: it cannot simulate the study.
        """
        if self._worker is None:
            self._worker = self._stop.new_worker()
            self._worker.send("open", self.study.spec, self._root)
        self._worker.send("simulate", points)
        left = len(points)
        while self._worker.pending:
            is_new = self._worker.pending[0].name == "open"
            try:
                reply = self._worker.receive(START if is_new else time_limit * max(left, 1))
            except WorkerEndedError:
                if self._stop.is_requested:
                    raise CancelledError from None
                raise
            if reply.failure:
                raise reply.failure.error("the simulation process failed")
            if isinstance(reply.value, list):
                left -= len(cast("list[PointResult]", reply.value))
                yield from reply.value
            elif isinstance(reply.value, WorkerVersions) and reply.value not in self.worker_versions:
                self.worker_versions += (reply.value,)


def _ending(error: WorkerEndedError | MjrunError) -> tuple[Status, int]:
    """Returns the status and the exit code of a point that has ended its process."""
    if isinstance(error, MjrunError):
        return "failed", error.exit_code
    if error.ending.cause == "time":
        return "timeout", TIMEOUT_CODE
    code = error.ending.code
    return "crashed", SIGNALLED - code if code < 0 else code
