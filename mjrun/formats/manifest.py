"""What made an output: a JSON document beside it, with a fingerprint of every file."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.destinations import StagedFile


class ManifestWriter(OutputWriter):
    """Writes one manifest. Opening it proves that the output can be written.

    Raises:
      FileError: the output cannot be written.
    """

    def __init__(self, output: str) -> None:
        super().__init__(StagedFile(Path(output)))

    def write(self, facts: Mapping[str, Any], files: Iterable[Path]) -> None:
        """Writes `facts`, and the fingerprints of `files` under `outputs`.

        Raises:
          FileError: it cannot be written.
        """
        with self.writing():
            document = with_fingerprints(facts, files)
        self.write_document(document)

    def write_document(self, manifest: Mapping[str, Any]) -> None:
        """Writes a manifest that has its fingerprints already.

        Raises:
          FileError: it cannot be written.
        """
        self.write_file(f"{json.dumps(manifest, indent=2, default=str)}\n".encode())


def with_fingerprints(facts: Mapping[str, Any], files: Iterable[Path]) -> dict[str, Any]:
    """`facts`, and the fingerprints of `files` under `outputs`."""
    return {**facts, "outputs": [fingerprint(file) for file in files]}


def parse_manifest(text: str | bytes | None) -> dict[str, Any] | None:
    """The manifest in a file, or None if there is none; the file is not trusted, and may say anything."""
    try:
        manifest = json.loads(text or "null")
    except (ValueError, RecursionError):
        return None
    return manifest if isinstance(manifest, dict) else None


def fingerprint(path: Path) -> dict[str, object]:
    """Path, size [bytes] and SHA-256 of a file."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256")
        return {"path": str(path), "bytes": file.tell(), "sha256": digest.hexdigest()}
