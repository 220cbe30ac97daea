"""Manifests: JSON documents that state how outputs were made, with a fingerprint of every file."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mjrun.formats.input_file import parse_manifest
from mjrun.formats.output_writer import OutputWriter, StagedFile
from mjrun.formats.tables import format_of_suffix

MOST = 2**24  # bytes of a sidecar that are read, at most


class ManifestWriter(OutputWriter):
    """A writer of one manifest. Opening it checks that the output can be written.

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
        """Writes a manifest that already has its fingerprints.

        Raises:
          FileError: it cannot be written.
        """
        self.write_file(f"{json.dumps(manifest, indent=2, default=str)}\n".encode())


def with_fingerprints(facts: Mapping[str, Any], files: Iterable[Path]) -> dict[str, Any]:
    """Returns `facts`, and the fingerprints of `files` under `outputs`."""
    return {**facts, "outputs": [fingerprint(file) for file in files]}


def fingerprint(path: Path) -> dict[str, object]:
    """Returns path, size [bytes] and SHA-256 of a file."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256")
        return {"path": str(path), "bytes": file.tell(), "sha256": digest.hexdigest()}


def sidecar_path(table: Path) -> Path | None:
    """Returns the path of the manifest of a table; None if the table itself holds it."""
    known = format_of_suffix(table.suffix)
    return table.with_name(f"{table.name}.json") if known and known.is_text else None


def read_sidecar(table: Path) -> dict[str, Any] | None:
    """Returns the manifest beside a table; None if it is missing, or was written for another table."""
    path = sidecar_path(table)
    try:
        if path is None or path.stat().st_size > MOST:
            return None
        manifest = parse_manifest(path.read_bytes())
        if manifest is None or not _describes(manifest.get("outputs"), table):
            return None
    except OSError:
        return None
    return manifest


def _describes(outputs: object, table: Path) -> bool:
    """Returns whether one of the outputs that a manifest lists is `table` in its present state."""
    if not isinstance(outputs, list):
        return False
    size = table.stat().st_size
    same_size = [output for output in outputs if isinstance(output, dict) and output.get("bytes") == size]
    return bool(same_size) and fingerprint(table)["sha256"] in [output.get("sha256") for output in same_size]


class TableManifestWriter(ManifestWriter):
    """A writer of the manifest of a table that is finished before it, and published with it."""

    def __init__(self, table: OutputWriter, path: Path, facts: Mapping[str, Any]) -> None:
        super().__init__(str(path))
        self._table, self._facts = table.destination, facts

    def finish(self) -> None:
        table = {**fingerprint(Path(self._table.path)), "path": str(self._table.shown)}
        self.write_document({**self._facts, "outputs": [table]})
        super().finish()
