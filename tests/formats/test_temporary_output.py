"""Temporary files and folders: whose they are, and which of them are left behind."""

import errno
import fcntl
import os
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import pytest

from mjrun.errors import FileError
from mjrun.formats import temporary_output
from mjrun.formats.temporary_output import (
    WEEK,
    TemporaryOutput,
    left_behind,
    one_at_a_time,
    remove_left_behind,
    scratch_folder,
    temporary_file,
)

OTHER_PROCESS = """
import sys, pathlib
from mjrun.formats.temporary_output import TemporaryOutput
made = [TemporaryOutput(pathlib.Path(sys.argv[1]) / f"film{i}", folder=bool(i)) for i in range(2)]
print("made", flush=True)
sys.stdin.read()
"""


def is_locked(folder: Path) -> bool:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def leave_behind(target: Path, *, folder: bool = False) -> Path:
    """Makes what a killed process leaves."""
    temporary = TemporaryOutput(target, folder=folder)
    temporary.release()
    return temporary.path


def test_what_another_process_works_on_is_not_left_behind_until_it_is_killed(tmp_path: Path) -> None:
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", OTHER_PROCESS, str(tmp_path)]
    with subprocess.Popen(command, stdin=pipe, stdout=pipe) as other:
        assert other.stdout
        assert other.stdout.readline() == b"made\n"
        with left_behind(tmp_path) as found:
            assert found == []
        other.kill()
    with left_behind(tmp_path) as found:
        assert sorted(found) == sorted(tmp_path.iterdir())
        assert len(found) == 2
        with left_behind(tmp_path) as taken:  # somebody sees to them already
            assert taken == []
    for path in found:
        temporary_output.remove(path)


def test_what_this_process_works_on_is_not_left_behind(tmp_path: Path) -> None:
    temporary = TemporaryOutput(tmp_path / "film")
    with left_behind(tmp_path) as found:
        assert found == []
    temporary.remove()
    temporary.remove()
    assert [*tmp_path.iterdir()] == []


def test_a_scratch_folder_is_removed_by_its_process_or_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with scratch_folder() as folder:
        (folder / "a").write_text("half")
        with scratch_folder() as other:  # and not by one beside it
            assert folder.exists()
            assert other != folder
    assert list(tmp_path.iterdir()) == []

    left = TemporaryOutput(tmp_path / "mjrun", folder=True)
    (left.path / "a").write_text("half")
    left.release()  # as when its process is killed
    with scratch_folder() as folder:
        assert list(tmp_path.iterdir()) == [folder.parent]
        with one_at_a_time(folder):  # as where an output is published
            pass
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    with pytest.raises(FileError, match=r"none: cannot hold temporary files: No such file"), scratch_folder():
        pass


def test_a_scratch_folder_whose_disk_fills_up_is_reported_and_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def mkdir(path: Path, *how: Any) -> None:
        if path.name == "files":
            raise OSError(errno.ENOSPC, "No space left on device")
        os.mkdir(path, *how)  # noqa: PTH102

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(Path, "mkdir", mkdir)
    with pytest.raises(FileError, match=r"cannot hold temporary files: No space left"), scratch_folder():
        pass
    assert not list(tmp_path.iterdir())


def test_a_scratch_folder_is_where_tmpdir_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with scratch_folder() as folder:
        assert [folder.parent] == list(tmp_path.iterdir())


def test_a_temporary_file_keeps_its_suffix_and_lasts_as_long_as_the_block(tmp_path: Path) -> None:
    with temporary_file(tmp_path / "model.xml", b"<mujoco/>", ".xml") as path:
        assert (path.suffix, path.read_bytes(), path.parent) == (".xml", b"<mujoco/>", tmp_path)
        remove_left_behind(tmp_path)
        assert path.exists()
    TemporaryOutput(tmp_path / "model.xml", suffix=".xml").release()
    assert len([*tmp_path.iterdir()]) == 1
    remove_left_behind(tmp_path)
    assert [*tmp_path.iterdir()] == []


def test_files_of_others_are_never_left_behind(tmp_path: Path) -> None:
    for name in (".film.mp4.part", ".film.12345678.part", ".film.mjrun-12345678.part", "film.mjrun-0123456789abcdef"):
        (tmp_path / name).write_text("precious")
    with left_behind(tmp_path) as found:
        assert found == []
    for path in tmp_path.iterdir():
        path.unlink()


def test_what_is_left_of_one_output_is_found_by_its_name(tmp_path: Path) -> None:
    paths = {name: leave_behind(tmp_path / name) for name in ("film", "film.mp4", "x" * 255, "y" * 255)}
    for name, path in paths.items():
        with left_behind(tmp_path, tmp_path / name) as found:
            assert found == [path]
        path.unlink()


def test_what_another_machine_has_left_counts_after_a_week(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(temporary_output, "_machine", lambda: "0" * 8)
        path = leave_behind(tmp_path / "film")
    with left_behind(tmp_path) as found:
        assert found == []
    past = path.stat().st_mtime - WEEK - 60
    os.utime(path, (past, past))
    with left_behind(tmp_path) as found:
        assert found == [path]
    path.unlink()


def test_without_locks_nothing_is_taken_for_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuse)
    path = leave_behind(tmp_path / "film")
    with left_behind(tmp_path) as found, one_at_a_time(tmp_path):
        assert found == []
    path.unlink()


def test_blocks_of_one_folder_wait_for_each_other(tmp_path: Path) -> None:
    inside, most = [0], [0]

    def work() -> None:
        for _ in range(50):
            with one_at_a_time(tmp_path):
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                inside[0] -= 1

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1]


def test_a_block_within_a_block_of_one_folder_waits_for_nothing(tmp_path: Path) -> None:
    with one_at_a_time(tmp_path):
        with one_at_a_time(tmp_path):
            pass
        assert is_locked(tmp_path)
    assert not is_locked(tmp_path)


def test_a_file_that_somebody_takes_for_left_behind_before_it_is_locked_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, removed = os.open, list[str]()

    def opened(path: str | Path, flags: int, *mode: int) -> int:
        if not flags & os.O_CREAT and not removed:
            removed.append(str(path))
            Path(path).unlink()
        return real(path, flags, *mode)

    monkeypatch.setattr(os, "open", opened)
    temporary = TemporaryOutput(tmp_path / "film.mp4")
    assert removed
    assert [str(temporary.path)] == [str(path) for path in tmp_path.iterdir()] != removed
    temporary.remove()
