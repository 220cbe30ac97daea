"""Clusters that cannot be used; test_executors.py runs chunks on real ones."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest

from mjrun.errors import UsageError
from mjrun.study import clusters
from mjrun.study.clusters import open_cluster
from mjrun.study.executors import QUEUED, open_executor


@pytest.mark.parametrize("engine", ["dask://127.0.0.1:1", "ray://127.0.0.1:1"])
def test_a_cluster_that_does_not_answer_is_told(monkeypatch: pytest.MonkeyPatch, engine: str) -> None:
    monkeypatch.setattr("mjrun.study.clusters.PATIENCE", 1)
    monkeypatch.setattr("ray.util.client.worker.INITIAL_TIMEOUT_SEC", 0.01)
    with ExitStack() as stack, pytest.raises(UsageError, match=f"engine: {engine} cannot be used: .*[Tt]ime"):
        open_cluster(engine, 1, stack)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_cluster_without_workers_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: int) -> None:
    notes = list[str]()
    monkeypatch.setitem(clusters._CONNECT, "dask", lambda *_: (ThreadPoolExecutor(1), workers))
    with ExitStack() as stack:
        _, ahead = open_executor("dask://host:1", 1, tmp_path, stack, note=notes.append)
    assert ahead == max(1, workers) * QUEUED
    assert len(notes) == (not workers)
