"""The report of a study in prose."""

import shlex
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, cast

from mjrun.cli.click_command import is_repeatable
from mjrun.cli.console import flag
from mjrun.cli.report_formats import markdown_report
from mjrun.cli.table_cells import ReportColumn, byte_size, interval_text, number, short_value, verdict_lines
from mjrun.cli.terminal_layout import TerminalReport
from mjrun.errors import clean, counted, spelled
from mjrun.model.table_column import with_unit
from mjrun.options.option import is_given, options_of
from mjrun.options.simulation import SimulationOptions
from mjrun.simulation.simulation import Simulation
from mjrun.study.status import StudyStatus, UnusedFiles, age, span_of_time

if TYPE_CHECKING:
    from mjrun.study.study import StudyPreview, StudyResult

SHOWN = 10  # reasons of failures
NOTHING_MEASURED = (
    "nothing was measured: --metric 'drift=max(abs(energy/drift))' computes a number per point from the columns that "
    "mjrun trace MODEL --list shows; --keep trace stores the columns"
)
FEW = 4  # values of a point that are shown


def study_report(result: "StudyResult", simulation: Simulation, controller: str = "") -> str:
    """Formats the metrics, the failures by reason, and the requirements.

    Args:
      controller: what the command line names as the controller of `simulation`.
    """
    page = TerminalReport()
    if result.metrics:
        page.table("metrics", _metrics(result), len(result.metrics))
        extremes = _extremes(result)
        if extremes:
            page.table("extremes", extremes, 2 * len(result.metrics))
    if result.repeats:
        hint = f"{result.path}/repeats.csv has all"
        page.table("means over repeats", _repeats(result), len(result.repeats), SHOWN, hint)
    if result.sensitivities:
        page.table("sensitivity", _sensitivities(result), len(result.sensitivities))
    if result.failures:
        hint = f"{result.path}/results.csv has all"
        page.table("failures", _failures(result), len(result.failures), SHOWN, hint)
        shown = result.failures[:SHOWN]
        commands = [point_command(simulation, failure.values, controller) for failure in shown]
        page.verbatim("to see the first of each", commands)
    if result.assertions:
        page.lines("required", verdict_lines(result.assertions))
    if result.kept.points:
        page.note(_kept(result))
    elif not result.metrics and "ok" in result.statuses:
        page.note(NOTHING_MEASURED)
    page.note(_last_line(result))
    return page.text()


def study_markdown(result: "StudyResult", simulation: Simulation) -> str:
    """Formats the report of a study as Markdown, the requirements and failures first."""
    tables = list[list[ReportColumn]]()
    if result.failures:
        first = [f"{each.point}: {_where(each.values)}" for each in result.failures]
        tables.append(_first_rows([*_failures(result), ReportColumn("first of them", first)]))
    if result.metrics:
        tables += [_metrics(result), _extremes(result)]
    if result.repeats:
        tables.append(_first_rows(_repeats(result)))
    if result.sensitivities:
        tables.append(_sensitivities(result))
    title = f"mjrun sweep: {simulation.source.text}"
    return markdown_report(title, _last_line(result), verdict_lines(result.assertions), tables)


def status_report(status: StudyStatus) -> str:
    """Formats the progress of a study, and the ranges that processes work on."""
    page, ranges = TerminalReport(), status.running
    if ranges:
        columns = [
            ReportColumn("first", [f"{each.first:,}" for each in ranges], right=True),
            ReportColumn("last", [f"{each.last:,}" for each in ranges], right=True),
            ReportColumn("left", [f"{each.left:,}" for each in ranges], right=True),
            ReportColumn("machine", [each.host for each in ranges]),
            ReportColumn("process", [each.process for each in ranges]),
            ReportColumn("", [age(each) for each in ranges]),
        ]
        page.table("running", columns, len(ranges), SHOWN, "--json has all")
    page.note(status.text)
    return page.text()


def unused_report(unused: UnusedFiles) -> str:
    """Formats the number and size of unused files of a study."""
    kinds = [f"{counted(each.files, each.noun)} ({byte_size(each.size)})" for each in unused.kinds]
    did = "removed" if unused.is_removed else "would remove"
    lines = [f"{clean(unused.path)}: {did} {', '.join(kinds) or 'nothing'}"]
    if unused.missing:
        lines.append(f"outdated parts stay: they may have results of {counted(unused.missing, 'missing point')}")
    return "\n".join(lines)


def _first_rows(columns: Sequence[ReportColumn]) -> list[ReportColumn]:
    """Returns the rows of a table that a report shows."""
    return [replace(column, cells=column.cells[:SHOWN]) for column in columns]


def _last_line(result: "StudyResult") -> str:
    """Formats the numbers of points, and the wall time."""
    from mjrun.study.results import FINAL, status_counts

    before = result.points - result.simulated - result.statuses.get("missing", 0)
    known = f", {before:,} of them known before" if before else ""
    if before and result.statuses.keys() - {*FINAL, "missing"}:
        known += ": --retry-failed repeats those that failed"
    points = f"{result.points:,} point{'' if result.points == 1 else 's'}"
    return f"{clean(result.path)}: {points} ({status_counts(result.statuses)}){known}; {result.wall:.1f} s"


def preview_report(preview: "StudyPreview") -> str:
    """Formats the size and the expected duration of a study."""
    page = TerminalReport()
    time = "unknown" if preview.wall is None else span_of_time(preview.wall)
    if preview.processes and preview.missing:
        time += f" on {preview.processes} process{'es' if preview.processes > 1 else ''}"
    if preview.point_wall is not None:
        time += f"; {span_of_time(preview.point_wall)} a point"
    known = f", {preview.known:,} of them known already" if preview.known else ""
    chunks = f"{preview.missing:,} in about {counted(preview.chunks, 'chunk')}"
    facts = [
        ("points", f"{preview.points:,}{known}"),
        ("to simulate", f"{chunks}, {preview.steps:,} steps" if preview.missing else "nothing"),
        ("wall time", f"about {time}" if preview.wall is not None else time),
        ("disk", f"about {byte_size(preview.disk)}"),
        ("failure", clean(spelled(preview.message, flag).partition("\n")[0])),
    ]
    page.lines("study", facts, clean(preview.path))
    if preview.names:
        page.table("points", _sample(preview), preview.points)
    return page.text()


def _sample(preview: "StudyPreview") -> list[ReportColumn]:
    """Returns the first and the last points, with a row for the omitted ones between them."""
    rows = [[str(each.point), *(clean(each.values.get(name, "")) for name in preview.names)] for each in preview.sample]
    if len(rows) < preview.points:
        rows.insert(len(rows) // 2, ["…"] * len(rows[0]))
    headings = ["point", *map(clean, preview.names)]
    return [
        ReportColumn(heading, cells, right=True)
        for heading, cells in zip(headings, zip(*rows, strict=True), strict=True)
    ]


def _kept(result: "StudyResult") -> str:
    """Formats the number of points with files, and the number of those made now."""
    count, made = len(result.kept.points), result.kept.made
    known = "" if made == count else f", {count - made:,} of them known before"
    return f"{clean(result.path)}/points: files of {count:,} point{'' if count == 1 else 's'}{known}"


def _metrics(result: "StudyResult") -> list[ReportColumn]:
    summaries = list(result.metrics.values())
    columns = [ReportColumn("metric", [clean(with_unit(name, each.unit)) for name, each in result.metrics.items()])]
    columns += [
        ReportColumn(
            heading, [number(summary.quantiles[i]) for summary in summaries], right=True, extra=i in (1, 2, 4, 5)
        )
        for i, heading in enumerate(("min", "5 %", "25 %", "median", "75 %", "95 %", "max"))
    ]
    columns += [
        ReportColumn("mean", [number(summary.mean) for summary in summaries], right=True),
    ]
    if any(summary.count < result.points for summary in summaries):
        columns.insert(1, ReportColumn("points", [str(summary.count) for summary in summaries], right=True))
    return columns


def _extremes(result: "StudyResult") -> list[ReportColumn]:
    """Yields the points with the lowest and highest value of each metric and their parameters, except of constants."""
    rows = [
        (name, word, number(value), str(point), _where(values))
        for name, summary in result.metrics.items()
        if summary.quantiles[0] != summary.quantiles[-1]
        for word, value, point, values in (
            ("lowest", summary.quantiles[0], summary.lowest, summary.lowest_values),
            ("highest", summary.quantiles[-1], summary.highest, summary.highest_values),
        )
        if point is not None
    ]
    if not rows:
        return []
    names, words, values, points, where = (list(cells) for cells in zip(*rows, strict=True))
    return [
        ReportColumn("metric", names),
        ReportColumn("", words),
        ReportColumn("value", values, right=True),
        ReportColumn("point", points, right=True),
        ReportColumn("where", where),
    ]


def _repeats(result: "StudyResult") -> list[ReportColumn]:
    """Returns the first means over repeats, with a row for each combination of the other parameters."""
    from mjrun.study.results import SEED

    groups, level = result.repeats, f"{100 * result.confidence:g} %"
    columns = [
        ReportColumn(clean(name), [clean(short_value(group.values.get(name, ""))) for group in groups], right=True)
        for name in result.names
        if name != SEED
    ]
    columns.append(ReportColumn("points", [str(group.points) for group in groups], right=True, extra=True))
    for name, summary in result.metrics.items():
        means = [group.metrics[name] for group in groups]
        columns.append(
            ReportColumn(clean(with_unit(name, summary.unit)), [number(each.mean) for each in means], right=True)
        )
        intervals = [interval_text(each.interval) for each in means]
        columns.append(ReportColumn(level, intervals, right=True, extra=True))
    return columns


def _sensitivities(result: "StudyResult") -> list[ReportColumn]:
    """Returns the indices of each metric and parameter, and the intervals of those that have one."""
    made, level = result.sensitivities, f"{100 * result.confidence:g} %"
    columns = [
        ReportColumn("metric", [clean(each.metric) for each in made]),
        ReportColumn("parameter", [clean(each.parameter) for each in made]),
    ]
    for name in made[0].indices:
        estimates = [each.indices[name] for each in made]
        columns.append(ReportColumn(name, [number(each.value) for each in estimates], right=True))
        columns.append(ReportColumn(level, [interval_text(each.interval) for each in estimates], right=True))
    return columns


def _where(values: Mapping[str, str]) -> str:
    """Formats the first few values of a point, with a few digits."""
    texts = [f"{name}={short_value(text)}" for name, text in values.items()]
    more = [f"… {len(texts) - FEW} more"] if len(texts) > FEW else []
    return clean(", ".join([*texts[:FEW], *more]))


def _failures(result: "StudyResult") -> list[ReportColumn]:
    failures = result.failures
    return [
        ReportColumn("points", [str(failure.count) for failure in failures], right=True),
        ReportColumn("status", [failure.status for failure in failures]),
        ReportColumn("reason", [clean(spelled(failure.message, flag).partition("\n")[0]) for failure in failures]),
    ]


def point_command(simulation: Simulation, values: Mapping[str, str], controller: str = "") -> str:
    """Returns the command that simulates one point alone.

    Args:
      values: parameters of the point, which replace options of the same name.
      controller: what the command line names as the controller.
    """
    model = values.get("model", simulation.source.text)
    words = ["mjrun", "trace", model, *_arguments(simulation, values, controller)]
    for name, text in values.items():
        group, slash, rest = name.partition("/")
        if name == "model":
            continue
        if slash and group in ("qpos", "qvel", "ctrl"):
            words += [flag(group), f"{rest}={text}"]
        elif "." in name:
            words += [flag("set"), f"{name}={text}"]
        else:
            words += [flag(name), text]
    return clean(shlex.join(words))


def _arguments(options: SimulationOptions, replaced: Container[str], controller: str) -> list[str]:
    """Formats explicit options as on a command line, except `replaced` ones."""
    words: list[str] = []
    for each in options_of(SimulationOptions):
        if each.name in replaced or not is_given(options, each.name):
            continue
        value = controller if each.name == "controller" else each.kind.plain(getattr(options, each.attribute))
        if value is True:
            words.append(flag(each.name))
            continue
        texts = [_text(value)]
        if isinstance(value, Mapping):
            entries = cast("Mapping[str, object]", value)
            texts = [f"{name}={_text(part)}" for name, part in entries.items()]
        elif isinstance(value, list) and is_repeatable(each):
            texts = [_text(part) for part in cast("list[object]", value)]
        for text in texts:
            words += [flag(each.name), text]
    return words


def _text(value: object) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ",".join(map(_text, cast("Sequence[object]", value)))
    return str(value)
