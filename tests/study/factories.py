"""Executors for tests of `module:factory`."""

import pickle
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import Any

from mjrun.study.clusters import LostJobError
from mjrun.study.part_files import PartPublisher
from mjrun.study.spec import ChunkResult


def threads() -> Executor:
    return ThreadPoolExecutor(2)


def nothing() -> str:
    return "no executor"


class Forgetful(Executor):
    """Loses every second task."""

    def __init__(self) -> None:
        self._count = 0

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future = Future[Any]()
        self._count += 1
        if self._count % 2:
            future.set_exception(RuntimeError("the machine is gone"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


class Losing(Executor):
    """Loses a node with its first task, as Slurm reports it."""

    def __init__(self) -> None:
        self._has_lost = False

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future = Future[Any]()
        if self._has_lost:
            future.set_result(fn(*args, **kwargs))
        else:
            future.set_exception(LostJobError("NODE_FAIL", Path("log")))
        self._has_lost = True
        return future


class Broken(Executor):
    """Ends after a task, as a pool of processes when one is killed, or a scheduler that cancels its tasks."""

    def __init__(self, error: Exception | None) -> None:
        self._error, self._has_ended = error, False

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future = Future[Any]()
        if not self._has_ended:
            future.set_result(fn(*args, **kwargs))
        elif self._error:
            future.set_exception(self._error)
        else:
            raise RuntimeError("cannot schedule new futures after shutdown")
        self._has_ended = True
        return future


class Elsewhere(Executor):
    """Another machine: it has none of this one's files, and gets all that it needs by pickle.

    Attributes:
      asked: of each chunk that came, whether it held the contents of files.
    """

    def __init__(self) -> None:
        self.asked: list[bool] = []
        made.append(self)

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> "Future[Any]":
        (chunk,) = pickle.loads(pickle.dumps(args))
        self.asked.append(chunk.contents is not None)
        snapshot = replace(chunk.study.snapshot, root=Path("/nowhere/at/all"))
        future = Future[Any]()
        future.set_result(pickle.loads(pickle.dumps(fn(replace(chunk, study=replace(chunk.study, snapshot=snapshot))))))
        return future


class Neighbour(Executor):
    """Another process, which may see the folder of the study.

    Args:
      view: returns where the process publishes results, from the place that it receives.

    Attributes:
      replies: results of the chunks.
    """

    def __init__(self, view: Callable[[PartPublisher], PartPublisher]) -> None:
        self._view, self.replies = view, list[ChunkResult]()

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> "Future[Any]":
        (chunk,) = pickle.loads(pickle.dumps(args))
        if chunk.parts:
            chunk = replace(chunk, parts=self._view(chunk.parts))
        future = Future[Any]()
        self.replies.append(fn(chunk))
        future.set_result(pickle.loads(pickle.dumps(self.replies[-1])))
        return future


class OtherLibraries(Executor):
    """Workers of which every N-th has another version of MuJoCo."""

    def __init__(self, every: int) -> None:
        self._every, self._count = every, 0

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future, result = Future[Any](), fn(*args, **kwargs)
        self._count += 1
        if self._count % self._every == 0:
            proofs = [replace(each, versions={**each.versions, "mujoco": "3.9.9"}) for each in result.worker_versions]
            wrong = [replace(each, metrics=tuple(-metric for metric in each.metrics)) for each in result.results]
            result = replace(result, results=wrong, worker_versions=tuple(proofs))
        future.set_result(result)
        return future


made: list[Elsewhere] = []


def one_of_two() -> Executor:
    return OtherLibraries(2)


def all_of_them() -> Executor:
    return OtherLibraries(1)


def in_this_process() -> Executor:
    return OtherLibraries(10**9)


def that_breaks() -> Executor:
    return Broken(BrokenProcessPool("a process was terminated"))


def that_cancels() -> Executor:
    return Broken(CancelledError())


def that_closes() -> Executor:
    return Broken(None)
