"""The tables of a benchmark's report: a title and cells each, for a terminal as for Markdown."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from mjrun.cli.bench_csv import phases_of
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.bench.baseline import BaselineComparison
    from mjrun.bench.frame_timing import FrameTiming
    from mjrun.bench.output_timing import OutputTiming
    from mjrun.bench.results import Accuracy, BenchResult, GridPointResult
    from mjrun.bench.statistics import SampleStatistics
    from mjrun.bench.step_phases import Phase

UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))

Table = list[list[str]]  # rows of cells, the first is the header
Section = tuple[str, Table]


def sections(result: "BenchResult") -> Iterator[Section]:
    """Every table of the report."""
    first = result.rows[0]
    if len(result.rows) > 1 or not first.step:
        yield _grid_title(result), _grid(result.rows)
    elif first.accuracy:
        yield _horizon(first.accuracy), [["drift", "distance"], _accuracy(first.accuracy)]

    for row in result.rows:
        point = "".join(f", {clean(_short(path))}={clean(value)}" for path, value in row.point.items())
        if [threads.threads for threads in row.threads] not in ([], [1]):
            yield f"threads{point}", _threads(row)
    if len(result.rows) == 1 and first.phases and first.step:
        title = f"phases, with timers on: they make a step {_overhead(first.phases, first.step)}"
        yield title, _phase_table(first.phases)

    for renderer, device in dict.fromkeys((frame.renderer, frame.device) for frame in result.frames):
        frames = [frame for frame in result.frames if (frame.renderer, frame.device) == (renderer, device)]
        yield f"a frame, by {clean(device)}, {renderer}", _frames(frames)
    if result.whole:
        yield "whole outputs", _whole(result.whole)
    if result.comparison:
        limit = result.comparison.limit
        yield f"against {clean(result.comparison.base)}; slower is above {limit:.4g}", _ratios(result.comparison)


def _grid_title(result: "BenchResult") -> str:
    rows, worlds = result.rows, result.engine.worlds
    steps = ", ".join(dict.fromkeys(str(row.steps) for row in rows if row.step))
    title = f"a step, of rollouts of {steps} steps" + (f" of {worlds} worlds" if worlds > 1 else "")
    return title if rows[0].accuracy is None else f"{title};\n{_horizon(rows[0].accuracy)}"


def _grid(rows: Sequence["GridPointResult"]) -> Table:
    paths, accuracy = list(rows[0].point), rows[0].accuracy
    table = [[*map(_short, paths), "step", "±", "real time", *(["drift", "distance"] if accuracy else [])]]
    for row in rows:
        cells = [clean(value) for value in row.point.values()]
        if (step := row.step) is None:
            cells += ["failed", "-", "-"]
        else:
            cells += [duration(step.median, 3), _unsure(step), f"{digits(row.realtime_factor or 0, 3)} x"]
        table.append(cells + (_accuracy(row.accuracy) if row.accuracy else []))
    return table


def _unsure(step: "SampleStatistics") -> str:
    """How far the farther end of the interval is from the median."""
    if step.low is None or step.high is None:
        return "-"
    share = max(step.high - step.median, step.median - step.low) / step.median
    return f"{share:.1%}" if share < 0.0995 else f"{share:.0%}"


def _accuracy(accuracy: "Accuracy") -> list[str]:
    values = ((accuracy.energy_drift, "J"), (accuracy.distance, ""))
    return ["-" if value is None else f"{value:.3g} {unit}".strip() for value, unit in values]


def _horizon(accuracy: "Accuracy") -> str:
    return f"energy and position after {accuracy.horizon:.6g} s, against a timestep of {accuracy.reference:.6g} s"


def _threads(row: "GridPointResult") -> Table:
    table = [["threads", "steps/s", "real time", "scaling"]]
    for one in row.threads:
        speed = [digits(one.steps_per_second), f"{digits(one.realtime_factor)} x", f"{one.scaling:.2f}"]
        table.append([str(one.threads), *speed])
    return table


def _phase_table(step: "Phase") -> Table:
    table = [["phase", "time", "share"]]
    for _, depth, phase in phases_of(step):
        table.append([f"{'  ' * depth}{phase.name}", duration(phase.seconds), f"{phase.share:.1%}"])
    return table


def _overhead(timed: "Phase", step: "SampleStatistics") -> str:
    longer = timed.seconds / step.median - 1
    return f"{longer:.0%} longer" if longer >= 0 else "no longer"


def _frames(frames: Sequence["FrameTiming"]) -> Table:
    table = [["view", "size", "quality", "update", "draw", "read", "compose", "encode", "first"]]
    for frame in frames:
        parts = (frame.update, frame.draw, frame.read, frame.compose, frame.encode)
        costs = [duration(part.median if part else None, 3) for part in parts]
        width, height = frame.size
        table.append([frame.view, f"{width}x{height}", frame.quality, *costs, duration(frame.first, 3)])
    return table


def _whole(outputs: Sequence["OutputTiming"]) -> Table:
    table = [["what", "simulated", "made", "took"]]
    for one in outputs:
        table.append([one.what, duration(one.simulated), f"{one.count} {one.unit}", duration(one.seconds)])
    return table


def _ratios(comparison: "BaselineComparison") -> Table:
    table = [["figure", "base", "now", "ratio", "interval", "verdict"]]
    for one in comparison.ratios:
        interval = "-" if one.low is None else f"{one.low:.3f}..{one.high:.3f}"
        costs = [duration(one.base, 3), duration(one.now, 3), f"{one.ratio:.3f}", interval]
        table.append([clean(one.name), *costs, one.verdict])
    for missing in comparison.gone:
        verdict = "failed" if missing.failure else "not measured"
        table.append([clean(missing.name), duration(missing.base, 3), "-", "-", "-", verdict])
    return table


def _short(path: str) -> str:
    """The last part of a setting's path."""
    return clean(path.rpartition(".")[2])


def duration(seconds: float | None, significant: int = 4) -> str:
    """`12.34 ms`: in the unit that suits the value."""
    if seconds is None:
        return "-"
    scale, unit = next((u for u in UNITS if abs(seconds) >= u[0]), UNITS[-1])
    return f"{digits(seconds / scale, significant)} {unit}"


def digits(value: float, significant: int = 4) -> str:
    """So many significant digits, without an exponent where possible."""
    size = len(str(int(abs(value))))
    return f"{value:,.{max(0, significant - size)}f}" if abs(value) < 1e9 else f"{value:.{significant}g}"
