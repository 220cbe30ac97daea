"""Results of earlier checks, in the user's cache folder: a model is checked again only if something has changed.

The name of an entry is a hash of everything that a result depends on: the content of all files that MuJoCo may open
for the model, and which of them are missing; the settings; the versions of mjrun, MuJoCo and NumPy. Another entry
stores that name with the versions of these files, so that none is read again while all of them stay untouched. A result
that names files beside a missing one is stored with the versions of the folders in which they were searched.
"""

import hashlib
import json
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from mjrun.check.rules.check_itself import CRASH, INTERNAL_ERROR, MISSING_MODEL, OUT_OF_MEMORY, TIMEOUT
from mjrun.check.worker_pool import CheckRequest
from mjrun.confinement.confinement import confinement
from mjrun.file_version import file_version, folder_version, is_settled
from mjrun.formats.input_file import in_any_case
from mjrun.formats.user_cache import FileDigestCache, UserCache, program_facts

LIMITS = {"timeout", "memory", "cache"}  # of a task, which do not affect a result that is complete
# Findings that may differ in the next check although no file of the model has changed.
DISTURBED = {rule.code for rule in (CRASH, INTERNAL_ERROR, MISSING_MODEL, OUT_OF_MEMORY, TIMEOUT)}
MISSING_FILE = "MJ107"  # its remedy names other files, which may come and go; the rule itself is slow to import
SEARCHED = 2000  # most folders in which these files may be; with more, the result is not stored

Messages = Sequence[Mapping[str, Any]]


class ResultCache:
    """A cache of the results of checks, which several processes may share.

    Args:
      versions: the versions of packages by name.

    Attributes:
      entries: the stored entries.
    """

    def __init__(self, versions: Mapping[str, str]) -> None:
        self.entries = UserCache("check")
        self._versions, self._digests = dict(versions), FileDigestCache()

    def key(self, task: CheckRequest) -> str:
        """Returns the name of the entry for a check; empty if the result depends on more than files and settings."""
        if confinement() is not None or task.reader:  # tasks run code
            return ""
        settings = {name: value for name, value in vars(task).items() if name not in LIMITS}
        facts = [program_facts(), self._versions, str(Path.cwd()), settings]
        untouched = self.entries.read(_digest(facts))
        if untouched and all(file_version(place) == version for place, version in untouched["files"].items()):
            return untouched["key"]
        since, states = time.time_ns(), self._states(task.path)
        if not states:
            return ""
        key, versions = _digest([*facts, states]), {place: file_version(place) for place in states}
        if all(version is None or is_settled(version, since) for version in versions.values()):
            self.entries.write(_digest(facts), {"key": key, "files": versions})
        return key

    def _states(self, model: str) -> dict[str, str]:
        """Returns the digests of all files that MuJoCo may open for a model; none if it may open others."""
        from mjrun.model.model_files import main_text, places_of_files  # slow to import

        path = Path(model)
        files = places_of_files(path, *main_text(path))
        if files is None:
            return {}
        return {place: self._digests.of(place) for place in (model, *chain.from_iterable(files))}

    def read(self, key: str) -> Messages | None:
        """Returns the messages of an earlier check; None without one."""
        entry = self.entries.read(key) if key else None
        if not entry or any(folder_version(place) != version for place, version in entry["folders"].items()):
            return None
        return entry["messages"]

    def write(self, key: str, task: CheckRequest, messages: Messages, began: int) -> None:
        """Stores the messages of a check that is complete, unless its files have changed since it `began` [ns]."""
        codes = {message["finding"]["code"] for message in messages if "finding" in message}
        is_complete = any("done" in message for message in messages) and not codes & DISTURBED
        if not key or not is_complete or self.key(task) != key:
            return
        folders: dict[str, list[int] | None] = {}
        if MISSING_FILE in codes:
            missing = [place for place, digest in self._states(task.path).items() if not digest]
            folders = {place: folder_version(place) for place in _searched_folders(task.path, missing)}
            if len(folders) > SEARCHED or not all(each is None or is_settled(each, began) for each in folders.values()):
                return
        kept = [message for message in messages if message.keys().isdisjoint({"pid", "stage"})]
        self.entries.write(key, {"messages": kept, "folders": folders})


def _searched_folders(model: str, missing: Iterable[str]) -> set[str]:
    """Returns the folders of missing files in any case, and all below that of the model; not many above `SEARCHED`."""
    parents = {parent for place in missing for parent in Path(place).parents}
    found = {str(folder) for parent in parents for folder in (parent, *in_any_case(parent))}
    for parent, folders, _ in os.walk(os.path.dirname(model) or "."):  # noqa: PTH120
        folders[:] = [name for name in folders if not name.startswith(".")]
        found.add(parent)
        if len(found) > SEARCHED:
            break
    return found


def _digest(facts: object) -> str:
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()
