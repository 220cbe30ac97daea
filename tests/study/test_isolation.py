"""A point that crashes or hangs its process costs that point alone."""

import os
import signal
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjrun.simulation.simulation import Simulation
from mjrun.study.isolation import IsolatedSimulator, end_process, run_chunk
from mjrun.study.simulate import PointSimulator
from mjrun.study.spec import Chunk, ShippedStudy, StudyPoint, StudySpec
from tests.study.models import BALL, DEADLY

METRICS = (("low", "min(qpos/ball/z)"),)


@pytest.fixture(autouse=True)
def no_process_is_left() -> Iterator[None]:
    yield
    end_process()


@pytest.fixture
def spec(tmp_path: Path) -> StudySpec:
    (tmp_path / "ball.xml").write_text(BALL)
    (tmp_path / "deadly.xml").write_text(DEADLY)
    return StudySpec(Simulation(str(tmp_path / "ball.xml"), steps=20), ("model", "seed"), METRICS)


def shipped(spec: StudySpec, points: Sequence[StudyPoint]) -> ShippedStudy:
    """The study, with copies of the models that its points name."""
    base = spec.base.with_snapshot()
    assert base.snapshot
    snapshot = base.snapshot.with_files(Path(point.values[0]) for point in points)
    return ShippedStudy.of(replace(spec, base=replace(base, snapshot=snapshot)))


def points(spec: StudySpec, *names: str) -> tuple[StudyPoint, ...]:
    folder = Path(spec.base.source.text).parent
    return tuple(StudyPoint(10 + i, (str(folder / f"{name}.xml"), str(i))) for i, name in enumerate(names))


def test_the_results_are_those_of_this_process_in_the_order_of_the_points(spec: StudySpec) -> None:
    wanted = points(spec, "ball", "ball", "none", "ball")
    here = {result.index: result for result in PointSimulator(spec).run(wanted)}
    study = shipped(spec, wanted)
    for _ in range(2):  # the second time in the same process
        there = run_chunk(Chunk(study, wanted)).results
        assert [result.index for result in there] == [10, 11, 12, 13]
        for result in there:
            np.testing.assert_array_equal(result.metrics, here[result.index].metrics)
            assert result.status == here[result.index].status
            assert result.message.splitlines()[:1] == here[result.index].message.splitlines()[:1]


def test_a_crash_costs_the_point_that_crashes(spec: StudySpec) -> None:
    wanted = points(spec, "ball", "deadly", "ball", "deadly", "ball")
    results = run_chunk(Chunk(shipped(spec, wanted), wanted)).results
    assert [result.status for result in results] == ["ok", "crashed", "ok", "crashed", "ok"]
    assert results[1].exit_code == 128 + signal.SIGSEGV
    assert "SIGSEGV" in results[1].message


@pytest.mark.slow
def test_a_point_that_does_not_end_in_time_is_ended(spec: StudySpec) -> None:
    endless = StudySpec(spec.base, ("model", "steps"), METRICS)
    folder = Path(spec.base.source.text).parent
    wanted = [StudyPoint(i, (str(folder / "ball.xml"), steps)) for i, steps in enumerate(("5", "2000000000", "6"))]
    simulator = IsolatedSimulator(shipped(endless, wanted))
    results = {result.index: result for result in simulator.run(wanted, time_limit=1)}
    simulator.close()
    assert [results[i].status for i in range(3)] == ["ok", "timeout", "ok"]
    assert results[1].exit_code == 124
    assert "did not end in time" in results[1].message


def test_a_process_that_is_killed_from_outside_is_replaced(spec: StudySpec) -> None:
    wanted = points(spec, *["ball"] * 5)
    simulator = IsolatedSimulator(shipped(spec, wanted))
    list(simulator.run(wanted))
    assert simulator._worker
    os.kill(simulator._worker.process.pid, signal.SIGKILL)
    results = list(simulator.run(wanted))
    simulator.close()
    assert [result.status for result in results] == ["ok"] * 5
