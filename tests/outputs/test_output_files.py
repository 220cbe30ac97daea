"""Two outputs are never one file, and no input is written."""

from pathlib import Path

import pytest

from mjrun.errors import UsageError
from mjrun.outputs.image import Image
from mjrun.outputs.output_files import ReservedFiles, named_files
from mjrun.outputs.perform import perform
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.simulation.simulation import Simulation


def test_no_file_is_written_twice_or_read_and_written(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, duration=0.1)
    at = f"{tmp_path}/"
    before = swing.read_bytes()
    for jobs, said in [
        ([Image(simulation, f"{at}a.json", view="seg", calibration=f"{at}a.json")], "a.json clashes with the output"),
        ([Image(simulation, f"{at}a.png", manifest=f"{at}a.png")], "a.png clashes with the output"),
        ([Image(simulation, f"{at}a.png", view="seg", calibration=f"{at}a.labels.json")], "a.labels.json clashes"),
        (
            [Image(simulation, f"{at}a.png", calibration=f"{at}c.json", manifest=f"{at}c.json")],
            "c.json clashes with the",
        ),
        (
            [Video(simulation, f"{at}a.mkv", view=["rgb", "seg"], separate=True, calibration=f"{at}a-seg.labels.json")],
            "a-seg.labels.json clashes with the output",
        ),
        (
            [Video(simulation, f"{at}f/", calibration=f"{at}f/transforms.json")],
            "transforms.json clashes with the output",
        ),
        ([Trace(simulation, f"{at}t.npz"), Recording(simulation, f"{at}t.npz")], "t.npz clashes with the output"),
        ([Image(simulation, f"{at}a.png", calibration=str(swing))], "swing.xml clashes with the model, which is read"),
        ([Plot(simulation, f"{at}a.png", probe=["time"], manifest=f"{at}x/../swing.xml")], "clashes with the model"),
    ]:
        with pytest.raises(UsageError, match=f"{said}.*; each output needs a separate file"):
            perform(jobs)
        assert [*tmp_path.iterdir()] == [swing]
    assert swing.read_bytes() == before


def test_files_that_are_not_asked_for_have_no_name() -> None:
    assert named_files(output="a", contacts=None, manifest="-") == [("output", "a"), ("manifest", "-")]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("a.csv", "a.csv"),
        ("a.csv", "x/../a.csv"),
        ("f/", "f/000000.png"),
        ("f/000000.png", "f/"),
        ("f_%04d.png", "f_0007.png"),
        ("f_0007.png", "f_%04d.png"),
        ("f_%d.png", "f_%06d.png"),
        ("real/a.csv", "link/a.csv"),
    ],
)
def test_two_names_of_one_file_clash(tmp_path: Path, first: str, second: str) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    reserved = ReservedFiles()
    reserved.reserve(f"{tmp_path}/{first}", "the first")
    with pytest.raises(UsageError, match=r"clashes with the first; each output needs a separate file"):
        reserved.reserve(f"{tmp_path}/{second}", "the second")


@pytest.mark.parametrize(
    "paths",
    [
        ("-", "-"),
        ("a.csv", "a.csv.gz", "b/a.csv"),
        ("f_%04d.png", "f_.png", "f_7.jpg", "g_0007.png", "sub/f_0007.png"),
        ("f/", "f2/", "f.png"),
        ("a+%d.png", "aa1.png"),
    ],
)
def test_files_apart_do_not_clash(tmp_path: Path, paths: tuple[str, ...]) -> None:
    reserved = ReservedFiles()
    for path in paths:
        reserved.reserve(path if path == "-" else tmp_path / path, "another")


def test_a_file_may_be_read_under_two_names_but_is_not_written(swing: Path, tmp_path: Path) -> None:
    (tmp_path / "link.xml").symlink_to(swing)
    reserved = ReservedFiles()
    for path in (swing, tmp_path / "link.xml"):
        reserved.reserve_input(path, "the model, which is read")
    with pytest.raises(UsageError, match="clashes with the model"):
        reserved.reserve(tmp_path / "link.xml", "the output")
