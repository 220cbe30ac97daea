"""Folders of file systems and of stores: files appear whole, may be created once, and errors that pass are survived."""

import errno
import itertools
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import fsspec
import numpy as np
import pytest
from fsspec.implementations.memory import MemoryFileSystem

from mjrun.errors import FileError, UsageError
from mjrun.formats.local_and_remote_folders import DELAYS, Folder, destination_at, folder_at, written_file
from mjrun.formats.output_writer import OutputWriter
from mjrun.formats.table_reader import read_table
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model.table_column import Column
from mjrun.suffixes import is_url
from tests.processes import largest_file

NUMBERS = itertools.count()


class Unsteady(MemoryFileSystem):
    """A store that answers some requests with errors.

    Attributes:
      faults: errors of the next requests, in order; None for a request that succeeds.
    """

    protocol = "unsteady"
    faults: ClassVar[list[Exception | None]] = []

    def pipe_file(self, path: str, value: bytes, mode: str = "overwrite", **_: Any) -> None:
        fault = self.faults.pop(0) if self.faults else None
        if not isinstance(fault, PermissionError):
            super().pipe_file(path, value, mode=mode)
        if fault:  # after the content was stored, as when the answer is lost
            raise fault

    def put_file(self, lpath: str, rpath: str, *_: Any, **__: Any) -> None:
        if self.faults and (fault := self.faults.pop(0)):
            raise fault
        super().put_file(lpath, rpath)


@pytest.fixture(params=["path", "file", "memory"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Folder:
    place = f"{tmp_path}/a study"
    urls = {"path": place, "file": f"file://{place}", "memory": f"memory://bucket{next(NUMBERS)}/a study/"}
    return folder_at(urls[request.param])


def test_no_folder_is_made_where_a_name_is_too_long(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="a name in it is longer than 255 bytes"):
        folder_at(f"{tmp_path}/new/{'x' * 300}/study").create()
    assert not [*tmp_path.iterdir()]


@pytest.fixture
def unsteady(monkeypatch: pytest.MonkeyPatch) -> Iterator[Folder]:
    fsspec.register_implementation("unsteady", Unsteady, clobber=True)
    pauses = list[float]()
    monkeypatch.setattr("mjrun.formats.local_and_remote_folders.time.sleep", pauses.append)
    yield folder_at(f"unsteady://bucket{next(NUMBERS)}")
    assert not Unsteady.faults
    assert pauses in ([], [*DELAYS], [DELAYS[0], *DELAYS])


def content(folder: Folder, name: str) -> bytes:
    with folder.open(name) as stream:
        stream.seek(1)
        rest = stream.read()
        stream.seek(0)
        return stream.read(1) + rest


def test_every_folder_does_the_same(folder: Folder) -> None:
    parts = folder / "parts"
    assert parts.path("x") == f"{folder.path()}/parts/x"
    assert not parts.exists()
    assert parts.names("") == []
    parts.create()
    parts.create_file("b.lease", b"one")
    with pytest.raises(FileError, match=r"b\.lease: cannot be written: .*[Ee]xists|b\.lease"):
        parts.create_file("b.lease", b"other")
    assert content(parts, "b.lease") == b"one"
    parts.rewrite("b.lease", b"2")
    assert content(parts, "b.lease") == b"2"
    assert 0 <= parts.age("b.lease") + 1 < 60
    with pytest.raises(FileError):
        parts.rewrite("a.lease", b"")
    with pytest.raises(FileNotFoundError):
        parts.age("a.lease")
    with pytest.raises(FileNotFoundError):
        parts.open("a.lease")

    with OutputWriter(parts.destination("a.parquet")) as output:
        Path(output.destination.path).write_bytes(b"whole")
        assert parts.names(".parquet") == []
        output.publish()
    with written_file(parts.path("c.parquet"), b"not published"):
        pass
    assert (parts.names(""), parts.names(".parquet")) == (["a.parquet", "b.lease"], ["a.parquet"])
    assert (parts.size("a.parquet"), parts.size("c.parquet")) == (5, 0)
    assert (parts.has("a.parquet"), parts.has("c.parquet"), folder.has("parts")) == (True, False, False)
    assert parts.exists()
    for _ in range(2):
        parts.remove("a.parquet")
    assert parts.names("") == ["b.lease"]


@pytest.mark.parametrize(("target", "place"), [("nowhere", "nowhere/parts"), ("study", "study/parts")])
def test_a_folder_below_a_link_to_nothing_is_not_created(tmp_path: Path, target: str, place: str) -> None:
    (tmp_path / "study").symlink_to(target)
    reason = f"{tmp_path}/study/parts: the link {tmp_path}/study leads to a missing folder, {tmp_path}/{place}"
    with pytest.raises(FileError, match=re.escape(reason)):
        (folder_at(tmp_path / "study") / "parts").create()


def test_a_small_file_for_which_the_disk_has_no_room_is_not_left_empty(tmp_path: Path) -> None:
    folder = folder_at(tmp_path)
    folder.create_file("a.lease", b"content")
    with largest_file(0):
        for name in ("a.lease", "b.lease"):
            with pytest.raises(FileError, match="cannot be written: File"):
                folder.create_file(name, b"content")
    assert folder.names(".lease") == ["a.lease"]


def test_a_small_file_is_created_once_where_the_file_system_has_no_hard_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    folder = folder_at(tmp_path)
    folder.create_file("a.lease", b"one")
    with pytest.raises(FileError, match=r"a\.lease: cannot be written: "):
        folder.create_file("a.lease", b"other")
    assert content(folder, "a.lease") == b"one"
    assert [*tmp_path.iterdir()] == [tmp_path / "a.lease"]


def test_a_folder_in_which_no_file_can_be_created_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, _: path != tmp_path / "parts")
    folder_at(tmp_path).create()
    with pytest.raises(FileError, match=r"/parts: the folder is not writable$"):
        (folder_at(tmp_path) / "parts").create()


def test_errors_that_pass_are_tried_again(unsteady: Folder) -> None:
    busy = OSError(errno.EBUSY, "Please reduce your request rate")
    Unsteady.faults = [busy, None]
    unsteady.create_file("a", b"content")  # the first request has created it, though its answer was lost
    assert content(unsteady, "a") == b"content"
    Unsteady.faults = [busy, TimeoutError(), None]
    with written_file(unsteady.path("b"), b"whole") as output:
        output.publish()
    assert content(unsteady, "b") == b"whole"


def test_errors_that_stay_are_raised_and_nothing_is_published(unsteady: Folder) -> None:
    Unsteady.faults = [OSError(errno.EBUSY, "Slow Down")] * (len(DELAYS) + 1)
    with (
        written_file(unsteady.path("table.csv"), b"1") as output,
        pytest.raises(FileError, match=r"^unsteady://.*/table.csv: cannot be written: Slow Down$"),
    ):
        output.publish()
    assert unsteady.names("") == []


def test_errors_are_raised_at_once_where_an_answer_is_wanted_soon(unsteady: Folder) -> None:
    Unsteady.faults = [TimeoutError("no answer")]
    with pytest.raises(FileError, match=r"/parts/a: cannot be written: no answer$"):
        (folder_at(unsteady.path(), delays=()) / "parts").create_file("a", b"")


def test_an_error_that_cannot_pass_is_raised_at_once(unsteady: Folder) -> None:
    Unsteady.faults = [PermissionError("Access Denied")]
    with pytest.raises(FileError, match=r"/a: cannot be written: Access Denied$"):
        unsteady.create_file("a", b"")


def test_urls_are_distinguished_from_paths_and_unknown_ones_refused() -> None:
    assert [is_url(text) for text in ("s3://b/x", "S3://b", "a/b://c", "c:/x", "scene:dominos", "x://")] == [
        *(True, True, False, False, False, False)
    ]
    assert not is_url(Path("s3://b"))
    with pytest.raises(UsageError, match=r"^odd://x: Protocol not known: odd$"):
        folder_at("odd://x")
    with pytest.raises(UsageError, match=r"needs a library for oci://.*\nInstall ocifs"):
        destination_at("oci://bucket/table.csv")


def test_tables_are_read_by_url() -> None:
    folder = f"memory://bucket{next(NUMBERS)}"
    for name in ("t.parquet", "t.feather", "t.csv", "t.jsonl", "t.npz", "t.mat", "t.h5"):
        with TableWriter(f"{folder}/{name}", output_format(name).name, [Column("x", "m")]) as table:
            table.write(np.array([[0.1], [2.0]]))
            table.publish()
        assert read_table(f"{folder}/{name}")["x"].tolist() == [0.1, 2.0]
    with pytest.raises(FileError, match=r"memory://bucket\d+/u.csv: cannot be read"):
        read_table(f"{folder}/u.csv")
    folder_at(folder).create_file("damaged.npz", b"")
    with pytest.raises(FileError, match=r"^memory://bucket\d+/damaged.npz: "):
        read_table(f"{folder}/damaged.npz")
