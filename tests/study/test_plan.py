"""Tasks of a plan do together what a study does alone, and nothing where the results would be others."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import FailedPointsError, FileError, UsageError
from mjrun.reporter import WarningReporter
from mjrun.simulation.simulation import Simulation
from mjrun.study.plan import StudyPlan, TaskResult, plan, run_task, task_points
from mjrun.study.spec import StudyPoint
from mjrun.study.study import Study
from tests.study.models import BALL


@pytest.fixture
def study(tmp_path: Path) -> Study:
    (tmp_path / "ball.xml").write_text(BALL)
    simulation = Simulation(str(tmp_path / "ball.xml"), steps=20)
    vary = {"qpos/ball/z": "0.2..1:5", "qvel/ball/vz": "0,-1e9"}
    return Study(simulation, str(tmp_path / "study"), vary=vary, metric={"low": "min(qpos/ball/z)"}, jobs=1, chunk=3)


def task(made: StudyPlan, number: int, count: int) -> TaskResult:
    return run_task(made, number, count, WarningReporter())


def test_tasks_in_any_order_make_the_table_of_the_study(study: Study, tmp_path: Path) -> None:
    alone = replace(study, output=str(tmp_path / "alone"))
    with pytest.raises(FailedPointsError):
        alone.run()
    made = plan(study)
    assert [len(line) for line in made.chunks] == [3, 3, 3, 1]
    with pytest.raises(FailedPointsError) as caught:
        study.collect()
    assert caught.value.results[0].statuses == {"missing": 10}

    done = [task(made, number, 3) for number in (3, 1)]
    assert [(each.points, each.simulated) for each in done] == [(3, 3), (4, 4)]
    with pytest.raises(FailedPointsError, match="3 missing, of 10 points"):
        study.collect()
    assert [len(line) for line in plan(study).chunks] == [3]
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


@given(st.lists(st.integers(1, 40), max_size=8), st.integers(1, 60))
def test_tasks_divide_all_points_evenly(lines: list[int], tasks: int) -> None:
    every = [StudyPoint(index, ()) for index in range(sum(lines))]
    ends = np.cumsum([0, *lines]).tolist()
    made = StudyPlan(
        Study(Simulation("ball.xml"), "study"), (), {}, [every[start:end] for start, end in pairwise(ends)]
    )
    shares = [task_points(made, task, tasks) for task in range(1, tasks + 1)]
    assert sorted(point.index for share in shares for point in share) == [*range(len(every))]
    counts = [*map(len, shares)]
    assert max(counts) - min(counts) <= max(1, -(-len(every) // (4 * tasks)))
    assert counts.count(0) == max(0, tasks - len(every))


def test_a_plan_of_another_model_or_version_is_refused(study: Study, tmp_path: Path) -> None:
    made = plan(study)
    other = replace(made, identity={**made.identity, "mujoco": "3.9.9"})
    with pytest.raises(UsageError, match=r"^the plan was made with other mujoco 3.9.9, here \d"):
        task(other, 1, 1)
    (tmp_path / "ball.xml").write_text(BALL.replace("0.002", "0.001"))
    with pytest.raises(UsageError, match=r"^the plan was made with other model; files\n"):
        task(made, 1, 1)


def test_requirements_are_not_judged_while_points_are_missing(study: Study) -> None:
    required = replace(study, require=["share(ok) > 0.9"])
    plan(required)
    with pytest.raises(FailedPointsError) as caught:
        required.collect()
    assert caught.value.results[0].assertions == []


def test_there_must_be_something_to_collect(study: Study) -> None:
    with pytest.raises(FileError, match="there are no results of a study"):
        study.collect()
