"""Simulates points in a process of their own, so that one that crashes or hangs MuJoCo costs that point alone."""

import math
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from mjrun.errors import MjrunError
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.study.point_server import new_worker
from mjrun.study.spec import Chunk, ChunkResult, PointResult, Proof, ShippedStudy, Status, StudyPoint
from mjrun.worker import Worker, WorkerEndedError

TIMEOUT_CODE = 124  # as timeout(1) has it
SIGNALLED = 128  # plus the number of the signal, as shells have it
START = 120.0  # [s] that a process may take to start


_processes = threading.local()
_copies: dict[str, InputSnapshot] = {}  # of the files of studies of other machines, by their fingerprints
_copying = threading.Lock()


def run_chunk(chunk: Chunk) -> ChunkResult:
    """The results of a chunk; the task that engines run, on whatever machine.

    Points are simulated in a process that is kept for the next chunk of this thread. When it crashes or takes too
    long, every point without a result is simulated once more, by itself; one that fails again is listed as failed.
    """
    snapshot = _snapshot_here(chunk)
    if snapshot is None:
        return ChunkResult((), lacks_files=True)
    simulator: IsolatedSimulator | None = getattr(_processes, "simulator", None)
    if simulator is None or simulator.study != chunk.study:
        end_process()
        simulator = _processes.simulator = IsolatedSimulator(chunk.study, snapshot.root)
    results = {result.index: result for result in simulator.run(chunk.points, chunk.time_limit)}
    return ChunkResult([results[point.index] for point in chunk.points], simulator.taken_proofs())


def end_process() -> None:
    """Ends the process that this thread has kept for its next chunk, if there is one."""
    if simulator := getattr(_processes, "simulator", None):
        simulator.close()
        _processes.simulator = None


def _snapshot_here(chunk: Chunk) -> InputSnapshot | None:
    """Returns the copies of the study's files on this machine: the study's own, or those made of a chunk's contents."""
    snapshot = chunk.study.snapshot
    if snapshot.root.is_dir():
        return snapshot
    with _copying:
        key = snapshot.fingerprint
        if key not in _copies and chunk.contents is not None:
            _copies.clear()  # of the last study
            _copies[key] = snapshot.copied_from(chunk.contents)
        return _copies.get(key)


class IsolatedSimulator:
    """A process that simulates points of one study, replaced by another when it has died. To be closed.

    Args:
      root: the folder of the study's files on this machine.
    """

    def __init__(self, study: ShippedStudy, root: Path | None = None) -> None:
        self.study, self._root = study, root or study.snapshot.root
        self._worker: Worker | None = None
        self._proofs: list[Proof] = []

    def run(self, points: Sequence[StudyPoint], time_limit: float = math.inf) -> Iterator[PointResult]:
        """The results of points, each as soon as it is known."""
        missing = {point.index: point for point in points}
        for result in self._together(points, time_limit):
            del missing[result.index]
            yield result
        for point in missing.values():
            yield from self._by_itself(point, time_limit)

    def taken_proofs(self) -> tuple[Proof, ...]:
        """Returns what points were simulated with since the last call."""
        proofs, self._proofs = tuple(self._proofs), []
        return proofs

    def close(self) -> None:
        """Ends the process."""
        if self._worker:
            self._worker.close()
        self._worker = None

    def _together(self, points: Sequence[StudyPoint], time_limit: float) -> Iterator[PointResult]:
        """What results there are until the process dies or takes too long."""
        try:
            yield from self._simulated(points, time_limit)
        except (WorkerEndedError, MjrunError):
            self.close()

    def _by_itself(self, point: StudyPoint, time_limit: float) -> Iterator[PointResult]:
        start, nothing = time.perf_counter(), (math.nan,) * self.study.metrics
        try:
            yield from self._simulated([point], time_limit)
        except (WorkerEndedError, MjrunError) as error:
            self.close()
            status, code = _ending(error)
            message = f"the process that simulated it {error}" if isinstance(error, WorkerEndedError) else str(error)
            yield PointResult(point.index, status, nothing, 0, code, message, time.perf_counter() - start)

    def _simulated(self, points: Sequence[StudyPoint], time_limit: float) -> Iterator[PointResult]:
        """The results of points.

        Raises:
          WorkerEndedError: the process ended, or took longer than the limit for all points that were left.
          MjrunError: it cannot simulate the study.
        """
        if self._worker is None:
            self._worker = new_worker()
            self._worker.send("open", self.study.spec, self._root)
        self._worker.send("simulate", points)
        left = len(points)
        while self._worker.pending:
            is_new = self._worker.pending[0].name == "open"
            reply = self._worker.receive(START if is_new else time_limit * max(left, 1))
            if reply.failure:
                raise reply.failure.error("the process that simulates cannot do so")
            if isinstance(reply.value, PointResult):
                left -= 1
                yield reply.value
            elif isinstance(reply.value, Proof) and reply.value not in self._proofs:
                self._proofs.append(reply.value)


def _ending(error: WorkerEndedError | MjrunError) -> tuple[Status, int]:
    """How a point ended that has cost its process, and the exit code that tells of it."""
    if isinstance(error, MjrunError):
        return "failed", error.exit_code
    if error.ending.cause == "time":
        return "timeout", TIMEOUT_CODE
    code = error.ending.code
    return "crashed", SIGNALLED - code if code < 0 else code
