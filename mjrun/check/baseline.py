"""Baselines: files of known findings, so that only new ones are reported."""

import json
import os
import re
from collections import Counter
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import NamedTuple

from mjrun.check.rule import Finding
from mjrun.errors import FileError, option
from mjrun.formats.input_file import exists, opened
from mjrun.formats.local_and_remote_folders import written_file
from mjrun.formats.output_writer import publish_together, require_own

SCHEMA = "mjrun-baseline-1"
KIND = "a baseline of mjrun check"
LARGEST = 2**26  # bytes
ID = re.compile(r"(?<= )\d+(?= of )|(?<=:)\d+(?=')")  # of an object without a name
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")


class KnownFinding(NamedTuple):
    """A finding without its line and its numbers, which change when other parts of a model do.

    Attributes:
      file: the path of the file relative to the folder of the baseline, with slashes.
      objects: the objects, sorted, with `#` for the ids of those without a name: `geom # of body 'thigh'`.
      message: the message with `#` for each number.
    """

    file: str
    rule: str
    objects: tuple[str, ...]
    message: str


class Baseline:
    """Known findings, each with its number of occurrences."""

    def __init__(self, folder: Path, known: Counter[KnownFinding]) -> None:
        self.folder, self.known = folder, known

    @classmethod
    def read(cls, path: Path) -> "Baseline":
        """Reads a baseline.

        Raises:
          FileError: it does not exist, or is not a baseline.
        """
        if not exists(path):
            raise FileError(path, "the baseline does not exist", f"{option('update_baseline')} creates it")
        with opened(path, "baseline", [path.suffix]) as file:
            text = file.read(LARGEST)
        try:
            document = json.loads(text)
            if document["schema"] != SCHEMA:
                raise ValueError(document["schema"])
            known = Counter[KnownFinding]()
            for entry in document["findings"]:
                file, rule, message = (str(entry[name]) for name in ("file", "rule", "message"))
                known[KnownFinding(file, rule, tuple(map(str, entry["objects"])), message)] += int(entry["count"])
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise FileError(
                path, f"is not {KIND}", f"remove it, and {option('update_baseline')} creates one"
            ) from error
        return cls(path.parent, known)

    def contains(self, finding: Finding) -> bool:
        """Returns whether a finding is known."""
        return self._known(finding) is not None

    def new(self, findings: Iterable[Finding]) -> tuple[Finding, ...]:
        """Returns the findings that are not known, and counts down the known ones."""
        new: list[Finding] = []
        for finding in findings:
            known = self._known(finding)
            if known:
                self.known[known] -= 1
            else:
                new.append(finding)
        return tuple(new)

    def _known(self, finding: Finding) -> KnownFinding | None:
        """Returns the known finding that is left, if any; it may be about more objects."""
        new = known_finding(finding, self.folder)
        if self.known[new] > 0:
            return new
        left = (known for known, count in self.known.items() if count > 0)
        same = (known for known in left if known._replace(objects=new.objects) == new)
        return next((known for known in same if Counter(new.objects) <= Counter(known.objects)), None)

    def gone(self, files: Collection[str], codes: Collection[str]) -> int:
        """Returns the number of known findings of these rules in these files that `new` has not met."""
        names = {_relative(file, self.folder) for file in files}
        return sum(count for known, count in self.known.items() if known.file in names and known.rule in codes)


def require_baseline(path: Path) -> None:
    """Refuses to replace a file that is not a baseline.

    Raises:
      FileError: it is something else.
    """
    require_own(path, SCHEMA.rpartition("-")[0], KIND)


def write_baseline(path: Path, findings: Iterable[Finding]) -> None:
    """Writes a baseline of `findings`.

    Raises:
      FileError: it cannot be written.
    """
    counts = Counter(known_finding(finding, path.parent) for finding in findings)
    entries = [{**known._asdict(), "count": count} for known, count in sorted(counts.items())]
    text = json.dumps({"schema": SCHEMA, "findings": entries}, indent=1, ensure_ascii=False)
    with written_file(path, f"{text}\n".encode()) as output:
        publish_together([output])


def known_finding(finding: Finding, folder: Path) -> KnownFinding:
    """Returns a finding as a baseline in `folder` stores it."""
    objects = sorted(ID.sub("#", name) for name in (finding.object, *finding.others))
    message = NUMBER.sub("#", finding.message)
    return KnownFinding(_relative(finding.file, folder), finding.code, tuple(objects), message)


def _relative(file: str, folder: Path) -> str:
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # on another drive
        return Path(file).as_posix()
