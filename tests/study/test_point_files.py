"""The choice of points whose files are kept, against pandas, and these files."""

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import BadValueError, FailedPointsError, FileError, UnknownNameError, UnmadeFilesError, UsageError
from mjrun.formats.image_and_video_reader import read_video
from mjrun.formats.study_reader import read_point, read_study
from mjrun.formats.temporary_output import TemporaryOutput
from mjrun.options.sweep import KEPT, KeptFileOptions
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation
from mjrun.study import point_files
from mjrun.study.isolation import LocalExecutor
from mjrun.study.point_files import PointFileRequest, PointSelection, keep_options, make_isolated, up_to
from mjrun.study.status import remove_unused
from mjrun.study.study import Study
from mjrun.study.video_grid import VideoCell
from tests.reporters import RecordingReporter


def outputs(ball: Simulation, folder: Path, *kinds: str, key: str = "a", **options: object) -> PointFileRequest:
    kept = KeptFileOptions(keep=kinds, **options)  # type: ignore[arg-type]
    return PointFileRequest(folder, ball, key, kinds, kept, 2, {"values": {"seed": "1"}})


def test_a_trace_is_that_of_the_simulation_alone(ball: Simulation, tmp_path: Path) -> None:
    made = outputs(ball, tmp_path / "p", "trace", "recording", probe=("qpos",))
    assert make_isolated(made) == ""
    Trace(ball, str(tmp_path / "t.parquet"), probe=("qpos",), every=2).run()
    pd.testing.assert_frame_equal(
        pd.read_parquet(tmp_path / "p" / "trace.parquet"), pd.read_parquet(tmp_path / "t.parquet"), check_exact=True
    )
    assert (tmp_path / "p" / "recording.npz").is_file()
    assert read_point(tmp_path / "p")["values"] == {"seed": "1"}


def test_what_is_there_is_known_until_something_changes(ball: Simulation, tmp_path: Path) -> None:
    folder = tmp_path / "p"
    outputs(ball, folder, "trace", "recording").make()
    assert outputs(ball, folder, "trace", "recording").missing() == []
    assert outputs(ball, folder, "trace", "recording", probe=("qvel",)).missing() == ["trace"]
    assert outputs(ball, folder, "trace", key="b").missing() == ["trace"]
    (folder / "recording.npz").unlink()
    assert outputs(ball, folder, "trace", "recording").missing() == ["recording"]
    (folder / "point.json").write_text("[]")
    assert outputs(ball, folder, "trace").missing() == ["trace"]


def test_every_kind_of_file_that_can_be_kept_is_made_by_its_own_job(ball: Simulation, tmp_path: Path) -> None:
    jobs = outputs(ball, tmp_path, *KEPT).requests(KEPT)
    assert [type(job).__name__.lower() for job in jobs] == [*KEPT]
    with pytest.raises(ValueError, match="no output plot can be kept"):
        outputs(ball, tmp_path)._request("plot", "plot.png")


def test_files_of_an_older_simulation_are_removed_and_others_stay(ball: Simulation, tmp_path: Path) -> None:
    folder = tmp_path / "p"
    outputs(ball, folder, "trace", "recording").make()
    outputs(ball, folder, "trace").make()
    assert {file.name for file in folder.iterdir()} == {"trace.parquet", "recording.npz", "point.json"}
    (folder / "notes.txt").write_text("mine")
    outputs(ball, folder, "trace", key="b").make()
    assert {file.name for file in folder.iterdir()} == {"trace.parquet", "point.json", "notes.txt"}
    assert set(json.loads((folder / "point.json").read_text())["files"]) == {"trace.parquet"}


def test_a_process_that_dies_and_an_error_are_told(ball: Simulation, tmp_path: Path) -> None:
    deadly = Simulation(str(tmp_path / "deadly.xml"), steps=5)
    assert "the process that simulated it" in make_isolated(outputs(deadly, tmp_path / "p", "trace"))
    assert "nothing_like_it" in make_isolated(outputs(ball, tmp_path / "q", "trace", probe=("nothing_like_it",)))


def test_options_and_length_are_taken_over() -> None:
    assert keep_options(KeptFileOptions(keep=("video",), fps=25)).fps == 25
    shorter = up_to(Simulation("a.xml", duration=3), 7)
    assert (shorter.steps, shorter.duration) == (7, None)


@pytest.fixture
def study(ball: Simulation, tmp_path: Path) -> dict[str, object]:
    return {
        "simulation": ball,
        "output": str(tmp_path / "study"),
        "vary": {"qpos/ball/z": "0.2..0.5:4"},
        "metric": {"low": "min(qpos/ball/z)"},
        "jobs": 1,
    }


def test_traces_of_chosen_points_are_those_of_their_simulations(study: dict[str, object], tmp_path: Path) -> None:
    kept = Study(**study, keep=("trace",), keep_where=("z > 0.25",), keep_lowest=("2:low",), probe=("qpos",)).run().kept  # type: ignore[arg-type]
    lows: Any = pd.read_parquet(tmp_path / "study" / "results.parquet")
    expected = lows[lows["qpos/ball/z"] > 0.25].nsmallest(2, "low")
    assert list(kept.points) == sorted(expected.index)
    for index, row in expected.iterrows():
        alone = Simulation(str(tmp_path / "ball.xml"), steps=20, qpos={"ball/z": row["qpos/ball/z"]})
        Trace(alone, str(tmp_path / "alone.parquet"), probe=("qpos",)).run()
        trace = pd.read_parquet(tmp_path / "study" / "points" / f"{index:06}" / "trace.parquet")
        pd.testing.assert_frame_equal(trace, pd.read_parquet(tmp_path / "alone.parquet"), check_exact=True)


def test_traces_hold_the_columns_that_the_metrics_read(study: dict[str, object], tmp_path: Path) -> None:
    metrics = {"low": "min(qpos/ball/z)", "far": "max(abs(xpos(ball).x) + subtree_com/ball/z)", "end": "last(time)"}
    Study(**{**study, "metric": metrics}, keep=("trace",), keep_lowest=("1:low",), probe=("ctrl", "qpos")).run()  # type: ignore[arg-type]
    (path,) = (tmp_path / "study" / "points").glob("*/trace.parquet")
    names = list(pd.read_parquet(path).columns)
    assert names[0] == "time"
    assert names[-2:] == ["xpos/ball/x", "subtree_com/ball/z"]
    assert set(names[1:-2]) == {f"qpos/ball/{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz")}
    assert read_study(tmp_path / "study").metric_columns == ["qpos/ball/z", "xpos/ball/x", "subtree_com/ball/z"]


def test_what_ended_processes_have_left_beside_files_of_points_is_removed(
    study: dict[str, object], tmp_path: Path
) -> None:
    Study(**study, keep=("trace",)).run()  # type: ignore[arg-type]
    folder = tmp_path / "study" / "points" / "000002"
    files = {*folder.iterdir()}
    TemporaryOutput(folder / "point.json").release()
    living = TemporaryOutput(folder / "trace.parquet")
    Study(**study).run()  # type: ignore[arg-type]
    assert {*folder.iterdir()} == {*files, living.path}
    living.release()
    assert [kind.noun for kind in remove_unused(tmp_path / "study").kinds] == ["temporary file"]
    assert {*folder.iterdir()} == files


@pytest.mark.gl
def test_cells_of_a_contact_sheet_have_their_values_with_units(
    study: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    captions = list[str]()

    def collect(_path: str, cells: Sequence[VideoCell], *_: object) -> list[str]:
        captions.extend(cell.caption for cell in cells)
        return []

    monkeypatch.setattr("mjrun.study.video_grid.write_contact_sheet", collect)
    sheet = str(tmp_path / "sheet.mp4")
    Study(**study, contact_sheet=sheet, size=(64, 48), fps=10, quality="draft").run()  # type: ignore[arg-type]
    assert captions == ["z 0.2 m", "z 0.3 m", "z 0.4 m", "z 0.5 m"]


def test_traces_of_an_older_simulation_are_not_those_of_the_study(study: dict[str, object], tmp_path: Path) -> None:
    Study(**study, keep=("trace",), keep_lowest=("3:low",)).run()  # type: ignore[arg-type]
    assert [*read_study(tmp_path / "study").traces] == [0, 1, 2]
    Study(**study, time_limit=60).run()  # type: ignore[arg-type]
    assert [*read_study(tmp_path / "study").traces] == [0, 1, 2]
    other = {**study, "vary": {"qpos/ball/z": "0.2,0.25,0.4,0.5"}}
    Study(**other, keep=("trace",), keep_where=("z > 0.45",)).run()  # type: ignore[arg-type]
    assert len([*(tmp_path / "study" / "points").glob("*/trace.parquet")]) == 4
    assert [*read_study(tmp_path / "study").traces] == [0, 2, 3]


@pytest.mark.usefixtures("half_a_core")
def test_files_are_made_once_by_as_many_processes_as_the_quota_of_a_container_feeds(
    study: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[int] = []

    def record(count: int) -> LocalExecutor:
        counts.append(count)
        return LocalExecutor(count)

    monkeypatch.setattr(point_files, "LocalExecutor", record)
    options = {**study, "jobs": "auto", "vary": {"qpos/ball/z": "0.2,0.5"}, "keep": ("recording",)}
    assert [Study(**options).run().kept.made for _ in range(2)] == [2, 0]  # type: ignore[arg-type]
    assert counts == [1, 1]


class InterruptingReporter(RecordingReporter):
    """Interrupts the main thread while the files of the second point, in `folder`, are being written."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder

    def progress(self, what: str, done: int, total: int) -> None:
        if what == "files of points":
            while not (self.folder.is_dir() and any(self.folder.iterdir())):
                time.sleep(0.001)
            raise KeyboardInterrupt


def test_an_interruption_ends_the_processes_that_write_files_and_leaves_no_unfinished_ones(
    study: dict[str, object], tmp_path: Path
) -> None:
    study["simulation"] = Simulation(str(tmp_path / "ball.xml"))
    study |= {"vary": {"duration": "0.01,600"}, "keep": ("trace",)}
    points = tmp_path / "study" / "points"
    with pytest.raises(KeyboardInterrupt):
        Study(**study).run(InterruptingReporter(points / "000001"))  # type: ignore[arg-type]
    assert {path.name for path in points.rglob("*.*")} == {"trace.parquet", "point.json"}
    assert not [*(points / "000001").iterdir()]


def test_an_unstable_point_is_kept_up_to_its_last_good_step(study: dict[str, object], tmp_path: Path) -> None:
    study["vary"] = {"opt.gravity[2]": "-9.81,9e9"}
    study["simulation"] = Simulation(str(tmp_path / "ball.xml"), steps=60, timestep="0.05")
    with pytest.raises(FailedPointsError) as failure:
        Study(**study, keep=("trace",), keep_where=("unstable",), probe=("qpos",)).run()  # type: ignore[arg-type]
    (result,) = failure.value.results
    rows = pd.read_parquet(tmp_path / "study" / "results.parquet")
    assert list(result.kept.points) == [1]
    for index in result.kept.points:
        trace = pd.read_parquet(tmp_path / "study" / "points" / f"{index:06}" / "trace.parquet")
        assert len(trace) == rows["steps"][index]
        assert np.isfinite(trace.to_numpy()).all()


def test_names_are_checked_before_the_first_point(study: dict[str, object]) -> None:
    for options in ({"probe": ("nothing",)}, {"keep_where": ("nothing > 1",)}, {"keep_lowest": ("1:nothing",)}):
        with pytest.raises(UnknownNameError):
            Study(**study, keep=("trace",), **options).run()  # type: ignore[arg-type]
    assert not Path(str(study["output"])).exists()


def test_a_file_that_cannot_be_made_is_told_and_costs_nothing_else(study: dict[str, object], tmp_path: Path) -> None:
    (tmp_path / "study" / "points").mkdir(parents=True)
    (tmp_path / "study" / "points" / "000001").write_text("in the way")
    with pytest.raises(UnmadeFilesError, match="files of point 1") as failure:
        Study(**{**study, "vary": {"qpos/ball/z": "0.2,0.5"}}, keep=("trace",)).run()  # type: ignore[arg-type]
    assert failure.value.exit_code == 8
    assert len(failure.value.results[0].kept.files) == 1


@pytest.mark.gl
@pytest.mark.filterwarnings("ignore::mjrun.errors.MjrunWarning")
def test_a_contact_sheet_shows_the_frames_of_the_videos(study: dict[str, object], tmp_path: Path) -> None:
    study |= {"simulation": Simulation(str(tmp_path / "ball.xml"), duration="0.2"), "vary": {"qpos/ball/z": "0.2,0.5"}}
    sheet = str(tmp_path / "sheet.mkv")
    kept = Study(**study, contact_sheet=sheet, size=(160, 120), fps=10, quality="draft").run().kept  # type: ignore[arg-type]
    assert sheet in kept.files
    frames = read_video(sheet).frames
    assert frames.shape == (2, 120, 324, 3)
    single = read_video(tmp_path / "study" / "points" / "000001" / "video.mp4").frames
    middle = np.s_[40:90, 40:110]
    np.testing.assert_allclose(frames[:, :, 164:][:, *middle], single[:, *middle], atol=12)


RNG = np.random.default_rng(2)
COLUMNS = {"geom/box.mass": RNG.random(40), "drift": RNG.permutation(40).astype(float)}
COLUMNS["drift"][:3] = np.nan
STATUS = ["unstable"] * 3 + ["ok"] * 37
ABLE = np.arange(40) != 1
FRAME: Any = pd.DataFrame(COLUMNS).assign(status=STATUS)[ABLE]


def points(**options: object) -> list[int]:
    kept = KeptFileOptions(**{"keep": ("trace",), **options})  # type: ignore[arg-type]
    return PointSelection(kept, ["geom/box.mass", "model"], ["drift"]).points(COLUMNS, np.array(STATUS), ABLE)


def test_points_are_chosen_by_conditions_that_all_hold() -> None:
    assert points() == FRAME.index.tolist()
    assert points(keep_where=("unstable",)) == [0, 2]
    chosen = FRAME[(FRAME["drift"] > 10) & (FRAME["geom/box.mass"] < 0.5)].index.tolist()
    assert points(keep_where=("drift > 10", "mass < 0.5")) == chosen
    assert points(keep_where=("unstable or drift > 37",)) == [0, 2, *FRAME[FRAME["drift"] > 37].index]


def test_points_are_chosen_by_the_ends_of_a_metric_within_the_conditions() -> None:
    light = FRAME[FRAME["geom/box.mass"] < 0.5]
    ends = {*light["drift"].nsmallest(3).index, *light["drift"].nlargest(2).index}
    assert points(keep_where=("mass < 0.5",), keep_lowest=("3:drift",), keep_highest=("2:drift",)) == sorted(ends)
    assert points(keep_lowest=("1000:drift",)) == FRAME["drift"].dropna().index.tolist()


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"keep_where": ("drft > 1",)}, UnknownNameError, "drft"),
        ({"keep_lowest": ("3:mass",)}, UnknownNameError, "metric"),
        ({"keep_highest": ("drift",)}, BadValueError, "4:drift"),
        ({"keep_where": ("model > 1",)}, UsageError, "not numbers"),
        ({"keep_where": ("unstable",), "keep": ()}, UsageError, "keep_where requires keep or contact_sheet"),
    ],
)
def test_an_invalid_choice_is_refused_before_the_study(
    options: dict[str, object], error: type[Exception], match: str
) -> None:
    with pytest.raises(error, match=match):
        points(**options)


@pytest.mark.gl
@pytest.mark.parametrize(("size", "match"), [((64, 9), "not at least 16x16"), ((64, 1_000_000), "too large")])
def test_videos_that_cannot_be_made_are_refused_before_the_study(
    ball: Simulation, tmp_path: Path, size: tuple[int, int], match: str
) -> None:
    study = Study(ball, str(tmp_path / "s"), vary=(("seed", "1..2:2"),), keep=("trace", "video"), size=size)
    with pytest.raises(UsageError, match=match) as caught:
        study.run()
    assert caught.value.path == ("size",)
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize("sheet", ["s/points/000001/video.mp4", "s/points/", "s/"])
def test_a_contact_sheet_does_not_replace_files_of_points(ball: Simulation, tmp_path: Path, sheet: str) -> None:
    study = Study(ball, f"{tmp_path}/s", vary=(("seed", "1..2:2"),), contact_sheet=f"{tmp_path}/{sheet}")
    with pytest.raises(UsageError, match="clashes with the files of points") as caught:
        study.run()
    assert caught.value.path == ("contact_sheet",)


def test_a_rate_of_a_contact_sheet_is_reported_at_its_option(ball: Simulation, tmp_path: Path) -> None:
    study = Study(ball, str(tmp_path / "s"), vary=(("seed", "1..2:2"),), contact_sheet="c.gif", fps=33)
    with pytest.raises(UsageError, match="GIF") as caught:
        study.run()
    assert caught.value.path == ("fps",)


@pytest.mark.gl
def test_a_contact_sheet_that_cannot_be_written_is_reported_before_the_study(ball: Simulation, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    sheet = str(tmp_path / "file" / "c.mp4")
    study = Study(ball, str(tmp_path / "s"), vary=(("seed", "1..2:2"),), contact_sheet=sheet)
    with pytest.raises(FileError, match="is not a folder"):
        study.run()
    assert not (tmp_path / "s").exists()
