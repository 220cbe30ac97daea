"""The answer of a command as a value: prose, JSON, and the other forms that it can be printed in."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from mjrun.errors import clean


def _nothing() -> str:
    return ""


@dataclass(frozen=True)
class Report:
    """The answer of a command; each of its forms is made only if it is printed.

    Attributes:
      kind: of its JSON document, as `mjrun schema` knows it; empty for a document without a schema.
      result: the dataclass that the JSON document holds.
      text: what the user has asked for, which is printed also with --quiet.
      summary: what was done, which --quiet leaves out.
      forms: by option, such as `csv`, what standard output holds instead: text, or a JSON document of another kind.
      remark: the line on standard error beside another form; the summary if it is None.
      document: the JSON document, where it is not `result` alone.
    """

    kind: str
    result: Any
    text: Callable[[], str] = _nothing
    summary: Callable[[], str] = _nothing
    forms: Mapping[str, Callable[[], str | Mapping[str, object]]] = field(default_factory=dict[str, Any])
    remark: Callable[[], str] | None = None
    document: Callable[[Any], dict[str, object]] = asdict

    def json(self) -> dict[str, object]:
        """The JSON document, which names its schema."""
        named = {"schema": f"mjrun-{self.kind}-1"} if self.kind else {}
        return {**self.document(self.result), **named}


def annotation(level: str, text: str, file: str, title: str, line: int | None = None) -> str:
    """An annotation of a GitHub workflow, `::warning file=…,line=…,title=…::message`, without a file if that is empty.

    https://docs.github.com/actions/reference/workflow-commands-for-github-actions

    Args:
      level: error, warning or notice.
    """
    place = f"file={_escaped_property(file)}," + (f"line={line}," if line else "") if file else ""
    # In one line, and without anything that could begin another command.
    message = "\n".join(clean(part) for part in text.split("\n"))
    message = message.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
    return f"::{level} {place}title={_escaped_property(title)}::{message}"


def _escaped_property(text: str) -> str:
    return clean(text).replace("%", "%25").replace(":", "%3A").replace(",", "%2C")
