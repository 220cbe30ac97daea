"""Findings: the violations of rules with their fixes, and what was found and fixed in each model."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from mjrun.dataclass import dataclass
from mjrun.model.text_edits import TextEdit
from mjrun.options.check import SEVERITIES as CHOICES

MAX_OBJECTS = 5  # that a text names in addition to the finding's own
SEVERITIES = CHOICES[::-1]  # in ascending order


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


MakeFix = Callable[[], Fix | str]


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
    fix: MakeFix | None = None


def short_path(path: Path) -> str:
    """Returns `path` without detours such as `arm/../hand/hand.xml`, if it still refers to the same file."""
    short = Path(os.path.normpath(path))
    with suppress(OSError, ValueError):
        if short != path and short.samefile(path):
            return str(short)
    return str(path)


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
