"""The model of a cluster: what a task does with files does not depend on the number of tasks."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

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
