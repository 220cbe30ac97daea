"""What a benchmark found, as CSV."""

import csv
import io
from collections.abc import Iterator
from typing import TYPE_CHECKING

from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.bench.results import BenchResult, Row
    from mjrun.bench.step_phases import Phase


def table(result: "BenchResult") -> str:
    """CSV: a line for each point of the grid, times in seconds; what was not measured is empty."""
    out = io.StringIO()
    rows = [_record(result, row) for row in result.rows]
    names = list(dict.fromkeys(name for row in rows for name in row))
    writer = csv.DictWriter(out, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: "" if value is None else value for name, value in row.items()} for row in rows)
    return out.getvalue().rstrip("\n")


def _record(result: "BenchResult", row: "Row") -> dict[str, object]:
    step, counts, accuracy = row.step, row.counts, row.accuracy
    found: dict[str, object] = {"model": clean(result.model.path)}
    found |= {clean(path): clean(value) for path, value in row.point.items()}
    found |= {"engine": result.engine.name, "device": result.engine.device, "worlds": result.engine.worlds}
    found |= {"integrator": row.integrator, "timestep": row.timestep, "steps": row.steps}
    for name in ("n", "median", "low", "high", "min", "p5", "p95"):
        found[f"step/{name}"] = getattr(step, name, None)
    found |= {"steps_per_second": row.steps_per_second, "realtime_factor": row.realtime_factor}
    found |= {"first_step": row.first_step}
    for name in ("contacts", "constraints", "iterations", "arena"):
        found[name] = getattr(counts, name, None)
    for name, _, phase in phases_of(row.phases):
        found[f"phase/{name}"] = phase.seconds
    for threads in row.threads:
        found[f"threads/{threads.threads}/steps_per_second"] = threads.steps_per_second
    if accuracy:
        found |= {"horizon": accuracy.horizon, "energy_drift": accuracy.energy_drift, "distance": accuracy.distance}
    found |= {"overflows": clean("; ".join(row.overflows))}
    failure = row.failure or (accuracy.failure if accuracy else None)
    return found | {"failure": None if failure is None else clean(failure)}


def phases_of(phase: "Phase | None", above: str = "", depth: int = 0) -> Iterator[tuple[str, int, "Phase"]]:
    """Every phase: its path, how deep it lies, itself."""
    if phase is None:
        return
    yield above + phase.name, depth, phase
    for part in phase.parts:
        yield from phases_of(part, f"{above}{phase.name}/", depth + 1)
