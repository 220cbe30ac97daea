"""The folder of an evaluation: what is in it, and what it may replace."""

import contextlib
import json
import re
from collections.abc import Collection, Mapping
from pathlib import Path

from mjrun.errors import FileError, clean, option
from mjrun.formats.atomic_output import OutputWriter, written_file
from mjrun.formats.destinations import StagedFile
from mjrun.formats.input_file import exists, is_file, is_folder
from mjrun.options.evaluation import MANIFEST

FILMS = re.compile(r"(worst|median|best|rank\d+)(_point\d+)?_seed\d+\.mp4")


class ResultsFolder:
    """The folder at `path`. Only what an evaluation has written is ever replaced or removed.

    Raises:
      FileError: it cannot be made or written, or holds something else.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._require_ours()
        StagedFile(path / MANIFEST).discard()  # which proves that it can be written

    def remove_old_films(self, films: Collection[str]) -> None:
        """Removes those of an evaluation before, which would be taken for `films`, the names of the new ones."""
        for path in self.path.iterdir():
            if FILMS.fullmatch(path.name) and path.name not in films:
                path.unlink(missing_ok=True)

    def write_manifest(self, stack: contextlib.ExitStack, facts: Mapping[str, object]) -> OutputWriter:
        """Writes what made the results, and what they are; it still has to be published, or `stack` discards it."""
        text = f"{json.dumps(facts, indent=2, default=str)}\n"
        return stack.enter_context(written_file(self.path / MANIFEST, text.encode()))

    def _require_ours(self) -> None:
        path = self.path
        if not exists(path):
            return
        if not is_folder(path):
            raise FileError(path, "is no folder", f"{option('output')} names the folder of the results")
        if any(path.iterdir()) and not is_file(path / MANIFEST):
            hint = f"{option('output')} names a folder that is new, empty, or of an evaluation before"
            raise FileError(path, f"holds other things than an evaluation: it has no {clean(MANIFEST)}", hint)
