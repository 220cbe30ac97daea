"""Processes that simulate points: one that crashes or hangs costs its point alone, and may start early."""

import gc
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError, SystemLimitError
from mjrun.simulation.simulation import Simulation
from mjrun.study import point_server
from mjrun.study.isolation import IsolatedSimulator, LocalExecutor, PointChunk, end_process, run_chunk
from mjrun.study.point_server import PointSimulationServer, new_worker, start_early
from mjrun.study.simulate import PointSimulator
from mjrun.study.spec import ShippedStudy, StudyPoint, StudySpec, WorkerVersions
from tests.processes import wait_until

pytestmark = pytest.mark.usefixtures("point_processes")

METRICS = (("low", "min(qpos/ball/z)"),)


@pytest.fixture(autouse=True)
def no_process_is_left() -> Iterator[None]:
    yield
    end_process()


@pytest.fixture
def spec(ball: Simulation) -> StudySpec:
    return StudySpec(ball, ("model", "seed"), METRICS)


def shipped(spec: StudySpec, points: Sequence[StudyPoint]) -> ShippedStudy:
    """Returns a study with copies of the models that its points name."""
    base = spec.base.with_snapshot()
    assert base.snapshot
    snapshot = base.snapshot.with_files(Path(point.values[0]) for point in points)
    return ShippedStudy.of(replace(spec, base=replace(base, snapshot=snapshot)))


def points(spec: StudySpec, *names: str) -> tuple[StudyPoint, ...]:
    folder = Path(spec.base.source.text).parent
    return tuple(StudyPoint(10 + i, (str(folder / f"{name}.xml"), str(i))) for i, name in enumerate(names))


def test_the_results_are_those_of_this_process_in_the_order_of_the_points(spec: StudySpec) -> None:
    wanted = points(spec, "ball", "ball", "none", "ball")
    here = {result.index: result for part in PointSimulator(spec).run(wanted) for result in part}
    study = shipped(spec, wanted)
    for _ in range(2):  # the second time in the same process
        there = run_chunk(PointChunk(study, wanted)).results
        assert [result.index for result in there] == [10, 11, 12, 13]
        for result in there:
            np.testing.assert_array_equal(result.metrics, here[result.index].metrics)
            assert result.status == here[result.index].status
            assert result.message.splitlines()[:1] == here[result.index].message.splitlines()[:1]


def test_a_crash_costs_the_point_that_crashes(spec: StudySpec) -> None:
    wanted = points(spec, "ball", "deadly", "ball", "deadly", "ball")
    results = run_chunk(PointChunk(shipped(spec, wanted), wanted)).results
    assert [result.status for result in results] == ["ok", "crashed", "ok", "crashed", "ok"]
    assert results[1].exit_code == 128 + signal.SIGSEGV
    assert "SIGSEGV" in results[1].message


@pytest.mark.parametrize(
    "text", ["can't start new thread", "thread constructor failed: Resource temporarily unavailable"]
)
def test_a_process_that_can_start_no_thread_ends_the_study(spec: StudySpec, text: str) -> None:
    def controller(model: object, data: object) -> None:
        raise RuntimeError(text)

    controlled = replace(spec, base=replace(spec.base, controller=controller))
    wanted = points(controlled, "ball", "ball")
    with pytest.raises(SystemLimitError, match="the system starts no other process or thread"):
        run_chunk(PointChunk(shipped(controlled, wanted), wanted))


@pytest.mark.slow
def test_a_point_that_does_not_end_in_time_is_ended(spec: StudySpec) -> None:
    endless = StudySpec(spec.base, ("model", "steps"), METRICS)
    folder = Path(spec.base.source.text).parent
    wanted = [StudyPoint(i, (str(folder / "ball.xml"), steps)) for i, steps in enumerate(("5", "2000000000", "6"))]
    simulator = IsolatedSimulator(shipped(endless, wanted))
    results = {result.index: result for result in simulator.run(wanted, time_limit=0.6)}
    simulator.close()
    assert [results[i].status for i in range(3)] == ["ok", "timeout", "ok"]
    assert results[1].exit_code == 124
    assert results[1].message == "it took longer than the time limit of 0.6 s"


def test_an_error_ends_threads_and_processes_that_simulate(spec: StudySpec) -> None:
    endless = StudySpec(spec.base, ("model", "steps"), METRICS)
    wanted = (StudyPoint(0, (str(Path(spec.base.source.text).parent / "ball.xml"), "2000000000")),)
    executor = LocalExecutor(1)
    future = executor.submit(run_chunk, PointChunk(shipped(endless, wanted), wanted))
    wait_until(lambda: executor._stops and executor._stops[0]._worker)
    executor.__exit__(FileError)
    (stop,) = executor._stops
    assert stop._worker
    assert not stop._worker.process.running
    assert isinstance(future.exception(timeout=0), CancelledError)  # not a result, which would be that of a crash


def test_no_process_is_left_after_a_study(spec: StudySpec) -> None:
    wanted = points(spec, "ball")
    gc.disable()  # which would end those that are garbage, at some time
    try:
        with LocalExecutor(2) as executor:
            result = executor.submit(run_chunk, PointChunk(shipped(spec, wanted), wanted)).result()
            (worker,) = [stop._worker for stop in executor._stops if stop._worker]
    finally:
        gc.enable()
    assert [point.status for point in result.results] == ["ok"]
    assert not worker.process.running
    assert worker.connection.closed


def test_a_process_that_is_killed_from_outside_is_replaced(spec: StudySpec) -> None:
    wanted = points(spec, *["ball"] * 5)
    simulator = IsolatedSimulator(shipped(spec, wanted))
    list(simulator.run(wanted))
    assert simulator._worker
    os.kill(simulator._worker.process.pid, signal.SIGKILL)
    results = list(simulator.run(wanted))
    simulator.close()
    assert [result.status for result in results] == ["ok"] * 5


def test_each_point_has_a_result_and_each_chunk_its_versions(ball: Simulation) -> None:
    study = ShippedStudy.of(StudySpec(ball, ("seed",), METRICS))
    server = PointSimulationServer()
    server.open(study.spec, study.snapshot.root)
    for chunk in ([StudyPoint(4, ("1",)), StudyPoint(2, ("2",))], [], [StudyPoint(9, ("3",))]):
        *parts, worker_versions = server.simulate(chunk)
        results = [result for part in parts if isinstance(part, list) for result in part]
        assert {result.index for result in results} == {point.index for point in chunk}
        assert worker_versions == WorkerVersions.here([])


def test_a_worker_that_was_started_early_is_the_next_unless_that_was_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(point_server, "may_fork", lambda: False)
    start_early(1)
    start_early(1)
    first, second = (worker for _, worker in point_server._waiting)
    with closing(new_worker()) as worker:
        assert worker is first
    monkeypatch.chdir(tmp_path)
    with closing(new_worker()) as worker:
        assert worker not in (first, second)
        assert worker.process.running
        assert not second.process.running


def test_starting_one_needs_no_mujoco() -> None:
    code = "import sys, mjrun.study.point_server; sys.exit('mujoco' in sys.modules or 'numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
