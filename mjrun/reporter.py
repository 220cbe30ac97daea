"""Messages and progress of a running job, which the command line and the Python API report differently."""

import warnings
from collections.abc import Iterable
from typing import Protocol

from mjrun.errors import MjrunWarning, clean, spelled


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


class WarningReporter:
    """The reporter of the Python API: warnings and requests become Python warnings; the rest is silent."""

    def note(self, text: str) -> None:
        pass

    def warn(self, text: str) -> None:
        warnings.warn(spelled(text), MjrunWarning, stacklevel=2)

    def ask(self, text: str) -> None:
        self.warn(text)

    def progress(self, what: str, done: int, total: int) -> None:
        pass


def pass_on(heard: Iterable[str], reporter: Reporter) -> None:
    """Reports MuJoCo's warnings to `reporter`, one per line."""
    for text in heard:
        reporter.warn(f"MuJoCo: {clean('; '.join(text.splitlines()))}")
