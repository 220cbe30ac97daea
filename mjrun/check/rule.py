"""Rules, the findings and violations that they produce, and the results for models: a rule has a code, a severity and a
title.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from mjrun.dataclass import dataclass
from mjrun.errors import clean, option
from mjrun.model.text_edits import TextEdit, UneditableError
from mjrun.model.xml_source import Element
from mjrun.options.check import SEVERITIES as CHOICES

if TYPE_CHECKING:
    from mjrun.check.context import CheckContext

MAX_OBJECTS = 5  # that a text names in addition to the finding's own
SEVERITIES = CHOICES[::-1]  # in ascending order
SAFE, UNSAFE = "safe", "unsafe"  # fixes that are certain, and fixes that need a look

# Reasons why a fault is not fixed.
NOT_CERTAIN = "the right fix of this case depends on what was meant"
NOT_SAFE = f"{option('unsafe_fixes')} may fix it"
GENERATED = "MuJoCo or an attached model generates it: no text of this model states the value"


@dataclass(frozen=True)
class Fix:
    """A fix of a fault by edits of the text of the model.

    Attributes:
      edits: the edits, which are made together or left out together; some may create files.
      changes: what it may change in the compiled model, as pairs of a field, with wildcards, and an object as `mjrun
        diff` names it: `("jnt_*", "knee")`. `geom` is a new or removed geom; the object `geom:*` is each one without a
        name, and "" the model.
      files: files that only the fixed model reads.
    """

    edits: tuple[TextEdit, ...]
    changes: tuple[tuple[str, str], ...] = ()
    files: tuple[str, ...] = ()


@dataclass(frozen=True)
class Finding:
    """A fault in a model, or a remark about it.

    Attributes:
      code: the code of the rule, such as `MJ301`; stable.
      severity: `error`, `warning` or `note`.
      message: the fault, in one line, without the objects that have it.
      file: the model, or a file that it includes. For an attached model, the file that attaches it.
      line: the line in `file`, counted from 1, if known.
      object: the object with the fault, such as `joint 'knee'`; empty for the whole model.
      remedy: the remedy.
      fixes: the fixes of the fault, several for a finding about several objects.
      others: the other objects with the same fault; empty texts for those without a name.
      unfixed: the reason why it has no fix, although its rule fixes some faults; else empty.

    All texts except `code` and `severity` may contain unescaped names from the model.
    """

    code: str
    severity: str
    message: str
    file: str
    line: int | None = None
    object: str = ""
    remedy: str = ""
    fixes: tuple[Fix, ...] = ()
    others: tuple[str, ...] = ()
    unfixed: str = ""

    @property
    def text(self) -> str:
        """The message, and the first of the other objects."""
        if not self.others:
            return self.message
        names = [*self.others[:MAX_OBJECTS], *(["…"] if len(self.others) > MAX_OBJECTS else [])]
        listed = f": {', '.join(names)}" if all(names) else " like it"
        return f"{self.message} (and {len(self.others)} more{listed})"

    @classmethod
    def read(cls, values: dict[str, Any]) -> "Finding":
        """Returns the finding that `asdict` has turned into `values`."""
        fixes = [
            Fix(
                tuple(TextEdit(**edit) for edit in fix["edits"]),
                tuple((field, name) for field, name in fix["changes"]),
                tuple(fix["files"]),
            )
            for fix in values["fixes"]
        ]
        made: dict[str, Any] = {"fixes": tuple(fixes), "others": tuple(values["others"])}
        return cls(**values | made)


class Place(NamedTuple):
    """A place in a file, by its line.

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
      fix: makes the fix, or returns the reason why it is impossible; None if it is never possible.
    """

    message: str
    remedy: str
    place: Place
    object: str = ""
    severity: str = ""
    fix: "MakeFix | None" = None


def short_path(path: Path) -> str:
    """Returns `path` without detours such as `arm/../hand/hand.xml`, if it still refers to the same file."""
    short = Path(os.path.normpath(path))
    with suppress(OSError, ValueError):
        if short != path and short.samefile(path):
            return str(short)
    return str(path)


Violations = Callable[["CheckContext"], Iterator[Violation]]
MakeFix = Callable[[], Fix | str]


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


@dataclass(frozen=True)
class ModelCheckResult:
    """The result for one model.

    Attributes:
      model: the path of the model, as given.
      loads: true if it loads, and the process that checked it survived.
      findings: the selected findings, in the order of their discovery.
      suppressed: the number of findings that comments in the model suppress.
      known: the number of findings that are in the baseline.
    """

    model: str
    loads: bool
    findings: tuple[Finding, ...]
    suppressed: int = 0
    known: int = 0

    def count(self, severity: str) -> int:
        """Returns the number of findings of this severity."""
        return sum(finding.severity == severity for finding in self.findings)


def without_repeats(models: Iterable[ModelCheckResult]) -> Iterator[ModelCheckResult]:
    """Yields models without the findings of earlier ones, which are in a file that both include."""
    first = dict[tuple[object, ...], str]()
    for model in models:
        keys = [(each.code, each.severity, each.file, each.line, each.object, each.text) for each in model.findings]
        own = (
            finding
            for finding, key in zip(model.findings, keys, strict=True)
            if not finding.line or first.setdefault(key, model.model) == model.model
        )
        yield replace(model, findings=tuple(own))


@dataclass(frozen=True)
class FixedFile:
    """A file that was fixed or created, or would be.

    Attributes:
      file: the path of the file.
      fixes: the number of faults that were fixed in it, by the code of their rule; in the first file of several.
      diff: the change as a unified diff.
      is_new: true if the file was created.
    """

    file: str
    fixes: Mapping[str, int]
    diff: str
    is_new: bool = False


class FixResult(NamedTuple):
    """The result of the fixes of a model.

    Attributes:
      changes: the fields of the compiled model that differ from those of the original, each with its object; None if
        the original was not loaded, too.
    """

    result: ModelCheckResult
    changes: Sequence[tuple[str, str]] | None = None


class FixedModelCopy(NamedTuple):
    """A copy of a model with its fixes, to be compared with the original.

    Attributes:
      model: the path of the model, as given.
      path: the path of the copy, below the folder `root`, which mirrors absolute paths.
      original: the path of the model to compare it with.
    """

    model: str
    path: Path
    root: Path
    original: Path
