"""Where chunks of points run, and how large they are.

They run on this machine, or by an existing engine for many; all are `concurrent.futures.Executor`s.
"""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from mjrun.confinement.confinement import require_unconfined
from mjrun.errors import MjrunError, UsageError, clean, option
from mjrun.options.number_kinds import AUTO
from mjrun.options.sweep import EXTRAS
from mjrun.packages import require
from mjrun.physics.warp_device import require_library
from mjrun.platform.cores import available_cores
from mjrun.study.isolation import run_chunk
from mjrun.study.spec import Chunk, ChunkResult

ENGINES = ("local", "warp", "dask", "dask://HOST:PORT", "slurm", "module:factory")
WARP, SLURM = "warp", "slurm"
PATIENCE = 20  # [s] for a scheduler to answer
POLL = 0.2  # [s] between two looks at jobs of slurm
REFUSALS = 5  # of a chunk's results, after which its points have failed
SECONDS = 3.0  # that a chunk takes, which are lost when it is killed
LEAST_SECONDS = 0.2  # of the last chunks, which are smaller so that all workers end together
GROWTH = 4  # from the largest measured chunk to the next: few points tell little of many
MOST = 4096  # points in a chunk
QUEUED = 3  # chunks that wait for each process, beside the one that runs


class ChunkSizes:
    """The sizes of the chunks of a study, each decided when it is handed out.

    A point is expected to take the mean time of points, or the mean time of its steps where that is more.

    Args:
      size: of all chunks; measured when None.
      ahead: chunks in flight, a multiple of the workers.
      seconds: that a chunk should take [s].
      first: points of a chunk before anything is measured.
    """

    def __init__(self, size: int | None, ahead: int, seconds: float = SECONDS, first: int = 1) -> None:
        self._size, self._ahead, self._target, self._largest = size, ahead, seconds, first
        self._points = self._steps = self._seconds = 0.0

    def next(self, steps: np.ndarray) -> int:
        """How many points the next chunk takes of those that are left, which have so many steps `(n,)`, n > 0."""
        left = len(steps)
        if self._size:
            return min(self._size, left)
        share = -(-left // self._ahead)
        if not self._points:
            return min(self._largest, share)
        of_step = self._seconds / self._steps if self._steps else 0.0
        ends = np.cumsum(np.maximum(self._seconds / self._points, of_step * steps[:MOST]))
        fair = max(share, int(np.searchsorted(ends, LEAST_SECONDS, "right")))
        return max(1, min(fair, int(np.searchsorted(ends, self._target, "right")), GROWTH * self._largest))

    def add(self, points: int, steps: int, seconds: float) -> None:
        """Takes the measurement of a chunk: its wall time [s] in the worker. Earlier ones count half with each."""
        self._points = self._points / 2 + points
        self._steps = self._steps / 2 + steps
        self._seconds = self._seconds / 2 + seconds
        self._largest = max(self._largest, points)


def open_executor(engine: str, jobs: int | str, folder: Path, stack: ExitStack) -> tuple[Executor, int]:
    """What runs chunks, closed by `stack`, and how many to hand it at a time.

    Args:
      folder: for the logs of engines that write any.

    Raises:
      UsageError: there is no such engine.
      MissingExtraError: its library is not installed.
    """
    check_engine(engine)
    count = _count(jobs) if engine != WARP else 1  # which has all of a GPU
    if engine in ("local", WARP):
        pool = ThreadPoolExecutor(count, thread_name_prefix="study")  # threads that wait for processes
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        return pool, count * QUEUED
    if engine == "dask" or engine.startswith("dask://"):
        return _dask(engine.removeprefix("dask").removeprefix("://"), count, stack)
    if engine == SLURM:
        return _slurm(count, folder, stack)
    return stack.enter_context(_made_by(engine, *_factory(engine))), count * QUEUED


def check_engine(engine: str) -> None:
    """Refuses an engine that cannot be used, before anything is written.

    Raises:
      UsageError: there is no such engine.
      MissingExtraError: its library is not installed.
    """
    if engine not in ("local", WARP):
        require_unconfined(f"{option('engine')} {clean(engine)} works in processes of others")
    if engine == WARP:
        require_library()
    elif engine == "dask" or engine.startswith("dask://"):
        require_extra("dask")
    elif engine == SLURM:
        require_extra("slurm")
    elif engine != "local":
        _factory(engine)


def process_count(engine: str, jobs: int | str) -> int | None:
    """How many processes simulate; None where they are not ours to start.

    Raises:
      UsageError: there is no such engine.
    """
    if engine == WARP:
        return 1
    if engine in ("local", "dask", SLURM):
        return _count(jobs)
    if not engine.startswith("dask://"):
        _factory(engine)
    return None


def completed(
    executor: Executor, chunks: Iterator[Chunk], ahead: int, fault: Callable[[ChunkResult], str]
) -> Iterator[tuple[Chunk, ChunkResult]]:
    """The results of chunks as they come, while at most `ahead` of them are in flight.

    A machine without copies of the study's files gets them. Results that are refused are simulated again; the points
    of a chunk that is refused `REFUSALS` times have failed.

    Args:
      fault: says why results are refused; empty if they are not.
    """
    running: dict[Future[ChunkResult], Chunk] = {}
    again: deque[Chunk] = deque()
    while True:
        while len(running) < ahead and (chunk := again.popleft() if again else next(chunks, None)):
            running[executor.submit(run_chunk, chunk)] = chunk
        if not running:
            return
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            chunk = running.pop(future)
            result = _result(future, chunk)
            if result.lacks_files and chunk.contents is None:
                again.append(chunk.with_contents())
            elif not (reason := fault(result)):
                yield chunk, result
            elif chunk.refusals + 1 < REFUSALS:
                again.append(replace(chunk, refusals=chunk.refusals + 1))
            else:
                yield chunk, replace(chunk.failed(reason), is_refused=True)


def _result(future: Future[ChunkResult], chunk: Chunk) -> ChunkResult:
    """The results of a chunk; where an engine has lost it, each of its points has failed."""
    try:
        return future.result()
    except MjrunError:
        raise
    except Exception as error:
        return chunk.failed(f"the engine lost it: {type(error).__name__}: {error}")


def _dask(address: str, count: int, stack: ExitStack) -> tuple[Executor, int]:
    """A cluster that listens at `address`, or one of this machine's cores."""
    import distributed  # whose functions say that they may return coroutines

    client_class: Any = distributed.Client
    cluster_class: Any = distributed.LocalCluster
    if not address:
        cluster = cluster_class(n_workers=count, threads_per_worker=1, dashboard_address="127.0.0.1:0")
        address = stack.enter_context(cluster).scheduler_address
    try:
        client = stack.enter_context(client_class(address, timeout=PATIENCE))
    except (OSError, ValueError, TimeoutError) as error:
        raise UsageError(
            f"{option('engine')}: no Dask scheduler answers at {clean(address)}: {clean(str(error))}"
        ) from None
    workers = max(1, sum(client.nthreads().values()))
    return client.get_executor(pure=False), workers * QUEUED


def _slurm(count: int, folder: Path, stack: ExitStack) -> tuple[Executor, int]:
    """Jobs of Slurm; where there is none, processes of this machine that submitit starts in the same way."""
    import submitit

    made = submitit.AutoExecutor(folder=folder / "slurm")
    return stack.enter_context(SubmittedJobs(made.submit)), count * QUEUED


class SubmittedJob(Protocol):
    """A job that can be asked whether it is done."""

    def done(self) -> bool: ...

    def result(self) -> Any: ...

    def cancel(self) -> object: ...


class SubmittedJobs(Executor):
    """An executor of `concurrent.futures` on jobs that can only be asked whether they are done.

    Args:
      start: submits a call, and returns a job with `done()` and `result()`.
    """

    def __init__(self, start: Callable[..., SubmittedJob]) -> None:
        self._start = start
        self._waiting: dict[Future[Any], SubmittedJob] = {}
        self._lock, self._closed = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._watch, name="submitted jobs", daemon=True)
        self._thread.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future = Future[Any]()
        future.set_running_or_notify_cancel()
        with self._lock:
            self._waiting[future] = self._start(fn, *args, **kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._closed.set()
        with self._lock:
            for job in self._waiting.values():
                job.cancel()
            self._waiting.clear()

    def _watch(self) -> None:
        while not self._closed.wait(POLL):
            with self._lock:
                done = [(future, job) for future, job in self._waiting.items() if job.done()]
                for future, _ in done:
                    del self._waiting[future]
            for future, job in done:
                try:
                    future.set_result(job.result())
                except Exception as error:  # whatever became of the job, whoever waits for it is told
                    future.set_exception(error)


def _factory(engine: str) -> tuple[str, str]:
    """The module and the name in `module:factory`."""
    module, colon, name = engine.partition(":")
    if not (colon and module and name):
        raise UsageError(f"{option('engine')}: no engine {clean(engine)}\nengines: {', '.join(ENGINES)}")
    return module, name


def _made_by(engine: str, module: str, name: str) -> Executor:
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


def _count(jobs: int | str) -> int:
    return available_cores() if jobs == AUTO else int(jobs)
