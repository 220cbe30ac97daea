"""The report of a benchmark, as text for a terminal and as Markdown."""

from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

from mjrun.cli.bench_tables import Table, digits, duration, sections
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.bench.baseline import BaselineComparison
    from mjrun.bench.load_timing import LoadTiming
    from mjrun.bench.results import BenchResult

BYTES = ((10**9, "GB"), (10**6, "MB"), (10**3, "kB"))
WIDTH = 80  # of a terminal
LABEL = 10  # width of the label before a line


def text(result: "BenchResult") -> str:
    """For a terminal of 80 columns, or a pipe."""
    lines = [_model(result), _machine(result), "", *_single_point(result)]
    lines += [f"{'load':{LABEL}}{_load(result.load)}"] if result.load else []
    for title, table in sections(result):
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
    if comparison := result.comparison:
        parts.append(f"against {_escaped(clean(comparison.base))}: **{comparison.verdict}**")
        parts += _reference_workload(comparison)
    if lines := _single_point(result):
        parts.append("\n".join(f"- {_escaped(' '.join(line.split()))}" for line in lines))

    for title, table in sections(result):
        header, *rows = ([_escaped(cell.replace("  ", "&ensp;")) for cell in row] for row in table)
        rule = [":--", *["--:"] * (len(header) - 1)]
        lines = [f"| {' | '.join(row)} |" for row in (header, rule, *rows)]
        parts.append("\n".join([f"**{_escaped(title)}**", "", *lines]))

    if notes := _notes(result):
        parts.append("\n".join(f"- {_escaped(note)}" for note in notes))
    return "\n\n".join(parts) + "\n"


def _model(result: "BenchResult") -> str:
    model, row = result.model, result.rows[0]
    name = clean(Path(model.path).name) or "model"
    facts = [f"{model.nv} dof", f"{model.nu} actuators"]
    if len(result.rows) == 1:
        facts += [f"{row.integrator}, timestep {row.timestep:g} s"]
    return f"{name}: {', '.join(facts)}; MuJoCo {result.mujoco}"


def _machine(result: "BenchResult") -> str:
    machine, engine, options = result.machine, result.engine, result.options
    where = f"{clean(machine.cpu)}, {machine.available} of {machine.cores} cores"
    if engine.version is not None:
        library = engine.version.partition(",")[0]
        where = f"{engine.worlds} worlds on {engine.device}, {clean(engine.device_name)}; {library}"
    noise = f"noise {options.noise_std:g}" if options.noise_std else "no noise"
    start = f", from keyframe {clean(options.key)}" if options.key is not None else ""
    return f"{where}; {noise}{start}"


def _single_point(result: "BenchResult") -> list[str]:
    """The cost of a step in labelled lines; none for a grid, which is a table."""
    row, worlds = result.rows[0], result.engine.worlds
    step, counts = row.step, row.counts
    if len(result.rows) > 1 or step is None or counts is None:
        return []

    interval = f"{duration(step.low)} to {duration(step.high)} at {step.confidence:.1%}" if step.confidence else ""
    number = f"{counts.contacts:.3g} contacts, {counts.constraints:.3g} constraints"
    lines = {
        "step": f"{duration(step.median)}{' of a world' if worlds > 1 else ''}, {interval or 'no interval'}",
        "": f"median of {step.n} rollouts of {row.steps} steps; the fastest {duration(step.min)}",
        "all worlds": f"{duration(worlds * step.median)} for a step of each of them" if worlds > 1 else "",
        " ": f"{row.block} at a time: 5 % {duration(step.p5)}, 95 % {duration(step.p95)}",
        "speed": f"{digits(row.steps_per_second or 0)} steps/s, {digits(row.realtime_factor or 0)} times real time",
        "a step has": f"{number}, {counts.iterations:.3g} iterations ({counts.solver})",
        "  ": "" if counts.arena is None else f"{_bytes(counts.arena)} of {_bytes(counts.arena_size or 0)} arena",
        "first step": "" if row.first_step is None else f"{duration(row.first_step)}; it compiles what is not cached",
    }
    return [f"{label.strip():{LABEL}} {line}" for label, line in lines.items() if line]


def _load(load: "LoadTiming") -> str:
    parts = [("parse", load.parse), ("compile", load.compile)]
    repeated = [f"{name} {duration(part.median)}" for name, part in parts if part]
    return f" {duration(load.first)} the first time" + (f"; again: {', '.join(repeated)}" if repeated else "")


def _notes(result: "BenchResult") -> list[str]:
    """What a reader should know, and why something has failed."""
    notes = list(result.notes)
    for row in result.rows:
        point = " ".join(f"{path}={value}" for path, value in row.point.items())
        # What fails with noise fails without it too, at another step.
        for failure in dict.fromkeys((row.failure or (row.accuracy and row.accuracy.failure), *row.overflows)):
            notes += [f"{point}: {failure}".removeprefix(": ")] if failure else []
    return [clean(note) for note in notes]


def _reference_workload(comparison: "BaselineComparison") -> list[str]:
    """How much slower or faster the machine itself is, where ratios are relative to that."""
    factors = [one.reference_workload for one in comparison.ratios if one.reference_workload is not None]
    if not factors:
        return []
    span = " to ".join(dict.fromkeys(f"{factor:.3g}" for factor in (min(factors), max(factors))))
    return [f"relative to a reference workload, which took {span} times as long as in the baseline"]


def _bytes(count: int) -> str:
    scale, unit = next((u for u in BYTES if count >= u[0]), (1, "B"))
    return f"{count / scale:.3g} {unit}"


def _aligned(table: Table) -> list[str]:
    """The first column to the left, the others to the right."""
    widths = [max(len(row[i]) for row in table if i < len(row)) for i in range(len(table[0]))]
    lines: list[str] = []
    for row in table:
        others = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=False))
        lines.append("  " + "  ".join([row[0].ljust(widths[0]), *others]).rstrip())
    return lines


def _escaped(text: str) -> str:
    """Text that is nothing but text in Markdown."""
    return "".join(f"\\{c}" if c in r"\`*_{}[]<>#|" else c for c in text)
