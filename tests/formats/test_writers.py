"""What every writer of a file promises, whatever it writes: the whole new file, or the old one and nothing else."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.formats import table_writer
from mjrun.formats.calibration_writer import FORMATS as CALIBRATIONS
from mjrun.formats.calibration_writer import CalibrationEntry, CalibrationWriter
from mjrun.formats.image_format import FORMATS as IMAGES
from mjrun.formats.image_writer import PIXELS, ImageWriter
from mjrun.formats.manifest import ManifestWriter
from mjrun.formats.output_writer import OutputWriter
from mjrun.formats.pointcloud import PointCloudWriter
from mjrun.formats.recording import RecordingWriter
from mjrun.formats.segmentation_labels import LabelsWriter
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import FORMATS
from mjrun.model.camera_images import CameraCalibration, CameraImages, SegmentedObject
from tests.formats.table_files import COLUMNS, columns, names
from tests.formats.table_files import write as write_table
from tests.processes import largest_file

DISK = 2**16  # bytes that a file may have
LENS = CameraCalibration((4, 4), 4.0, 4.0, 2.0, 2.0, np.eye(4), 0.01, 50.0, True)


@dataclass(frozen=True)
class Case:
    """A writer.

    Attributes:
      name: of its file.
      open, write: make a writer of a path, and fill it, with an amount.
      small, large: amounts for which the disk has room, and has not: while they come, or at the end.
      beside: the other files that it publishes.
    """

    name: str
    open: Callable[[str, int], OutputWriter]
    write: Callable[[Any, int], object]
    small: int
    large: Sequence[int]
    beside: Sequence[str] = ()


def segments(count: int) -> list[SegmentedObject]:
    return [SegmentedObject("geom", index, f"geom_{index}", "torso") for index in range(count)]


def table(form: str) -> Case:
    def write(writer: TableWriter, rows: int) -> None:
        for block in np.array_split(np.random.default_rng(1).standard_normal((rows, 3)), 20):
            writer.write(block)

    return Case(f"t.{form}", lambda path, _: TableWriter(path, form, COLUMNS), write, 5, [3_000, 30_000])


def image(view: str, form: str) -> Case:
    shape, kind = PIXELS[view]
    known = IMAGES[view][form]

    def write(writer: ImageWriter, side: int) -> None:
        pixels = np.random.default_rng(1).integers(0, 3, (side, side, *shape)).astype(kind) * (
            80 if view == "rgb" else 1
        )
        legend = segments(3) if view == "seg" else []
        writer.write(pixels.astype(kind), legend, np.zeros((3, 3), np.uint8) if view == "seg" else None)

    beside = ["a.labels.json"] if known.nothing is not None else []
    name = f"a{known.suffixes[0]}"
    return Case(name, lambda path, side: ImageWriter(path, view, form, (side, side)), write, 8, [700], beside)


def recording(size: int, *counts: int) -> Case:
    def write(writer: RecordingWriter, count: int) -> None:
        for step in range(count):
            writer.write(step, np.zeros(size))

    return Case("run.npz", lambda path, _: RecordingWriter(path, size, {}), write, 1, counts)


def write_points(writer: PointCloudWriter, side: int) -> None:
    depth, rgb = np.ones((side, side), np.float32), np.zeros((side, side, 3), np.uint8)
    lens = CameraCalibration((side, side), 4.0, 4.0, 2.0, 2.0, np.eye(4), 0.01, 50.0, True)
    writer.write(CameraImages(lens, rgb, depth))


def write_calibrations(writer: CalibrationWriter, count: int) -> None:
    for frame in range(count):
        writer.write(CalibrationEntry("side", LENS, frame, 0.1, f"{frame:06d}.png", f"d{frame:06d}.png"))


def write_labels(writer: LabelsWriter, count: int) -> None:
    writer.write((4, 4), segments(count), None)


def write_manifest(writer: ManifestWriter, length: int) -> None:
    writer.write({"command": "x" * length}, [])


CASES = {
    **{f"table {form}": table(form) for form in FORMATS},
    **{f"{view} {form}": image(view, form) for view, known in IMAGES.items() for form in known},
    "recording, while states come": recording(1000, 100),
    "recording, with the last state": recording(2**13 - 1, 1),
    "recording, with the steps": recording(2, 4000),
    "points": Case("a.ply", lambda path, _: PointCloudWriter(path), write_points, 3, [80, 200]),
    **{
        f"calibration {form}": Case(
            "a.json",
            lambda path, _, form=form: CalibrationWriter(path, form),
            write_calibrations,
            1,
            [] if known.one == "lens" else [400, 1000],
        )
        for form, known in CALIBRATIONS.items()
    },
    "labels": Case(
        "a.labels.json", lambda path, _: LabelsWriter(path.replace("labels.json", "png")), write_labels, 3, [2000]
    ),
    "manifest": Case("a.json", lambda path, _: ManifestWriter(path), write_manifest, 3, [10**5]),
}
# A recording that is too large for the disk with its first state has none that is small.
SMALL = {name: case for name, case in CASES.items() if name != "recording, with the last state"}
LARGE = [(name, amount) for name, case in CASES.items() for amount in case.large if "jpeg" not in name]


@pytest.fixture
def small_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No file can grow beyond `DISK`: the operating system refuses as it does on a full disk."""
    monkeypatch.setattr(table_writer, "GROUP", 12_000)
    with largest_file(DISK):
        yield


@pytest.mark.parametrize("name", SMALL)
def test_what_is_not_published_leaves_no_trace_and_the_old_file_stays(tmp_path: Path, name: str) -> None:
    case = SMALL[name]
    path = tmp_path / case.name
    with case.open(str(path), case.small) as writer:
        pass
    assert names(tmp_path) == []
    for old in (case.name, *case.beside):
        (tmp_path / old).write_text("old")
    with case.open(str(path), case.small) as writer:
        case.write(writer, case.small)
    writer.close()
    assert {file.read_text() for file in tmp_path.iterdir()} == {"old"}
    assert names(tmp_path) == sorted([case.name, *case.beside])


@pytest.mark.parametrize("name", SMALL)
def test_the_old_file_is_there_until_the_new_one_is_published_with_those_beside_it(tmp_path: Path, name: str) -> None:
    case = SMALL[name]
    path = tmp_path / case.name
    path.write_text("old")
    with case.open(str(path), case.small) as writer:
        case.write(writer, case.small)
        assert path.read_text() == "old"
        assert writer.publish() == [path, *(tmp_path / name for name in case.beside)]
        assert path.read_bytes() != b"old"
    assert names(tmp_path) == sorted([case.name, *case.beside])


@pytest.mark.parametrize("name", SMALL)
def test_an_output_that_cannot_be_written_is_named_at_opening(name: str) -> None:
    case = SMALL[name]
    with pytest.raises(FileError, match="/dev/null is not a folder"):
        case.open(f"/dev/null/{case.name}", case.small)


@pytest.mark.parametrize(("name", "amount"), LARGE)
def test_a_full_disk_is_reported_and_the_old_file_stays(
    tmp_path: Path, small_disk: None, name: str, amount: int
) -> None:
    case = CASES[name]
    path = tmp_path / case.name
    path.write_text("old")

    def run() -> None:
        with case.open(str(path), amount) as writer:
            case.write(writer, amount)
            writer.publish()

    with pytest.raises(FileError) as caught:
        run()
    assert str(caught.value) == f"{path}: cannot be written: File too large"
    assert path.read_text() == "old"
    assert names(tmp_path) == [path.name]


# --- standard output -------------------------------------------------------------------------------

ROOT = Path(__file__).parents[2]
PROGRAM = """
import sys
import numpy as np
from mjrun.errors import ClosedPipeError, FileError
from mjrun.formats.image_writer import ImageWriter
from mjrun.formats.table_writer import TableWriter
from mjrun.model.camera_images import SegmentedObject
from mjrun.model.table_column import Column

form, size = sys.argv[1], int(sys.argv[2])
noise = np.random.default_rng(1).integers(0, 3, (size % 1000, size % 1000, 3))
try:
    if form == "png":
        with ImageWriter(None, "rgb", form, noise.shape[:2]) as out:
            out.write(noise.astype(np.uint8))
            out.publish()
    elif form == "coco":
        with ImageWriter(None, "seg", form, noise.shape[:2]) as out:
            out.write(noise[..., 0].astype(np.int32), [SegmentedObject("geom", k, str(k)) for k in range(3)])
            out.publish()
    else:
        with TableWriter(None, form, [Column("time"), Column("qpos/a")]) as out:
            for k in range(size):
                out.write(np.full((1000, 2), k, float))
            out.publish()
except ClosedPipeError as end:
    sys.exit(end.exit_code)
except FileError as error:
    sys.exit(str(error))
assert sys.modules.keys().isdisjoint({"pyarrow", "scipy"})
"""


def piped(form: str, size: int, stdout: Any = subprocess.PIPE) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-W", "error", "-c", PROGRAM, form, str(size)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, env=environment, stdout=stdout, stderr=subprocess.PIPE)


@pytest.mark.parametrize("form", ["csv", "jsonl"])
def test_standard_output_gets_the_table_and_needs_no_other_library(tmp_path: Path, form: str) -> None:
    out, errors = piped(form, 3).communicate()
    assert errors == b""
    data = np.repeat([[k, k] for k in (0.0, 1.0, 2.0)], 1000, axis=0)
    assert out == write_table(tmp_path / f"t.{form}", [data], columns("time", "qpos/a")).read_bytes()


@pytest.mark.parametrize(("form", "size"), [("csv", 10**6), ("jsonl", 10**6), ("png", 600)])
def test_a_reader_that_goes_away_ends_the_writing_without_a_word(form: str, size: int) -> None:
    with piped(form, size) as child:
        assert child.stdout
        assert child.stderr
        assert child.stdout.read(10)
        child.stdout.close()
        assert child.stderr.read() == b""
    assert child.returncode == 141


@pytest.mark.parametrize("form", ["csv", "png"])
def test_a_full_device_on_standard_output_is_reported(form: str) -> None:
    with Path("/dev/full").open("wb") as full, piped(form, 8, stdout=full) as child:
        assert child.stderr
        assert child.stderr.read() == b"-: cannot be written: No space left on device\n"


@pytest.mark.parametrize(
    ("form", "shown"),
    [("csv", b"time,qpos/a\r\n" + 1000 * b"0.0,0.0\r\n"), ("coco", b'"annotations"'), ("png", b"")],
)
def test_only_text_goes_to_a_terminal(form: str, shown: bytes) -> None:
    ours, theirs = os.openpty()
    with piped(form, 1, stdout=theirs) as child:
        os.close(theirs)
        text = b""
        with contextlib.suppress(OSError):  # Linux ends a terminal so
            while part := os.read(ours, 4096):
                text += part
        assert child.stderr
        told = child.stderr.read()
    os.close(ours)
    assert shown in text if shown else b"standard output is a terminal" in told
    assert bool(text) == bool(shown) == (child.returncode == 0)
