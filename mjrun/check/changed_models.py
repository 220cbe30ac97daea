"""Models that have changed since a commit of git: those of which a file, an include or an asset differs or is new."""

import os
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path

from mjrun.child_process import ChildProcess
from mjrun.confinement.confinement import require_unconfined
from mjrun.errors import BadValueError, UsageError, clean, option
from mjrun.model.model_files import main_text, places_of_files
from mjrun.suffixes import is_yaml

LARGEST = 2**30  # bytes of a list of files
SHALLOW = "in a shallow clone, fetch it first: git fetch origin REF, or fetch-depth: 0 of actions/checkout"


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
            with ChildProcess(command, stdout="capture", stderr="capture", stdout_limit=LARGEST) as process:
                succeeds = process.wait().code == 0
                return os.fsdecode(process.stdout) if succeeds else ""
        except FileNotFoundError:
            raise UsageError(f"{option('changed_since')} requires git, which is not installed") from None
