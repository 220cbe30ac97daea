"""Measure the speed of a simulation: steps, phases, threads, rendering, accuracy."""

import csv
import io
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import zip_longest
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

from mjrun.cli.click_command import MODEL, ON_FILES, ParsedCommandLine, command
from mjrun.cli.console import CommandReport, Console
from mjrun.cli.simulation_command import import_mujoco
from mjrun.cli.table_cells import ReportColumn
from mjrun.errors import UsageError, clean, counted, file_errors, option
from mjrun.options.bench import SUMMARY, BenchOptions, BenchReportOptions
from mjrun.options.every_command import opened_file

if TYPE_CHECKING:
    from mjrun.bench.block_timing import StepPhase
    from mjrun.bench.output_timing import EndToEndTiming, FrameTiming, LoadTiming
    from mjrun.bench.results import BaselineComparison, BenchResult, GridPointResult, IntegrationAccuracy
    from mjrun.bench.statistics import SampleStatistics
    from mjrun.plotting.html_page import Page

SLOWER, PARTLY = 1, 8  # exit codes
BYTES = ((10**9, "GB"), (10**6, "MB"), (10**3, "kB"))
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))
WIDTH = 80  # of a terminal
LABEL = 10  # width of the label before a line
BAD = ("slower", "failed")  # verdicts
INDENT = "\u2003"  # of phases within others in Markdown and on a page: browsers join spaces

Table = list[list[str]]  # rows of cells, the first is the header


@command(
    BenchOptions,
    BenchReportOptions,
    *ON_FILES,
    arguments=[MODEL],
    python="Bench",
    reports={"bench": "mjrun.bench.results:BenchResult"},
)
def bench(console: Console, command_line: ParsedCommandLine) -> None:
    """Measure the speed of simulating MODEL: its steps and their phases, threads and rendering; and its accuracy.

    Repeats a rollout with the control noise of MuJoCo's testspeed, and reports the median with its confidence
    interval.

    \b
    mjrun bench scene.xml
    mjrun bench scene.xml --scan integrator=euler,rk4 --scan timestep=.001,.002,.004 --accuracy
    mjrun bench scene.xml --render --view rgb --view depth --size 640x480
    mjrun bench scene.xml --engine warp --worlds 4096
    mjrun bench scene.xml --save base.json
    mjrun bench scene.xml --compare base.json --fail-above 10%

    Exits with 8 if points of a --scan could not be measured, for example because their timestep is too long.
    """
    form = command_line.form("csv", "markdown")
    reports = command_line.make(BenchReportOptions)
    command_line.require(opened_file(), reports)
    if reports.html is not None:
        from mjrun.plotting.html_page import check_page_name

        check_page_name(reports.html)
    with _summary(reports.summary) as append:
        import_mujoco()
        from mjrun.bench.bench import Bench

        result = command_line.make(Bench, model=command_line.argument("model"), command=console.command).run(console)
        forms = {"csv": lambda: csv_table(result), "markdown": lambda: markdown(result)}
        console.answer(CommandReport("bench", result, lambda: text(result), forms=forms), form)
        append(markdown(result))
        if reports.html is not None:
            from mjrun.plotting.html_page import write_page

            write_page(reports.html, _page(result, console.command))
    comparison, failed = result.comparison, sum(bool(row.failure) for row in result.rows)
    if command_line.value("fail_above") is not None and comparison and comparison.verdict in ("slower", "failed"):
        console.fail(SLOWER, "Slower", "slower than the baseline allows, or not measured any more")
    elif failed:
        console.fail(PARTLY, "PartlyDone", f"{failed} of {counted(len(result.rows), 'point')} could not be measured")


@contextmanager
def _summary(file: str | None) -> Generator[Callable[[str], None], None, None]:
    """Appends the report to the summary file, if one is requested, after checking that it can be written.

    A file that did not exist before is removed again if nothing is appended.

    Raises:
      UsageError: no file name is known.
      FileError: it cannot be written.
    """
    path = os.environ.get(SUMMARY.removeprefix("$"), "") if file == SUMMARY else file
    if path is None:
        yield lambda text: None
        return
    if not path:
        raise UsageError(f"{option('summary')}: name a file, since {SUMMARY} does not")

    from mjrun.formats.temporary_output import ParentFolders

    is_new = not Path(path).exists()
    parents = ParentFolders(Path(path), Path(os.path.realpath(path)).parent)
    try:
        _append(path, "")
        yield lambda text: _append(path, text + "\n")
    finally:
        with suppress(OSError):
            if is_new and not Path(path).stat().st_size:
                Path(path).unlink()
        parents.release()


def _append(path: str, text: str) -> None:
    with file_errors(path, "written"), Path(path).open("a", encoding="utf-8") as file:
        file.write(text)


def text(result: "BenchResult") -> str:
    """Formats the report for a terminal of 80 columns, or a pipe."""
    lines = [model_line(result), machine_line(result), "", *_single_point_lines(result)]
    lines += [f"{'load':{LABEL}}{_load(result.load)}"] if result.load else []
    for title, table in sections(result):
        lines += ["", title, *_aligned(table)]

    if comparison := result.comparison:
        lines += ["", f"verdict: {comparison.verdict}", *_reference_workload(comparison)]
        lines += [f"compared in spite of a difference: {clean(difference)}" for difference in comparison.differences]

    remarks = [fill(f"note: {note}", WIDTH, subsequent_indent="      ") for note in notes(result)]
    lines += ["", *remarks] if remarks else []
    return "\n".join(lines)


def markdown(result: "BenchResult") -> str:
    """Formats the report for the summary of a CI job."""
    from mjrun.cli.report_formats import escaped, markdown_table

    parts = [f"### mjrun bench: {escaped(model_line(result))}", escaped(machine_line(result))]
    if comparison := result.comparison:
        parts.append(f"against {escaped(clean(comparison.base))}: **{comparison.verdict}**")
        parts += _reference_workload(comparison)
    if lines := _single_point_lines(result):
        parts.append("\n".join(f"- {escaped(' '.join(line.split()))}" for line in lines))

    for title, table in sections(result):
        cells = ([cell.replace("  ", INDENT) for cell in column] for column in zip_longest(*table, fillvalue=""))
        columns = [ReportColumn(heading, column, right=bool(i)) for i, (heading, *column) in enumerate(cells)]
        parts.append(f"**{escaped(title)}**\n\n{markdown_table(columns)}")

    if remarks := notes(result):
        parts.append("\n".join(f"- {escaped(note)}" for note in remarks))
    return "\n\n".join(parts) + "\n"


def model_line(result: "BenchResult") -> str:
    """Returns the model and its size."""
    model, row = result.model, result.rows[0]
    name = clean(Path(model.path).name) or "model"
    facts = [f"{model.nv} dof", counted(model.nu, "actuator")]
    if len(result.rows) == 1:
        facts += [f"{row.integrator}, timestep {row.timestep:g} s"]
    return f"{name}: {', '.join(facts)}; MuJoCo {result.mujoco}"


def machine_line(result: "BenchResult") -> str:
    """Returns the processor or the device, and the conditions of the measurement."""
    machine, engine, options = result.machine, result.engine, result.options
    where = f"{clean(machine.cpu)}, {machine.available} of {machine.cores} cores"
    if engine.version is not None:
        library = engine.version.partition(",")[0]
        where = f"{engine.worlds} worlds on {engine.device}, {clean(engine.device_name)}; {library}"
    noise = f"noise {options.noise_std:g}" if options.noise_std else "no noise"
    start = f", from keyframe {clean(options.key)}" if options.key is not None else ""
    return f"{where}; {noise}{start}"


def _single_point_lines(result: "BenchResult") -> list[str]:
    return [f"{label:{LABEL}} {line}" for label, line in single_point(result)]


def single_point(result: "BenchResult") -> list[tuple[str, str]]:
    """Returns the cost of a step as labels and texts; empty for a grid, which is shown as a table."""
    row, worlds = result.rows[0], result.engine.worlds
    step, counts = row.step, row.counts
    if len(result.rows) > 1 or step is None or counts is None:
        return []

    interval = (
        f"{duration(step.low)} to {duration(step.high)} at {100 * step.confidence:.1f} %" if step.confidence else ""
    )
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
    return [(label.strip(), line) for label, line in lines.items() if line]


def _load(load: "LoadTiming") -> str:
    parts = [("parse", load.parse), ("compile", load.compile)]
    repeated = [f"{name} {duration(part.median)}" for name, part in parts if part]
    return f" {duration(load.first)} the first time" + (f"; again: {', '.join(repeated)}" if repeated else "")


def notes(result: "BenchResult") -> list[str]:
    """Formats remarks about the measurement, and the reasons of failures."""
    notes = list(result.notes)
    for row in result.rows:
        point = " ".join(f"{path}={value}" for path, value in row.point.items())
        # A point that fails with noise also fails without it, at another step.
        for failure in dict.fromkeys((row.failure or (row.accuracy and row.accuracy.failure), *row.overflows)):
            notes += [f"{point}: {failure}".removeprefix(": ")] if failure else []
    return [clean(note) for note in notes]


def _reference_workload(comparison: "BaselineComparison") -> list[str]:
    """Formats the change in speed of the machine itself, where ratios are relative to it."""
    factors = [one.reference_workload for one in comparison.ratios if one.reference_workload is not None]
    if not factors:
        return []
    span = " to ".join(dict.fromkeys(f"{factor:.3g}" for factor in (min(factors), max(factors))))
    return [f"relative to a reference workload, which took {span} times as long as in the baseline"]


def _bytes(count: int) -> str:
    scale, unit = next((u for u in BYTES if count >= u[0]), (1, "B"))
    return f"{count / scale:.3g} {unit}"


def _aligned(table: Table) -> list[str]:
    """Aligns the first column to the left, the others to the right."""
    widths = [max(len(row[i]) for row in table if i < len(row)) for i in range(len(table[0]))]
    lines: list[str] = []
    for row in table:
        others = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=False))
        lines.append("  " + "  ".join([row[0].ljust(widths[0]), *others]).rstrip())
    return lines


def sections(result: "BenchResult") -> Iterator[tuple[str, Table]]:
    """Yields every table of the report with its title."""
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
        longer = first.phases.seconds / first.step.median - 1
        overhead = f"{100 * longer:.0f} % longer" if longer >= 0 else "no longer"
        yield f"phases, with timers on: they make a step {overhead}", _phase_table(first.phases)

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
    """Returns the distance from the median to the farther end of the interval."""
    if step.low is None or step.high is None:
        return "-"
    share = max(step.high - step.median, step.median - step.low) / step.median
    return f"{100 * share:.1f} %" if share < 0.0995 else f"{100 * share:.0f} %"


def _accuracy(accuracy: "IntegrationAccuracy") -> list[str]:
    values = ((accuracy.energy_drift, "J"), (accuracy.distance, ""))
    return ["-" if value is None else f"{value:.3g} {unit}".strip() for value, unit in values]


def _horizon(accuracy: "IntegrationAccuracy") -> str:
    return f"energy and position after {accuracy.horizon:.6g} s, against a timestep of {accuracy.reference:.6g} s"


def _threads(row: "GridPointResult") -> Table:
    table = [["threads", "steps/s", "real time", "scaling"]]
    for one in row.threads:
        speed = [digits(one.steps_per_second), f"{digits(one.realtime_factor)} x", f"{one.scaling:.2f}"]
        table.append([str(one.threads), *speed])
    return table


def _phase_table(step: "StepPhase") -> Table:
    table = [["phase", "time", "share"]]
    for _, depth, phase in phases_of(step):
        table.append([f"{'  ' * depth}{phase.name}", duration(phase.seconds), f"{100 * phase.share:.1f} %"])
    return table


def _frames(frames: Sequence["FrameTiming"]) -> Table:
    table = [["view", "size", "quality", "update", "draw", "read", "compose", "encode", "first"]]
    for frame in frames:
        parts = (frame.update, frame.draw, frame.read, frame.compose, frame.encode)
        costs = [duration(part.median if part else None, 3) for part in parts]
        width, height = frame.size
        table.append([frame.view, f"{width}x{height}", frame.quality, *costs, duration(frame.first, 3)])
    return table


def _whole(outputs: Sequence["EndToEndTiming"]) -> Table:
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
    """Returns the last part of a setting's path."""
    return clean(path.rpartition(".")[2])


def duration(seconds: float | None, significant: int = 4) -> str:
    """Formats a time in the unit that suits its value: `12.34 ms`."""
    if seconds is None:
        return "-"
    scale, unit = next((u for u in UNITS if abs(seconds) >= u[0]), UNITS[-1])
    return f"{digits(seconds / scale, significant)} {unit}"


def digits(value: float, significant: int = 4) -> str:
    """Formats a number with N significant digits, without an exponent where possible."""
    size = len(str(int(abs(value))))
    return f"{value:,.{max(0, significant - size)}f}" if abs(value) < 1e9 else f"{value:.{significant}g}"


def csv_table(result: "BenchResult") -> str:
    """Formats a line per point of the grid, with times in seconds; unmeasured values are empty."""
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
        **_accuracy_columns(accuracy),
        "overflows": clean("; ".join(row.overflows)),
        "failure": failure and clean(failure),
    }


def _accuracy_columns(accuracy: "IntegrationAccuracy | None") -> dict[str, object]:
    if accuracy is None:
        return {}
    return {"horizon": accuracy.horizon, "energy_drift": accuracy.energy_drift, "distance": accuracy.distance}


def phases_of(phase: "StepPhase | None", above: str = "", depth: int = 0) -> Iterator[tuple[str, int, "StepPhase"]]:
    """Yields every phase, with its path and depth in the tree."""
    if phase is None:
        return
    yield above + phase.name, depth, phase
    for part in phase.parts:
        yield from phases_of(part, f"{above}{phase.name}/", depth + 1)


def _page(result: "BenchResult", command: str) -> "Page":
    """Returns the page about a benchmark: the tables of its report, the verdict, and how it was measured."""
    from mjrun.plotting.html_page import MAKER, FileManifest, Page, PageFactTable

    facts = [PageFactTable("Step", "Cost of a step", ("", ""), rows)] if (rows := single_point(result)) else []
    tables = [(" ".join(title.split()), table) for title, table in sections(result)]
    names = [title.partition(",")[0] for title, _ in tables]
    for name, (caption, (heads, *cells)) in zip(names, tables, strict=True):
        rows = [[cell.replace("  ", INDENT) for cell in row] for row in cells]
        title = name if names.count(name) == 1 else caption  # such as the threads of each point of a grid
        facts.append(PageFactTable(title[:1].upper() + title[1:], caption, heads, rows, range(1, len(heads))))
    comparison, machine = result.comparison, result.machine
    origin = {
        "command": command,
        "mujoco": result.mujoco,
        "model": {"path": result.model.path, "sha256": result.model.sha256},
        "processor": machine.cpu,
        "cores": machine.available,
        "system": machine.system,
        "load": machine.load,
    }
    return Page(
        title=model_line(result),
        maker=MAKER,
        verdict=(comparison.verdict not in BAD, comparison.verdict) if comparison else None,
        notes=[machine_line(result), *(f"Note: {text}" for text in notes(result))],
        facts=facts,
        manifests=[FileManifest("This benchmark", origin)],
    )
