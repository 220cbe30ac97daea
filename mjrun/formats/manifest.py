"""What made an output: a JSON document beside it, with a fingerprint of every file."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from mjrun.errors import FileError
from mjrun.formats.publishing import StagedFile


class ManifestWriter:
    """Writes one manifest; without an output it does nothing. Opening it proves that the output can be written.

    Raises:
      FileError: the output cannot be written.
    """

    def __init__(self, output: str | None) -> None:
        self._target = None if output is None else StagedFile(Path(output))

    def publish(self, facts: Mapping[str, Any], files: Iterable[Path]) -> None:
        """Writes `facts`, and the fingerprints of `files` under `outputs`.

        Raises:
          FileError: it cannot be written.
        """
        if self._target is None:
            return
        document = {**facts, "outputs": [fingerprint(file) for file in files]}
        try:
            Path(self._target.path).write_text(json.dumps(document, indent=2, default=str) + "\n", "utf-8")
        except OSError as error:
            raise FileError(self._target.shown, f"cannot be written: {error.strerror or error}") from None
        self._target.publish()

    def __enter__(self) -> "ManifestWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._target:
            self._target.discard()


def fingerprint(path: Path) -> dict[str, Any]:
    """Path, size [bytes] and SHA-256 of a file."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256")
        return {"path": str(path), "bytes": file.tell(), "sha256": digest.hexdigest()}
