"""Manifests, beside hashlib and json."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from mjrun.formats.manifest import ManifestWriter, TableManifestWriter, fingerprint, read_sidecar, sidecar_path
from mjrun.formats.output_writer import OutputWriter, StagedFile, publish_together
from mjrun.formats.table_reader import open_table
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import FORMATS
from mjrun.model.table_column import Column


def test_a_manifest_holds_facts_and_the_hash_of_every_file(tmp_path: Path) -> None:
    made = tmp_path / "a.csv"
    made.write_bytes(b"time\n0\n")
    entry = {"path": str(made), "bytes": 7, "sha256": hashlib.sha256(b"time\n0\n").hexdigest()}
    assert fingerprint(made) == entry
    with ManifestWriter(str(tmp_path / "m.json")) as writer:
        writer.write({"seed": 7, "model": Path("a.xml")}, [made])
        assert not (tmp_path / "m.json").exists()
        assert writer.publish() == [tmp_path / "m.json"]
    assert json.loads((tmp_path / "m.json").read_text()) == {"seed": 7, "model": "a.xml", "outputs": [entry]}


def test_formats_that_hold_no_manifest_have_a_sidecar(tmp_path: Path) -> None:
    for name, known in FORMATS.items():
        path = tmp_path / f"table{known.suffixes[0]}"
        with TableWriter(str(path), name, [Column("time", "s")], {"mjrun": "1"}) as writer:
            writer.write(np.zeros((1, 1)))
            writer.publish()
        with open_table(path) as table:
            assert (table.manifest is None) == (sidecar_path(path) is not None)


def written(table: Path, text: str) -> None:
    path = sidecar_path(table)
    assert path
    assert path == table.parent / "golden.csv.json"
    with OutputWriter(StagedFile(table)) as writer, TableManifestWriter(writer, path, {"mjrun": "1.2"}) as sidecar:
        writer.write_file(text.encode())
        publish_together([writer, sidecar])


def test_a_sidecar_is_of_the_table_as_it_was(tmp_path: Path) -> None:
    table = tmp_path / "golden.csv"
    written(table, "time\n0\n")
    assert (read_sidecar(table) or {})["mjrun"] == "1.2"
    table.write_text("time\n1\n")
    assert read_sidecar(table) is None


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"outputs": 3}', '{"outputs": [3, {"bytes": 7}, {"bytes": 7, "sha256": 1}]}']
)
def test_what_is_no_manifest_is_none(tmp_path: Path, text: str) -> None:
    table = tmp_path / "golden.csv"
    table.write_text("time\n0\n")
    assert read_sidecar(table) is None
    (tmp_path / "golden.csv.json").write_text(text)
    assert read_sidecar(table) is None
