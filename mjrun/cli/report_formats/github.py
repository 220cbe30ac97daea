"""GitHub Actions annotations: `::warning file=…,line=…,title=…::message`.

https://docs.github.com/actions/reference/workflow-commands-for-github-actions
"""

from collections.abc import Iterable

from mjrun.cli.console import Case
from mjrun.errors import clean

LEVELS = {"error": "error", "warning": "warning", "note": "notice"}


def text(cases: Iterable[Case]) -> str:
    """Formats an annotation for each case that did not pass."""
    return "\n".join(_annotation(case) for case in cases if case.level and not case.repeats)


def _annotation(case: Case) -> str:
    place = f"file={_escaped_property(case.file)}," + (f"line={case.line}," if case.line else "") if case.file else ""
    # In one line, with escapes so that no other command can begin.
    message = "\n".join(clean(part) for part in case.text.split("\n"))
    message = message.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
    return f"::{LEVELS[case.level]} {place}title={_escaped_property(case.title)}::{message}"


def _escaped_property(text: str) -> str:
    return clean(text).replace("%", "%25").replace(":", "%3A").replace(",", "%2C")
