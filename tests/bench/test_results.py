"""Keys of the document of a benchmark, facts about its machine, and conditions that distort figures."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from mjrun.bench.results import MachineInfo, machine_info
from tests.bench.bench_clocks import FakeClock, bench

STAT = ["n", "median", "low", "high", "confidence", "min", "p5", "p95", "samples"]
KEYS = {
    "": [
        *("mjrun", "mujoco", "numpy", "python", "command", "machine", "load_after", "engine", "model", "options"),
        *("reference_workload", "load", "rows", "frames", "whole", "comparison", "notes", "wall", "schema"),
    ],
    "machine": ["system", "cpu", "cores", "available", "governor", "load"],
    "engine": ["name", "version", "device", "device_name", "worlds", "nconmax", "njmax"],
    "model": ["path", "sha256", "file_sha256", "nq", "nv", "nu", "nbody", "ngeom"],
    "options": ["key", "noise_std", "noise_rate", "steps", "repeats", "budget", "settings", "scan"],
    "reference_workload": ["version", "steps"],
    "load": ["first", "parse", "compile"],
    "load/parse": STAT,
    "load/compile": STAT,
    "rows": [
        *("point", "integrator", "timestep", "steps", "block", "step", "reference_workload", "steps_per_second"),
        *("realtime_factor", "first_step", "counts", "phases", "threads", "overflows", "accuracy", "failure"),
    ],
    "rows/step": STAT,
    "rows/counts": ["contacts", "constraints", "solver", "iterations", "arena", "arena_size"],
    "rows/phases": ["name", "seconds", "share", "parts"],
    "rows/threads": ["threads", "step", "reference_workload", "steps_per_second", "realtime_factor", "scaling"],
    "rows/reference_workload": STAT,
    "rows/threads/step": STAT,
    "rows/threads/reference_workload": STAT,
    "rows/accuracy": ["horizon", "energy_drift", "reference", "distance", "failure"],
    "frames": [
        *("view", "size", "renderer", "quality", "device", "software", "first", "update", "draw", "read", "compose"),
        *("total", "reference_workload", "encode"),
    ],
    **{
        f"frames/{part}": STAT
        for part in ("update", "draw", "read", "compose", "total", "reference_workload", "encode")
    },
    "whole": ["what", "simulated", "count", "unit", "seconds", "simulation", "rest"],
    "comparison": ["base", "limit", "verdict", "ratios", "gone", "differences"],
    "comparison/ratios": ["name", "base", "now", "ratio", "low", "high", "fastest", "reference_workload", "verdict"],
    "comparison/gone": ["name", "base", "failure"],
}


def keys_of(value: Any, where: str = "") -> dict[str, list[str]]:
    """Returns the keys of every object in a document, by its place."""
    if isinstance(value, list):
        return {name: keys for item in value for name, keys in keys_of(item, where).items()}
    if not isinstance(value, dict) or where in ("options/scan", "rows/point"):
        return {}
    result = {where: list(value)}
    for key, item in value.items():
        result |= keys_of(item, f"{where}/{key}".lstrip("/")) if where != "rows/phases" else {}
    return result


@pytest.mark.gl
@pytest.mark.slow
def test_the_document_has_these_keys(path: Path) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base, threads=(1, 2, 3), repeats=2).run(clock=FakeClock())
    job = bench(path, accuracy=True, render=True, size=(64, 48), whole=True, compare=base, repeats=2)
    result = json.loads(json.dumps(asdict(job.run(clock=FakeClock()))))
    assert result["schema"] == "mjrun-bench-1"
    assert keys_of(result) == KEYS


@pytest.mark.parametrize(
    ("load", "governor", "expected"),
    [
        (0.4, None, []),
        (None, "performance", []),
        (3.0, "powersave", ["load average 3.00 on 4 cores", "governor is powersave"]),
    ],
)
def test_what_spoils_figures_is_reported(load: float | None, governor: str | None, expected: Sequence[str]) -> None:
    causes = MachineInfo("Linux", "a CPU", 4, 4, governor, load).disturbances
    assert len(causes) == len(expected)
    for cause, part in zip(causes, expected, strict=True):
        assert part in cause


def test_this_machine_is_known() -> None:
    result = machine_info()
    assert result.cpu
    assert 1 <= result.available <= result.cores
