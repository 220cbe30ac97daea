"""The report of a command: prose, JSON, and the other forms in which it can be printed."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from mjrun.errors import clean


def _nothing() -> str:
    return ""


@dataclass(frozen=True)
class Report:
    """The report of a command; each form is made only if it is printed.

    Attributes:
      kind: the kind of its JSON document in `mjrun schema`; empty for a document without a schema.
      result: the dataclass that the JSON document holds.
      text: the requested information, which is printed even with --quiet.
      summary: a summary of the actions, which --quiet suppresses.
      forms: other forms for standard output, by option, such as `csv`: text, or a JSON document of another kind.
      remark: the line on standard error beside another form; by default, the summary.
      document: makes the JSON document, if it is not `result` alone.
    """

    kind: str
    result: Any
    text: Callable[[], str] = _nothing
    summary: Callable[[], str] = _nothing
    forms: Mapping[str, Callable[[], str | Mapping[str, object]]] = field(default_factory=dict[str, Any])
    remark: Callable[[], str] | None = None
    document: Callable[[Any], dict[str, object]] = asdict

    def json(self) -> dict[str, object]:
        """Returns the JSON document, which names its schema."""
        named = {"schema": f"mjrun-{self.kind}-1"} if self.kind else {}
        return {**self.document(self.result), **named}


def annotation(level: str, text: str, file: str, title: str, line: int | None = None) -> str:
    """Formats a GitHub annotation, `::warning file=…,line=…,title=…::message`, without a file if that is empty.

    https://docs.github.com/actions/reference/workflow-commands-for-github-actions

    Args:
      level: error, warning or notice.
    """
    place = f"file={_escaped_property(file)}," + (f"line={line}," if line else "") if file else ""
    # In one line, with escapes so that no other command can begin.
    message = "\n".join(clean(part) for part in text.split("\n"))
    message = message.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
    return f"::{level} {place}title={_escaped_property(title)}::{message}"


def _escaped_property(text: str) -> str:
    return clean(text).replace("%", "%25").replace(":", "%3A").replace(",", "%2C")
