"""The result of a benchmark as CSV."""

import csv
import io
from collections.abc import Iterator
from typing import TYPE_CHECKING

from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.bench.results import Accuracy, BenchResult, GridPointResult
    from mjrun.bench.step_phases import Phase


def table(result: "BenchResult") -> str:
    """A line for each point of the grid, times in seconds; what was not measured is empty."""
    rows = [_record(result, row) for row in result.rows]
    names = list(dict.fromkeys(name for row in rows for name in row))

    out = io.StringIO()
    writer = csv.DictWriter(out, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: "" if value is None else value for name, value in row.items()} for row in rows)
    return out.getvalue().rstrip("\n")


def _record(result: "BenchResult", row: "GridPointResult") -> dict[str, object]:
    step, counts, accuracy = row.step, row.counts, row.accuracy
    failure = row.failure or (accuracy.failure if accuracy else None)
    return {
        "model": clean(result.model.path),
        **{clean(path): clean(value) for path, value in row.point.items()},
        "engine": result.engine.name,
        "device": result.engine.device,
        "worlds": result.engine.worlds,
        "integrator": row.integrator,
        "timestep": row.timestep,
        "steps": row.steps,
        "step/n": step and step.n,
        "step/median": step and step.median,
        "step/low": step and step.low,
        "step/high": step and step.high,
        "step/min": step and step.min,
        "step/p5": step and step.p5,
        "step/p95": step and step.p95,
        "steps_per_second": row.steps_per_second,
        "realtime_factor": row.realtime_factor,
        "first_step": row.first_step,
        "contacts": counts and counts.contacts,
        "constraints": counts and counts.constraints,
        "iterations": counts and counts.iterations,
        "arena": counts and counts.arena,
        **{f"phase/{name}": phase.seconds for name, _, phase in phases_of(row.phases)},
        **{f"threads/{one.threads}/steps_per_second": one.steps_per_second for one in row.threads},
        **_accuracy(accuracy),
        "overflows": clean("; ".join(row.overflows)),
        "failure": failure and clean(failure),
    }


def _accuracy(accuracy: "Accuracy | None") -> dict[str, object]:
    if accuracy is None:
        return {}
    return {"horizon": accuracy.horizon, "energy_drift": accuracy.energy_drift, "distance": accuracy.distance}


def phases_of(phase: "Phase | None", above: str = "", depth: int = 0) -> Iterator[tuple[str, int, "Phase"]]:
    """Every phase, with its path and depth in the tree."""
    if phase is None:
        return
    yield above + phase.name, depth, phase
    for part in phase.parts:
        yield from phases_of(part, f"{above}{phase.name}/", depth + 1)
