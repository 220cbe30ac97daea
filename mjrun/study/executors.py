"""Executors of chunks of points, and the sizes of chunks.

Chunks run on this machine or on an existing distributed engine; each executor is a `concurrent.futures.Executor`.
"""

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np

from mjrun.confinement.confinement import require_unconfined
from mjrun.errors import MjrunError, UsageError, clean, option, system_limit
from mjrun.formats.local_and_remote_folders import Folder, LocalFolder
from mjrun.options.sweep import EXTRAS
from mjrun.packages import require
from mjrun.physics.warp_device import require_library
from mjrun.platform.cores import available_cores
from mjrun.study.clusters import (
    ClusterExecutor,
    LostJobError,
    SlurmExecutor,
    has_ended,
    is_cluster,
    most_jobs,
    open_cluster,
)
from mjrun.study.isolation import LocalExecutor, PointChunk, run_chunk
from mjrun.study.spec import ChunkResult

ENGINES = ("local", "warp", "dask", "dask://HOST:PORT", "ray", "ray://HOST:PORT", "slurm", "module:factory")
WARP, SLURM = "warp", "slurm"
ON_ONE_GPU = 4  # processes with `--jobs auto`: preparing models takes longer than their steps, and each needs memory
INTERVAL = 0.5  # [s] between two parts: results wait for others
REFUSALS = 5  # refused results of a chunk, after which its points have failed
SECONDS = 3.0  # wall time of a chunk, which is lost when it is killed
LEAST = 0.05  # [s] wall time of the last chunks: they are smaller so that all workers end together
HANDLING = 0.001  # [s] that this process takes for a chunk: many workers would wait for it if chunks were smaller
GROWTH = 4  # from the largest measured chunk to the next, since a few points predict many badly
MOST = 4096  # points in a chunk
QUEUED = 3  # chunks that wait for each process in addition to the running one


class ExecutorEndedError(Exception):
    """An engine that executes no more chunks, such as a scheduler that was killed; those in flight have not failed."""


class ChunkSizes:
    """Sizes of the chunks of a study, each decided when it is submitted.

    A point is expected to take the mean time of points, or the mean time of its steps where that is more.

    Args:
      size: size of all chunks; None chooses it by measurement.
      ahead: chunks in flight, a multiple of the workers.
      seconds: target wall time of a chunk [s].
      first: points in a chunk before anything is measured.
      least: target wall time of the last chunks [s]; more if many chunks are in flight.
    """

    def __init__(
        self, size: int | None, ahead: int, seconds: float = SECONDS, first: int = 1, least: float = LEAST
    ) -> None:
        self._size, self._ahead, self._target, self._largest = size, ahead, seconds, first
        self._least = max(least, HANDLING * ahead)
        self._points = self._steps = self._seconds = 0.0

    def next(self, steps: np.ndarray, left: int | None = None) -> int:
        """Returns the number of points in the next chunk, which may be more than there are steps.

        Args:
          steps: steps of each of the next points `(n,)`, n > 0.
          left: number of all remaining points, by default n.
        """
        left = len(steps) if left is None else left
        if self._size:
            return min(self._size, left)
        share = -(-left // self._ahead)
        if not self._points:
            return min(self._largest, share)
        of_step = self._seconds / self._steps if self._steps else 0.0
        ends = np.cumsum(np.maximum(self._seconds / self._points, of_step * steps[:MOST]))
        fair = max(share, int(np.searchsorted(ends, self._least, "right")))
        return max(1, min(fair, int(np.searchsorted(ends, self._target, "right")), GROWTH * self._largest))

    def add(self, points: int, steps: int, seconds: float) -> None:
        """Adds the wall time of a chunk [s], measured in the worker; the weight of earlier ones is halved."""
        self._points = self._points / 2 + points
        self._steps = self._steps / 2 + steps
        self._seconds = self._seconds / 2 + seconds
        self._largest = max(self._largest, points)


def open_executor(
    engine: str,
    jobs: int | str,
    folder: Path,
    stack: ExitStack,
    slurm: Sequence[str] = (),
    note: Callable[[str], None] = lambda _: None,
) -> tuple[Executor, int]:
    """Opens an executor, to be closed by `stack`, and returns it with the number of chunks to keep in flight.

    Args:
      folder: folder for the logs of Slurm.
      slurm: settings of Slurm jobs.
      note: reports cancelled jobs of Slurm, or a cluster without workers.

    Raises:
      UsageError: the engine is unknown.
      MissingExtraError: its library is not installed.
    """
    check_engine(engine)
    count = _local_processes(engine, jobs)
    if engine in ("local", WARP):
        return stack.enter_context(LocalExecutor(count)), count * QUEUED
    if is_cluster(engine):
        cluster = open_cluster(engine, count, stack, note)
        return cluster, max(1, cluster.count) * QUEUED
    if engine == SLURM:
        most = most_jobs(jobs, slurm)
        return stack.enter_context(SlurmExecutor(folder, slurm, most, note)), most
    return stack.enter_context(_made_by(engine)), count * QUEUED


def check_engine(engine: str, folder: Folder | None = None) -> None:
    """Refuses an engine that cannot be used, before anything is written.

    Args:
      folder: folder of the results.

    Raises:
      UsageError: the engine is unknown.
      MissingExtraError: its library is not installed.
    """
    if engine not in ("local", WARP):
        require_unconfined(f"{option('engine')} {clean(engine)} works in processes of others")
    if engine == WARP:
        require_library()
    elif is_cluster(engine):
        require_extra(engine.partition("://")[0])
    elif engine == SLURM:
        require_extra("slurm")
        if folder and not isinstance(folder, LocalFolder):
            reason = f"the jobs need a folder that the machines share, and {clean(folder.path())} is in a store"
            raise UsageError(f"{option('engine')} slurm: {reason}\nwrite a plan with {option('plan')} for a job array")
    elif engine != "local":
        _factory(engine)


def process_count(engine: str, jobs: int | str, slurm: Sequence[str] = ()) -> int | None:
    """Returns the number of processes that simulate; None where another system decides.

    Raises:
      UsageError: the engine is unknown.
    """
    if engine == SLURM:
        return most_jobs(jobs, slurm)
    if engine in ("local", WARP, "dask", "ray"):
        return _local_processes(engine, jobs)
    if not is_cluster(engine):
        _factory(engine)
    return None


def _local_processes(engine: str, jobs: int | str) -> int:
    if isinstance(jobs, int):
        return jobs
    return min(ON_ONE_GPU, available_cores()) if engine == WARP else available_cores()


def completed(
    executor: Executor,
    chunks: Iterator[PointChunk | None],
    ahead: int,
    fault: Callable[[ChunkResult], str],
    is_over: Callable[[], bool] = lambda: False,
    is_wanted: Callable[[], bool] = lambda: False,
    give_back: Callable[[Sequence[PointChunk]], None] = lambda _: None,
    lost: Callable[[PointChunk, LostJobError], None] = lambda *_: None,
) -> Iterator[Sequence[tuple[PointChunk, ChunkResult]]]:
    """Yields the results of chunks as they arrive; at most `ahead` chunks are in flight.

    Yields an empty list as soon as the first chunks are submitted, and whenever nothing has arrived for `INTERVAL`.
    A machine without copies of the study's files receives them. Refused results are simulated again; the points of a
    chunk that is refused `REFUSALS` times have failed, as have those of a job of Slurm that is lost twice.

    Args:
      chunks: None where the next chunk has to wait for other processes.
      fault: returns the reason to refuse results; empty to accept them.
      is_over: returns whether to submit no more chunks; those that are running finish.
      is_wanted: returns whether chunks that have not begun are wanted back.
      give_back: receives these chunks.
      lost: called with a chunk whose Slurm job is lost before its points are submitted again.

    Raises:
      ExecutorEndedError: the engine has ended.
      SystemLimitError, OutOfMemoryError: this process can open no more files, or start no more processes.
    """
    running = dict[Future[ChunkResult], PointChunk]()
    again = deque[PointChunk]()
    is_first, end = True, ""
    while True:
        if isinstance(executor, ThreadPoolExecutor) and is_wanted():
            unused = [future for future, chunk in running.items() if not chunk.refusals and future.cancel()]
            give_back([running.pop(future) for future in unused])
        with executor.batch() if isinstance(executor, SlurmExecutor) else nullcontext():
            while is_waiting := not is_over() and len(running) < ahead:
                try:
                    chunk = again.popleft() if again else next(chunks)
                except StopIteration:
                    is_waiting = False
                    break
                if chunk is None:
                    break
                try:
                    running[executor.submit(run_chunk, chunk)] = chunk
                except Exception as error:  # of whatever kind: RuntimeError, ClosedClientError
                    _require_within_limits(executor, error)
                    end = _reason(error)
                    break
        if is_over() and isinstance(executor, ThreadPoolExecutor | SlurmExecutor):  # which know what has begun
            running = {future: chunk for future, chunk in running.items() if not future.cancel()}
        if is_first:
            yield []
            is_first = False
        if not running and not end:
            if not is_waiting:
                return
            time.sleep(INTERVAL)
            yield []
            continue
        if isinstance(executor, ClusterExecutor) and executor.is_deserted() and is_over():
            end = "it has no workers"
        arrived = list[tuple[PointChunk, ChunkResult]]()
        done = wait(running, 0 if end else INTERVAL, FIRST_COMPLETED).done
        for future in [each for each in running if each in done]:  # in the order of submission
            chunk = running.pop(future)
            try:
                result = future.result()
            except MjrunError:
                raise
            except Exception as error:
                if has_ended(error):
                    end = _reason(error)
                    continue
                if isinstance(error, LostJobError) and (parts := _tried_again(chunk, error)):
                    again.extend(parts)
                    lost(chunk, error)
                    continue
                _require_within_limits(executor, error)
                reason = f"{error}" if isinstance(error, LostJobError) else _reason(error)
                result = chunk.failed(f"the engine lost it: {reason}")
            if result.lacks_files and chunk.contents is None:
                again.append(replace(chunk, contents=chunk.study.snapshot.contents()))
            elif not (reason := fault(result)):
                arrived.append((chunk, result))
            elif chunk.refusals + 1 < REFUSALS:
                again.append(replace(chunk, refusals=chunk.refusals + 1, parts=None))
            else:
                arrived.append((chunk, replace(chunk.failed(reason), is_refused=True)))
        yield arrived
        if end:
            raise ExecutorEndedError(end)


def _require_within_limits(executor: Executor, error: Exception) -> None:
    """Raises the error of a limit of this process, which its points have not caused."""
    if isinstance(executor, ThreadPoolExecutor) and (limit := system_limit(error)):
        raise limit from error


def _reason(error: Exception) -> str:
    return ": ".join(filter(None, [type(error).__name__, f"{error}".partition("\n")[0]]))


def _tried_again(chunk: PointChunk, error: LostJobError) -> Sequence[PointChunk]:
    """Returns what to simulate in place of the chunk of a lost job of Slurm; nothing if its points have failed.

    It is tried once more; a chunk that reached the time limit is divided as long as it has several points. Dask and Ray
    have tried again by themselves.
    """
    if not error.is_over_time:
        return [] if chunk.losses else [replace(chunk, losses=1)]
    middle = len(chunk.points) // 2
    halves = (chunk.points[:middle], chunk.points[middle:])
    return [replace(chunk, points=part, parts=None) for part in halves] if middle else []


def _factory(engine: str) -> tuple[str, str]:
    """Splits `module:factory`."""
    module, colon, name = engine.partition(":")
    if not (colon and module and name):
        raise UsageError(f"{option('engine')}: no engine {clean(engine)}\nengines: {', '.join(ENGINES)}")
    return module, name


def _made_by(engine: str) -> Executor:
    """Calls the factory `module:factory`."""
    module, name = _factory(engine)
    try:
        made = getattr(import_module(module), name)()
    except (ImportError, AttributeError) as error:
        raise UsageError(f"{option('engine')} {clean(engine)}: {clean(str(error))}") from None
    if not isinstance(made, Executor):
        kind = type(made).__name__
        raise UsageError(f"{option('engine')} {clean(engine)} returns a {kind}, not a concurrent.futures.Executor")
    return made


def require_extra(extra: str) -> None:
    """Raises MissingExtraError or WrongVersionError if the libraries of an extra of studies cannot be used."""
    libraries, use = EXTRAS[extra]
    require(use, extra, *libraries)
