"""Files of a point, made alone."""

import json
from pathlib import Path

import pandas as pd
import pytest

from mjrun.formats.study_folder import read_point
from mjrun.options.sweep import KEPT, KeepOptions
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation
from mjrun.study.point_files import PointOutputs, keep_options, make_isolated, up_to
from tests.study.models import BALL, DEADLY


@pytest.fixture
def simulation(tmp_path: Path) -> Simulation:
    (tmp_path / "ball.xml").write_text(BALL)
    return Simulation(str(tmp_path / "ball.xml"), steps=20)


def outputs(simulation: Simulation, folder: Path, *kinds: str, key: str = "a", **options: object) -> PointOutputs:
    kept = KeepOptions(**options)  # type: ignore[arg-type]
    return PointOutputs(folder, simulation, key, kinds, kept, 2, {"values": {"seed": "1"}})


def test_a_trace_is_that_of_the_simulation_alone(simulation: Simulation, tmp_path: Path) -> None:
    made = outputs(simulation, tmp_path / "p", "trace", "recording", probe=("qpos",))
    assert make_isolated(made) == ""
    Trace(simulation, str(tmp_path / "t.parquet"), probe=("qpos",), every=2).run()
    pd.testing.assert_frame_equal(
        pd.read_parquet(tmp_path / "p" / "trace.parquet"), pd.read_parquet(tmp_path / "t.parquet"), check_exact=True
    )
    assert (tmp_path / "p" / "recording.npz").is_file()
    assert read_point(tmp_path / "p")["values"] == {"seed": "1"}


def test_what_is_there_is_known_until_something_changes(simulation: Simulation, tmp_path: Path) -> None:
    folder = tmp_path / "p"
    outputs(simulation, folder, "trace", "recording").make()
    assert outputs(simulation, folder, "trace", "recording").missing() == []
    assert outputs(simulation, folder, "trace", "recording", probe=("qvel",)).missing() == ["trace"]
    assert outputs(simulation, folder, "trace", key="b").missing() == ["trace"]
    (folder / "recording.npz").unlink()
    assert outputs(simulation, folder, "trace", "recording").missing() == ["recording"]
    (folder / "point.json").write_text("[]")
    assert outputs(simulation, folder, "trace").missing() == ["trace"]


def test_every_kind_of_file_that_can_be_kept_is_made_by_its_own_job(simulation: Simulation, tmp_path: Path) -> None:
    jobs = outputs(simulation, tmp_path, *KEPT).jobs(KEPT)
    assert [type(job).__name__.lower() for job in jobs] == [*KEPT]
    with pytest.raises(ValueError, match="no output plot can be kept"):
        outputs(simulation, tmp_path)._job("plot", "plot.png")


def test_files_of_an_older_simulation_are_removed_and_others_stay(simulation: Simulation, tmp_path: Path) -> None:
    folder = tmp_path / "p"
    outputs(simulation, folder, "trace", "recording").make()
    outputs(simulation, folder, "trace").make()
    assert {file.name for file in folder.iterdir()} == {"trace.parquet", "recording.npz", "point.json"}
    (folder / "notes.txt").write_text("mine")
    outputs(simulation, folder, "trace", key="b").make()
    assert {file.name for file in folder.iterdir()} == {"trace.parquet", "point.json", "notes.txt"}
    assert set(json.loads((folder / "point.json").read_text())["files"]) == {"trace.parquet"}


def test_a_process_that_dies_and_an_error_are_told(simulation: Simulation, tmp_path: Path) -> None:
    (tmp_path / "deadly.xml").write_text(DEADLY)
    deadly = Simulation(str(tmp_path / "deadly.xml"), steps=5)
    assert "the process that simulated it" in make_isolated(outputs(deadly, tmp_path / "p", "trace"))
    assert "nothing_like_it" in make_isolated(outputs(simulation, tmp_path / "q", "trace", probe=("nothing_like_it",)))


def test_options_and_length_are_taken_over() -> None:
    assert keep_options(KeepOptions(fps=25)).fps == 25
    shorter = up_to(Simulation("a.xml", duration=3), 7)
    assert (shorter.steps, shorter.duration) == (7, None)
