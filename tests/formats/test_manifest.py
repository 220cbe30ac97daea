"""Manifests, beside hashlib and json."""

import hashlib
import json
from pathlib import Path

import pytest

from mjrun.errors import FileError
from mjrun.formats.manifest import ManifestWriter, fingerprint


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


def test_a_manifest_that_is_not_published_leaves_no_trace(tmp_path: Path) -> None:
    with ManifestWriter(str(tmp_path / "m.json")) as writer:
        writer.write({}, [])
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileError, match="is not a folder"):
        ManifestWriter("/dev/null/m.json")
