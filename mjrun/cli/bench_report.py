"""What a benchmark found, as text for a terminal and as Markdown."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

from mjrun.cli import bench_csv
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.bench.baseline import BaselineComparison
    from mjrun.bench.frame_timing import FrameTiming
    from mjrun.bench.results import Accuracy, BenchResult, GridPointResult
    from mjrun.bench.statistics import SampleStatistics
    from mjrun.bench.step_phases import Phase

UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))
BYTES = ((10**9, "GB"), (10**6, "MB"), (10**3, "kB"))
WIDTH = 80  # of a terminal
LABEL = 10  # width of what stands before a line

Table = list[list[str]]  # rows of cells, the first is the header
Section = tuple[str, Table]


def duration(seconds: float | None, digits: int = 4) -> str:
    """`12.34 ms`: in the unit that suits."""
    if seconds is None:
        return "-"
    scale, unit = next((u for u in UNITS if abs(seconds) >= u[0]), UNITS[-1])
    return f"{_digits(seconds / scale, digits)} {unit}"


def _digits(value: float, digits: int = 4) -> str:
    """So many significant digits, without an exponent where it can be."""
    size = len(str(int(abs(value))))
    return f"{value:,.{max(0, digits - size)}f}" if abs(value) < 1e9 else f"{value:.{digits}g}"


def text(result: "BenchResult") -> str:
    """For a terminal of 80 columns, or a pipe."""
    lines = [_model(result), _machine(result), ""]
    if len(result.rows) == 1 and result.rows[0].step:
        lines += _single(result)
    lines += [f"{'load':{LABEL}}{_load(result)}"] if result.load else []
    for title, table in _sections(result):
        lines += ["", title, *_aligned(table)]
    if comparison := result.comparison:
        lines += ["", f"verdict: {comparison.verdict}", *_reference_workload(comparison)]
        lines += [f"compared in spite of a difference: {clean(difference)}" for difference in comparison.differences]
    notes = [fill(f"note: {note}", WIDTH, subsequent_indent="      ") for note in _notes(result)]
    lines += ["", *notes] if notes else []
    return "\n".join(lines)


def markdown(result: "BenchResult") -> str:
    """For the summary of a CI job."""
    parts = [f"### mjrun bench: {_escaped(_model(result))}", _escaped(_machine(result))]
    if result.comparison:
        parts.append(f"against {_escaped(clean(result.comparison.base))}: **{result.comparison.verdict}**")
    if len(result.rows) == 1 and result.rows[0].step:
        parts.append("\n".join(f"- {_escaped(' '.join(line.split()))}" for line in _single(result)))
    for title, table in _sections(result):
        header, *rows = ([_escaped(cell.replace("  ", "&ensp;")) for cell in row] for row in table)
        rule = [":--", *["--:"] * (len(header) - 1)]
        lines = (f"| {' | '.join(row)} |" for row in (header, rule, *rows))
        parts.append("\n".join([f"**{_escaped(title)}**", "", *lines]))
    parts += ["\n".join(f"- {_escaped(note)}" for note in notes)] if (notes := _notes(result)) else []
    return "\n\n".join(parts) + "\n"


def _model(result: "BenchResult") -> str:
    model, row = result.model, result.rows[0]
    name = clean(Path(model.path).name) or "model"
    known = [f"{model.nv} dof", f"{model.nu} actuators"]
    if len(result.rows) == 1:
        known += [f"{row.integrator}, timestep {row.timestep:g} s"]
    return f"{name}: {', '.join(known)}; MuJoCo {result.mujoco}"


def _machine(result: "BenchResult") -> str:
    machine, engine, options = result.machine, result.engine, result.options
    where = f"{clean(machine.cpu)}, {machine.available} of {machine.cores} cores"
    if engine.version is not None:
        library = engine.version.partition(",")[0]
        where = f"{engine.worlds} worlds on {engine.device}, {clean(engine.device_name)}; {library}"
    noise = f"noise {options.noise_std:g}" if options.noise_std else "no noise"
    start = f", from keyframe {clean(options.key)}" if options.key is not None else ""
    return f"{where}; {noise}{start}"


def _single(result: "BenchResult") -> list[str]:
    row, worlds = result.rows[0], result.engine.worlds
    step, counts = row.step, row.counts
    assert step is not None
    assert counts is not None
    sure = (
        f"{duration(step.low)} to {duration(step.high)} at {step.confidence:.1%}" if step.confidence else "no interval"
    )
    content = (
        f"{counts.contacts:.3g} contacts, {counts.constraints:.3g} constraints, {counts.iterations:.3g} iterations"
    )
    lines = {
        "step": f"{duration(step.median)}{' of a world' if worlds > 1 else ''}, {sure}",
        "": f"median of {step.n} rollouts of {row.steps} steps; the fastest {duration(step.min)}",
        "all worlds": f"{duration(worlds * step.median)} for a step of each of them" if worlds > 1 else "",
        " ": f"{row.block} at a time: 5 % {duration(step.p5)}, 95 % {duration(step.p95)}",
        "speed": f"{_digits(row.steps_per_second or 0)} steps/s, {_digits(row.realtime_factor or 0)} times real time",
        "a step has": f"{content} ({counts.solver})",
        "  ": "" if counts.arena is None else f"{_bytes(counts.arena)} of {_bytes(counts.arena_size or 0)} arena",
        "first step": "" if row.first_step is None else f"{duration(row.first_step)}; it compiles what is not cached",
    }
    return [f"{label.strip():{LABEL}} {line}" for label, line in lines.items() if line]


def _load(result: "BenchResult") -> str:
    load = result.load
    assert load
    parts = [("parse", load.parse), ("compile", load.compile)]
    told = [f"{name} {duration(part.median)}" for name, part in parts if part]
    return f" {duration(load.first)} the first time" + (f"; again: {', '.join(told)}" if told else "")


def _notes(result: "BenchResult") -> list[str]:
    """What is to be known, and why something has failed."""
    found = list(result.notes)
    for row in result.rows:
        point = " ".join(f"{path}={value}" for path, value in row.point.items())
        # What fails with noise fails without it too, at another step.
        for failure in dict.fromkeys((row.failure or (row.accuracy and row.accuracy.failure), *row.overflows)):
            found += [f"{point}: {failure}".removeprefix(": ")] if failure else []
    return [clean(note) for note in found]


def _sections(result: "BenchResult") -> Iterator[Section]:
    if len(result.rows) > 1 or not result.rows[0].step:
        yield _grid_title(result), _grid(result.rows)
    elif accuracy := result.rows[0].accuracy:
        yield _horizon(accuracy), [["drift", "distance"], _accuracy(accuracy)]
    for row in result.rows:
        point = "".join(f", {clean(_short(path))}={clean(value)}" for path, value in row.point.items())
        if [threads.threads for threads in row.threads] not in ([], [1]):
            yield f"threads{point}", _threads(row)
        if row.phases and row.step and len(result.rows) == 1:
            yield (
                f"phases, with timers on: they make a step {_overhead(row.phases, row.step)}",
                _phase_table(row.phases),
            )
    for renderer, device in dict.fromkeys((frame.renderer, frame.device) for frame in result.frames):
        drawn = [frame for frame in result.frames if (frame.renderer, frame.device) == (renderer, device)]
        yield f"a frame, by {clean(device)}, {renderer}", _frames(drawn)
    if result.whole:
        yield "all of it", _whole(result)
    if result.comparison:
        limit = result.comparison.limit
        yield f"against {clean(result.comparison.base)}; slower is above {limit:.4g}", _ratios(result)


def _grid_title(result: "BenchResult") -> str:
    rows, worlds = result.rows, result.engine.worlds
    steps = ", ".join(dict.fromkeys(str(row.steps) for row in rows if row.step))
    said = f"a step, of rollouts of {steps} steps" + (f" of {worlds} worlds" if worlds > 1 else "")
    return said if rows[0].accuracy is None else f"{said};\n{_horizon(rows[0].accuracy)}"


def _grid(rows: Sequence["GridPointResult"]) -> Table:
    paths, accuracy = list(rows[0].point), rows[0].accuracy
    header = [*map(_short, paths), "step", "±", "real time"]
    found = [header + ["drift", "distance"] * bool(accuracy)]
    for row in rows:
        cells = [clean(value) for value in row.point.values()]
        if row.step is None:
            cells += ["failed", "-", "-"]
        else:
            step = row.step
            cells += [duration(step.median, 3), _unsure(step), f"{_digits(row.realtime_factor or 0, 3)} x"]
        found.append(cells + (_accuracy(row.accuracy) if row.accuracy else []))
    return found


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
    found = [["threads", "steps/s", "real time", "scaling"]]
    for one in row.threads:
        speed = [_digits(one.steps_per_second), f"{_digits(one.realtime_factor)} x", f"{one.scaling:.2f}"]
        found.append([str(one.threads), *speed])
    return found


def _phase_table(whole: "Phase") -> Table:
    rows = [
        [f"{'  ' * depth}{p.name}", duration(p.seconds), f"{p.share:.1%}"] for _, depth, p in bench_csv.phases_of(whole)
    ]
    return [["phase", "time", "share"], *rows]


def _overhead(whole: "Phase", step: "SampleStatistics") -> str:
    longer = whole.seconds / step.median - 1
    return f"{longer:.0%} longer" if longer >= 0 else "no longer"


def _frames(frames: Sequence["FrameTiming"]) -> Table:
    found = [["view", "size", "quality", "update", "draw", "read", "compose", "encode", "first"]]
    for frame in frames:
        parts = (frame.update, frame.draw, frame.read, frame.compose, frame.encode)
        costs = [duration(part.median if part else None, 3) for part in parts]
        width, height = frame.size
        found.append([frame.view, f"{width}x{height}", frame.quality, *costs, duration(frame.first, 3)])
    return found


def _whole(result: "BenchResult") -> Table:
    found = [["what", "simulated", "made", "took"]]
    for one in result.whole:
        found.append([one.what, duration(one.simulated), f"{one.count} {one.unit}", duration(one.seconds)])
    return found


def _ratios(result: "BenchResult") -> Table:
    found = [["figure", "base", "now", "ratio", "interval", "verdict"]]
    for one in result.comparison.ratios if result.comparison else ():
        interval = "-" if one.low is None else f"{one.low:.3f}..{one.high:.3f}"
        costs = [duration(one.base, 3), duration(one.now, 3), f"{one.ratio:.3f}", interval]
        found.append([clean(one.name), *costs, one.verdict])
    for one in result.comparison.gone if result.comparison else ():
        verdict = "failed" if one.failure else "not measured"
        found.append([clean(one.name), duration(one.base, 3), "-", "-", "-", verdict])
    return found


def _reference_workload(comparison: "BaselineComparison") -> list[str]:
    """How the machine itself has changed, where ratios are relative to that."""
    factors = [one.reference_workload for one in comparison.ratios if one.reference_workload is not None]
    if not factors:
        return []
    span = " to ".join(dict.fromkeys(f"{factor:.3g}" for factor in (min(factors), max(factors))))
    return [f"relative to a reference workload, which took {span} times as long as in the baseline"]


def _short(path: str) -> str:
    """The last part of a setting's path."""
    return clean(path.rpartition(".")[2])


def _bytes(count: int) -> str:
    scale, unit = next((u for u in BYTES if count >= u[0]), (1, "B"))
    return f"{count / scale:.3g} {unit}"


def _aligned(table: Table) -> list[str]:
    """The first column to the left, the others to the right."""
    widths = [max(len(row[i]) for row in table if i < len(row)) for i in range(len(table[0]))]
    lines = []
    for row in table:
        others = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=False))
        lines.append("  " + "  ".join([row[0].ljust(widths[0]), *others]).rstrip())
    return lines


def _escaped(text: str) -> str:
    """Text that is nothing but text in Markdown."""
    return "".join(f"\\{c}" if c in r"\`*_{}[]<>#|" else c for c in text)
