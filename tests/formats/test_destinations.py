"""Destinations that appear whole or not at all."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from mjrun.errors import FileError
from mjrun.formats import temporary_output
from mjrun.formats.output_writer import Destination, StagedFile, StagedFrameFolder, StagedFramePattern, StandardOutput
from tests.formats.file_faults import MOST, fault, killed_at
from tests.formats.outputs import both_ways, fill, names, no_exchange

needs_permissions = pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")


def publish(target: Destination, count: int, text: str) -> None:
    """Writes and publishes an output."""
    try:
        fill(target, count, text)
        target.publish()
    finally:
        target.cleanup()


@pytest.mark.parametrize("target", [StagedFile, StagedFrameFolder, StagedFramePattern])
@pytest.mark.parametrize("name", ["x" * 256, "é" * 128, "x" * 5000, f"{'x' * 256}/a"])
def test_a_name_that_is_too_long_is_an_unwritable_output(
    tmp_path: Path, target: Callable[[Path], Destination], name: str
) -> None:
    with pytest.raises(FileError, match=r"is longer than 255 bytes|cannot be created: File name too long"):
        target(tmp_path / name)
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("make", "name"),
    [(StagedFile, "film.mp4"), (StagedFrameFolder, "frames"), (StagedFramePattern, "frame_%03d.png")],
)
def test_what_is_discarded_leaves_no_trace(tmp_path: Path, make: Callable[[Path], Destination], name: str) -> None:
    staged = make(tmp_path / name)
    fill(staged, 3, "new")
    staged.cleanup()
    assert names(tmp_path) == []


def test_a_link_stays_a_link_to_the_new_file(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    real, link = tmp_path / "real/film.mp4", tmp_path / "link.mp4"
    real.write_text("old")
    link.symlink_to(real)
    staged = StagedFile(link)
    fill(staged, 1, "new")
    staged.publish()
    staged.cleanup()
    assert link.is_symlink()
    assert real.read_text() == "new"


def test_the_file_has_the_permissions_that_any_new_file_would_have(tmp_path: Path) -> None:
    (tmp_path / "other").write_text("")
    staged = StagedFile(tmp_path / "film.mp4")
    staged.publish()
    staged.cleanup()
    assert (tmp_path / "film.mp4").stat().st_mode == (tmp_path / "other").stat().st_mode


@pytest.mark.parametrize("make", [StagedFile, StagedFrameFolder])
def test_a_folder_that_is_a_file_is_refused(tmp_path: Path, make: Callable[[Path], Destination]) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="is not a folder"):
        make(tmp_path / "file/x")


def test_a_device_or_a_folder_is_not_replaced_by_a_video(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mp4")
    (tmp_path / "folder.mp4").mkdir()
    for name in ("pipe.mp4", "folder.mp4"):
        with pytest.raises(FileError, match="exists and is not a regular file"):
            StagedFile(tmp_path / name)


@needs_permissions
def test_a_read_only_folder_or_video_is_refused_before_anything_is_drawn(tmp_path: Path) -> None:
    film = tmp_path / "film.mp4"
    film.write_text("old")
    film.chmod(0o444)
    with pytest.raises(FileError, match="read-only"):
        StagedFile(film)
    tmp_path.chmod(0o555)
    with pytest.raises(FileError, match="is not writable"):
        StagedFile(tmp_path / "other.mp4")
    tmp_path.chmod(0o755)


@both_ways
def test_a_folder_of_frames_is_replaced_as_a_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exchange: Callable[[Path, Path], bool]
) -> None:
    monkeypatch.setattr(temporary_output, "exchange", exchange)
    for count, text in ((5, "old"), (3, "new")):
        publish(StagedFrameFolder(tmp_path / "frames"), count, text)
        assert names(tmp_path / "frames") == [f"{number:06d}.png" for number in range(count)]
        assert (tmp_path / "frames/000002.png").read_text() == f"{text} 2"
        assert names(tmp_path) == ["frames"]


def contents(folder: Path) -> list[str]:
    """What is in a folder of frames, in the order of their names; nothing if there is no folder."""
    return [path.read_text() for path in sorted(folder.glob("[!.]*"))]


OLD, NEW = [f"old {i}" for i in range(3)], [f"new {i}" for i in range(2)]
OUTPUTS = [  # how it is made, its name, where its frames are, and what is there at the end
    pytest.param(StagedFile, "film", ".", ["old"], ["new"], id="file"),
    pytest.param(StagedFrameFolder, "frames", "frames", OLD, NEW, id="folder"),
    pytest.param(StagedFramePattern, "f_%02d.png", ".", OLD, [*NEW, OLD[2]], id="pattern"),
]


@pytest.mark.slow
@both_ways
@pytest.mark.parametrize(("make", "name", "folder", "old", "new"), OUTPUTS)
def test_a_process_that_is_killed_at_any_operation_leaves_the_old_output_or_the_new_one(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    exchange: Callable[[Path, Path], bool],
    make: Callable[[Path], Destination],
    name: str,
    folder: str,
    old: list[str],
    new: list[str],
) -> None:
    monkeypatch.setattr(temporary_output, "exchange", exchange)
    number = 0
    while True:
        number += 1
        assert number < MOST
        here = tmp_path / str(number)
        here.mkdir()
        publish(make(here / name), 3, "old")
        killed = killed_at(number, lambda here=here: publish(make(here / name), 2, "new"))
        if exchange is not no_exchange or make is not StagedFrameFolder:
            assert len(contents(here / folder)) in (len(old), len(new))  # nothing is missing, not even for a moment

        make(here / name).cleanup()  # the next run finishes or undoes it
        assert contents(here / folder) in (old, new)
        assert not killed or not list(here.glob(".*"))
        if not killed:
            break
    assert number > 2
    assert contents(here / folder) == new


@pytest.mark.parametrize("name", ["é" * 127, "x" * 255])
def test_a_name_may_be_as_long_as_the_system_allows(tmp_path: Path, name: str) -> None:
    publish(StagedFile(tmp_path / name), 1, "new")
    assert names(tmp_path) == [name]


def test_what_killed_runs_have_left_is_removed_by_the_next_output_to_their_folder(tmp_path: Path) -> None:
    live = StagedFile(tmp_path / "film")
    for make, name in ((StagedFile, "film"), (StagedFrameFolder, "frames"), (StagedFramePattern, "%d.png")):
        left = make(tmp_path / name)
        fill(left, 3, "half")
        left._temporary.release()
    StagedFile(tmp_path / "table.csv").cleanup()
    assert [path.name for path in tmp_path.iterdir()] == [Path(live.path).name]
    live.cleanup()


@both_ways
@pytest.mark.parametrize("kind", ["once", "from then on"])
@pytest.mark.parametrize(("make", "name", "folder", "old", "new"), OUTPUTS)
def test_an_operation_that_fails_leaves_the_old_output_or_the_new_one(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    exchange: Callable[[Path, Path], bool],
    make: Callable[[Path], Destination],
    name: str,
    folder: str,
    old: list[str],
    new: list[str],
    kind: str,
) -> None:
    monkeypatch.setattr(temporary_output, "exchange", exchange)
    number = 0
    while True:
        number += 1
        assert number < MOST
        here, message = tmp_path / f"{number}", ""
        here.mkdir()
        publish(make(here / name), 3, "old")
        with fault(number, kind) as tried:
            try:
                publish(make(here / name), 2, "new")
            except FileError as error:
                message = str(error)
        failed = len(tried) >= number
        found = contents(here / folder)
        if message and "the next run" not in message:
            assert found == old
        elif not message:
            assert found == new

        make(here / name).cleanup()
        assert contents(here / folder) in (old, new)
        assert not list(here.glob(".*"))
        if not failed:
            break
    assert number > 2
    assert not message


@pytest.mark.parametrize("make", [StagedFrameFolder, StagedFramePattern])
def test_frames_beyond_a_million_stay_in_order(tmp_path: Path, make: Callable[[Path], Destination]) -> None:
    target = tmp_path / ("frames" if make is StagedFrameFolder else "f_%d.png")
    staged = make(target)
    numbers = [999_998, 999_999, 1_000_000, 1_000_001]
    for number in numbers:  # six digits, then seven
        Path(staged.path % number).write_text(str(number))
    assert [int(path.read_text()) for path in staged.publish()] == numbers
    staged.cleanup()


def test_a_folder_with_anything_else_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(FileError, match=r"holds other files \('thesis.tex'\)"):
        StagedFrameFolder(tmp_path)
    assert names(tmp_path) == ["thesis.tex"]


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("f_%04d.png", ["f_0000.png", "f_0001.png"]),
        ("%d.png", ["0.png", "1.png"]),
        ("a%02db.png", ["a00b.png", "a01b.png"]),
        ("s%4d.png", ["s   0.png", "s   1.png"]),
    ],
)
def test_a_pattern_names_the_frames_and_leaves_all_other_files_alone(
    tmp_path: Path, pattern: str, expected: list[str]
) -> None:
    others = ["f_x.png", "2024.png", "f_1.png", "a002b.png", "f_00007.png"]
    for name in others:
        (tmp_path / name).write_text("precious")
    for count in (12, 2):
        staged = StagedFramePattern(tmp_path / pattern)
        fill(staged, count, f"of {count}")
        made = staged.publish()
        staged.cleanup()
        assert [path.name for path in made[:2]] == expected
    assert (tmp_path / expected[1]).read_text() == "of 2 1"
    left = [made[0].with_name(pattern % number).name for number in range(2, 12)]
    assert staged.others == [*left, *(["2024.png"] if pattern == "%d.png" else [])]
    assert staged.remark.startswith(f"{left[0]} and {len(staged.others) - 1} more already existed")
    assert names(tmp_path) == sorted([*expected, *left, *others])
    assert all((tmp_path / name).read_text() == "precious" for name in others)


def test_a_percent_sign_in_the_folder_s_own_name_is_no_pattern(tmp_path: Path) -> None:
    (tmp_path / "100%d").mkdir()
    staged = StagedFrameFolder(tmp_path / "100%d/frames")
    assert (staged.path % 7).endswith("000007.png")
    assert (Path(staged.path % 7)).parent.is_dir()
    staged.cleanup()


def test_a_video_is_never_written_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    with pytest.raises(FileError, match="standard output is a terminal"):
        StandardOutput()


def test_a_reader_that_closed_the_pipe_is_noticed() -> None:
    program = (
        "import sys, time; from mjrun.formats.output_writer import StandardOutput; out = StandardOutput();"
        "before = out.reader_is_gone(); sys.stderr.write('go'); sys.stderr.flush(); sys.stdin.read();"
        "sys.stderr.write(f'{before} {out.reader_is_gone()}')"
    )
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", program], stdin=pipe, stdout=pipe, stderr=pipe) as child:
        assert child.stdin
        assert child.stdout
        assert child.stderr
        assert child.stderr.read(2) == b"go"
        child.stdout.close()
        child.stdin.close()
        assert child.stderr.read() == b"False True"
