"""Results of earlier checks, in the user's cache folder: a model is checked again only if something has changed.

The name of an entry is a hash of everything that a result depends on: the content of all files that MuJoCo may open
for the model, and which of them are missing; the settings; the versions of mjrun, MuJoCo and NumPy.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mjrun.check.rules.process_failures import CRASH, INTERNAL_ERROR, OUT_OF_MEMORY, TIMEOUT
from mjrun.check.worker_pool import WorkerTask
from mjrun.confinement.confinement import confinement
from mjrun.formats.user_cache import FileDigests, UserCache, program_facts
from mjrun.model.archive_paths import main_text
from mjrun.model.referenced_files import places_of_files
from mjrun.suffixes import ARCHIVES

LIMITS = {"timeout", "memory"}  # of a task, which do not affect a result that is complete
DISTURBED = {rule.code for rule in (CRASH, INTERNAL_ERROR, OUT_OF_MEMORY, TIMEOUT)}  # may differ the next time

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
        self._versions, self._digests = dict(versions), FileDigests()

    def key(self, task: WorkerTask) -> str:
        """Returns the name of the entry for a check; empty if the result depends on more than files and settings."""
        if confinement() is not None or task.reader:  # tasks run code
            return ""
        path = Path(task.path)
        text, main = main_text(path)
        files = places_of_files(path, text, main)
        if files is None:
            return ""
        states = {place: self._digests.of(place) for places in files for place in places}
        # A remedy for a missing file names others, which may come and go.
        if path.suffix not in ARCHIVES and not all(any(states[place] for place in places) for places in files):
            return ""
        settings = {name: value for name, value in asdict(task).items() if name not in LIMITS}
        facts = [program_facts(), self._versions, str(Path.cwd()), settings, self._digests.of(task.path), states]
        return hashlib.sha256(json.dumps(facts).encode()).hexdigest()

    def read(self, key: str) -> Messages | None:
        """Returns the messages of an earlier check; None without one."""
        return self.entries.read(key) if key else None

    def write(self, key: str, task: WorkerTask, messages: Messages) -> None:
        """Stores the messages of a check that is complete, unless its files have changed since it began."""
        codes = {message["finding"]["code"] for message in messages if "finding" in message}
        is_complete = any("done" in message for message in messages) and not codes & DISTURBED
        if not key or not is_complete or self.key(task) != key:
            return
        kept = [message for message in messages if message.keys().isdisjoint({"pid", "stage"})]
        self.entries.write(key, kept)
