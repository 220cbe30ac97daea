"""Results of the check of one model, and of its fixes."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from mjrun.check.rule import Finding
from mjrun.dataclass import dataclass


@dataclass(frozen=True)
class ModelResult:
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


def without_repeats(models: Iterable[ModelResult]) -> Iterator[ModelResult]:
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


class FixOutcome(NamedTuple):
    """The outcome of the fixes of a model.

    Attributes:
      changes: the fields of the compiled model that differ from those of the original, each with its object; None if
        the original was not loaded, too.
    """

    result: ModelResult
    changes: Sequence[tuple[str, str]] | None = None


class Copy(NamedTuple):
    """A copy of a model.

    Attributes:
      model: the path of the model, as given.
      path: the path of the copy, below the folder `root`, which mirrors absolute paths.
      original: the path of the model to compare it with.
    """

    model: str
    path: Path
    root: Path
    original: Path
