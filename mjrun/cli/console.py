"""Reports of commands and their output: the payload on stdout, everything else on stderr, in colours where wanted."""

import os
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

import click

from mjrun.cli.standard_streams import STDERR, STDOUT, PayloadStream, text_stream
from mjrun.confinement.confinement import confinement
from mjrun.dataclass import dataclass
from mjrun.errors import FailureReport, clean, flag, option, spelled
from mjrun.shared_status import note_answered
from mjrun.suffixes import HTML

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from mjrun.cli.report_formats import CiVerdict

PATHS = ("path", "paths", "html", "files")  # keys of reports
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
EVERY = 10.0  # [s] between two lines of progress when stderr is no terminal
HELP_COLUMNS = 100  # most columns of help
HEADING = r"(?m)^(Usage:|\S.*:$)"  # patterns are compiled when they are used
OPTION = r"(?m)^(  )((?:-\w, )?--?[\w-]+(?:, ?--?[\w-]+|/--?[\w-]+)*)"
COMMAND = r"(?m)^(  )([a-z]+)(?=  )"
# Variables and values by which terminals make themselves known that show hyperlinks (OSC 8).
LINKING_PROGRAMS = ("iTerm.app", "WezTerm", "vscode", "Hyper", "ghostty", "Tabby", "rio")
LINKING_TERMS = ("xterm-kitty", "xterm-ghostty", "alacritty", "foot", "foot-extra", "wezterm")
LINKING_VARIABLES = ("WT_SESSION", "KONSOLE_VERSION", "KITTY_WINDOW_ID", "DOMTERM")
LINKING_VTE = 5000  # the first version of the library of GNOME's and other terminals
PREFIX = r"^(mjrun: )(error|warning)(:)"
LEVELS = {"error": "red", "warning": "yellow"}


def document_form(arguments: Sequence[str]) -> str:
    """Returns the option by which a command line, possibly invalid, requests a document; empty for prose."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    return "json" if flag("json") in arguments[:end] else ""


@dataclass(frozen=True)
class CommandReport:
    """The report of a command; each form is made only if it is printed.

    Attributes:
      kind: the kind of its JSON document in `mjrun schema`; empty for a document without a schema.
      result: the dataclass that the JSON document holds.
      text: the requested information, which is printed even with --quiet.
      summary: a summary of the actions, which --quiet suppresses.
      forms: other forms for standard output, by option, such as `csv`: text, or a JSON document of another kind.
      cases: its verdicts, for the formats in `mjrun.cli.report_formats`.
      remark: the line on standard error beside another form; by default, the summary.
      document: makes the JSON document, if it is not `result` alone.
    """

    kind: str
    result: Any
    text: Callable[[], str] = str
    summary: Callable[[], str] = str
    forms: Mapping[str, Callable[[], str | Mapping[str, object]]] = field(default_factory=dict[str, Any])
    cases: Callable[[], Iterable["CiVerdict"]] = tuple["CiVerdict", ...]
    remark: Callable[[], str] | None = None
    document: Callable[[Any], dict[str, object]] = asdict

    def json(self) -> dict[str, object]:
        """Returns the JSON document, which names its schema."""
        named = {"schema": f"mjrun-{self.kind}-1"} if self.kind else {}
        return {**self.document(self.result), **named}

    def form(self, option: str) -> str | Mapping[str, object]:
        """Returns the form that an option requests: one of `forms`, or its cases in a format for CI systems."""
        if option in self.forms:
            return self.forms[option]()
        from mjrun.cli.report_formats import FORMATS  # which few commands need

        return FORMATS[option](self.cases())


class Console:
    """Messages, progress and results of one command; the reporter of its job.

    Attributes:
      verbosity: −1 for errors only, 0 normal, 1 for more details.
      debug: print tracebacks.
      code: the exit code of a command that completed.
      command: the command line.
      document_form: the option by which one document replaces prose on stdout, failures included; empty for prose.
      report: the answer, once it is printed.
    """

    def __init__(self, command: str = "mjrun", *, document_form: str = "") -> None:
        self.command = command
        self.document_form = document_form
        self.verbosity = 0
        self.debug = False
        self.code = 0
        self.report: CommandReport | None = None
        self.page: str | None = None  # about the result
        self._progress: Progress | None = None
        self._task: TaskID | None = None
        self._last = time.monotonic()
        self._stdout: TextIO | None = None
        self._document: Mapping[str, object] | None = None
        self._failure: Mapping[str, object] | None = None
        self._noted = set[str]()

    def guard_stdout(self) -> None:
        """Reserves standard output for the payload: output of native libraries goes to stderr."""
        sys.stdout.flush()
        self._stdout, payload = sys.stdout, os.dup(STDOUT)
        os.dup2(STDERR, STDOUT)
        sys.stdout = text_stream(PayloadStream(payload, "w"))

    def release_stdout(self) -> None:
        """Ends `guard_stdout`; output that cannot be written is dropped."""
        if self._stdout is None:
            return
        payload, sys.stdout = sys.stdout, self._stdout
        self._stdout = None
        os.dup2(payload.fileno(), STDOUT)
        with suppress(OSError):
            payload.close()

    def result(self, text: str) -> None:
        """Prints the command's answer, one line or a document, to stdout."""
        print(text, flush=True)  # noqa: T201

    def answer(self, report: CommandReport, form: str = "", *, is_piped: bool = False) -> None:
        """Prints a report: as a document, in another form, or in prose.

        Args:
          form: the option that requests another form.
          is_piped: standard output carries the output of the command.
        """
        self.report = report
        if self.document_form:
            self.document(report.json())
        elif form:
            payload = report.form(form)
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
        """Stores the command's answer as a document, which `finish` prints."""
        self._document = value

    def fail(self, code: int, kind: str, message: str) -> None:
        """Sets the exit code of a command that completed, and adds the reason to its document."""
        self.code = code
        self.report_failure(FailureReport(kind, message, code))

    def report_failure(self, failure: FailureReport) -> None:
        """Adds the `error` to the document, if one is requested."""
        if self.document_form:
            self._failure = failure.document()

    def finish(self) -> None:
        """Prints the document to stdout, if any, with the confinement of the process, if any."""
        document = {**(self._document or {}), **({"error": self._failure} if self._failure else {})}
        if not document:
            return
        import json

        limits = confinement()
        if limits and "runs" not in document:  # SARIF has runs, and allows no further key
            document["untrusted"] = limits.facts()
        note_answered()
        self.result(json.dumps(document, indent=2))

    def say(self, text: str) -> None:
        """Prints the command's answer to stderr, as stdout carries something else."""
        if self.verbosity >= 0:
            self._line(text)

    def note(self, text: str) -> None:
        """Prints a remark, once even if several outputs make it."""
        if self.verbosity >= 0 and text not in self._noted:
            self._noted.add(text)
            self.ask(text)

    def warn(self, text: str) -> None:
        if self.verbosity >= 0:
            self._line(f"mjrun: warning: {spelled(text, flag)}")

    def ask(self, text: str) -> None:
        self._line(f"mjrun: {spelled(text, flag)}")

    def error(self, text: str) -> None:
        """Prints the error that ended the command."""
        if self.debug:
            import traceback

            traceback.print_exc()
        first, *rest = spelled(text, flag).splitlines()
        self._line("\n".join([f"mjrun: error: {first}", *(f"  {line}" for line in rest)]))

    def progress(self, what: str, done: int, total: int) -> None:
        if self.verbosity < 0:
            return
        if self._progress or sys.stderr.isatty():  # a bar replaces sys.stderr by a stream that is not a terminal
            self._bar(what, done, total)
        elif time.monotonic() - self._last > EVERY and done < total:
            self._last = time.monotonic()
            self._line(f"mjrun: {done} of {total} {what}")

    def close(self) -> None:
        """Ends a progress bar."""
        if self._progress:
            self._progress.stop()
            self._progress = None

    def open_file(self) -> None:
        """Opens the page, or else the most telling file in the report, in the program of the desktop for it."""
        paths = [*([self.page] if self.page else []), *(_files_in(self.report.json()) if self.report else ())]
        if warning := _opened(paths):
            self.warn(warning)

    def _bar(self, what: str, done: int, total: int) -> None:
        if self._progress is None:
            from rich.console import Console as Terminal
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            pace = TextColumn("{task.fields[pace]}")
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), pace, TimeRemainingColumn())
            self._progress = Progress(*columns, console=Terminal(stderr=True), transient=True)
            self._progress.start()
            self._task = self._progress.add_task(what, total=total, pace="")
        assert self._task is not None
        speed = self._progress.tasks[0].speed
        pace = f"{speed:.3g}/s" if speed else ""
        self._progress.update(self._task, completed=done, total=total, pace=pace)
        if done == total:
            self.close()

    def _line(self, text: str) -> None:
        if self._progress:
            self._progress.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            text = coloured_message(text) if is_coloured(sys.stderr) else text
            print(text, file=sys.stderr, flush=True)  # noqa: T201


def is_coloured(stream: TextIO) -> bool:
    """Returns whether a stream is a terminal that shows colours: see no-color.org."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def shows_links(stream: TextIO) -> bool:
    """Returns whether a stream is a terminal that is known to show hyperlinks; FORCE_HYPERLINK overrides that."""
    given = os.environ.get
    if forced := given("FORCE_HYPERLINK"):
        return forced != "0"
    if not stream.isatty() or given("TMUX") or given("STY") or given("TERM") == "dumb":
        return False
    version = given("VTE_VERSION", "")
    return (
        any(map(given, LINKING_VARIABLES))
        or given("TERM_PROGRAM") in LINKING_PROGRAMS
        or given("TERM") in LINKING_TERMS
        or (version.isdigit() and int(version) >= LINKING_VTE)
    )


def linked(text: str, address: str) -> str:
    """Returns a text that a terminal shows as a hyperlink: see https://gist.github.com/egmontkob/eb114294efbcd5adb1944c9f3cb5feda."""
    return f"\x1b]8;;{address}\x1b\\{text}\x1b]8;;\x1b\\"


class HelpContext(click.Context):
    """A context whose help is as wide as the terminal; click asks `shutil` for that, which is slow to import."""

    def make_formatter(self) -> click.HelpFormatter:
        return click.HelpFormatter(width=max(min(_columns(), HELP_COLUMNS) - 2, 50))


def _columns() -> int:
    """Returns the width of the terminal as `shutil.get_terminal_size` does."""
    with suppress(ValueError):
        if (columns := int(os.environ.get("COLUMNS", "0"))) > 0:
            return columns
    with suppress(AttributeError, ValueError, OSError):  # standard output is no terminal
        return os.get_terminal_size(sys.__stdout__.fileno()).columns or 80  # type: ignore[union-attr]
    return 80


def shown_help(text: str) -> str:
    """Returns help as standard output shows it."""
    return coloured_help(text) if is_coloured(sys.stdout) else text


def coloured_help(text: str) -> str:
    """Returns help with bold headings, and coloured options and commands."""
    text = re.sub(HEADING, lambda match: click.style(match[0], bold=True), text)
    for pattern in (OPTION, COMMAND):
        text = re.sub(pattern, lambda match: match[1] + click.style(match[2], fg="cyan"), text)
    return text


def coloured_message(text: str) -> str:
    """Returns an error or a warning with its first words coloured."""
    return re.sub(PREFIX, lambda match: click.style(match[0], fg=LEVELS[match[2]], bold=True), text)


def _files_in(document: object) -> Iterator[str]:
    """Yields the paths in the JSON document of a report."""
    if isinstance(document, Mapping):
        for key, value in cast("Mapping[str, object]", document).items():
            if key not in PATHS:
                yield from _files_in(value)
            elif isinstance(value, str):
                yield value
            elif isinstance(value, list | tuple):
                yield from map(str, cast("Sequence[object]", value))
    elif isinstance(document, list | tuple):
        for value in cast("Sequence[object]", document):
            yield from _files_in(value)


def _opened(paths: Sequence[str]) -> str:
    """Opens the most telling of `paths`: a page, else a video, an image or any other; returns a warning, or nothing."""
    from mjrun.formats import codecs

    existing = [path for path in paths if Path(path).exists()]
    kinds = (HTML, codecs.VIDEO_SUFFIXES, (".png", ".jpg", ".jpeg", ".tiff", ".svg", ".pdf"))
    ranked = [path for suffixes in kinds for path in existing if path.lower().endswith(suffixes)]
    chosen = next(iter([*ranked, *existing]), None)
    if chosen is None:
        return f"{option('open')}: no file was made"
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in DISPLAYS):
        return f"{option('open')}: {clean(chosen)} is not shown: this session has no display"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # click does not wait for the program
        failed = click.launch(chosen)
    if failed:
        return f"{option('open')}: no program opens {clean(chosen)}; on Linux, install xdg-utils"
    return ""
