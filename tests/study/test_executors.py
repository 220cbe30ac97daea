"""Real engines give the same results, and chunks take seconds for any cost of points."""

import os
import signal
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from threading import Event
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import MissingExtraError, UsageError
from mjrun.simulation.simulation import Simulation
from mjrun.study.executors import GROWTH, MOST, QUEUED, SECONDS, ChunkSizes, completed, open_executor, process_count
from mjrun.study.isolation import run_chunk
from mjrun.study.simulate import PointSimulator
from mjrun.study.spec import ChunkResult, PointChunk, ShippedStudy, StudyPoint, StudySpec
from tests.processes import PATIENCE
from tests.study.slurm_stand_in import install


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
