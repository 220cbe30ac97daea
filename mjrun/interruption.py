"""Signals that end the process, and sections that they must not interrupt."""

import threading
from collections.abc import Generator
from contextlib import contextmanager

_depth = 0
_waiting: BaseException | None = None


@contextmanager
def uninterrupted() -> Generator[None]:
    """Delays errors from `interrupt` to the end of the `with` block, which should be short."""
    global _depth, _waiting
    if threading.current_thread() is not threading.main_thread():  # handlers of signals run in the main thread
        yield
        return
    _depth += 1
    try:
        yield
    finally:
        _depth -= 1
        if not _depth and _waiting is not None:
            error, _waiting = _waiting, None
            raise error


def interrupt(error: BaseException) -> None:
    """Raises `error` as soon as the main thread may be interrupted; for signal handlers."""
    global _waiting
    if not _depth:
        raise error
    _waiting = error
