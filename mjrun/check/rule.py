"""Rules: a code, a severity and a title, and usually a function that finds what violates the rule."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mjrun.check.context import LintContext
from mjrun.check.finding import Finding, Place, Violation, short_path
from mjrun.model.xml_source import Element

Violations = Callable[[LintContext], Iterator[Violation]]


@dataclass(frozen=True)
class Rule:
    """A rule of the lint.

    Attributes:
      code: such as `MJ301`; stable.
      severity: of its findings, unless a violation says otherwise.
      title: a few words.
      violations: finds what violates the rule in a model that loads; None if loading or stepping shows it.
    """

    code: str
    severity: str
    title: str
    violations: Violations | None = None

    def findings(self, context: LintContext) -> Iterator[Finding]:
        """The violations in a model that loads; none if the rule is not for such a model."""
        for message, remedy, place, name, severity in self.violations(context) if self.violations else ():
            yield self.finding(message, remedy, place, name, severity)

    def finding(self, message: str, remedy: str, place: Place, object: str = "", severity: str = "") -> Finding:  # noqa: A002
        """A violation of this rule at `place`."""
        file, line, origin = place
        attached = f" (attached from {short_path(origin[0])}:{origin[1]})" if origin else ""
        return Finding(self.code, severity or self.severity, message + attached, short_path(file), line, object, remedy)

    def in_element(self, element: Element, message: str, remedy: str) -> Finding:
        """A violation of this rule in an XML element."""
        return self.finding(message, remedy, Place(element.file, element.line), str(element))

    def in_model(self, model: Path, message: str, remedy: str = "") -> Finding:
        """A violation of this rule by a model as a whole."""
        return self.finding(message, remedy, Place(model))


def rule(code: str, severity: str, title: str) -> Callable[[Violations], Rule]:
    """Makes a rule of the function that finds its violations."""
    return lambda violations: Rule(code, severity, title, violations)
