"""A study before it runs: what is missing of it, in which chunks."""

from dataclasses import replace
from pathlib import Path

import pytest

from mjrun.errors import FailedPointsError, UsageError
from mjrun.reporter import WarningReporter
from mjrun.simulation.simulation import Simulation
from mjrun.study.executors import ChunkSizes
from mjrun.study.prepared import PreparedStudy
from mjrun.study.study import Study
from tests.study.models import BALL


def prepared(study: Study) -> PreparedStudy:
    return PreparedStudy.of(study, study.spec)


@pytest.fixture
def study(tmp_path: Path) -> Study:
    (tmp_path / "ball.xml").write_text(BALL)
    simulation = Simulation(str(tmp_path / "ball.xml"), steps=20)
    metric = {"low": "min(qpos/ball/z)"}
    return Study(simulation, str(tmp_path / "study"), vary={"qvel/ball/vz": "0,1,-1e9"}, metric=metric, jobs=1)


def test_a_column_of_points_that_is_no_parameter_is_told_with_its_table(study: Study, tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("seed,wrod\n1,2\n")
    with pytest.raises(UsageError, match="no parameter 'wrod'") as caught:
        prepared(replace(study, vary={}, points=str(tmp_path / "points.csv")))
    assert "points.csv are parameters, too" in caught.value.spelled(str)


def test_all_points_are_missing_and_nothing_is_written(study: Study) -> None:
    made = prepared(study)
    assert made.missing() == [0, 1, 2]
    assert [result.status for result in made.results()] == ["missing"] * 3
    assert not made.folder.exists()


def test_chunks_hold_every_missing_point_once(study: Study) -> None:
    made = prepared(study)
    chunks = [*made.chunks(made.missing(), study, ChunkSizes(2, 1))]
    assert [point.index for chunk in chunks for point in chunk.points] == [0, 1, 2]
    assert [chunk.points[0].values for chunk in chunks] == [("0",), ("-1e9",)]


def test_what_is_simulated_is_known(study: Study) -> None:
    made = prepared(study)
    made.files.create()
    (results,) = made.simulate([1], study, WarningReporter())
    assert [result.status for result in results] == ["ok"]
    assert prepared(study).missing() == [0, 2]
    with pytest.raises(FailedPointsError):
        study.run()
    assert prepared(study).missing(retry_failed=True) == []  # another try would not be more stable
