"""Theorems about versions: whatever happens to a settled file or folder, its version is another one."""

import io
import os
import time
from pathlib import Path

from mjrun.file_version import COARSEST_TIME, content_version, file_version, folder_version, is_settled, version_of


def test_a_file_has_another_version_once_its_content_is_changed_or_replaced_even_with_its_size_and_time(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a"
    path.write_text("0")
    version, times = file_version(str(path)), (path.stat().st_atime_ns, path.stat().st_mtime_ns)
    assert version == version_of(path.stat())
    time.sleep(0.02)  # longer than a tick of the system's clock
    path.write_text("1")
    os.utime(path, ns=times)
    written = file_version(str(path))
    (tmp_path / "b").write_text("2")
    os.utime(tmp_path / "b", ns=times)
    (tmp_path / "b").replace(path)
    assert version != written != file_version(str(path)) != version


def test_a_folder_has_another_version_once_a_file_comes_goes_or_is_renamed(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    seen = [folder_version(str(tmp_path))]
    for change in (
        lambda: (tmp_path / "b").touch(),
        lambda: (tmp_path / "b").rename(tmp_path / "c"),
        lambda: (tmp_path / "c").unlink(),
    ):
        time.sleep(0.02)
        change()
        seen.append(folder_version(str(tmp_path)))
    assert len({tuple(version) for version in seen if version}) == 4


def test_the_content_of_an_open_file_has_another_version_once_it_is_written_to_and_not_when_it_is_replaced(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"one")
    with path.open("rb") as file:
        first = content_version(file)
        path.rename(tmp_path / "b")
        path.write_bytes(b"another")
        assert content_version(file) == first
        time.sleep(0.02)
        (tmp_path / "b").write_bytes(b"two")
        assert content_version(file) != first
    assert content_version(io.BytesIO()) is None


def test_there_is_no_version_of_what_is_missing_or_of_another_kind(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    assert file_version(str(tmp_path)) is folder_version(str(tmp_path / "a")) is None
    assert file_version(str(tmp_path / "b")) is folder_version(str(tmp_path / "b")) is file_version("\0") is None


def test_a_file_is_settled_if_it_changed_longer_ago_than_times_are_apart() -> None:
    changed = 10**18
    for mtime, ctime in ((changed, 0), (0, changed)):
        version = [1, 1, 1, mtime, ctime]
        assert not is_settled(version, changed + COARSEST_TIME)
        assert is_settled(version, changed + COARSEST_TIME + 1) is (os.name == "posix")
