"""Simulates points in a process of their own, so that one that crashes or hangs MuJoCo costs that point alone."""

import contextlib
import math
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mjrun.child_process import ExitStatus
from mjrun.study.simulate import PointResult, Status, StudyPoint, StudySpec
from mjrun.study.worker_process import new_process

TIMEOUT_CODE = 124  # as timeout(1) has it
SIGNALLED = 128  # plus the number of the signal, as shells have it
START = 120.0  # [s] that a process may take to start


@dataclass(frozen=True)
class Chunk:
    """Points that are simulated in one go: a picklable value, and all that a machine needs to know.

    Attributes:
      time_limit: wall time of a point [s].
    """

    spec: StudySpec
    points: tuple[StudyPoint, ...]
    time_limit: float = math.inf


_processes = threading.local()


def run_chunk(chunk: Chunk) -> list[PointResult]:
    """The results of the points of a chunk, in their order; the task that engines run, on whatever machine.

    Points are simulated in a process that is kept for the next chunk of this thread. When it crashes or takes too
    long, every point without a result is simulated once more, by itself; one that fails again is listed as failed.
    """
    simulator = getattr(_processes, "simulator", None)
    if simulator is None or simulator.spec != chunk.spec:
        end_process()
        simulator = _processes.simulator = IsolatedSimulator(chunk.spec)
    results = {result.index: result for result in simulator.run(chunk.points, chunk.time_limit)}
    return [results[point.index] for point in chunk.points]


def end_process() -> None:
    """Ends the process that this thread has kept for its next chunk, if there is one."""
    if simulator := getattr(_processes, "simulator", None):
        simulator.close()
        _processes.simulator = None


class IsolatedSimulator:
    """A process that simulates points of one study, replaced by another when it has died. To be closed."""

    def __init__(self, spec: StudySpec) -> None:
        self.spec = spec
        self._worker: _Worker | None = None

    def run(self, points: Sequence[StudyPoint], time_limit: float = math.inf) -> Iterator[PointResult]:
        """The results of points, each as soon as it is known."""
        missing = {point.index: point for point in points}
        for result in self._together(points, time_limit):
            del missing[result.index]
            yield result
        for point in missing.values():
            yield from self._by_itself(point, time_limit)

    def close(self) -> None:
        """Ends the process."""
        if self._worker:
            self._worker.close()
        self._worker = None

    def _together(self, points: Sequence[StudyPoint], time_limit: float) -> Iterator[PointResult]:
        """What results there are until the process dies or takes too long."""
        self._worker = self._worker or _Worker(self.spec)
        with contextlib.suppress(_WorkerDiedError):
            yield from self._worker.run(points, time_limit)
            return
        self.close()

    def _by_itself(self, point: StudyPoint, time_limit: float) -> Iterator[PointResult]:
        start = time.perf_counter()
        self._worker = self._worker or _Worker(self.spec)
        try:
            yield from self._worker.run([point], time_limit)
        except _WorkerDiedError as death:
            self.close()
            yield death.result(point, len(self.spec.metrics), time.perf_counter() - start)


class _WorkerDiedError(Exception):
    """A process has ended, or was ended since it took too long."""

    def __init__(self, ending: ExitStatus, last_words: str) -> None:
        self.ending, self.last_words = ending, last_words
        super().__init__(str(ending))

    def result(self, point: StudyPoint, metrics: int, wall: float) -> PointResult:
        """What becomes of the point that did it."""
        status: Status = "timeout" if self.ending.cause == "time" else "crashed"
        code = TIMEOUT_CODE if status == "timeout" else self.ending.code
        code = SIGNALLED - code if code < 0 else code
        words = f": {self.last_words}" if self.last_words and status == "crashed" else ""
        message = f"the process that simulated it {self.ending}{words}"
        return PointResult(point.index, status, (math.nan,) * metrics, 0, code, message, wall)


class _Worker:
    """A process, as its parent sees it."""

    def __init__(self, spec: StudySpec) -> None:
        self._connection, self._process = new_process()
        self._is_new = True
        self._send(spec)

    def run(self, points: Sequence[StudyPoint], time_limit: float) -> Iterator[PointResult]:
        """The results of points.

        Raises:
          _WorkerDiedError: the process ended, or took longer than the limit for all points that were left.
        """
        self._send(points)
        if self._is_new:
            self._receive(START)
            self._is_new = False
        left = len(points)
        while True:
            result = self._receive(time_limit * max(left, 1))
            if result is None:
                return
            left -= 1
            yield result

    def close(self) -> None:
        """Ends the process."""
        self._connection.close()
        self._process.end()

    def _send(self, message: object) -> None:
        with contextlib.suppress(OSError):  # it has ended; `_receive` says why
            self._connection.send(message)

    def _receive(self, seconds: float) -> PointResult | None:
        try:
            if self._connection.poll(None if seconds == math.inf else seconds):
                return self._connection.recv()
            self._process.kill("time")
        except (EOFError, OSError):
            pass
        raise _WorkerDiedError(self._process.wait(), self._process.last_words)
