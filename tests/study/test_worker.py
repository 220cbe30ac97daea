"""The process that simulates points serves its connection, and ends with it."""

from multiprocessing.connection import Pipe
from pathlib import Path

from mjrun.child_process import ChildProcess, python_call
from mjrun.simulation.simulation import Simulation
from mjrun.study.isolation import ShippedStudy
from mjrun.study.proof import Proof
from mjrun.study.simulate import StudyPoint, StudySpec
from tests.processes import PATIENCE
from tests.study.models import BALL


def test_it_answers_with_each_result_and_ends_when_its_parent_hangs_up(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(BALL)
    spec = StudySpec(Simulation(str(tmp_path / "ball.xml"), steps=5), ("seed",), (("z", "last(qpos/ball/z)"),))
    ours, theirs = Pipe()
    with ChildProcess(python_call("mjrun.study.worker:main"), descriptors=[theirs.fileno()]) as process:
        theirs.close()
        shipped = ShippedStudy.of(spec)
        ours.send((shipped.spec, shipped.snapshot.root))
        assert ours.recv() == Proof.here([])
        for points in ([StudyPoint(4, ("1",)), StudyPoint(2, ("2",))], [], [StudyPoint(9, ("3",))]):
            ours.send(points)
            assert sorted(ours.recv().index for _ in points) == sorted(point.index for point in points)
            assert ours.recv() == Proof.here([])
        ours.close()
        assert process.wait(PATIENCE).code == 0
