"""Rules: a rule has a code, a severity and a title, and finds violations in a model."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.check.finding import Finding, Fix, MakeFix, Place, Violation, short_path
from mjrun.dataclass import dataclass
from mjrun.errors import clean, option
from mjrun.model.text_edits import UneditableError
from mjrun.model.xml_source import Element

if TYPE_CHECKING:  # findings of earlier checks are reported without MuJoCo and numpy
    from mjrun.check.context import CheckContext

SAFE, UNSAFE = "safe", "unsafe"  # fixes that are certain, and fixes that need a look

# Reasons why a fault is not fixed.
NOT_CERTAIN = "the right fix of this case depends on what was meant"
NOT_SAFE = f"{option('unsafe_fixes')} may fix it"
GENERATED = "MuJoCo or an attached model generates it: no text of this model states the value"


Violations = Callable[["CheckContext"], Iterator[Violation]]


@dataclass(frozen=True)
class Rule:
    """A rule of the lint.

    Attributes:
      code: its code, such as `MJ301`; stable.
      severity: the severity of its findings, unless a violation overrides it.
      title: its title, a few words.
      violations: the function that finds violations in a model that loads; None if loading or stepping reveals them.
      fix: `safe` or `unsafe` if `mjrun check` can fix some of its violations; else empty.
    """

    code: str
    severity: str
    title: str
    violations: Violations | None = None
    fix: str = ""

    def findings(self, context: "CheckContext") -> Iterator[Finding]:
        """Yields the violations in a model that loads; none if the rule does not apply to such a model."""
        for message, remedy, place, name, severity, fix in self.violations(context) if self.violations else ():
            wanted = fix if self.fix == SAFE or context.unsafe or fix is None else lambda: NOT_SAFE
            yield self.finding(message, remedy, place, name, severity, wanted)

    def finding(
        self,
        message: str,
        remedy: str,
        place: Place,
        object: str = "",  # noqa: A002
        severity: str = "",
        fix: MakeFix | None = None,
    ) -> Finding:
        """Returns a violation of this rule at `place`."""
        file, line, origin = place
        attached = f" (attached from {short_path(origin[0])}:{origin[1]})" if origin else ""
        text, severity = message + attached, severity or self.severity
        made = _made(fix or (lambda: NOT_CERTAIN)) if self.fix else ""
        fixes, unfixed = ((), made) if isinstance(made, str) else ((made,), "")
        return Finding(self.code, severity, text, short_path(file), line, object, remedy, fixes, unfixed=unfixed)

    def in_element(self, element: Element, message: str, remedy: str, fix: MakeFix | None = None) -> Finding:
        """Returns a violation of this rule in an XML element."""
        return self.finding(message, remedy, Place(element.file, element.line), str(element), fix=fix)

    def in_model(self, model: Path, message: str, remedy: str = "") -> Finding:
        """Returns a violation of this rule by a model as a whole."""
        return self.finding(message, remedy, Place(model))


def rule(code: str, severity: str, title: str, fix: str = "") -> Callable[[Violations], Rule]:
    """Turns the function that finds violations into a rule."""
    return lambda violations: Rule(code, severity, title, violations, fix)


def words_fix(
    context: "CheckContext",
    element: Element | None,
    attribute: str,
    words: Mapping[int, str],
    *changes: tuple[str, str],
) -> Fix | str:
    """Returns the fix that replaces words of an attribute, and may change these fields of objects."""
    if not words:
        return NOT_CERTAIN
    if element is None or attribute not in element.attributes:
        return GENERATED
    return Fix(context.editor.with_words(element, attribute, words), changes)


def _made(fix: MakeFix) -> Fix | str:
    """Returns the fix, or the reason why it is impossible."""
    try:
        return fix()
    except UneditableError as error:
        return clean(str(error))
