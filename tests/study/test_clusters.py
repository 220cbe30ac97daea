"""Clusters that cannot be used; test_executors.py runs chunks on real ones."""

from contextlib import ExitStack

import pytest

from mjrun.errors import UsageError
from mjrun.study.clusters import open_cluster


@pytest.mark.parametrize("engine", ["dask://127.0.0.1:1", "ray://127.0.0.1:1"])
def test_a_cluster_that_does_not_answer_is_told(monkeypatch: pytest.MonkeyPatch, engine: str) -> None:
    monkeypatch.setattr("mjrun.study.clusters.PATIENCE", 1)
    monkeypatch.setattr("ray.util.client.worker.INITIAL_TIMEOUT_SEC", 0.01)
    with ExitStack() as stack, pytest.raises(UsageError, match=f"engine: {engine} cannot be used: .*[Tt]ime"):
        open_cluster(engine, 1, stack)
