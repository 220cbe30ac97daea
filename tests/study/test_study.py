"""Whole studies: every way to compute the table gives the same bytes, and no known result is lost."""

from __future__ import annotations

import json
import os
import shutil
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import fsspec
import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest

from mjrun.cli.simulation_command import load_controller
from mjrun.errors import FailedAssertionError, FailedPointsError, FileError, UnknownNameError, UsageError, spelled
from mjrun.model.sources.file import FileSource
from mjrun.options.sweep import EXTRAS
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.simulation import Simulation
from mjrun.study import executors, isolation
from mjrun.study.executors import open_executor
from mjrun.study.isolation import PointChunk, run_chunk
from mjrun.study.job_plan import plan, run_task
from mjrun.study.part_files import PartFiles, PartPublisher
from mjrun.study.prepared import PreparedStudy
from mjrun.study.spec import ChunkResult
from mjrun.study.study import Study, StudyResult
from tests.cases import cases
from tests.reporters import RecordingReporter
from tests.study import factories
from tests.study.models import BALL, PENDULUM

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tests.conftest import Command

METRICS = {"low": "min(qpos/ball/z)", "drift": "max(abs(energy/drift))"}


@pytest.fixture
def simulation(ball: Simulation) -> Simulation:
    return replace(ball, steps=100)


def study(simulation: Simulation, folder: Path, **options: object) -> Study:
    defaults: dict[str, object] = {"metric": METRICS, "jobs": 1}
    return Study(simulation, str(folder), **(defaults | options))  # type: ignore[arg-type]


def table(folder: Path) -> bytes:
    return (folder / "results.parquet").read_bytes() + (folder / "results.csv").read_bytes()


def test_what_changed_since_the_last_run_is_noted_without_a_document_too(
    simulation: Simulation, tmp_path: Path
) -> None:
    folder, vary = tmp_path / "study", {"seed": "1,2"}
    for changed, options in (
        ([], {}),
        ([], {}),
        (["changed since the last run: metrics"], {"metric": {"high": "max(qpos/ball/z)"}}),
        (["changed since the last run: every"], {"metric": {"high": "max(qpos/ball/z)"}, "every": 2}),
    ):
        reporter = RecordingReporter()
        study(simulation, folder, vary=vary, **options).run(reporter)
        assert [text for text in reporter.texts if "changed" in text] == changed


def test_controls_that_outlast_the_default_duration_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "controls.csv"
    path.write_text("time,ctrl/motor\n0,1\n5.5,0\n")
    model = tmp_path / "pendulum.xml"
    model.write_text(PENDULUM)
    driven, reporter = Simulation(str(model), ctrl_from=str(path)), RecordingReporter()
    study(driven, tmp_path / "study", metric={"end": "last(time)"}, vary={"seed": "1"}).run(reporter)
    assert [spelled(each) for each in reporter.warnings if "controls" in each] == [
        f"{path} has controls until 5.5 s, of which 5 s are simulated; duration 5.5 simulates all"
    ]


def test_a_value_that_is_the_end_of_a_name_is_explained(simulation: Simulation, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"vary.* ctrl/a: invalid value 'b=1'\nwhere a name contains =, write \?$"):
        study(simulation, tmp_path, vary={"ctrl/a": "b=1,2"}).run()


def test_runs_that_use_a_folder_at_once_for_different_studies_are_warned(
    simulation: Simulation, tmp_path: Path
) -> None:
    class Meeting(RecordingReporter):
        """Runs the other study as soon as the first has begun its points."""

        other = RecordingReporter()

        def progress(self, what: str, done: int, total: int) -> None:
            if done == 1:
                study(simulation, tmp_path, vary={"seed": "1..3:3"}, metric={"low": "max(time)"}).run(self.other)

    meeting = Meeting()
    study(simulation, tmp_path, vary={"seed": "1..3:3"}, chunk=1).run(meeting)
    texts = [[text for text in each.texts if text.startswith("another run uses")] for each in (meeting, meeting.other)]
    assert [len(each) for each in texts] == [1, 1]
    assert {*pd.read_csv(tmp_path / "results.csv")} >= {"low", "drift"}
    later = RecordingReporter()
    study(simulation, tmp_path, vary={"seed": "1..3:3"}, metric={"low": "max(time)"}).run(later)
    assert later.texts == ["changed since the last run: metrics", "3 of 3 points are known already"]


def test_parameters_and_metrics_have_units_in_the_table(simulation: Simulation, tmp_path: Path) -> None:
    vary = {"qpos/ball/z": "1,2", "opt.timestep": "1e-3", "seed": "1"}
    result = study(simulation, tmp_path / "study", vary=vary).run()
    units = {name: unit for name, unit in result.table.units.items() if unit}
    assert units == {"qpos/ball/z": "m", "opt.timestep": "s", "low": "m", "drift": "J"}
    assert result.metrics["drift"].unit == "J"


def test_a_unit_beside_the_name_of_a_metric_is_that_of_its_column_and_identifies_no_result(
    simulation: Simulation, tmp_path: Path
) -> None:
    vary = {"qpos/ball/z": "0.2,0.3"}
    bare = study(simulation, tmp_path / "study", vary=vary, metric={"low": "1000*min(qpos/ball/z)"}).run()
    assert not bare.table.units["low"]
    named = {"low [mm]": "1000*min(qpos/ball/z)"}
    result = study(simulation, tmp_path / "study", vary=vary, metric=named, require=["max(low) < 300"]).run()
    assert (result.simulated, result.table.units["low"], result.metrics["low"].unit) == (0, "mm", "mm")
    schema = pyarrow.parquet.read_schema(tmp_path / "study" / "results.parquet")
    assert schema.field("low").metadata[b"unit"] == b"mm"
    assert (tmp_path / "study" / "results.csv").read_text().startswith("point,qpos/ball/z,low,status")


def test_a_run_that_cannot_begin_leaves_the_folder_as_it_was(simulation: Simulation, tmp_path: Path) -> None:
    study(simulation, tmp_path / "study", vary={"qvel/ball/vx": "0,1"}).run()
    before = {path: path.read_bytes() for path in (tmp_path / "study").rglob("*") if path.is_file()}
    endless = replace(simulation, steps=10**17)
    with pytest.raises(UsageError, match="too many to count exactly"):
        study(endless, tmp_path / "study", vary={"qvel/ball/vx": "0,1,2"}).run()
    assert {path: path.read_bytes() for path in (tmp_path / "study").rglob("*") if path.is_file()} == before


def test_a_folder_in_which_no_results_can_be_written_is_left_as_it_was(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study(simulation, tmp_path, vary={"qvel/ball/vx": "0,1"}).run()
    before = (tmp_path / "study.json").read_bytes()
    monkeypatch.setattr(os, "access", lambda path, _: path != tmp_path / "parts")
    with pytest.raises(FileError, match=r"/parts: the folder is not writable$"):
        study(simulation, tmp_path, vary={"qvel/ball/vx": "0,1,2"}).run()
    assert (tmp_path / "study.json").read_bytes() == before


def test_a_study_on_warp_says_why_its_first_points_take_so_long(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco_warp")
    monkeypatch.setattr(PreparedStudy, "simulate", lambda *_: SimpleNamespace(total=lambda: 0))
    reporter = RecordingReporter()
    with pytest.raises(FailedPointsError, match="2 missing"):
        study(simulation, tmp_path, engine="warp", vary={"qpos/ball/z": "0.3,0.5"}).run(reporter)
    assert reporter.texts == ["warp compiles kernels that are not cached, which may take minutes"]


def test_each_row_is_the_trace_of_its_point(simulation: Simulation, tmp_path: Path) -> None:
    vary = {"qpos/ball/z": "0.2..0.6:3", "opt.timestep": "0.001,0.004"}
    result = study(simulation, tmp_path / "study", vary=vary).run()
    assert (result.points, result.simulated, result.statuses) == (6, 6, {"ok": 6})
    rows = pd.read_parquet(tmp_path / "study" / "results.parquet")
    for row in rows.to_dict("records"):
        values = {"qpos": {"ball/z": row["qpos/ball/z"]}, "timestep": row["opt.timestep"]}
        alone = Simulation(simulation.model, steps=100, **values)
        Trace(alone, str(tmp_path / "alone.parquet"), probe=["qpos", "energy"]).run()
        trace = pd.read_parquet(tmp_path / "alone.parquet")
        assert row["low"] == trace["qpos/ball/z"].min()
        assert row["drift"] == trace["energy/drift"].abs().max()
    lows = rows["low"].tolist()
    assert result.metrics["low"].quantiles[0] == min(lows) == lows[result.metrics["low"].lowest or 0]
    assert result.metrics["low"].std == pytest.approx(np.std(lows, ddof=1))


@pytest.mark.slow
def test_the_same_study_again_simulates_nothing_and_more_values_only_what_is_new(
    simulation: Simulation, tmp_path: Path
) -> None:
    folder = tmp_path / "study"
    study(simulation, folder, vary={"seed": "1..5:5", "perturb": "uniform(0,1)"}, samples=2).run()
    first, manifest = table(folder), json.loads((folder / "study.json").read_text())
    assert (manifest["points"], manifest["names"]) == (10, ["seed", "perturb"])
    again = study(simulation, folder, vary={"seed": "1..5:5", "perturb": "uniform(0,1)"}, samples=2).run()
    assert (again.points, again.simulated) == (10, 0)
    assert table(folder) == first
    grown = study(simulation, folder, vary={"seed": "1..6:6", "perturb": "uniform(0,1)"}, samples=3).run()
    assert (grown.points, grown.simulated) == (18, 8)

    study(simulation, tmp_path / "fresh", vary={"seed": "1..6:6", "perturb": "uniform(0,1)"}, samples=3).run()
    assert table(tmp_path / "fresh") == table(folder)
    changed = study(simulation, folder, vary={"seed": "1..6:6", "perturb": "0.5"}, metric={"low": "last(qpos/ball/z)"})
    assert changed.run().simulated == 6


@pytest.mark.slow
def test_the_table_does_not_depend_on_the_chunks_or_the_engine(simulation: Simulation, tmp_path: Path) -> None:
    tables = set[bytes]()
    for index, options in enumerate(
        [{"chunk": 1}, {"jobs": 2}, {"engine": "tests.study.factories:threads", "chunk": 3}]
    ):
        folder = tmp_path / str(index)
        study(simulation, folder, vary={"perturb": "uniform(0, 3)"}, samples=8, **options).run()
        tables.add(table(folder))
    assert len(tables) == 1


@pytest.mark.parametrize("values", ["10mm,10deg", "10deg,10mm"])
def test_a_point_that_cannot_start_fails_alone_wherever_it_is(tmp_path: Path, values: str) -> None:
    hinge = Simulation("scene:pendulum", steps=10)
    with pytest.raises(FailedPointsError):
        study(hinge, tmp_path / "study", vary={"qpos/hinge": values}, metric={}).run()
    rows = pd.read_csv(tmp_path / "study" / "results.csv")
    assert rows["status"].tolist() == [{"10mm": "failed", "10deg": "ok"}[text] for text in values.split(",")]


def test_the_number_of_steps_may_vary(ball: Simulation, tmp_path: Path) -> None:
    study(replace(ball, steps=None), tmp_path / "study", vary={"steps": "2,30"}).run()
    rows = pd.read_csv(tmp_path / "study" / "results.csv")
    assert rows["steps"].tolist() == [2, 30]
    assert rows["status"].tolist() == ["ok", "ok"]


def test_a_study_is_refused_if_no_point_can_start(tmp_path: Path) -> None:
    hinge = Simulation("scene:pendulum", steps=10)
    with pytest.raises(UsageError, match="is not an angle"):
        study(hinge, tmp_path / "study", vary={"qpos/hinge": "10mm,12mm"}, metric={}).run()


@pytest.mark.slow
def test_points_that_fail_are_rows_and_the_rest_is_done(
    simulation: Simulation, tmp_path: Path, point_processes: None
) -> None:
    models = ",".join(str(tmp_path / name) for name in ("ball.xml", "deadly.xml", "missing.xml"))
    with pytest.raises(FailedPointsError) as caught:
        study(simulation, tmp_path / "study", vary={"model": models, "qvel/ball/vz": "0,-1e9"}, metric={}).run()
    assert caught.value.exit_code == 8
    (result,) = caught.value.results
    assert isinstance(result, StudyResult)
    assert result.statuses == {"ok": 1, "unstable": 1, "failed": 2, "crashed": 2}
    rows = pd.read_csv(tmp_path / "study" / "results.csv")
    assert rows["status"].tolist() == ["ok", "unstable", "crashed", "crashed", "failed", "failed"]
    assert rows["exit_code"].tolist() == [0, 4, 139, 139, 3, 3]
    reasons = {failure.status: failure for failure in result.failures}
    assert reasons["crashed"].count == 2
    assert reasons["failed"].values["model"].endswith("missing.xml")


@pytest.mark.parametrize("masses", ["-1,1", "1,-1"])
def test_a_point_that_does_not_compile_fails_wherever_it_is(
    simulation: Simulation, tmp_path: Path, masses: str
) -> None:
    with pytest.raises(FailedPointsError, match="1 failed, of 2 points"):
        study(simulation, tmp_path / "study", vary={"geom/*.mass": masses}).run()
    rows = pd.read_csv(tmp_path / "study" / "results.csv")
    assert dict(zip(rows["geom/*.mass"], rows["status"], strict=True)) == {-1: "failed", 1: "ok"}
    assert 3 in rows["exit_code"].tolist()


def test_points_that_an_engine_loses_have_failed_and_are_tried_again_on_request(
    simulation: Simulation, tmp_path: Path
) -> None:
    options: dict[str, object] = {"vary": {"seed": "1..4:4"}, "chunk": 1}
    with pytest.raises(FailedPointsError) as caught:
        study(simulation, tmp_path / "study", engine="tests.study.factories:Forgetful", **options).run()
    (lost,) = caught.value.results
    assert lost.statuses == {"ok": 2, "failed": 2}
    assert "the machine is gone" in lost.failures[0].message
    with pytest.raises(FailedPointsError):
        study(simulation, tmp_path / "study", **options).run()
    result = study(simulation, tmp_path / "study", retry_failed=True, **options).run()
    assert (result.simulated, result.statuses) == (2, {"ok": 4})


def test_a_lost_job_is_reported_and_submitted_again(simulation: Simulation, tmp_path: Path) -> None:
    reporter = RecordingReporter()
    options: dict[str, object] = {"vary": {"seed": "1..4:4"}, "chunk": 2}
    lossy = study(simulation, tmp_path / "study", engine="tests.study.factories:Losing", **options)
    assert lossy.run(reporter).statuses == {"ok": 4}
    assert reporter.warnings == ["2 points submitted again: the job ended as NODE_FAIL without a result: see log"]


@cases("engine, limit, counts, reason")
def test_a_run_ends_at_its_limit_or_with_its_engine_and_leaves_a_study_that_continues_to_the_same_table(
    simulation: Simulation,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    engine: str,
    limit: dict[str, object],
    counts: str,
    reason: str,
) -> None:
    """Three points are in flight, and the clock advances by a second for each of them. What ends has done one."""
    here = "tests.study.factories:in_this_process"
    options = {"vary": {"qpos/ball/z": "1..2:10"}, "chunk": 1, "require": ["min(low) > 0"]}
    study(simulation, tmp_path / "whole", engine=here, **options).run()
    with monkeypatch.context() as patch:
        patch.setattr("mjrun.study.prepared_points.time", SimpleNamespace(perf_counter=count().__next__))
        reporter = RecordingReporter()
        limited = study(simulation, tmp_path / "study", engine=f"tests.study.factories:{engine}", **limit, **options)
        with pytest.raises(FailedPointsError, match=f"^{counts}, of 10 points; the table has the others") as caught:
            limited.run(reporter)
    (result,) = caught.value.results
    left = int(counts.split()[-2])
    assert (caught.value.exit_code, result.simulated, result.assertions) == (8, 10 - left, [])
    (end,) = (text for text in reporter.texts if text.endswith(f": {left} points left; repeat the command to continue"))
    assert reason in end
    again = study(simulation, tmp_path / "study", engine=here, retry_failed=True, **options).run()
    assert again.simulated == 10 - result.statuses["ok"]
    assert table(tmp_path / "study") == table(tmp_path / "whole")


@pytest.mark.parametrize("view", ["same", "copy", "overlay", "full", "versions"])
def test_processes_that_see_the_folder_publish_their_results_and_others_return_them(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, view: str
) -> None:
    options: dict[str, object] = {"vary": {"qvel/ball/vz": "0,1,2,-1e9,3,4,5"}, "chunk": 3, "metric": METRICS}
    folder, other = tmp_path / "study", tmp_path / "other"
    with pytest.raises(FailedPointsError):
        study(simulation, tmp_path / "here", **options).run()

    def seen(parts: PartPublisher) -> PartPublisher:
        if view == "copy":  # made before this study began
            return replace(parts, folder=str(other))
        if view == "overlay":  # reads this folder, and writes to another one
            shutil.copytree(folder, other, dirs_exist_ok=True)
            return replace(parts, folder=str(other))
        if view == "versions":
            return replace(parts, versions=replace(parts.versions, versions={"mujoco": "3.9.9"}))
        return parts

    def refused(*_: object) -> None:
        raise FileError("part", "cannot be written: No space left on device")

    def run(chunk: PointChunk) -> ChunkResult:
        with pytest.MonkeyPatch.context() as patch:
            if view == "full":
                patch.setattr(PartFiles, "write", refused)
            return run_chunk(chunk)

    process = factories.Neighbour(seen)
    monkeypatch.setattr(executors, "open_executor", lambda *_: (process, 2))
    monkeypatch.setattr(executors, "run_chunk", run)
    monkeypatch.setattr("mjrun.study.prepared_points.SHARED", 2)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FailedPointsError) as caught:
        study(simulation, Path("study"), **options).run()
    assert caught.value.results[0].statuses == {"ok": 6, "unstable": 1}
    assert table(folder) == table(tmp_path / "here")
    returned = [([each.index for each in reply.results], bool(reply.part)) for reply in process.replies]
    everything = [([0, 1, 2], False), ([3, 4, 5], False), ([6], False)]
    published = [([], True), ([3], True), ([6], False)]
    expected = {"same": published, "overlay": published + everything[:2]}.get(view, everything)
    assert sorted(returned) == sorted(expected)


def test_a_model_that_varies_and_has_changed_is_simulated_again(simulation: Simulation, tmp_path: Path) -> None:
    other = tmp_path / "other.xml"
    other.write_text(BALL)
    options: dict[str, object] = {"vary": {"model": f"{simulation.model},{other}"}}
    assert study(simulation, tmp_path / "study", **options).run().simulated == 2
    other.write_text(BALL.replace(".3", ".4"))
    assert study(simulation, tmp_path / "study", **options).run().simulated == 1


REQUIRED = [
    "share(unstable) < 0.5",
    "max(drift, ok > 0) < 1e9",
    "count(status == 'ok') == count(status=='unstable') + 1",
    'share(status != "unstable" and drift < 1e9) > 0.5',
]


def test_a_study_that_its_processes_cannot_open_ends_with_the_reason(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def damaged(alternative: str) -> None:
        raise UsageError(f"warp is damaged; {alternative} is not")

    monkeypatch.setattr("mjrun.study.simulate.WarpDevice", damaged)
    monkeypatch.setattr("mjrun.study.executors.require_library", lambda: None)
    with pytest.raises(UsageError, match="warp is damaged; local is not"):
        study(simulation, tmp_path / "study", vary={"seed": "1,2,3"}, engine="warp").run()
    assert study(simulation, tmp_path / "study", vary={"seed": "1,2,3"}).run().statuses == {"ok": 3}


def test_a_requirement_is_checked_over_all_points(simulation: Simulation, tmp_path: Path) -> None:
    options: dict[str, object] = {"vary": {"qvel/ball/vz": "0,1,-1e9"}}
    with pytest.raises(FailedAssertionError, match=r"share\(ok\)"):
        study(simulation, tmp_path / "study", require=["share(ok) > 0.9"], **options).run()
    with pytest.raises(FailedPointsError) as caught:
        study(simulation, tmp_path / "study", require=REQUIRED, **options).run()
    assert [verdict.passed for verdict in caught.value.results[0].assertions] == [True] * len(REQUIRED)
    with pytest.raises(FailedAssertionError, match=r'share\(status == "ok"\) > 0\.9: it is 0\.6'):
        study(simulation, tmp_path / "study", require=['share(status == "ok") > 0.9'], **options).run()


@pytest.mark.parametrize(
    ("options", "kind", "expected"),
    [
        ({"metric": {"x": "max(nothing)"}}, UnknownNameError, "metric x|no column 'nothing'"),
        ({"metric": {"two words": "max(time)"}}, UsageError, "cannot be the name of a metric"),
        ({"metric": {"status": "max(time)"}}, UsageError, "cannot be the name of a metric"),
        ({"metric": {"x": "time"}}, UsageError, "values per row"),
        ({"vary": {"geom/bal.size": "1,2"}}, UnknownNameError, "ball"),
        ({"vary": {"nonsense": "1,2"}}, UnknownNameError, "nonsense"),
        ({"require": ["max(nothing) > 1"]}, UnknownNameError, "nothing"),
    ],
)
def test_what_is_wrong_with_all_points_is_told_before_the_first(
    simulation: Simulation, tmp_path: Path, options: dict[str, object], kind: type[Exception], expected: str
) -> None:
    with pytest.raises(kind, match=expected):
        study(simulation, tmp_path / "study", **options).run()
    assert not (tmp_path / "study" / "results.csv").exists()


def test_a_confidence_without_intervals_is_warned_of(simulation: Simulation, tmp_path: Path) -> None:
    for number, (options, is_warned) in enumerate(
        (
            ({"vary": {"qpos/ball/z": "0.2,0.3"}}, True),
            ({"vary": {"qpos/ball/z": "0.2,0.3"}, "repeats": 2}, False),
            ({"vary": {"qpos/ball/z": "uniform(0.2,0.3)"}, "sampler": "morris", "samples": 2}, False),
        )
    ):
        reporter = RecordingReporter()
        study(simulation, tmp_path / str(number), confidence=0.9, **options).run(reporter)
        assert any(text.startswith("confidence has no effect") for text in map(spelled, reporter.warnings)) == is_warned


def test_a_parameter_that_does_not_change_replayed_states_is_warned_of(simulation: Simulation, tmp_path: Path) -> None:
    recording = str(tmp_path / "recording.npz")
    Recording(simulation, recording).run()
    replay = replace(simulation, replay=recording)
    vary = {"geom/ball.friction[0]": "0.1,2"}
    for mode, warned in (("states", True), ("controls", False)):
        reporter = RecordingReporter()
        study(replace(replay, replay_mode=mode), tmp_path / mode, vary=vary).run(reporter)
        expected = "all points replay the recorded states: geom/ball.friction[0] only changes"
        assert any(text.startswith(expected) for text in reporter.warnings) == warned


@pytest.mark.parametrize("engine", ["dask", "ray", "slurm", "rya"])
def test_an_engine_that_is_not_there_leaves_no_folder(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, engine: str
) -> None:
    monkeypatch.setattr("mjrun.study.executors.EXTRAS", {**EXTRAS, engine: (("not_installed",), "mjrun sweep")})
    with pytest.raises(UsageError):
        study(simulation, tmp_path / "study", engine=engine, vary={"seed": "1"}).run()
    assert not (tmp_path / "study").exists()


CODE = """
def push(model, data):
    data.qfrc_applied[2] = 5

class Count:
    def __init__(self):
        self.calls = 0

    def reset(self, model, data):
        self.calls = 0

    def __call__(self, model, data):
        self.calls += 1
        data.qfrc_applied[2] = self.calls

class Forgotten:
    calls = 0

    def __call__(self, model, data):
        self.calls += 1
        data.qfrc_applied[2] = -self.calls

kept = Forgotten()
"""


@pytest.mark.parametrize("period", [(), ("--control-dt", "0.01")])
@pytest.mark.slow
def test_controllers_vary_and_their_code_is_part_of_what_a_point_is(
    mjrun_here: Command, period: Sequence[str], point_processes: None
) -> None:
    (mjrun_here.folder / "ball.xml").write_text(BALL)
    name = f"pushes_{len(period)}.py"  # a module that this process has not imported yet
    code = mjrun_here.folder / name
    code.write_text(CODE)
    steps = ("--steps", "40", *period)
    vary = (
        "--vary",
        f"controller={name}:push,{name}:Count,{name}:kept",
        "--repeats",
        "2",
        "--metric",
        "z=last(qpos/ball/z)",
    )

    def simulated() -> int:
        return json.loads(mjrun_here("sweep", "ball.xml", *steps, "--json", *vary).stdout)["simulated"]

    assert (simulated(), simulated()) == (6, 0)
    rows = pd.read_csv(mjrun_here.folder / "ball_study" / "results.csv")
    for index, controller in ((0, "push"), (2, "Count"), (4, "kept")):
        options = (*steps, "--controller", f"{name}:{controller}", "-o", "alone.csv")
        assert mjrun_here("trace", "ball.xml", *options).returncode == 0
        alone = pd.read_csv(mjrun_here.folder / "alone.csv")["qpos/ball/z"].tolist()[-1]
        assert rows["z"].tolist()[index : index + 2] == [alone] * 2
    if period:
        nobody = mjrun_here("sweep", "ball.xml", *steps, "--vary", "seed=1,2", "-o", "other")
        assert nobody.returncode == 2
        assert b"--control-dt requires --controller, which it calls periodically" in nobody.stderr
    else:
        code.write_text(CODE.replace("= 5", "= 6"))
        del sys.modules[code.stem]  # as in another process
        assert simulated() == 6


def test_a_memory_that_points_would_share_and_edited_code_are_reported(
    simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    code = tmp_path / "control_with_memory.py"
    code.write_text(
        "CALLS = []\n"
        "def count(model, data):\n    CALLS.append(0)\n    data.qfrc_applied[2] = len(CALLS)\n"
        "def push(model, data):\n    data.qfrc_applied[2] = 5\n"
    )
    shared = "controller acts differently when it is called again at the same start"
    edited = f"{code} was edited after Python had imported it"
    for name, expected in (("count", [shared]), ("push", []), ("push", [edited])):
        if expected == [edited]:
            code.write_text("")
        controlled = replace(simulation, controller=load_controller(f"{code}:{name}"))
        made = study(controlled, tmp_path / "study", vary={"seed": "1"})
        reporter = RecordingReporter()
        PreparedStudy(made, made.spec).warn(reporter)
        warned = [spelled(text).partition(":")[0] for text in reporter.warnings]
        assert warned == expected


def test_a_document_may_not_vary_code(simulation: Simulation, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="only the command line and Python may name code"):
        study(simulation, tmp_path / "study", vary={"controller": "os:getcwd"}).run()


class _Editor(RecordingReporter):
    """Calls `edit` when the first results arrive."""

    def __init__(self, edit: Callable[[], object]) -> None:
        super().__init__()
        self._edit = edit

    def progress(self, what: str, done: int, total: int) -> None:
        self._edit()


CONTROLLED = """<mujoco><include file="part.xml"/><worldbody><body><joint name="hinge" axis="0 1 0"/>
<geom name="bob" size=".1" pos="1 0 0"/></body></worldbody>
<actuator><motor name="m" joint="hinge"/></actuator></mujoco>"""


def edited_study(folder: Path, **options: object) -> Study:
    """A study whose points are all compiled, and read a model with an include, and a table."""
    folder.mkdir()
    (folder / "model.xml").write_text(CONTROLLED)
    (folder / "part.xml").write_text('<mujocoinclude><option gravity="0 0 -9"/></mujocoinclude>')
    (folder / "push.csv").write_text("time,ctrl/m\n0,0.5\n")
    simulation = Simulation(str(folder / "model.xml"), steps=30, ctrl_from=str(folder / "push.csv"))
    varied = {"geom/bob.size": "0.1..0.2:3"}
    defaults: dict[str, object] = {"vary": varied, "metric": {"x": "last(qpos/hinge)"}, "jobs": 1, "chunk": 1}
    return Study(simulation, str(folder / "study"), **(defaults | options))  # type: ignore[arg-type]


def edit(folder: Path) -> None:
    """Changes everything that the study reads."""
    (folder / "part.xml").write_text('<mujocoinclude><option gravity="0 0 -1"/></mujocoinclude>')
    (folder / "push.csv").write_text("time,ctrl/m\n0,-5\n")
    (folder / "model.xml").write_text(CONTROLLED.replace("1 0 0", "2 0 0"))


def test_a_model_that_is_edited_while_a_study_runs_changes_no_result(tmp_path: Path) -> None:
    edited_study(tmp_path / "quiet").run()
    running = edited_study(tmp_path / "edited", chunk=1)
    result = running.run(_Editor(lambda: edit(tmp_path / "edited")))
    assert result.simulated == 3
    assert table(tmp_path / "edited" / "study") == table(tmp_path / "quiet" / "study")

    assert running.run().simulated == 3  # they are other points now
    assert table(tmp_path / "edited" / "study") != table(tmp_path / "quiet" / "study")


def test_tasks_of_a_plan_are_not_changed_by_edits_while_they_run(tmp_path: Path) -> None:
    edited_study(tmp_path / "quiet").run()
    running = edited_study(tmp_path / "edited")
    made = plan(running)
    run_task(made, 1, 1, _Editor(lambda: edit(tmp_path / "edited")))
    with pytest.raises(FailedPointsError):  # of the model as it is now
        running.collect()
    with pytest.raises(UsageError, match="the plan was made with other model"):
        run_task(made, 1, 1, PythonApiReporter())
    shutil.copytree(tmp_path / "edited" / "study" / "parts", tmp_path / "parts")
    shutil.rmtree(tmp_path / "edited")
    again = edited_study(tmp_path / "edited")
    shutil.copytree(tmp_path / "parts", tmp_path / "edited" / "study" / "parts")
    assert again.run().simulated == 0


def test_a_controller_that_is_edited_while_a_study_runs_changes_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "gains_to_edit.py").write_text("KP = 1\n")
    code = tmp_path / "control_to_edit.py"
    code.write_text("import gains_to_edit\ndef push(model, data):\n    data.ctrl[:] = gains_to_edit.KP\n")
    controller = load_controller(f"{code}:push")
    quiet = edited_study(tmp_path / "quiet")
    controlled = replace(quiet.simulation, ctrl_from=None, controller=controller)
    replace(quiet, simulation=controlled).run()

    def edit_and_open(*arguments: Any) -> Any:
        (tmp_path / "gains_to_edit.py").write_text("KP = -3\n")
        code.write_text("def push(model, data):\n    data.ctrl[:] = 8\n")
        return open_executor(*arguments)

    monkeypatch.setattr("mjrun.study.executors.open_executor", edit_and_open)
    replace(quiet, simulation=controlled, output=str(tmp_path / "edited")).run()
    assert table(tmp_path / "edited") == table(tmp_path / "quiet" / "study")


def test_another_machine_gets_the_files_once(tmp_path: Path) -> None:
    edited_study(tmp_path / "quiet").run()
    elsewhere = edited_study(tmp_path / "elsewhere", engine="tests.study.factories:Elsewhere")
    elsewhere.run(_Editor(lambda: edit(tmp_path / "elsewhere")))
    assert table(tmp_path / "elsewhere" / "study") == table(tmp_path / "quiet" / "study")
    asked = factories.made.pop().asked
    assert asked.count(True) <= 3  # those that were under way before the first came back
    assert asked.count(False) >= 3
    isolation.end_process()


def test_parts_of_another_mujoco_are_refused_and_simulated_again(tmp_path: Path) -> None:
    edited_study(tmp_path / "quiet").run()
    reporter = _Editor(lambda: None)
    result = edited_study(tmp_path / "mixed", engine="tests.study.factories:one_of_two").run(reporter)
    assert result.statuses == {"ok": 3}
    assert table(tmp_path / "mixed" / "study") == table(tmp_path / "quiet" / "study")
    (warning,) = reporter.warnings
    assert "has mujoco 3.9.9 instead of" in warning
    assert "refused, and simulated again" in warning
    isolation.end_process()


def test_where_all_machines_have_another_mujoco_nothing_is_kept(tmp_path: Path) -> None:
    wrong = edited_study(tmp_path / "wrong", engine="tests.study.factories:all_of_them")
    with pytest.raises(FailedPointsError) as caught:
        wrong.run(_Editor(lambda: None))
    (failure,) = caught.value.results[0].failures
    assert "mujoco 3.9.9 instead of" in failure.message
    assert not list((tmp_path / "wrong" / "study" / "parts").iterdir())
    assert replace(wrong, engine="local").run().simulated == 3
    isolation.end_process()


@pytest.mark.slow
def test_kept_files_are_those_of_the_study_whatever_becomes_of_its_model(tmp_path: Path) -> None:
    options: dict[str, object] = {"vary": {"geom/bob.size": "0.1,0.2"}, "keep": ["trace", "recording"]}
    edited_study(tmp_path / "before", **options).run()
    kept = edited_study(tmp_path / "edited", **options)
    kept.run(_Editor(lambda: edit(tmp_path / "edited")))
    points = [tmp_path / folder / "study" / "points" for folder in ("before", "edited")]
    before, after = (pd.read_parquet(folder / "000000" / "trace.parquet") for folder in points)
    pd.testing.assert_frame_equal(before, after, check_exact=True)
    first, second = (np.load(folder / "000001" / "recording.npz") for folder in points)
    np.testing.assert_array_equal(first["states"], second["states"])
    facts = json.loads(str(second["facts"]))
    assert str(tmp_path / "edited" / "model.xml") in json.dumps(facts)


def test_points_with_other_meshes_are_bodies_of_their_masses(tmp_path: Path) -> None:
    for edge in (1, 2):
        corners = f"v 0 0 0\nv {edge} 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
        (tmp_path / f"{edge}.obj").write_text(corners)
    model = tmp_path / "m.xml"
    model.write_text(
        '<mujoco><asset><mesh name="m" file="1.obj"/></asset><worldbody><body name="b"><freejoint/>'
        '<geom type="mesh" mesh="m" density="6"/></body></worldbody></mujoco>'
    )
    options = {"vary": {"mesh/m.file": "1.obj,2.obj"}, "metric": {"weight": "-last(momentum/pz) / 9.81"}}
    made = Study(Simulation(model, steps=500), str(tmp_path / "study"), jobs=1, **options).run()  # type: ignore[arg-type]
    assert made.statuses == {"ok": 2}
    np.testing.assert_allclose(pd.read_csv(tmp_path / "study" / "results.csv")["weight"], [1, 2], rtol=1e-9)


def test_warnings_of_mujoco_are_reported_once(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "part.xml").write_text('<mujoco><worldbody><body name="b"><geom size="1"/></body></worldbody></mujoco>')
    (tmp_path / "m.xml").write_text(
        '<mujoco><asset><model name="part" file="part.xml"/></asset>'
        '<worldbody><attach model="part" body="b" prefix=""/></worldbody></mujoco>'
    )
    reporter = RecordingReporter()
    made = Study(
        Simulation(tmp_path / "m.xml", steps=2), str(tmp_path / "study"), vary={"opt.gravity[2]": "-9,-8"}, jobs=1
    ).run(reporter)
    assert made.statuses == {"ok": 2}
    assert [text for text in reporter.warnings if "empty prefix" in text] == reporter.warnings
    assert len(reporter.warnings) == 1
    assert "WARNING" not in capfd.readouterr().err


def test_a_parameter_that_does_not_exist_at_a_point_is_an_empty_cell(simulation: Simulation, tmp_path: Path) -> None:
    vary = {"opt.integrator": "rk4,euler", "opt.timestep": "0.001,0.004", "qvel/ball/vx": "1,2"}
    when = {"timestep": "integrator == 'rk4'", "vx": "timestep > 0.002"}
    result = study(simulation, tmp_path / "when", vary=vary, when=when).run()
    assert (result.points, result.simulated) == (4, 4)
    lines = (tmp_path / "when" / "results.csv").read_text().splitlines()
    cells = [line.split(",")[1:4] for line in lines[1:]]
    assert cells == [["rk4", "0.001", ""], ["rk4", "0.004", "1.0"], ["rk4", "0.004", "2.0"], ["euler", "", ""]]
    read = pd.read_parquet(tmp_path / "when" / "results.parquet")
    assert read["qvel/ball/vx"].isna().tolist() == [True, False, False, True]
    alone = study(replace(simulation, integrator="euler"), tmp_path / "alone", vary={"seed": "0"}).run()
    np.testing.assert_array_equal(alone.table.columns["low"], read["low"][3:])
    assert study(simulation, tmp_path / "when", vary={"opt.integrator": "euler"}).run().simulated == 0


def test_what_needs_a_local_folder_is_refused_before_the_first_point(simulation: Simulation, tmp_path: Path) -> None:
    url = f"memory://bucket/{tmp_path.name}"
    for options, message in [
        ({"keep": "trace"}, "keep: files of points are made on this machine"),
        ({"engine": "slurm"}, "the jobs need a folder that the machines share"),
    ]:
        with pytest.raises(UsageError, match=message):
            Study(simulation, url, metric=METRICS, vary={"seed": "1,2"}, **options).run()  # type: ignore[arg-type]
    assert not fsspec.filesystem("memory").exists(url)
    with pytest.raises(UsageError, match=r"is not a path on this machine; only mjrun sweep"):
        Trace(simulation, f"{url}/trace.csv")


@pytest.mark.parametrize(
    ("name", "values", "steps"),
    [("opt.timestep", "0.001,0.002,0.003", [600, 300, 200]), ("seed", "1,2,3", [300] * 3)],
)
def test_a_study_compiles_its_model_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, values: str, steps: list[int]
) -> None:
    (tmp_path / "ball.xml").write_text(BALL)
    compiled, compile_file = list[FileSource](), FileSource.compile
    monkeypatch.setattr(FileSource, "compile", lambda self: compiled.append(self) or compile_file(self))
    simulation = Simulation(str(tmp_path / "ball.xml"), duration="0.6")
    study = Study(simulation, str(tmp_path / "study"), vary={name: values}, metric={"height": "last(qpos/ball/z)"})
    prepared = PreparedStudy(study, study.spec)
    assert prepared.steps(range(3)).tolist() == steps
    assert len(compiled) == 1
