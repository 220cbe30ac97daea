"""Checks of what is new: findings that are not in a baseline, and models that have changed since a commit of git.

A model has changed if its file, an include or an asset differs or is new.
"""

import json
import os
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from mjrun.check.finding import Finding
from mjrun.child_process import ChildProcess
from mjrun.confinement.confinement import require_unconfined
from mjrun.errors import BadValueError, FileError, UsageError, clean, option
from mjrun.formats.input_file import exists, opened
from mjrun.formats.local_and_remote_folders import written_file
from mjrun.formats.output_writer import publish_together, require_own
from mjrun.model.model_files import main_text, places_of_files
from mjrun.suffixes import is_yaml

SCHEMA = "mjrun-baseline-1"
KIND = "a baseline of mjrun check"
LARGEST = 2**26  # bytes
ID = re.compile(r"(?<= )\d+(?= of )|(?<=:)\d+(?=')")  # of an object without a name
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
LONGEST = 2**30  # bytes of a list of files
SHALLOW = "in a shallow clone, fetch it first: git fetch origin REF, or fetch-depth: 0 of actions/checkout"


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
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
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


# --- models that have changed ------------------------------------------------------------------------


class ChangedModels:
    """The files that have changed in the repository of the working folder since it branched off from a commit.

    Args:
      ref: a branch, tag or commit.

    Raises:
      UsageError: the working folder is not in a repository, git is not installed, or the commit does not exist.
    """

    def __init__(self, ref: str) -> None:
        require_unconfined(f"{option('changed_since')} runs git")
        self._root = os.curdir
        root = self._git("rev-parse", "--show-toplevel")
        if not root:
            raise UsageError(
                f"{option('changed_since')} requires a git repository\ncd into one that contains the models"
            )
        self._root = os.path.realpath(root.rstrip("\n"))
        self._commit = self._git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{ref}^{{commit}}").strip()
        if not self._commit:
            expected = f"a branch, tag or commit of this repository\n{SHALLOW}"
            raise BadValueError(option("changed_since"), ref, expected)
        self._folders: dict[str, str] = {}

    def of(self, models: Iterable[str]) -> list[str]:
        """Returns the models that have changed.

        Raises:
          UsageError: a model is in another folder than that of the repository.
        """
        return [model for model in models if self._has_changed(model)]

    def _has_changed(self, model: str) -> bool:
        """Returns whether a model may have changed; tasks and plugins may use files whose names are not known."""
        if not self._real(model).startswith(f"{self._root}{os.sep}"):
            raise UsageError(f"{clean(model)} is not in the repository {clean(self._root)}, whose changes are known")
        places = None if is_yaml(model) else places_of_files(Path(model), *main_text(Path(model)))
        if places is None:
            return True
        return not self._changed.isdisjoint(self._files(model, *(place for each in places for place in each)))

    def _files(self, *places: str) -> Iterator[str]:
        """Yields the absolute path of each place, and those of links and of the files that these lead to."""
        for place in places:
            path = self._real(place)
            yield path
            if os.path.islink(path):  # noqa: PTH114 – of thousands
                yield os.path.realpath(path)

    def _real(self, place: str) -> str:
        """Returns an absolute path in which folders are no links."""
        folder, name = os.path.split(os.path.abspath(place))  # noqa: PTH100
        if folder not in self._folders:
            self._folders[folder] = os.path.realpath(folder)
        return os.path.join(self._folders[folder], name)  # noqa: PTH118

    @cached_property
    def _changed(self) -> frozenset[str]:
        """The absolute paths of files that differ from the commit, including missing ones and those not in git."""
        base = self._git("merge-base", self._commit, "HEAD").strip() or self._commit
        differing = self._git("diff", "--name-only", "--no-renames", "-z", base, "--")
        new = self._git("ls-files", "--others", "--exclude-standard", "-z")
        return frozenset(f"{self._root}{os.sep}{Path(name)}" for name in (differing + new).split("\0") if name)

    def _git(self, *arguments: str) -> str:
        """Returns the output of git in the root of the repository; an empty text if it fails."""
        try:
            # A repository can name a program that observes its files, which git would run.
            command = ("git", "-c", "core.fsmonitor=false", "-C", self._root, *arguments)
            with ChildProcess(command, stdout="capture", stderr="capture", stdout_limit=LONGEST) as process:
                succeeds = process.wait().code == 0
                return os.fsdecode(process.stdout) if succeeds else ""
        except FileNotFoundError:
            raise UsageError(f"{option('changed_since')} requires git, which is not installed") from None
