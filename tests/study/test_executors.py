"""Real engines, and a stand-in for Slurm, give the same results; chunks take seconds for any cost of points."""

import errno
import operator
import os
import re
import signal
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from threading import Event
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import MissingExtraError, MjrunError, OutOfMemoryError, SystemLimitError, UsageError
from mjrun.options.sweep import ExecutionOptions
from mjrun.simulation.simulation import Simulation
from mjrun.study import clusters
from mjrun.study.clusters import LostJobError, SlurmExecutor, most_jobs
from mjrun.study.executors import GROWTH, MOST, QUEUED, SECONDS, ChunkSizes, completed, open_executor, process_count
from mjrun.study.isolation import LocalExecutor, PointChunk, run_chunk
from mjrun.study.simulate import PointSimulator
from mjrun.study.spec import ChunkResult, ShippedStudy, StudyPoint, StudySpec
from tests.cases import cases
from tests.processes import PATIENCE, wait_until
from tests.study.slurm_stand_in import install, states


@pytest.fixture
def chunks(ball: Simulation) -> list[PointChunk]:
    study = ShippedStudy.of(StudySpec(replace(ball, perturb=1), ("seed",), (("z", "last(qpos/ball/z)"),)))
    return [PointChunk(study, tuple(StudyPoint(10 * i + k, (str(10 * i + k),)) for k in range(3))) for i in range(4)]


@pytest.mark.slow
@pytest.mark.usefixtures("point_processes")
@pytest.mark.parametrize("engine", ["local", "dask", "ray", "slurm", "tests.study.factories:threads"])
def test_every_engine_gives_the_same_results(
    tmp_path: Path, chunks: list[PointChunk], engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if engine == "slurm":  # which starts a process for each
        chunks = chunks[:2]
        install(tmp_path / "cluster")
        monkeypatch.setenv("PATH", str(tmp_path / "cluster"), prepend=os.pathsep)
    monkeypatch.setenv("HOME", str(tmp_path))  # where Ray stores the token of its clusters
    here = PointSimulator(cast("StudySpec", chunks[0].study.spec.open()))
    expected = [result for chunk in chunks for part in here.run(chunk.points) for result in part]
    (tmp_path / "ball.xml").unlink()  # of which the study has a copy
    with ExitStack() as stack:
        executor, ahead = open_executor(engine, 2, tmp_path, stack)
        assert ahead >= 2
        victim = executor.submit(os.getpid).result(timeout=PATIENCE) if engine in ("dask", "ray") else None
        futures = [executor.submit(run_chunk, chunk) for chunk in chunks]
        if victim:  # of which there are two: it costs nothing
            os.kill(victim, signal.SIGKILL)
        results = [result for future in futures for result in future.result(timeout=PATIENCE).results]
    assert [result.index for result in results] == [result.index for result in expected]
    np.testing.assert_array_equal([r.metrics for r in results], [r.metrics for r in expected])


@pytest.mark.parametrize(
    ("engine", "expected"),
    [
        ("rya", "no engine rya\nengines: local, warp, dask, "),
        ("nothing:here", "No module named 'nothing'"),
        ("tests.study.factories:none", "no attribute 'none'"),
        ("tests.study.factories:nothing", "returns a str, not a concurrent.futures.Executor"),
    ],
)
def test_an_engine_that_is_none_is_refused(tmp_path: Path, engine: str, expected: str) -> None:
    with ExitStack() as stack, pytest.raises(UsageError, match=expected):
        open_executor(engine, 1, tmp_path, stack)


@pytest.mark.usefixtures("half_a_core")
@pytest.mark.parametrize("engine", ["local", "dask", "ray", "slurm"])
def test_processes_are_as_many_as_the_quota_of_a_container_feeds(engine: str, tmp_path: Path) -> None:
    assert process_count(engine, "auto") == 1
    assert process_count(engine, 3) == 3
    if engine == "local":
        with ExitStack() as stack:
            executor, ahead = open_executor(engine, "auto", tmp_path, stack)
            assert (executor._max_workers, ahead) == (1, QUEUED)  # type: ignore[attr-defined]


def test_a_few_processes_share_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjrun.study.executors.available_cores", lambda: 16)
    assert [process_count("warp", jobs) for jobs in ("auto", 1, 9)] == [4, 1, 9]
    monkeypatch.setattr("mjrun.study.executors.available_cores", lambda: 2)
    assert process_count("warp", "auto") == 2


def test_warp_without_its_library_is_told_before_any_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjrun.physics.warp_device.LIBRARIES", ("not_installed",))
    with ExitStack() as stack, pytest.raises(MissingExtraError, match="mjrun\\[warp\\]"):
        open_executor("warp", 1, tmp_path, stack)


@pytest.mark.parametrize("case", ["over", "wanted"])
def test_chunks_that_have_not_begun_are_dropped_or_given_back(
    chunks: list[PointChunk], monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    started, has_begun, may_end = list[PointChunk](), Event(), Event()
    reached, given = list[str](), list[PointChunk]()

    def run(chunk: PointChunk) -> ChunkResult:
        started.append(chunk)
        has_begun.set()
        assert may_end.wait(PATIENCE)
        return chunk.failed("no reason")

    monkeypatch.setattr("mjrun.study.executors.run_chunk", run)
    monkeypatch.setattr("mjrun.study.executors.INTERVAL", 0.01)
    with ThreadPoolExecutor(1) as pool:
        is_over, is_wanted = (lambda name=name: name in reached for name in ("over", "wanted"))
        arriving = completed(pool, iter(chunks[:3]), 3, lambda _: "", is_over, is_wanted, given.extend)
        assert next(arriving) == []
        assert has_begun.wait(PATIENCE)
        reached.append(case)
        assert [*next(arriving), *next(arriving)] == []
        may_end.set()
        finished = [chunk for arrived in arriving for chunk, _ in arrived]
    assert finished == started == chunks[:1]
    assert given == (chunks[1:3] if case == "wanted" else [])


class _Immediate(Executor):
    def submit(self, call: Any, /, chunk: PointChunk, **_: Any) -> "Future[Any]":  # type: ignore[override]
        future = Future[Any]()
        future.set_result(chunk.failed("no reason"))
        return future


def test_chunks_that_are_complete_together_arrive_in_order(chunks: list[PointChunk]) -> None:
    many = [replace(chunks[0], time_limit=float(number)) for number in range(100)]
    arrived = [chunk for some in completed(_Immediate(), iter(many), 100, lambda _: "") for chunk, _ in some]
    assert [chunk.time_limit for chunk in arrived] == [*range(100)]


def division(sizes: ChunkSizes, costs: Sequence[float], ahead: int, steps: np.ndarray | None = None) -> list[int]:
    """Returns the size of each chunk, with `ahead` chunks in flight and the `costs` of points [s]."""
    counts, flying, start = list[int](), deque[tuple[int, int, float]](), 0
    steps = np.full(len(costs), 10) if steps is None else steps
    while start < len(costs):
        if len(flying) == ahead:
            sizes.add(*flying.popleft())
        count = sizes.next(steps[start:])
        part = slice(start, start + count)
        flying.append((count, int(steps[part].sum()), sum(costs[part])))
        counts.append(count)
        start += count
    return counts


@given(st.integers(1, 5000), st.integers(1, 60), st.sampled_from([0.0, 1e-5, 1e-3, 0.05, 1.0, 100.0]))
@settings(deadline=None, max_examples=30)
def test_every_point_is_in_a_chunk_that_takes_seconds(count: int, ahead: int, cost: float) -> None:
    counts = division(ChunkSizes(None, ahead), [cost] * count, ahead)
    assert sum(counts) == count
    assert min(counts) >= 1
    assert max(counts) <= MOST
    assert len(counts) >= min(ahead, count)  # each worker has as many as it takes ahead
    assert all(size == 1 or size * cost <= SECONDS * 1.001 for size in counts)
    largest = 1
    for size in counts:
        assert size <= GROWTH * largest
        largest = max(largest, size)


@pytest.mark.parametrize(("ahead", "last"), [(6, 5), (24, 5), (300, 30)])
def test_chunks_grow_to_seconds_and_shrink_towards_the_end(ahead: int, last: int) -> None:
    counts = division(ChunkSizes(None, ahead), [0.01] * 1500 * ahead, ahead)
    assert counts[:ahead] == [1] * ahead
    assert max(counts) == 300
    assert counts[-2] == pytest.approx(last, abs=1)  # 0.05 s, or a millisecond for each chunk in flight
    assert len(counts) < 15 * ahead


@pytest.mark.parametrize("order", [1, -1])
def test_chunks_take_seconds_where_points_take_ever_more_or_fewer_steps(order: int) -> None:
    steps = np.geomspace(10, 1e5, 6000).astype(int)[::order]
    costs = 2e-5 * steps
    ends = np.cumsum([0, *division(ChunkSizes(None, 6), costs.tolist(), 6, steps)])
    assert max(costs[start:end].sum() for start, end in pairwise(ends)) < 1.1 * SECONDS


def test_chunks_take_seconds_where_points_with_few_steps_are_compiled() -> None:
    steps = np.tile([10, 100_000], 500)
    costs = 0.1 + 1e-6 * steps
    counts = division(ChunkSizes(None, 6), costs.tolist(), 6, steps)
    assert max(counts) * costs.mean() < 1.1 * SECONDS
    assert sum(counts) / len(counts) > 4


def test_a_size_that_is_chosen_stays() -> None:
    assert division(ChunkSizes(40, 6), [9.0] * 100, 6) == [40, 40, 20]


@pytest.mark.parametrize(("left", "size"), [(10_000, 25), (60, 10), (1, 1)])
def test_a_first_guess_is_no_more_than_a_share(left: int, size: int) -> None:
    assert ChunkSizes(None, 6, first=25).next(np.ones(left)) == size


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


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (OSError(errno.EMFILE, "Too many open files"), SystemLimitError),
        (RuntimeError("can't start new thread"), SystemLimitError),
        (MemoryError(), OutOfMemoryError),
    ],
)
def test_a_limit_of_this_process_ends_a_study_and_is_no_result(
    chunks: list[PointChunk], monkeypatch: pytest.MonkeyPatch, error: Exception, expected: type[MjrunError]
) -> None:
    def fail(chunk: PointChunk) -> ChunkResult:
        raise error

    monkeypatch.setattr("mjrun.study.executors.run_chunk", fail)
    with LocalExecutor(1) as executor, pytest.raises(expected):
        [*completed(executor, iter(chunks), 1, lambda _: "")]


def test_a_job_that_slurm_refuses_is_reported(tmp_path: Path, cluster: Path) -> None:
    (cluster / "limit").write_text("0")
    assert process_count("slurm", "auto") == 1000  # whatever this machine has
    assert process_count("slurm", 500, ("array=20",)) == 20
    with SlurmExecutor(tmp_path, (), 1000, print) as executor:
        future = executor.submit(os.getpid)
        with pytest.raises(UsageError, match=r"engine slurm: .*violates accounting/QOS policy"):
            future.result(PATIENCE)


@cases("engine, text, expected")
def test_settings_of_slurm_are_checked(engine: str, text: str, expected: str) -> None:
    with pytest.raises(UsageError, match=expected):
        ExecutionOptions(engine=engine, slurm=text)  # type: ignore[arg-type]
