"""Jobs of Slurm, run by a stand-in for it: the settings of arrays, limits of the queue, and cancelled jobs."""

import operator
import os
import re
import signal
import time
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import pytest

from mjrun.errors import UsageError
from mjrun.options.sweep import ExecutionOptions
from mjrun.simulation.simulation import Simulation
from mjrun.study import clusters
from mjrun.study.clusters import LostJobError, SlurmExecutor, most_jobs
from mjrun.study.executors import completed, process_count
from mjrun.study.spec import ChunkResult, PointChunk, ShippedStudy, StudyPoint, StudySpec
from tests.processes import PATIENCE, wait_until
from tests.study.slurm_stand_in import install, states


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the stand-in for Slurm, whose commands are found first."""
    folder = tmp_path / "cluster"
    install(folder)
    monkeypatch.setenv("PATH", str(folder), prepend=os.pathsep)
    return folder


def log(cluster: Path) -> list[str]:
    return (cluster / "log").read_text().splitlines()


def test_calls_that_arrive_together_are_one_array_with_the_settings(tmp_path: Path, cluster: Path) -> None:
    texts = "partition=long,account=lab,time=2h,mem=16GB,gpus=a100:2,cpus=4,array=2"
    settings = ExecutionOptions(engine="slurm", slurm=texts).slurm  # type: ignore[arg-type]
    with SlurmExecutor(tmp_path, settings, most_jobs("auto", settings), print) as executor:
        with executor.batch():
            futures = [executor.submit(operator.floordiv, 7, divisor) for divisor in (1, 2, 0)]
        wait_until(lambda: [*tmp_path.glob("slurm/*/1000_submission.sh")])
        (script,) = tmp_path.glob("slurm/*/1000_submission.sh")
        lines = script.read_text().splitlines()
        assert [future.result(PATIENCE) for future in futures[:2]] == [7, 3]
        with pytest.raises(Exception, match="ZeroDivisionError"):
            futures[2].result(PATIENCE)
    wanted = ["partition=long", "account=lab", "time=120", "mem=16G", "gpus-per-node=a100:2", "cpus-per-task=4"]
    for each in [*wanted, "array=0-2%2"]:
        assert f"#SBATCH --{each}" in lines
    assert log(cluster) == ["sbatch 0-2%2"]
    assert {path.name for path in tmp_path.glob("slurm/*/*_log.err")} == {"1000_2_0_log.err"}  # of the failed one


def test_the_jobs_in_flight_are_as_many_as_the_queue_accepts(
    tmp_path: Path, cluster: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clusters, "BUSY", 0)
    monkeypatch.setattr(clusters, "EVERY", 0)
    (cluster / "limit").write_text("2")
    with SlurmExecutor(tmp_path, (), 100, print) as executor:
        with executor.batch():
            futures = [executor.submit(operator.neg, number) for number in range(5)]
        assert [future.result(PATIENCE) for future in futures] == [0, -1, -2, -3, -4]
    assert log(cluster)[:2] == ["sbatch 0-4%5", "sbatch 0-1%2"]
    wait_until(lambda: [*states(cluster).values()] == ["COMPLETED"] * 5)
    assert not (tmp_path / "slurm").exists()


def test_when_a_run_is_over_waiting_jobs_are_cancelled_and_running_ones_finish(
    tmp_path: Path, cluster: Path, ball: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = ShippedStudy.of(StudySpec(ball, ("seed",), ()))
    contents = {"release": str(tmp_path / "release").encode()}
    chunks = [PointChunk(study, (StudyPoint(i, (str(i),)),), contents=contents) for i in range(3)]
    monkeypatch.setattr("mjrun.study.executors.run_chunk", _fail_when_released)
    notes, over = list[str](), list[bool]()
    with SlurmExecutor(tmp_path, (), 1, notes.append) as executor:
        arriving = completed(executor, iter(chunks), 3, lambda _: "", lambda: bool(over))
        assert next(arriving) == []
        wait_until(lambda: any(future.running() for future in [*executor._jobs]))
        over.append(True)
        assert [*next(arriving), *next(arriving)] == []
        wait_until(lambda: notes)
        (tmp_path / "release").touch()
        assert [chunk for arrived in arriving for chunk, _ in arrived] == chunks[:1]
    assert notes == ["2 jobs of Slurm cancelled: 2 waiting"]
    assert log(cluster) == ["sbatch 0-2%1", "scancel 1000_1 1000_2"]
    wait_until(lambda: [*states(cluster).values()] == ["COMPLETED", "CANCELLED", "CANCELLED"])


def _fail_when_released(chunk: PointChunk) -> ChunkResult:
    assert chunk.contents
    while not os.path.exists(chunk.contents["release"]):  # noqa: PTH110
        time.sleep(0.01)
    return chunk.failed("no reason")


def test_lost_jobs_are_tried_again_once_and_those_over_time_in_parts(
    tmp_path: Path, cluster: Path, ball: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("EVERY", "SLOW_FILES", "REQUEUE"):
        monkeypatch.setattr(clusters, name, 0)
    monkeypatch.setattr("mjrun.study.executors.run_chunk", _end)
    study, points = ShippedStudy.of(StudySpec(ball, ("seed",), ())), [StudyPoint(i, (str(i),)) for i in range(2)]
    chunk = PointChunk(study, tuple(points), contents={"cluster": str(cluster).encode()})
    losses = list[tuple[PointChunk, LostJobError]]()
    with SlurmExecutor(tmp_path, (), 4, print) as executor:
        arriving = completed(executor, iter([chunk]), 4, lambda _: "", lost=lambda *loss: losses.append(loss))
        arrived = [each for some in arriving for each in some]
    assert [(len(part.points), error.state) for part, error in losses] == [(2, "TIMEOUT"), (1, "NODE_FAIL")]
    messages = {point.index: result.results[0].message for part, result in arrived for point in part.points}
    assert messages[0] == "simulated"
    assert re.fullmatch(r"the engine lost it: the job ended as PREEMPTED without a result: see .*\.err", messages[1])
    assert sorted(states(cluster).values()) == ["COMPLETED", "NODE_FAIL", "PREEMPTED", "TIMEOUT"]


def _end(chunk: PointChunk) -> ChunkResult:
    """Simulates point 0 alone; Slurm ends the job of the pair, and both jobs of point 1."""
    if len(chunk.points) == 1 and chunk.points[0].index == 0:
        return chunk.failed("simulated")
    assert chunk.contents
    job = "_".join(os.environ[name] for name in ("SLURM_ARRAY_JOB_ID", "SLURM_ARRAY_TASK_ID") if name in os.environ)
    state = "TIMEOUT" if len(chunk.points) == 2 else ("NODE_FAIL", "PREEMPTED")[chunk.losses]
    path = Path(os.fsdecode(chunk.contents["cluster"])) / f"{job or os.environ['SLURM_JOB_ID']}.state"
    path.write_text(state)
    os.killpg(0, signal.SIGKILL)
    raise AssertionError


def test_a_point_that_reaches_the_time_limit_alone_has_failed(ball: Simulation) -> None:
    class OverTime(Executor):
        def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> "Future[Any]":
            future = Future[Any]()
            future.set_exception(LostJobError("TIMEOUT", Path("log")))
            return future

    study = ShippedStudy.of(StudySpec(ball, ("seed",), ()))
    chunk = PointChunk(study, tuple(StudyPoint(i, (str(i),)) for i in range(3)))
    arrived = [each for some in completed(OverTime(), iter([chunk]), 4, lambda _: "") for each in some]
    assert sorted(len(part.points) for part, _ in arrived) == [1, 1, 1]
    assert all("; raise the time of jobs, or limit" in result.results[0].message for _, result in arrived)


def test_a_job_that_slurm_refuses_is_reported(tmp_path: Path, cluster: Path) -> None:
    (cluster / "limit").write_text("0")
    assert process_count("slurm", "auto") == 1000  # whatever this machine has
    assert process_count("slurm", 500, ("array=20",)) == 20
    with SlurmExecutor(tmp_path, (), 1000, print) as executor:
        future = executor.submit(os.getpid)
        with pytest.raises(UsageError, match=r"engine slurm: .*violates accounting/QOS policy"):
            future.result(PATIENCE)


@pytest.mark.parametrize(
    ("engine", "text", "expected"),
    [
        ("slurm", "array=0", "not a valid setting"),
        ("local", "time=2h", "slurm requires engine slurm"),
        ("slurm", "partitoin=a", "not a setting of Slurm; settings: partition, account"),
        ("slurm", "time=30", "time=90min"),
        ("slurm", "account=a\n#SBATCH", "not a valid setting"),
    ],
)
def test_settings_of_slurm_are_checked(engine: str, text: str, expected: str) -> None:
    with pytest.raises(UsageError, match=expected):
        ExecutionOptions(engine=engine, slurm=text)  # type: ignore[arg-type]
