"""Clusters of Dask and Ray, new ones on this machine or existing ones, as executors of chunks.

Both start the task of a worker that has died on another one, and end what is running when they are closed.
"""

import logging
import os
import signal
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import ExitStack
from typing import Any

from mjrun.errors import UsageError, clean, option

PATIENCE = 20  # [s] for a cluster of Dask to answer; Ray asks for 30 s
USAGE = "RAY_USAGE_STATS_ENABLED"  # Ray reports to its makers unless it is 0
ENDINGS = ("LocalRayletDiedError", "RaySystemError")  # errors of Ray without its daemon


def is_cluster(engine: str) -> bool:
    return engine.partition("://")[0] in _CONNECT


def open_cluster(engine: str, count: int, stack: ExitStack) -> tuple[Executor, int]:
    """Connects to `dask://HOST:PORT` or `ray://HOST:PORT`, or to a new cluster `dask` or `ray` with `count` workers.

    Returns:
      The executor, which `stack` closes, and the number of workers.

    Raises:
      UsageError: the cluster does not answer or cannot be used.
    """
    name, _, address = engine.partition("://")
    try:
        executor, workers = _CONNECT[name](address, count, stack)
    except Exception as error:  # of whatever kind: ConnectionError, RuntimeError for another version of Python
        reason = f"{error}".strip().splitlines() or [type(error).__name__]  # the last line follows a traceback
        raise UsageError(f"{option('engine')}: {clean(engine)} cannot be used: {clean(reason[-1])}") from None
    return executor, workers


def has_ended(error: Exception) -> bool:
    """Returns whether the error of a task is that of an engine that has ended: Dask cancels the tasks of a scheduler
    that is lost, and a pool of processes breaks.
    """
    return isinstance(error, BrokenExecutor | CancelledError | ConnectionError) or type(error).__name__ in ENDINGS


def _dask(address: str, count: int, stack: ExitStack) -> tuple[Executor, int]:
    import distributed  # whose functions are annotated as if they might return coroutines

    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # tracebacks of a scheduler that has ended
    client_class: Any = distributed.Client
    cluster_class: Any = distributed.LocalCluster
    if not address:
        cluster = cluster_class(n_workers=count, threads_per_worker=1, dashboard_address="127.0.0.1:0")
        address = stack.enter_context(cluster).scheduler_address
    client = stack.enter_context(client_class(address, timeout=PATIENCE))
    return client.get_executor(pure=False), sum(client.nthreads().values())


def _ray(address: str, count: int, stack: ExitStack) -> tuple[Executor, int]:
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
    return _RayExecutor(), int(ray.cluster_resources().get("CPU", 0))


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


class _RayExecutor(Executor):
    """Tasks of the cluster that this process is connected to."""

    def __init__(self) -> None:
        import ray

        self._task: Any = ray.remote(_call)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return self._task.remote(fn, args, kwargs).future()


def _call(fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    return fn(*args, **kwargs)


_CONNECT = {"dask": _dask, "ray": _ray}
