"""Messages and progress of a running job, which the command line and the Python API report differently."""

import sys
import time
import warnings
from importlib import import_module
from typing import Any, Protocol

from mjrun.errors import MjrunWarning, spelled


class Reporter(Protocol):
    """A receiver of messages and progress of a job."""

    def note(self, text: str) -> None:
        """Reports information for the user."""
        ...

    def warn(self, text: str) -> None:
        """Reports a circumstance that may make the result differ from expectations."""
        ...

    def ask(self, text: str) -> None:
        """Reports an action that the user must take before the job can continue."""
        ...

    def progress(self, what: str, done: int, total: int) -> None:
        """Reports that `done` of `total` are done."""
        ...


PAUSE = 0.2  # [s] between two updates of a bar in a notebook


class PythonApiReporter:
    """The reporter of the Python API: warnings and requests become Python warnings, and notebooks show progress."""

    def __init__(self) -> None:
        self._bar: Any = None  # IPython's handle of a displayed bar
        self._updated = 0.0

    def note(self, text: str) -> None:
        pass

    def warn(self, text: str) -> None:
        warnings.warn(spelled(text), MjrunWarning, stacklevel=1 + _depth())

    def ask(self, text: str) -> None:
        self.warn(text)

    def progress(self, what: str, done: int, total: int) -> None:
        is_end = done == total
        if not is_notebook() or (self._bar is None if is_end else time.monotonic() - self._updated < PAUSE):
            return
        library = import_module("IPython.display")  # which runs the notebook
        self._updated = time.monotonic()
        bar = f"<progress value='{done}' max='{total}'></progress> {done} of {total} {what}"
        shown = library.HTML("" if is_end else bar)
        if self._bar is None:
            self._bar = library.display(shown, display_id=True)
        else:
            self._bar.update(shown)


def _depth() -> int:
    """Returns the number of frames of mjrun on the stack, so that warnings name a line of the user."""
    frame, depth = sys._getframe(1), 0  # pyright: ignore[reportPrivateUsage]
    while frame and frame.f_globals.get("__name__", "").partition(".")[0] == "mjrun":
        frame, depth = frame.f_back, depth + 1
    return depth


def is_notebook() -> bool:
    """Returns whether this process is the kernel of a notebook."""
    library = sys.modules.get("IPython")
    return library is not None and hasattr(library.get_ipython(), "kernel")
