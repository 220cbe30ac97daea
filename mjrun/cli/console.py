"""What the user sees: payload on stdout, everything else on stderr."""

import contextlib
import json
import os
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from mjrun.cli.report import Report

from mjrun.cli.standard_streams import STDERR, STDOUT, Payload, text_stream
from mjrun.confinement.confinement import confinement
from mjrun.errors import Failure, flag, spelled
from mjrun.shared_status import note_answered

EVERY = 10.0  # [s] between two lines of progress when stderr is no terminal


def asks_for_json(arguments: Sequence[str]) -> bool:
    """Whether a command line that may be wrong has the option --json."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    return "--json" in arguments[:end]


class Console:
    """Messages, progress and results of one command. It is the job's reporter.

    Attributes:
      verbosity: −1 only errors, 0 normal, 1 more.
      debug: show tracebacks.
      code: the exit code of a command that ran through.
      command: the command line.
      as_json: whether standard output is one JSON document, which reports failures too.
    """

    def __init__(self, command: str = "mjrun", *, as_json: bool = False) -> None:
        self.command = command
        self.as_json = as_json
        self.verbosity = 0
        self.debug = False
        self.code = 0
        self._progress: Progress | None = None
        self._task: TaskID | None = None
        self._last = time.monotonic()
        self._stdout: TextIO | None = None
        self._document: Mapping[str, object] | None = None
        self._failure: Mapping[str, object] | None = None

    def guard_stdout(self) -> None:
        """Keeps standard output for the payload: what native libraries print there goes to stderr."""
        sys.stdout.flush()
        self._stdout, payload = sys.stdout, os.dup(STDOUT)
        os.dup2(STDERR, STDOUT)
        sys.stdout = text_stream(Payload(payload, "w"))

    def release_stdout(self) -> None:
        """Ends `guard_stdout`; what cannot be written any more is dropped."""
        if self._stdout is None:
            return
        payload, sys.stdout = sys.stdout, self._stdout
        self._stdout = None
        os.dup2(payload.fileno(), STDOUT)
        with contextlib.suppress(OSError):
            payload.close()

    def result(self, text: str) -> None:
        """The command's answer, one line or a document, on stdout."""
        print(text, flush=True)  # noqa: T201

    def answer(self, report: "Report", form: str = "", *, is_piped: bool = False) -> None:
        """Prints a report: as JSON, in another form, or in prose.

        Args:
          form: the option that asks for another form.
          is_piped: whether standard output holds the output of the command.
        """
        if self.as_json:
            self.document(report.json())
        elif form:
            payload = report.forms[form]()
            if not isinstance(payload, str):
                self.document(payload)
            elif payload:
                self.result(payload)
            if remark := (report.remark or report.summary)():
                self.say(remark)
        elif is_piped:
            self.say(report.summary())
        else:
            for text in (report.text(), report.summary() if self.verbosity >= 0 else ""):
                if text:
                    self.result(text)

    def document(self, value: Mapping[str, object]) -> None:
        """The command's answer as one JSON document; `finish` prints it."""
        self._document = value

    def fail(self, code: int, kind: str, message: str) -> None:
        """Makes `code` the exit code of a command that ran through, and reports why in its JSON document."""
        self.code = code
        self.report_failure(Failure(kind, message, code))

    def report_failure(self, failure: Failure) -> None:
        """Adds the `error` to the JSON document, where the command line asks for one."""
        if self.as_json:
            self._failure = failure.document()

    def finish(self) -> None:
        """Prints the JSON document on stdout, if any, and how the process is confined, if it is."""
        document = {**(self._document or {}), **({"error": self._failure} if self._failure else {})}
        if not document:
            return
        limits = confinement()
        if limits and "runs" not in document:  # which SARIF has, and nothing of its own beside
            document["untrusted"] = limits.facts()
        note_answered()
        self.result(json.dumps(document, indent=2))

    def say(self, text: str) -> None:
        """The command's answer when stdout holds something else; on stderr."""
        if self.verbosity >= 0:
            self._line(text)

    def note(self, text: str) -> None:
        if self.verbosity >= 0:
            self.ask(text)

    def warn(self, text: str) -> None:
        if self.verbosity >= 0:
            self._line(f"mjrun: warning: {spelled(text, flag)}")

    def ask(self, text: str) -> None:
        self._line(f"mjrun: {spelled(text, flag)}")

    def error(self, text: str) -> None:
        """What ended the command."""
        if self.debug:
            traceback.print_exc()
        first, *rest = spelled(text, flag).splitlines()
        self._line("\n".join([f"mjrun: error: {first}", *(f"  {line}" for line in rest)]))

    def progress(self, what: str, done: int, total: int) -> None:
        if self.verbosity < 0:
            return
        if self._progress or sys.stderr.isatty():  # a bar replaces sys.stderr by something that is no terminal
            self._bar(what, done, total)
        elif time.monotonic() - self._last > EVERY and done < total:
            self._last = time.monotonic()
            self._line(f"mjrun: {done} of {total} {what}")

    def close(self) -> None:
        """Ends a progress bar."""
        if self._progress:
            self._progress.stop()
            self._progress = None

    def _bar(self, what: str, done: int, total: int) -> None:
        if self._progress is None:
            from rich.console import Console as Terminal
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self._progress = Progress(*columns, console=Terminal(stderr=True), transient=True)
            self._progress.start()
            self._task = self._progress.add_task(what, total=total)
        assert self._task is not None
        self._progress.update(self._task, completed=done, total=total)
        if done == total:
            self.close()

    def _line(self, text: str) -> None:
        if self._progress:
            self._progress.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            print(text, file=sys.stderr, flush=True)  # noqa: T201
