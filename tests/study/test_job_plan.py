"""Studies before they run: prepared, previewed against the study that is run, and planned for tasks."""

import errno
import os
import tracemalloc
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import FailedPointsError, FileError, UsageError
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.simulation import Simulation
from mjrun.study.executors import ChunkSizes
from mjrun.study.job_plan import MOST_RANGES, JobPlan, JobTaskResult, plan, ranges_of, run_task, task_points
from mjrun.study.leases import Leases, PointLeaser
from mjrun.study.prepared import PreparedStudy
from mjrun.study.study import Study, StudyPreview
from tests.reporters import RecordingReporter
from tests.study.models import BALL


@pytest.fixture
def study(ball: Simulation, tmp_path: Path) -> Study:
    vary = {"qpos/ball/z": "0.2..1:5", "qvel/ball/vz": "0,-1e9"}
    return Study(ball, str(tmp_path / "study"), vary=vary, metric={"low": "min(qpos/ball/z)"}, jobs=1, chunk=3)


def task(made: JobPlan, number: int, count: int) -> JobTaskResult:
    return run_task(made, number, count, PythonApiReporter())


@pytest.mark.slow
def test_tasks_in_any_order_make_the_table_of_the_study(study: Study, tmp_path: Path) -> None:
    alone = replace(study, output=str(tmp_path / "alone"))
    with pytest.raises(FailedPointsError):
        alone.run()
    made = plan(study)
    assert made.ranges == [(0, 10)]
    with pytest.raises(FailedPointsError) as caught:
        study.collect()
    assert caught.value.results[0].statuses == {"missing": 10}

    done = [task(made, number, 3) for number in (3, 1)]
    assert [(each.points, each.simulated) for each in done] == [(3, 3), (4, 4)]
    with pytest.raises(FailedPointsError, match="3 missing, of 10 points"):
        study.collect()
    assert plan(study).ranges == [(1, 2), (4, 5), (7, 8)]
    assert task(made, 2, 3).simulated == 3
    assert task(made, 1, 1).simulated == 0
    with pytest.raises(FailedPointsError) as caught:
        study.collect()
    assert caught.value.results[0].statuses == {"ok": 5, "unstable": 5}
    names = ("results.parquet", "results.csv")
    assert [(tmp_path / "study" / name).read_bytes() for name in names] == [
        (tmp_path / "alone" / name).read_bytes() for name in names
    ]


def test_a_task_without_points_does_nothing(study: Study) -> None:
    assert task(plan(study), 11, 11).points == 0


def test_a_task_whose_points_are_known_does_nothing_on_any_engine(study: Study) -> None:
    made = plan(replace(study, engine="tests.study.factories:in_this_process"))
    assert [task(made, 1, 1).simulated for _ in range(2)] == [10, 0]


@given(st.sets(st.integers(0, 400)), st.integers(1, 60))
def test_tasks_divide_all_points_evenly(points: set[int], tasks: int) -> None:
    ranges = ranges_of(np.array(sorted(points), np.int64))
    assert [point for first, stop in ranges for point in range(first, stop)] == sorted(points)
    assert all(one[1] < other[0] for one, other in pairwise(ranges))
    shares = [task_points(ranges, task, tasks).tolist() for task in range(1, tasks + 1)]
    assert all(share == sorted(share) for share in shares)
    assert sorted(point for share in shares for point in share) == sorted(points)
    counts = [*map(len, shares)]
    assert max(counts) - min(counts) <= max(1, -(-len(points) // (4 * tasks)))
    assert counts.count(0) == max(0, tasks - len(points))


def test_a_plan_of_many_holes_has_few_ranges() -> None:
    points = np.concatenate([np.arange(0, 10 * MOST_RANGES, 2), [10**9]])
    ranges = ranges_of(points)
    assert len(ranges) == MOST_RANGES
    assert ranges[-1] == (10**9, 10**9 + 1)
    inside = np.concatenate([np.arange(first, stop) for first, stop in ranges])
    assert np.isin(points, inside).all()


def test_a_task_opens_only_the_parts_of_its_points(study: Study) -> None:
    made, reporter = plan(study), RecordingReporter()
    task(made, 1, 2)
    parts = [*(Path(study.output) / "parts").iterdir()]
    assert len(parts) == 3  # of blocks of two points, of which every second one is of the other task
    for part in parts:
        part.write_text("damaged")
    assert run_task(made, 2, 2, reporter).simulated == 4
    assert reporter.warnings == []
    assert run_task(made, 1, 2, reporter).simulated == 6
    assert len(reporter.warnings) == 3


def test_a_task_needs_no_memory_for_the_points_of_others(study: Study) -> None:
    large = replace(study, vary={"qpos/ball/z": "0.2..1:10000", "qvel/ball/vz": "0..1:1000"})
    PreparedStudy(study, study.spec)  # which imports what they need
    tracemalloc.start()
    prepared = PreparedStudy(large, large.spec)
    prepared.numbers = np.arange(5 * 10**6, 5 * 10**6 + 10)
    assert [*prepared.missing()] == [*prepared.numbers]
    assert tracemalloc.get_traced_memory()[1] < 10**7  # bytes, of 10**7 points
    tracemalloc.stop()


def test_a_plan_of_another_model_or_version_is_refused(study: Study, tmp_path: Path) -> None:
    made = plan(study)
    other = replace(made, identity={**made.identity, "mujoco": "3.9.9"})
    with pytest.raises(UsageError, match=r"^the plan was made with other mujoco 3.9.9, here \d"):
        task(other, 1, 1)
    (tmp_path / "ball.xml").write_text(BALL.replace("0.002", "0.001"))
    with pytest.raises(UsageError, match=r"^the plan was made with other model; files\n"):
        task(made, 1, 1)


def test_a_plan_that_is_edited_between_tasks_is_refused(study: Study) -> None:
    made = plan(study)
    for change, expected in (
        ({"metric": {"low": "max(qpos/ball/z)"}}, r"^the plan was made with other metrics\n"),
        ({"vary": {"qpos/ball/z": "0.2..1:10"}}, r"^the plan was made with other points\n"),
    ):
        with pytest.raises(UsageError, match=expected):
            task(replace(made, study=replace(study, **change)), 1, 1)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="the plan has a point 10, but its study has 10"):
        task(replace(made, ranges=[(0, 11)]), 1, 1)
    assert [*Path(study.output, "parts").iterdir()] == []


@pytest.mark.slow
def test_a_full_disk_costs_a_task_what_it_could_not_write(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    study = replace(study, chunk=1)
    made, written = plan(study), list[object]()
    write = pyarrow.parquet.ParquetWriter.write_table

    def write_once(*arguments: Any) -> None:
        written.append(arguments)
        if len(written) > 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(*arguments)

    monkeypatch.setattr("mjrun.study.executors.INTERVAL", 0)  # a part for each chunk
    with monkeypatch.context() as patch:
        patch.setattr(pyarrow.parquet.ParquetWriter, "write_table", write_once)
        with pytest.raises(FileError, match="cannot be written: No space left on device") as failed:
            task(made, 1, 2)
    where = f"finished points are kept in {study.output}/parts; repeat the command to continue"
    assert failed.value.__notes__ == [where]
    (part,) = Path(study.output, "parts").iterdir()  # neither a lease nor half a part
    rows = pyarrow.parquet.read_metadata(part).num_rows
    assert task(made, 1, 1).simulated == 10 - rows
    with pytest.raises(FailedPointsError) as caught:
        study.collect()
    assert caught.value.results[0].statuses == {"ok": 5, "unstable": 5}


def test_requirements_are_not_judged_while_points_are_missing(study: Study) -> None:
    required = replace(study, require=["share(ok) > 0.9"])
    plan(required)
    with pytest.raises(FailedPointsError) as caught:
        required.collect()
    assert caught.value.results[0].assertions == []


def test_there_must_be_something_to_collect(study: Study) -> None:
    with pytest.raises(FileError, match="contains no results of a study"):
        study.collect()


def test_a_column_of_points_that_is_no_parameter_is_told_with_its_table(study: Study, tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("seed,wrod\n1,2\n")
    with pytest.raises(UsageError, match="no parameter 'wrod'") as caught:
        PreparedStudy(replace(study, vary={}, points=str(tmp_path / "points.csv")), study.spec)
    assert "points.csv are parameters, too" in caught.value.spelled(str)


def test_chunks_contain_every_missing_point_once(study: Study) -> None:
    prepared = PreparedStudy(study, study.spec)
    assert [result.status for result in prepared.known] == ["missing"] * 10
    prepared.files.create()
    with Leases(prepared.files.ranges) as leases:
        leased = PointLeaser(prepared.missing(), prepared.known, prepared.files, leases, 1)
        chunks = [chunk for chunk in prepared.chunks(leased, study, ChunkSizes(4, 1)) if chunk]
    assert [point.index for chunk in chunks for point in chunk.points] == [*range(10)]
    assert [chunk.points[0].values for chunk in chunks] == [("0.2", "0"), ("0.6", "0"), ("1", "0")]


@pytest.mark.parametrize("steps", [1, 40, 5000])
def test_the_first_point_of_each_process_is_recorded_before_others_wait_for_it(study: Study, steps: int) -> None:
    longer = replace(study, simulation=replace(study.simulation, steps=steps), chunk=None)
    prepared = PreparedStudy(longer, longer.spec)
    sizes, steps_of_all = prepared.chunk_sizes(longer, ahead=2), prepared.steps(range(10))
    assert [sizes.next(steps_of_all, left=1000) for _ in range(2)] == [1, 1]
    sizes.add(1, steps, 1.2)  # points that take seconds each
    assert sizes.next(steps_of_all, left=1000) == 2


def test_processes_that_share_a_gpu_share_the_points_unless_they_are_few(study: Study) -> None:
    warped = replace(study, vary={"qpos/ball/z": "0.2..1:1200"}, engine="warp", chunk=None)
    prepared = PreparedStudy(warped, warped.spec)
    firsts = [
        prepared.chunk_sizes(replace(warped, jobs=jobs), ahead=2 * jobs).next(np.zeros(1200)) for jobs in (1, 4, 9)
    ]
    assert firsts == [1200, 300, 256]


def test_simulated_points_are_known(study: Study) -> None:
    prepared = PreparedStudy(study, study.spec)
    prepared.files.create()
    assert prepared.simulate([1, 2], study, PythonApiReporter()) == {"unstable": 1, "ok": 1}
    again = PreparedStudy(study, study.spec)
    assert (
        [*again.missing()] == [*again.missing(retry_failed=True)] == [0, *range(3, 10)]
    )  # another try is not more stable


@pytest.fixture
def timed(ball: Simulation, study: Study) -> Study:
    vary = {"opt.timestep": "0.001,0.002,0.01", "seed": "1..4:4"}
    return replace(study, simulation=replace(ball, steps=None, duration=0.1), vary=vary, jobs=2, chunk=None)


def test_it_counts_what_a_run_does_and_writes_nothing(timed: Study) -> None:
    preview: StudyPreview = timed.preview()
    assert (preview.points, preview.known, preview.missing, preview.processes) == (12, 0, 12, 2)
    assert preview.steps == 4 * (100 + 50 + 10)
    assert [each.point for each in preview.sample] == [0, 1, 2, 9, 10, 11]
    assert preview.sample[-1].values == {"opt.timestep": "0.01", "seed": "4"}
    assert preview.wall is not None
    assert preview.wall > (preview.point_wall or 0) > 0
    assert not Path(timed.output).exists()

    timed.run()
    files = sum(path.stat().st_size for path in Path(timed.output).rglob("*") if path.is_file())
    assert 0.3 * files < preview.disk < 3 * files
    again = timed.preview()
    assert (again.known, again.missing, again.chunks, again.steps, again.wall) == (12, 0, 0, 0, 0)


def test_a_point_that_fails_has_no_time_and_says_why(timed: Study, point_processes: None) -> None:
    folder = Path(timed.output).parent
    failing = replace(timed, vary={"model": f"{folder}/deadly.xml,{folder}/ball.xml"})
    preview = failing.preview()
    assert (preview.point_wall, preview.wall) == (None, None)
    assert "SIGSEGV" in preview.message


def test_an_engine_of_its_own_has_no_known_number_of_processes(timed: Study) -> None:
    preview = replace(timed, engine="tests.study.factories:threads").preview()
    assert (preview.processes, preview.wall) == (None, None)
    assert preview.point_wall is not None
    with pytest.raises(UsageError, match="engines: local"):
        replace(timed, engine="rya").preview()
