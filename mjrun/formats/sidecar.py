"""The manifest of a table whose format cannot hold one, in a file beside it: `golden.csv.json` of `golden.csv`.

It names the table's size and SHA-256, so that one which belongs to another state of the file is not taken for its own.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.manifest import ManifestWriter, fingerprint, parse_manifest
from mjrun.formats.tables import format_of_suffix

MOST = 2**24  # bytes of a sidecar that are read, at most


def sidecar_path(table: Path) -> Path | None:
    """Where the manifest of a table is; None if its format holds the manifest itself."""
    known = format_of_suffix(table.suffix)
    return None if known is None or known.holds_manifest else table.with_name(f"{table.name}.json")


def read_sidecar(table: Path) -> dict[str, Any] | None:
    """The manifest beside a table; None if there is none, or if the table is not the one that it was written for."""
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
    """Whether one of the outputs that a manifest lists is `table`, as it is now."""
    if not isinstance(outputs, list):
        return False
    size = table.stat().st_size
    same_size = [output for output in outputs if isinstance(output, dict) and output.get("bytes") == size]
    return bool(same_size) and fingerprint(table)["sha256"] in [output.get("sha256") for output in same_size]


class SidecarWriter(ManifestWriter):
    """Writes the manifest of a table that is finished before it, and published with it."""

    def __init__(self, table: OutputWriter, path: Path, facts: Mapping[str, Any]) -> None:
        super().__init__(str(path))
        self._table, self._facts = table.destination, facts

    def complete(self) -> None:
        table = {**fingerprint(Path(self._table.path)), "path": str(self._table.shown)}
        self.write_document({**self._facts, "outputs": [table]})
