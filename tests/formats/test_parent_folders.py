"""The folders of outputs: made when an output is opened, removed when nothing was published in them."""

import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from mjrun.errors import FileError
from mjrun.formats import temporary_output
from mjrun.formats.output_writer import Destination, StagedFile, StagedFrameFolder, StagedFramePattern
from mjrun.formats.temporary_output import TemporaryOutput
from tests.formats.outputs import fill, names
from tests.processes import PATIENCE

KINDS = pytest.mark.parametrize(
    ("make", "name"), [(StagedFile, "film"), (StagedFrameFolder, "frames"), (StagedFramePattern, "f_%02d.png")]
)
needs_permissions = pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
MANY = 40  # openings of each of several processes


@KINDS
def test_missing_folders_are_made_and_stay_with_what_is_published(
    tmp_path: Path, make: Callable[[Path], Destination], name: str
) -> None:
    staged = make(tmp_path / "a/b" / name)
    fill(staged, 2, "new")
    files = staged.publish()
    staged.cleanup()
    assert all(file.is_file() for file in files)
    assert names(tmp_path / "a") == ["b"]


@KINDS
def test_folders_go_again_with_an_output_that_is_not_published(
    tmp_path: Path, make: Callable[[Path], Destination], name: str
) -> None:
    (tmp_path / "a").mkdir()
    for taken_back in (False, True):
        staged = make(tmp_path / "a/b/c" / name)
        fill(staged, 2, "new")
        if taken_back:
            staged.publish()
            staged.take_back()
        staged.cleanup()
        staged.cleanup()
        assert names(tmp_path) == ["a"]
        assert names(tmp_path / "a") == []


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2)])
@pytest.mark.parametrize("published", [None, 0, 1, 2])
def test_outputs_share_their_folders_in_whichever_order_they_are_discarded(
    tmp_path: Path, order: tuple[int, ...], published: int | None
) -> None:
    paths = [tmp_path / "a/film", tmp_path / "a/b/film", tmp_path / "a/c/film"]
    outputs = [StagedFile(path) for path in paths]
    if published is not None:
        fill(outputs[published], 1, "new")
        outputs[published].publish()
    for index in order:
        outputs[index].cleanup()
    made = {path for path in tmp_path.rglob("*") if path.is_file()}
    assert made == (set() if published is None else {paths[published]})
    folders = {path for path in tmp_path.rglob("*") if path.is_dir()}
    assert folders == {folder for file in made for folder in file.parents if tmp_path in folder.parents}


def test_what_somebody_else_has_put_in_a_folder_stays(tmp_path: Path) -> None:
    staged = StagedFile(tmp_path / "a/b/film")
    (tmp_path / "a/notes.txt").write_text("mine")
    staged.cleanup()
    assert names(tmp_path / "a") == ["notes.txt"]


def test_a_folder_that_was_there_before_stays_empty(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    StagedFile(tmp_path / "a/film").cleanup()
    assert names(tmp_path) == ["a"]


def test_folders_go_with_an_output_that_cannot_be_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(TemporaryOutput, "__init__", refused)
    for make in (StagedFile, StagedFrameFolder):
        with pytest.raises(FileError, match="No space left"):
            make(tmp_path / "a/b/film")
        assert names(tmp_path) == []


def test_where_a_folder_cannot_be_made_none_is_left(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "gone").symlink_to("nowhere")
    (tmp_path / "film").symlink_to("nowhere/film")
    (tmp_path / "circle").symlink_to("circle")
    before, long = names(tmp_path), "x" * 300
    for path, message in (
        (f"new/{long}/a", "cannot be written: a name in it is longer than 255 bytes"),
        ("file/new/film", f"{tmp_path}/file is not a folder"),
        ("file/film", f"{tmp_path}/file is not a folder"),
        ("gone/film", f"the link {tmp_path}/gone leads to a missing folder, {tmp_path}/nowhere"),
        ("gone/new/film", f"the link {tmp_path}/gone leads to a missing folder, {tmp_path}/nowhere/new"),
        ("film", f"the link {tmp_path}/film leads to a missing folder, {tmp_path}/nowhere"),
        ("circle/film", f"the link {tmp_path}/circle leads to a missing folder, {tmp_path}/circle"),
    ):
        with pytest.raises(FileError) as caught:
            StagedFile(tmp_path / path)
        assert message in str(caught.value)
        assert names(tmp_path) == before


@KINDS
def test_no_folder_is_made_for_a_path_that_is_too_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Callable[[Path], Destination], name: str
) -> None:
    monkeypatch.setattr(temporary_output, "_make", lambda folder: pytest.fail(str(folder)))
    with pytest.raises(FileError, match=r"too long; the system allows [\d,]+ bytes"):
        make(tmp_path / ("a/" * 3000) / name)


@needs_permissions
def test_a_folder_without_permission_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    with pytest.raises(FileError, match=f"the folder {tmp_path}/new cannot be created: Permission denied"):
        StagedFile(tmp_path / "new/film")
    tmp_path.chmod(0o755)


def test_links_are_followed_and_a_folder_is_where_they_lead(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    staged = StagedFile(tmp_path / "link/a/film")
    fill(staged, 1, "new")
    staged.publish()
    staged.cleanup()
    assert (tmp_path / "real/a/film").read_text() == "new"


def test_a_folder_that_another_process_removes_meanwhile_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, removed = temporary_output._make, list[Path]()

    def make_and_lose(folder: Path) -> None:
        make(folder)
        if len(removed) < 5:
            folder.rmdir()
            removed.append(folder)

    monkeypatch.setattr(temporary_output, "_make", make_and_lose)
    staged = StagedFile(tmp_path / "a/b/film")
    assert len(removed) == 5
    staged.cleanup()
    assert names(tmp_path) == []


def test_processes_that_make_and_remove_the_same_folders_do_not_disturb_each_other(tmp_path: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from mjrun.formats.output_writer import StagedFile\n"
        f"for _ in range({MANY}): StagedFile(Path(sys.argv[1]) / 'a/b' / sys.argv[2]).cleanup()\n"
        "last = StagedFile(Path(sys.argv[1]) / 'a/b' / sys.argv[2]); last.publish(); last.cleanup()"
    )
    processes = [
        subprocess.Popen([sys.executable, "-c", program, str(tmp_path), str(number)], stderr=subprocess.PIPE)
        for number in range(3)
    ]
    errors = [process.communicate(timeout=PATIENCE)[1].decode() for process in processes]
    assert errors == ["", "", ""]
    assert names(tmp_path / "a/b") == ["0", "1", "2"]


def test_threads_that_make_and_remove_the_same_folders_do_not_disturb_each_other(tmp_path: Path) -> None:
    def work(number: int) -> None:
        for _ in range(MANY):
            StagedFile(tmp_path / f"a/b{number % 2}/film{number}").cleanup()

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(work, range(4)))
    assert names(tmp_path) == []
