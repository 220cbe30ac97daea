"""Where chunks of points run: this machine, or an existing engine for many. All are `concurrent.futures.Executor`s."""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from mjrun.confinement.confinement import require_unconfined
from mjrun.errors import MjrunError, UsageError, clean, option
from mjrun.options.kinds import AUTO
from mjrun.options.sweep import EXTRAS
from mjrun.packages import require
from mjrun.physics.warp_device import require_library
from mjrun.platform.cores import available_cores
from mjrun.study.isolation import Chunk, ChunkResult, run_chunk

ENGINES = ("local", "warp", "dask", "dask://HOST:PORT", "slurm", "module:factory")
WARP, SLURM = "warp", "slurm"
PATIENCE = 20  # [s] for a scheduler to answer
POLL = 0.2  # [s] between two looks at jobs of slurm
REFUSALS = 5  # of a chunk's results, after which its points have failed
QUEUED = 3  # chunks that wait for each process, beside the one that runs


def open_executor(engine: str, jobs: int | str, folder: Path, stack: ExitStack) -> tuple[Executor, int]:
    """What runs chunks, closed by `stack`, and how many to hand it at a time.

    Args:
      folder: for the logs of engines that write any.

    Raises:
      UsageError: there is no such engine.
      MissingExtraError: its library is not installed.
    """
    count = _count(jobs) if engine != WARP else 1  # which has all of a GPU
    if engine == WARP:
        require_library()
    if engine in ("local", WARP):
        pool = ThreadPoolExecutor(count, thread_name_prefix="study")  # threads that wait for processes
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        return pool, count * QUEUED
    require_unconfined(f"{option('engine')} {clean(engine)} works in processes of others")
    if engine == "dask" or engine.startswith("dask://"):
        return _dask(engine.removeprefix("dask").removeprefix("://"), count, stack)
    if engine == SLURM:
        return _slurm(count, folder, stack)
    return stack.enter_context(_made_by(engine, *_factory(engine))), count * QUEUED


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
    require_extra("dask")
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
    require_extra("slurm")
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
