"""Rules, and the findings and violations that they produce: a rule has a code, a severity and a title."""

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mjrun.dataclass import dataclass
from mjrun.model.xml_source import Element

if TYPE_CHECKING:
    from mjrun.check.context import LintContext

SEVERITIES = ("note", "warning", "error")  # in ascending order


@dataclass(frozen=True)
class Finding:
    """A fault in a model, or a remark about it.

    Attributes:
      code: the code of the rule, such as `MJ301`; stable.
      severity: `error`, `warning` or `note`.
      message: the fault, in one line.
      file: the model, or a file that it includes. For an attached model, the file that attaches it.
      line: the line in `file`, counted from 1, if known.
      object: the object with the fault, such as `joint 'knee'`; empty for the whole model.
      remedy: the remedy.

    All texts except `code` and `severity` may contain unescaped names from the model.
    """

    code: str
    severity: str
    message: str
    file: str
    line: int | None = None
    object: str = ""
    remedy: str = ""


class Place(NamedTuple):
    """A line of a file.

    Attributes:
      line: the number of the line, counted from 1, if known.
      origin: the file and line in the model that is attached at this place.
    """

    file: Path
    line: int | None = None
    origin: tuple[Path, int] | None = None


class Violation(NamedTuple):
    """A violation, as the function of a rule yields it.

    Attributes:
      severity: a severity that overrides that of the rule, if not empty.
    """

    message: str
    remedy: str
    place: Place
    object: str = ""
    severity: str = ""


def short_path(path: Path) -> str:
    """Returns `path` without detours such as `arm/../hand/hand.xml`, if it still refers to the same file."""
    short = Path(os.path.normpath(path))
    with suppress(OSError, ValueError):
        if short != path and short.samefile(path):
            return str(short)
    return str(path)


Violations = Callable[["LintContext"], Iterator[Violation]]


@dataclass(frozen=True)
class Rule:
    """A rule of the lint.

    Attributes:
      code: its code, such as `MJ301`; stable.
      severity: the severity of its findings, unless a violation overrides it.
      title: its title, a few words.
      violations: the function that finds violations in a model that loads; None if loading or stepping reveals them.
    """

    code: str
    severity: str
    title: str
    violations: Violations | None = None

    def findings(self, context: "LintContext") -> Iterator[Finding]:
        """Yields the violations in a model that loads; none if the rule does not apply to such a model."""
        for message, remedy, place, name, severity in self.violations(context) if self.violations else ():
            yield self.finding(message, remedy, place, name, severity)

    def finding(self, message: str, remedy: str, place: Place, object: str = "", severity: str = "") -> Finding:  # noqa: A002
        """Returns a violation of this rule at `place`."""
        file, line, origin = place
        attached = f" (attached from {short_path(origin[0])}:{origin[1]})" if origin else ""
        return Finding(self.code, severity or self.severity, message + attached, short_path(file), line, object, remedy)

    def in_element(self, element: Element, message: str, remedy: str) -> Finding:
        """Returns a violation of this rule in an XML element."""
        return self.finding(message, remedy, Place(element.file, element.line), str(element))

    def in_model(self, model: Path, message: str, remedy: str = "") -> Finding:
        """Returns a violation of this rule by a model as a whole."""
        return self.finding(message, remedy, Place(model))


def rule(code: str, severity: str, title: str) -> Callable[[Violations], Rule]:
    """Turns the function that finds violations into a rule."""
    return lambda violations: Rule(code, severity, title, violations)
