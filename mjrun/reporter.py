"""How a job speaks while it works; the command line and the Python API listen in their own ways."""

import warnings
from collections.abc import Iterable
from typing import Protocol

from mjrun.errors import MjrunWarning, clean, spelled


class Reporter(Protocol):
    """Hears a job."""

    def note(self, text: str) -> None:
        """Something the user may want to know."""
        ...

    def warn(self, text: str) -> None:
        """Something that may make the result other than expected."""
        ...

    def ask(self, text: str) -> None:
        """Something the user has to do, without which the job does not go on."""
        ...

    def progress(self, what: str, done: int, total: int) -> None:
        """`done` of `total` are done."""
        ...


class WarningReporter:
    """The Python API's: warnings become Python warnings, and so does what is asked; the rest is silent."""

    def note(self, text: str) -> None:
        pass

    def warn(self, text: str) -> None:
        warnings.warn(spelled(text), MjrunWarning, stacklevel=2)

    def ask(self, text: str) -> None:
        self.warn(text)

    def progress(self, what: str, done: int, total: int) -> None:
        pass


def pass_on(heard: Iterable[str], reporter: Reporter) -> None:
    """Tells `reporter` what MuJoCo warned of, a line each."""
    for text in heard:
        reporter.warn(f"MuJoCo: {clean('; '.join(text.splitlines()))}")
