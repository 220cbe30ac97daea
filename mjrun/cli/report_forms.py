"""The report of a command: prose, JSON, and the other forms in which it can be printed."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, field
from importlib import import_module
from typing import Any

from mjrun.dataclass import dataclass


def _nothing() -> str:
    return ""


@dataclass(frozen=True)
class Case:
    """A verdict of a command, as formats for CI systems report it.

    Attributes:
      name: the thing that was checked, such as a model.
      level: `error`, `warning` or `note`; empty if it passed.
      title: the name of the rule, or of the comparison.
      text: the message; empty if it passed.
      file: the file that the message is about; empty for none.
      line: line in the file, if known.
      repeats: true if an earlier case is the same but for its name, so that a list of places shows it once.
    """

    name: str
    level: str = ""
    title: str = ""
    text: str = ""
    file: str = ""
    line: int | None = None
    repeats: bool = False


@dataclass(frozen=True)
class Report:
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
    text: Callable[[], str] = _nothing
    summary: Callable[[], str] = _nothing
    forms: Mapping[str, Callable[[], str | Mapping[str, object]]] = field(default_factory=dict[str, Any])
    cases: Callable[[], Iterable[Case]] = tuple[Case, ...]
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
        return import_module(f"mjrun.cli.report_formats.{option}").text(self.cases())
