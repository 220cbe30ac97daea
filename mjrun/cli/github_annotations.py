"""Annotations of a GitHub workflow: https://docs.github.com/actions/reference/workflow-commands-for-github-actions."""

from mjrun.errors import clean


def annotation(level: str, text: str, file: str, title: str, line: int | None = None) -> str:
    """A workflow command, `::warning file=…,line=…,title=…::message`, without a file if that is empty.

    Args:
      level: error, warning or notice.
    """
    place = f"file={_escaped_property(file)}," + (f"line={line}," if line else "") if file else ""
    return f"::{level} {place}title={_escaped_property(title)}::{_escaped(text)}"


def _escaped(text: str) -> str:
    """The text of a workflow command, in one line and without anything that could begin another."""
    cleaned = "\n".join(clean(line) for line in text.split("\n"))
    return cleaned.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _escaped_property(text: str) -> str:
    """A property of a workflow command."""
    return clean(text).replace("%", "%25").replace(":", "%3A").replace(",", "%2C")
