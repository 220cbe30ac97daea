"""Tests of the hashes of files, which are read again only if they have changed."""

import os
import time
from pathlib import Path

import pytest

from mjrun.formats import file_digests
from mjrun.formats.file_digests import FileDigestCache


def test_a_file_that_is_written_again_has_another_hash(tmp_path: Path) -> None:
    digests, path = FileDigestCache(), tmp_path / "a"
    assert digests.of(str(path)) == digests.of(str(tmp_path)) == digests.of("\0") == ""
    path.write_bytes(b"1")
    first = digests.of(str(path))
    assert first == digests.of(str(path)) == "6b86b273ff34fce19d6b804eff5a3f5747ada4eaa22f1d49c01e52ddb7875b4b"
    path.write_bytes(b"2")
    os.utime(path, (1, 1))
    assert digests.of(str(path)) not in ("", first)


@pytest.mark.parametrize(("age", "is_read_again"), [(0, True), (10, False)])
def test_a_file_that_has_just_changed_may_change_again_at_the_same_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, age: float, is_read_again: bool
) -> None:
    changed = time.time_ns() - int(age * 1e9)
    monkeypatch.setattr(file_digests, "file_version", lambda place: [1, 1, 1, changed, changed])
    digests, path = FileDigestCache(), tmp_path / "a"
    path.write_bytes(b"1")
    first = digests.of(str(path))
    path.write_bytes(b"2")
    assert (digests.of(str(path)) != first) is is_read_again
