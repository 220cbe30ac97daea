"""Every engine gives the same results, for real: a Dask cluster, submitit's local jobs, an executor of the user's."""

import os
import signal
from contextlib import ExitStack
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from mjrun.errors import MissingExtraError, MjrunError, UsageError
from mjrun.simulation.simulation import Simulation
from mjrun.study.executors import QUEUED, open_executor, process_count
from mjrun.study.isolation import Chunk, ShippedStudy, run_chunk
from mjrun.study.simulate import PointSimulator, StudyPoint, StudySpec
from tests.processes import PATIENCE
from tests.study.models import BALL


@pytest.fixture
def chunks(tmp_path: Path) -> list[Chunk]:
    (tmp_path / "ball.xml").write_text(BALL)
    spec = StudySpec(
        Simulation(str(tmp_path / "ball.xml"), steps=50, perturb=1), ("seed",), (("z", "last(qpos/ball/z)"),)
    )
    study = ShippedStudy.of(spec)
    return [Chunk(study, tuple(StudyPoint(10 * i + k, (str(10 * i + k),)) for k in range(3))) for i in range(4)]


@pytest.mark.parametrize("engine", ["local", "dask", "slurm", "tests.study.factories:threads"])
def test_every_engine_gives_the_same_results(tmp_path: Path, chunks: list[Chunk], engine: str) -> None:
    with ExitStack() as stack:
        executor, ahead = open_executor(engine, 2, tmp_path, stack)
        assert ahead >= 2
        futures = [executor.submit(run_chunk, chunk) for chunk in chunks]
        results = [result for future in futures for result in future.result(timeout=PATIENCE).results]

    here = PointSimulator(cast("StudySpec", chunks[0].study.spec.open()))
    expected = [result for chunk in chunks for result in here.run(chunk.points)]
    assert [result.index for result in results] == [result.index for result in expected]
    np.testing.assert_array_equal([r.metrics for r in results], [r.metrics for r in expected])


def test_a_dask_worker_that_is_killed_costs_nothing(tmp_path: Path, chunks: list[Chunk]) -> None:
    with ExitStack() as stack:
        executor, _ = open_executor("dask", 2, tmp_path, stack)
        victim = executor.submit(os.getpid).result(timeout=PATIENCE)
        futures = [executor.submit(run_chunk, chunk) for chunk in chunks]
        os.kill(victim, signal.SIGKILL)
        results = [result for future in futures for result in future.result(timeout=PATIENCE).results]
    assert [result.status for result in results] == ["ok"] * 12


@pytest.mark.parametrize(
    ("engine", "expected"),
    [
        ("ray", "no engine ray\nengines: local, warp, dask, "),
        ("nothing:here", "No module named 'nothing'"),
        ("tests.study.factories:none", "no attribute 'none'"),
        ("tests.study.factories:nothing", "returns a str, not a concurrent.futures.Executor"),
    ],
)
def test_an_engine_that_is_none_is_refused(tmp_path: Path, engine: str, expected: str) -> None:
    with ExitStack() as stack, pytest.raises(UsageError, match=expected):
        open_executor(engine, 1, tmp_path, stack)


def test_a_cluster_that_does_not_answer_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjrun.study.executors.PATIENCE", 1)
    with ExitStack() as stack, pytest.raises(MjrunError, match=r"no Dask scheduler answers at 127\.0\.0\.1:1"):
        open_executor("dask://127.0.0.1:1", 1, tmp_path, stack)


@pytest.mark.usefixtures("half_a_core")
@pytest.mark.parametrize("engine", ["local", "dask", "slurm"])
def test_processes_are_as_many_as_the_quota_of_a_container_feeds(engine: str, tmp_path: Path) -> None:
    assert process_count(engine, "auto") == 1
    assert process_count(engine, 3) == 3
    if engine == "local":
        with ExitStack() as stack:
            executor, ahead = open_executor(engine, "auto", tmp_path, stack)
            assert (executor._max_workers, ahead) == (1, QUEUED)  # type: ignore[attr-defined]


def test_one_process_has_all_of_a_gpu() -> None:
    assert process_count("warp", 8) == 1


def test_warp_without_its_library_is_told_before_any_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjrun.physics.warp_device.LIBRARIES", ("not_installed",))
    with ExitStack() as stack, pytest.raises(MissingExtraError, match="mjrun\\[warp\\]"):
        open_executor("warp", 1, tmp_path, stack)
