"""Clusters of Dask and Ray, new ones on this machine or existing ones, as executors of chunks.

Both start the task of a worker that has died on another one, and end what is running when they are closed.
"""

import logging
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import ExitStack
from typing import Any

from mjrun.errors import UsageError, clean, option

PATIENCE = 20  # [s] for a cluster of Dask to answer; Ray asks for 30 s
LOOK = 10.0  # [s] between two looks at the workers
DESERTED = 60.0  # [s] without a worker until this is reported: a scheduler of jobs may start another one
USAGE = "RAY_USAGE_STATS_ENABLED"  # Ray reports to its makers unless it is 0
_Connection = tuple[Callable[..., Future[Any]], Callable[[], int]]  # submits a call, and counts workers
ENDINGS = ("LocalRayletDiedError", "RaySystemError")  # errors of Ray without its daemon


def is_cluster(engine: str) -> bool:
    return engine.partition("://")[0] in _CONNECT


class Cluster(Executor):
    """The tasks of a cluster, whose workers come and go.

    Args:
      engine: the engine in messages.
      submit: submits a call as `Executor.submit`.
      workers: returns the number of workers.
      note: reports that there are no workers.

    Attributes:
      count: number of workers at the start.
    """

    def __init__(
        self, engine: str, submit: Callable[..., Future[Any]], workers: Callable[[], int], note: Callable[[str], None]
    ) -> None:
        self._engine, self._submit, self._workers, self._note = engine, submit, workers, note
        self._looked = self._seen = time.monotonic()
        self.count = workers()
        self._is_reported = not self.count
        if not self.count:
            note(f"{engine} has no workers yet; waiting for the first")

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return self._submit(fn, *args, **kwargs)

    def is_deserted(self) -> bool:
        """Returns whether no worker has been seen for `DESERTED` seconds, and reports this once."""
        now = time.monotonic()
        if now >= self._looked + LOOK:
            self._looked = now
            try:
                has_workers = self._workers() > 0
            except Exception:  # of a cluster that has ended, as its tasks will show
                has_workers = True
            if has_workers:
                self._seen, self._is_reported = now, False
        if now < self._seen + DESERTED:
            return False
        if not self._is_reported:
            self._is_reported = True
            self._note(f"{self._engine} has had no workers for {DESERTED:g} s; waiting for some")
        return True


def open_cluster(engine: str, count: int, stack: ExitStack, note: Callable[[str], None]) -> Cluster:
    """Connects to `dask://HOST:PORT` or `ray://HOST:PORT`, or to a new cluster `dask` or `ray` with `count` workers.

    Args:
      stack: closes the connection.
      note: reports that there are no workers.

    Raises:
      UsageError: the cluster does not answer or cannot be used.
    """
    name, _, address = engine.partition("://")
    try:
        submit, workers = _CONNECT[name](address, count, stack)
        return Cluster(f"{option('engine')} {clean(engine)}", submit, workers, note)
    except Exception as error:  # of whatever kind: ConnectionError, RuntimeError for another version of Python
        reason = f"{error}".strip().splitlines() or [type(error).__name__]  # the last line follows a traceback
        raise UsageError(f"{option('engine')}: {clean(engine)} cannot be used: {clean(reason[-1])}") from None


def has_ended(error: Exception) -> bool:
    """Returns whether the error of a task is that of an engine that has ended: Dask cancels the tasks of a scheduler
    that is lost, and a pool of processes breaks.
    """
    return isinstance(error, BrokenExecutor | CancelledError | ConnectionError) or type(error).__name__ in ENDINGS


def _dask(address: str, count: int, stack: ExitStack) -> _Connection:
    import distributed  # whose functions are annotated as if they might return coroutines

    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # tracebacks of a scheduler that has ended
    client_class: Any = distributed.Client
    cluster_class: Any = distributed.LocalCluster
    if not address:
        cluster = cluster_class(n_workers=count, threads_per_worker=1, dashboard_address="127.0.0.1:0")
        address = stack.enter_context(cluster).scheduler_address
    client = stack.enter_context(client_class(address, timeout=PATIENCE))
    return client.get_executor(pure=False).submit, lambda: sum(client.nthreads().values())


def _ray(address: str, count: int, stack: ExitStack) -> _Connection:
    import ray

    if not ray.is_initialized():  # by the caller
        stack.callback(ray.shutdown)
        quiet = {"logging_level": logging.ERROR, "log_to_driver": False}
        handler = signal.getsignal(signal.SIGTERM)
        with warnings.catch_warnings(action="ignore"):
            if address:
                ray.init(f"ray://{address}", **quiet)
            elif "RAY_ADDRESS" in os.environ:  # of the cluster that runs this job
                ray.init(**quiet)
            else:
                os.environ.setdefault(USAGE, "0")
                _start_ray(num_cpus=count, include_dashboard=False, **quiet)
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, handler)  # which Ray has replaced
    task: Any = ray.remote(_call)
    return lambda *call: task.remote(*call).future(), lambda: int(ray.cluster_resources().get("CPU", 0))


def _start_ray(**settings: Any) -> None:
    """Starts a cluster on this machine; Ray gives up after 30 s, which a busy machine may take."""
    import ray

    for is_last in (False, False, True):
        try:
            ray.init("local", **settings)
        except Exception as error:
            ray.shutdown()
            if is_last or "timed out" not in str(error):
                raise
        else:
            return


def _call(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


_CONNECT = {"dask": _dask, "ray": _ray}
