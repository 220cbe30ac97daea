"""The process that simulates points, which may start before it is needed."""

import subprocess
import sys
from pathlib import Path

import pytest

from mjrun.simulation.simulation import Simulation
from mjrun.study import point_server
from mjrun.study.point_server import PointServer, new_worker, start_early
from mjrun.study.spec import PointResult, Proof, ShippedStudy, StudyPoint, StudySpec
from tests.study.models import BALL


def test_each_point_has_a_result_and_each_chunk_a_proof(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(BALL)
    spec = StudySpec(Simulation(str(tmp_path / "ball.xml"), steps=5), ("seed",), (("z", "last(qpos/ball/z)"),))
    shipped = ShippedStudy.of(spec)
    server = PointServer()
    server.open(shipped.spec, shipped.snapshot.root)
    for points in ([StudyPoint(4, ("1",)), StudyPoint(2, ("2",))], [], [StudyPoint(9, ("3",))]):
        *results, proof = server.simulate(points)
        assert {each.index for each in results if isinstance(each, PointResult)} == {point.index for point in points}
        assert proof == Proof.here([])


def test_a_worker_that_was_started_early_is_the_next_unless_that_was_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start_early()
    start_early()
    first, second = (worker for _, worker in point_server._waiting)
    with new_worker() as worker:
        assert worker is first
    monkeypatch.chdir(tmp_path)
    with new_worker() as worker:
        assert worker not in (first, second)
        assert worker.process.running
        assert not second.process.running


def test_starting_one_needs_no_mujoco() -> None:
    code = "import sys, mjrun.study.point_server; sys.exit('mujoco' in sys.modules or 'numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
