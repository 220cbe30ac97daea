"""Faults of the file system: the N-th operation fails, alone or with all that follow, or the process is killed."""

import errno
import os
import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from mjrun.formats import temporary_output

OPERATIONS = ("rename", "replace", "link", "mkdir", "rmdir", "unlink", "fsync")
MOST = 100  # operations of one publication, more than there are


@contextmanager
def fault(number: int, kind: str) -> Iterator[list[str]]:
    """File operations of which number `number`, from 1 on, is at fault; yields the names of those that were tried.

    Args:
      kind: `once`: it fails; `from then on`: so do all that follow; `kill`: the process is killed before it.
    """
    tried: list[str] = []

    def faulty(name: str, operation: Callable[..., Any]) -> Callable[..., Any]:
        def run(*args: Any, **kwargs: Any) -> Any:
            tried.append(name)
            if kind == "kill" and len(tried) == number:
                os.kill(os.getpid(), signal.SIGKILL)
            if len(tried) == number or (kind == "from then on" and len(tried) > number):
                if name == "exchange":
                    return False
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            return operation(*args, **kwargs)

        return run

    with pytest.MonkeyPatch.context() as patch:
        for name in OPERATIONS:
            patch.setattr(os, name, faulty(name, getattr(os, name)))
        patch.setattr(temporary_output, "exchange", faulty("exchange", temporary_output.exchange))
        yield tried


def killed_at(number: int, work: Callable[[], object]) -> bool:
    """Does `work` in a process that is killed before its file operation `number`; whether it got that far."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that this process may have threads, none of which the other one needs
        child = os.fork()
    if not child:
        try:
            with fault(number, "kill"):
                work()
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])
