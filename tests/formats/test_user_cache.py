"""Theorems about the user's cache: entries are read as they were written, or not at all."""

import os
import time
from pathlib import Path

import pytest

from mjrun.formats import user_cache
from mjrun.formats.user_cache import VARIABLE, FileDigestCache, UserCache, program_facts


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache for one test."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache" / "test"


def test_damaged_entries_and_folders_that_cannot_be_written_are_no_hindrance(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = UserCache("test")
    cache.write("a", {"b": [1, "ä"]})
    assert cache.read("a") == {"b": [1, "ä"]}
    assert UserCache("other").read("a") is None
    whole = (folder / "a").read_bytes()
    for damaged in (b"[{", b"[1]", whole[:-1], whole.replace(b"1", b"2")):
        (folder / "a").write_bytes(damaged)
        assert cache.read("a") is None
    monkeypatch.setenv(VARIABLE, os.devnull)
    blocked = UserCache("test")
    blocked.write("a", 1)
    assert blocked.read("a") is None


def test_entries_in_a_read_only_folder_are_read_however_old_they_are(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError  # as for the file of another user, or in an image of a container

    cache = UserCache("test")
    cache.write("a", 1)
    os.utime(folder / "a", (1000, 1000))
    monkeypatch.setattr(os, "utime", refused)
    assert cache.read("a") == 1


def test_an_entry_that_cannot_be_stored_leaves_no_file(folder: Path) -> None:
    (folder / "a").mkdir(parents=True)  # in the way of the entry
    UserCache("test").write("a", 1)
    assert [path.name for path in folder.iterdir()] == ["a"]


def test_nothing_is_stored_for_a_user_without_a_home_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # as where the user has no entry either
    before = {*Path().iterdir()}
    UserCache("test").write("a", 1)
    assert {*Path().iterdir()} == before


def test_the_entries_used_least_recently_are_removed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder.mkdir(parents=True)
    for age in range(4):
        (folder / str(age)).write_bytes(bytes(100))
        os.utime(folder / str(age), (1000 - age, 1000 - age))
    monkeypatch.setattr(user_cache, "LARGEST", 300)
    cache = UserCache("test")
    cache.trim()
    assert len([*folder.iterdir()]) == 4  # it has added nothing
    cache.write("a", "b" * 33)  # and 67 bytes of the digest and the quotes
    cache.trim()
    assert {path.name for path in folder.iterdir()} == {"a", "0", "1"}


def test_a_change_of_the_program_is_seen_without_another_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(user_cache, "PACKAGE", tmp_path)
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "b.py").write_text("1")

    def facts() -> object:
        program_facts.cache_clear()
        return program_facts()

    first = facts()
    assert facts() == first
    (tmp_path / "a" / "__pycache__").mkdir()
    (tmp_path / "a" / "__pycache__" / "b.py").touch()
    assert facts() == first
    (tmp_path / "a" / "b.py").write_text("12")
    assert facts() != first
    program_facts.cache_clear()


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
    monkeypatch.setattr(user_cache, "file_version", lambda place: [1, 1, 1, changed, changed])
    digests, path = FileDigestCache(), tmp_path / "a"
    path.write_bytes(b"1")
    first = digests.of(str(path))
    path.write_bytes(b"2")
    assert (digests.of(str(path)) != first) is is_read_again
