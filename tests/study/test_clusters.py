"""Clusters: what their tasks do, and those that cannot be used; test_executors.py runs chunks on real ones."""

import importlib.util
import os
import sys
import time
from concurrent.futures import Future
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from mjrun.errors import UsageError
from mjrun.python_code import PickledWithCode
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.study import clusters
from mjrun.study.clusters import ClusterExecutor, open_cluster
from mjrun.study.executors import QUEUED, ExecutorEndedError, completed, open_executor
from mjrun.study.isolation import PointChunk
from mjrun.study.spec import ShippedStudy


@pytest.mark.parametrize("engine", ["dask://127.0.0.1:1", "ray://127.0.0.1:1"])
def test_a_cluster_that_does_not_answer_is_told(monkeypatch: pytest.MonkeyPatch, engine: str) -> None:
    monkeypatch.setattr("mjrun.study.clusters.PATIENCE", 1)
    monkeypatch.setattr("ray.util.client.worker.INITIAL_TIMEOUT_SEC", 0.01)
    monkeypatch.delenv(clusters.FORKS)
    with ExitStack() as stack, pytest.raises(UsageError, match=f"engine: {engine} cannot be used: .*[Tt]ime"):
        open_cluster(engine, 1, stack, print)
    assert os.environ.get(clusters.FORKS) == ("0" if engine.startswith("ray") else None)


def _begin(mark: Path) -> None:
    mark.touch()
    time.sleep(60)


@pytest.mark.slow
def test_an_interrupted_cluster_of_dask_prints_no_warnings(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with ExitStack() as stack:
        executor, _ = open_executor("dask", 1, tmp_path, stack)
        executor.submit(_begin, tmp_path / "begun")
        while not (tmp_path / "begun").exists():
            time.sleep(0.01)
    assert "WARNING" not in capfd.readouterr().err


@pytest.mark.parametrize("workers", [0, 2])
def test_a_cluster_without_workers_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: int) -> None:
    notes = list[str]()
    monkeypatch.setitem(clusters._CONNECT, "dask", lambda *_: (Future, lambda: workers))
    with ExitStack() as stack:
        _, ahead = open_executor("dask://host:1", 1, tmp_path, stack, note=notes.append)
    assert ahead == max(1, workers) * QUEUED
    assert len(notes) == (not workers)


def test_a_cluster_that_loses_its_workers_is_reported_and_left_when_the_budget_is_spent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now, present, notes, is_spent = [0.0], [2], list[str](), list[bool]()
    monkeypatch.setattr(clusters, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr("mjrun.study.executors.INTERVAL", 0)
    cluster = ClusterExecutor("engine dask://host:1", lambda *_: Future(), lambda: present[0], notes.append)
    chunk = PointChunk(ShippedStudy(PickledWithCode(b"", ()), 1, InputSnapshot.empty()), ())
    arriving = completed(cluster, iter([chunk]), 3, lambda _: "", lambda: bool(is_spent))

    def seconds(count: int, workers: int) -> None:
        present[0] = workers
        for _ in range(count):
            now[0] += 1
            assert next(arriving) == []

    seconds(100, 2)
    seconds(50, 0)
    seconds(30, 1)
    assert not notes
    seconds(200, 0)
    assert notes == ["engine dask://host:1 has had no workers for 60 s; waiting for some"]
    seconds(20, 1)
    seconds(200, 0)
    assert len(notes) == 2
    seconds(20, 1)
    is_spent.append(True)
    seconds(50, 0)
    now[0] += 20
    assert next(arriving) == []
    with pytest.raises(ExecutorEndedError, match="it has no workers"):
        next(arriving)


SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks/cluster.py"


@pytest.fixture(scope="module")
def cluster() -> ModuleType:
    spec = importlib.util.spec_from_file_location("cluster", SCRIPT)
    assert spec
    assert spec.loader
    module = sys.modules["cluster"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_task_of_many_opens_as_many_files_as_one_of_few(cluster: ModuleType) -> None:
    few, many = (cluster.simulated(100 * nodes, nodes, failures=0.0, sizes=(400, 100)) for nodes in (6, 18))
    assert few.is_complete
    assert many.is_complete
    for kind in ("opens", "lists", "folders"):
        assert many.counts[kind] / many.nodes < 1.2 * few.counts[kind] / few.nodes
    assert many.counts["listed"] / many.nodes < 1.5 * few.counts["listed"] / few.nodes  # three times as many without
    assert many.task_bytes == few.task_bytes
    assert many.files == 4 * many.nodes  # one for each block of a task
    assert few.twice == many.twice == 0


def test_points_of_failed_nodes_are_simulated_again_and_no_others(cluster: ModuleType) -> None:
    run = cluster.simulated(200, 4, seconds=0.5, failures=1.0)
    assert run.is_complete
    assert 0 < run.twice < 0.2 * run.points
