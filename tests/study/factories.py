"""Executors that tests give as `module:factory`."""

from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any


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
