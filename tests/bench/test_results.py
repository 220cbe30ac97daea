"""The document that a benchmark is, key by key."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

sys.path.append(str(Path(__file__).parent))

from bench_clocks import MODEL, FakeClock, bench


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return path


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
        *(
            "point",
            "integrator",
            "timestep",
            "steps",
            "block",
            "step",
            "reference_workload",
            "steps_per_second",
            "realtime_factor",
        ),
        *("first_step", "counts", "phases", "threads", "overflows", "accuracy", "failure"),
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
    """The keys of every object in a document, by where it is."""
    if isinstance(value, list):
        return {name: keys for item in value for name, keys in keys_of(item, where).items()}
    if not isinstance(value, dict) or where in ("options/scan", "rows/point"):
        return {}
    found = {where: list(value)}
    for key, item in value.items():
        found |= keys_of(item, f"{where}/{key}".lstrip("/")) if where != "rows/phases" else {}
    return found


@pytest.mark.gl
def test_the_document_has_these_keys(path: Path) -> None:
    base = str(path.with_name("base.json"))
    bench(path, save=base, threads=(1, 2, 3)).run(clock=FakeClock())
    job = bench(path, accuracy=True, render=True, size=(64, 48), whole=True, compare=base)
    found = json.loads(json.dumps(asdict(job.run(clock=FakeClock()))))
    assert found["schema"] == "mjrun-bench-1"
    assert keys_of(found) == KEYS
