"""Clusters of Dask and Ray, new ones on this machine or existing ones, and jobs of Slurm, as executors of chunks.

Dask and Ray start the task of a worker that has died on another one, and end what is running when they are closed.
Calls that arrive together become one job array of Slurm, submitted by submitit. Where Slurm is missing, submitit's
stand-in runs each call in a process on this machine.
"""

import logging
import os
import secrets
import shutil
import signal
import subprocess
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from mjrun.errors import UsageError, clean, counted, option
from mjrun.options.sweep import SLURM_JOBS
from mjrun.platform.cores import available_cores

PATIENCE = 20  # [s] for a cluster of Dask to answer; Ray asks for 30 s
LOOK = 10.0  # [s] between two looks at the workers
DESERTED = 60.0  # [s] without a worker until this is reported: a scheduler of jobs may start another one
USAGE = "RAY_USAGE_STATS_ENABLED"  # Ray reports to its makers unless it is 0
FORKS = "GRPC_ENABLE_FORK_SUPPORT"  # unless it is 0, Ray's client prints beside programs that start
_Connection = tuple[Callable[..., Future[Any]], Callable[[], int]]  # submits a call, and counts workers
ENDINGS = ("LocalRayletDiedError", "RaySystemError")  # errors of Ray without its daemon
POLL = 0.2  # [s] between two looks at the jobs, if one takes little time
LOOKING = 20  # parts of the time, of which one is for looking: file systems of networks are slow
EVERY = 5.0  # [s] between two arrays: calls that arrive in the meantime become one
BUSY = 30.0  # [s] until a queue that is full is asked again
SOON = 0.3  # [s] for the jobs to be cancelled by their thread, if a command is not just running in it
SLOW_FILES = 20.0  # [s] until the result of a finished job is visible on this machine
REQUEUE = 180.0  # [s] for Slurm to start a preempted job again: submitit asks for states once a minute
PREEMPTED, TIMEOUT = "PREEMPTED", "TIMEOUT"  # states of jobs
STOPPED = "not requeued because: timed-out"  # error of submitit, which Slurm warns before the time limit
ADVICE = {
    TIMEOUT: "raise the time of jobs, or limit that of points",
    "OUT_OF_MEMORY": "raise the memory of jobs",
}
FOLDER = "slurm"  # in the folder of the study, with the logs of failed jobs


def is_cluster(engine: str) -> bool:
    return engine.partition("://")[0] in _CONNECT


class ClusterExecutor(Executor):
    """An executor of calls as tasks of a cluster, whose workers come and go.

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


def open_cluster(engine: str, count: int, stack: ExitStack, note: Callable[[str], None]) -> ClusterExecutor:
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
        return ClusterExecutor(f"{option('engine')} {clean(engine)}", submit, workers, note)
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
        settings = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.ERROR}  # no warnings of cancelled tasks
        cluster = cluster_class(n_workers=count, threads_per_worker=1, **settings)
        address = stack.enter_context(cluster).scheduler_address
    client = stack.enter_context(client_class(address, timeout=PATIENCE))
    return client.get_executor(pure=False).submit, lambda: sum(client.nthreads().values())


def _ray(address: str, count: int, stack: ExitStack) -> _Connection:
    os.environ.setdefault(FORKS, "0")
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


class LostJobError(Exception):
    """A job that Slurm ended before it had a result.

    Args:
      state: state of the job: `NODE_FAIL`.
      log: path of its log.
    """

    def __init__(self, state: str, log: Path) -> None:
        self.state, self.is_over_time = state, state == TIMEOUT
        advice = f"; {ADVICE[state]}" if state in ADVICE else ""
        super().__init__(f"the job ended as {state} without a result: see {log}{advice}")


class SlurmExecutor(Executor):
    """An executor of calls in Slurm jobs. Their futures can be cancelled until they begin.

    The jobs in flight are as many as Slurm accepts: an array that it refuses is submitted in halves, and what it still
    refuses waits while any job is in its queue.

    Args:
      folder: folder of the study.
      settings: settings of the jobs, such as `time=2h`.
      limit: largest number of jobs that run at once.
      note: reports cancelled jobs.
    """

    def __init__(self, folder: Path, settings: Sequence[str], limit: int, note: Callable[[str], None]) -> None:
        import submitit

        logging.getLogger("submitit").disabled = True  # it writes to standard output
        self._folder, self._note = folder / FOLDER / secrets.token_hex(4), note
        self._submitter = submitit.AutoExecutor(folder=self._folder)
        self._submitter.update_parameters(**slurm_parameters(settings), slurm_array_parallelism=limit)
        self._calls = list[tuple[Future[Any], Callable[[], Any]]]()  # to be submitted
        self._jobs = dict[Future[Any], Any]()
        self._ended = dict[Future[Any], float]()  # since when jobs without a result have ended
        self._most, self._next = SLURM_JOBS, 0.0  # calls in the next array, and its earliest time
        self._has_failures = self._is_gathering = False
        self._lock, self._wake, self._closed = threading.Lock(), threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._watch, name="jobs of Slurm", daemon=True)
        self._thread.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future = Future[Any]()
        with self._lock:
            self._calls.append((future, partial(fn, *args, **kwargs)))
        self._wake.set()
        return future

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Submits the calls in this context as one array at its end."""
        self._is_gathering = True
        try:
            yield
        finally:
            self._is_gathering = False
            self._wake.set()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._closed.set()
        self._wake.set()
        self._thread.join(SOON)
        self._cancel([*self._jobs])
        if not self._has_failures:
            shutil.rmtree(self._folder, ignore_errors=True)
            with suppress(OSError):  # another process has jobs in it
                self._folder.parent.rmdir()

    def _watch(self) -> None:
        next_look = 0.0
        while not self._closed.is_set():
            self._wake.wait(POLL)
            self._wake.clear()
            if not self._is_gathering and time.monotonic() >= self._next:
                self._submit_calls()
            self._cancel([future for future in [*self._jobs] if future.cancelled()])
            if (start := time.monotonic()) < next_look:
                continue
            for future, job in [*self._jobs.items()]:
                self._look(future, job)
            next_look = start + LOOKING * (time.monotonic() - start)
        self._cancel([*self._jobs])  # such as those that were just being submitted

    def _submit_calls(self) -> None:
        """Submits all calls in arrays that are as large as Slurm accepts."""
        while not self._closed.is_set() and (some := self._first_calls(self._most)):
            try:
                jobs = self._submitter.submit_array([call for _, call in some])
            except Exception as error:  # such as a FailedJobError for a command of Slurm
                if len(some) > 1:
                    self._most = len(some) // 2
                    continue
                self._next = time.monotonic() + BUSY
                if not self._jobs:
                    refusal = UsageError(f"{option('engine')} slurm: {clean(str(error).strip())}")
                    for future, _ in self._first_calls():
                        _settle(future, error=refusal)
                return
            self._jobs |= zip((future for future, _ in some), jobs, strict=True)
            self._most *= 2
            self._next = time.monotonic() + EVERY

    def _first_calls(self, most: int | None = None) -> list[tuple["Future[Any]", Callable[[], Any]]]:
        """Returns calls that wait to be submitted."""
        with self._lock:
            self._calls = [each for each in self._calls if each[0] not in self._jobs and not each[0].done()]
            return self._calls[:most]

    def _look(self, future: "Future[Any]", job: Any) -> None:
        """Marks a job that has begun as running, and passes on the result of one that has ended."""
        is_preempted = not job.done() and job.state == PREEMPTED
        if not job.done() and not is_preempted:
            self._ended.pop(future, None)
            if not future.running() and job.paths.stdout.exists():
                future.set_running_or_notify_cancel()
            return
        has_result, now = job.paths.result_pickle.exists(), time.monotonic()
        patience = REQUEUE if is_preempted else SLOW_FILES
        if not has_result and now < self._ended.setdefault(future, now) + patience:
            return
        try:
            if not has_result:
                raise LostJobError((job.state.split() or ["UNKNOWN"])[0], job.paths.stderr)
            _settle(future, job.result())
            for path in (job.paths.submitted_pickle, job.paths.result_pickle, job.paths.stdout, job.paths.stderr):
                path.unlink(missing_ok=True)
        except Exception as error:  # of whatever kind: the waiting thread raises it
            self._has_failures = True
            _settle(future, error=LostJobError(TIMEOUT, job.paths.stderr) if STOPPED in str(error) else error)
        self._ended.pop(future, None)
        self._jobs.pop(future, None)

    def _cancel(self, futures: Sequence["Future[Any]"]) -> None:
        """Cancels jobs, those of Slurm with one command."""
        jobs = [job for future in futures if (job := self._jobs.pop(future, None))]
        if not jobs:
            return
        if shutil.which("scancel"):
            command = ["scancel", *(job.job_id for job in jobs)]
            subprocess.run(command, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        else:
            for job in jobs:
                job.cancel()
        begun = sum(future.running() for future in futures)
        facts = [f"{begun} running" if begun else "", f"{len(jobs) - begun} waiting" if begun < len(jobs) else ""]
        self._note(f"{counted(len(jobs), 'job')} of Slurm cancelled: {', '.join(filter(None, facts))}")


def _settle(future: "Future[Any]", result: Any = None, error: Exception | None = None) -> None:
    """Sets the result of a future, or its exception, unless it has been cancelled."""
    if future.running() or future.set_running_or_notify_cancel():
        future.set_exception(error) if error else future.set_result(result)


def slurm_parameters(settings: Sequence[str]) -> dict[str, object]:
    """Returns the parameters of submitit for settings such as `time=2h`, except `array`."""
    parameters = dict[str, object]()
    for name, _, text in (setting.partition("=") for setting in settings):
        if name == "time":
            parameters["timeout_min"] = 60 * int(text[:-1]) if text.endswith("h") else int(text.removesuffix("min"))
        elif name != "array":
            own = {"gpus": "gpus_per_node", "cpus": "cpus_per_task"}.get(name, name)
            parameters[f"slurm_{own}"] = text.removesuffix("B") if name == "mem" else text
    return parameters


def most_jobs(jobs: int | str, settings: Sequence[str]) -> int:
    """Returns the largest number of jobs in flight; those of submitit's stand-in for Slurm run on this machine."""
    if isinstance(jobs, str):
        jobs = SLURM_JOBS if shutil.which("srun") else available_cores()
    arrays = [int(setting.removeprefix("array=")) for setting in settings if setting.startswith("array=")]
    return min([jobs, *arrays])
