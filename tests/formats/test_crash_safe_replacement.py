"""Frames that take the place of older ones. What faults leave behind is in test_destinations.py."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from mjrun.formats.temporary_output import MOVING, NEW, OLD, exchange, frame_number, move_frames

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux exchanges two names")
def test_names_are_exchanged_in_one_step(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).write_text("")
    if exchange(tmp_path / "a", tmp_path / "b"):  # not every file system can
        assert [path.name for path in (tmp_path / "a").iterdir()] == ["b"]
        assert [path.name for path in (tmp_path / "b").iterdir()] == ["a"]
    assert not exchange(tmp_path / "a", tmp_path / "none")


@pytest.fixture
def temporary(tmp_path: Path) -> Path:
    """Three new frames."""
    folder = tmp_path / "temporary"
    (folder / NEW).mkdir(parents=True)
    for number in range(3):
        (folder / NEW / f"{number:06d}.png").write_text(f"new {number}")
    return folder


def test_a_folder_in_the_place_of_a_frame_is_no_frame_and_stops_all(tmp_path: Path, temporary: Path) -> None:
    (tmp_path / "0").write_text("old 0")
    (tmp_path / "2").mkdir()
    (tmp_path / "2/thesis.tex").write_text("precious")
    with pytest.raises(IsADirectoryError):
        move_frames(temporary, lambda number: tmp_path / str(number))
    assert (tmp_path / "0").read_text() == "old 0"
    assert not (tmp_path / "1").exists()
    assert (tmp_path / "2/thesis.tex").read_text() == "precious"
    assert len([*(temporary / NEW).iterdir()]) == 3
    assert not (temporary / MOVING).exists()


def test_a_link_in_the_place_of_a_frame_is_replaced_and_not_followed(tmp_path: Path, temporary: Path) -> None:
    (tmp_path / "precious").write_text("precious")
    (tmp_path / "1").symlink_to("precious")
    move_frames(temporary, lambda number: tmp_path / str(number))
    assert [(tmp_path / name).read_text() for name in "012"] == ["new 0", "new 1", "new 2"]
    assert (tmp_path / "precious").read_text() == "precious"
    assert not (tmp_path / "1").is_symlink()


def test_frames_are_replaced_where_a_file_has_one_name_only(
    tmp_path: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "link", refuse)
    (tmp_path / "1").write_text("old 1")
    move_frames(temporary, lambda number: tmp_path / str(number))
    assert [(tmp_path / name).read_text() for name in "012"] == ["new 0", "new 1", "new 2"]
    assert (temporary / OLD / "000001.png").read_text() == "old 1"


def test_the_number_of_a_frame_has_any_number_of_digits() -> None:
    assert [frame_number(Path(f"new/{name}.png")) for name in ("000007", "1000000")] == [7, 1_000_000]


REPLACE = """
import os, sys
from pathlib import Path
from mjrun.formats import temporary_output as replacement
os.setgid(65534)
os.setuid(65534)
new, target = Path(sys.argv[1]) / ".new", Path(sys.argv[1]) / "target"
new.write_text("new")
if sys.argv[2] == "no exchange":
    replacement.exchange = lambda *_: False
try:
    replacement.replace_file(new, target)
except PermissionError as error:
    print(error.strerror)
new.unlink()
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
@pytest.mark.parametrize("how", ["exchange", "no exchange"])
def test_another_users_file_in_a_sticky_folder_stays_and_gets_no_second_name(how: str) -> None:
    with tempfile.TemporaryDirectory() as name:  # where another user may look
        folder = Path(name)
        folder.chmod(0o1777)
        os.chown(folder, 1000, 1000)
        (folder / "target").write_text("old")
        (folder / "target").chmod(0o666)  # or the kernel would refuse the second name
        os.chown(folder / "target", 1000, 1000)
        done = subprocess.run([sys.executable, "-c", REPLACE, name, how], capture_output=True, text=True, cwd=ROOT)
        assert [path.name for path in folder.iterdir()] == ["target"], done.stderr
        assert (folder / "target").read_text() == "old"
        assert done.stdout == "another user's file; users can replace only their own here\n"
