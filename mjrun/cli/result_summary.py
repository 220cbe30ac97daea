"""One-line summaries of all kinds of results."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from mjrun.cli.table_cells import byte_size
from mjrun.errors import clean, counted

if TYPE_CHECKING:
    from mjrun.diff.result import DiffResult
    from mjrun.outputs.export import ExportResult
    from mjrun.outputs.image import ImageResult
    from mjrun.outputs.keyframe import KeyframeResult
    from mjrun.outputs.output import OutputResult
    from mjrun.outputs.plot import PlotResult
    from mjrun.outputs.recording import RecordingResult
    from mjrun.outputs.trace import TraceResult
    from mjrun.outputs.video import VideoResult
    from mjrun.plotting.table_and_study_plot import TablePlotResult
    from mjrun.probe.verdict import Verdict

LISTED = 10  # changes of a golden table that are shown


def video(result: "VideoResult") -> str:
    width, height = result.size
    frames = counted(result.frames, "frame")
    shown = f"{width}x{height}, {frames}, {result.duration:.4g} s at {_figure(result.fps, 4)} fps, {result.codec}"
    pace = f"made in {result.wall:.1f} s, {_figure(result.frames / result.draw_wall, 3)} frames/s"
    by = f"by {clean(result.renderer)} ({result.gl})" + (f" in {result.jobs} processes" if result.jobs > 1 else "")
    return f"{', '.join(map(clean, result.paths))}: {shown}; {pace}, {by}"


def _figure(value: float, digits: int) -> str:
    """Formats a number with three significant digits, or all before the point: 0.125, 29.97, 10000."""
    return f"{value:.{digits}g}" if value < 10 ** (digits - 1) else f"{value:.0f}"


def image(result: "ImageResult") -> str:
    width, height = result.size
    paths = ", ".join(map(clean, result.paths)) or "-"
    return f"{paths}: {width}x{height} at {result.time:.6g} s; made in {result.wall:.1f} s, by {clean(result.renderer)}"


def trace(result: "TraceResult") -> str:
    size = f"{counted(result.rows, 'row')}, {counted(result.columns, 'column')}"
    pace = f"{result.simulated:.6g} s in {result.steps} steps; made in {result.wall:.2f} s"
    golden = f"\n{golden_summary(result.golden)}" if result.golden else ""
    path = f"{clean(result.path)}: " if result.path else ""
    return "\n".join([f"{path}{size}, {pace}{golden}", *_assertions(result.assertions)])


def _assertions(verdicts: Sequence["Verdict"]) -> list[str]:
    """Yields a line per assertion that holds; failed assertions are errors."""
    return [f"  assertion passed: {verdict.message}" for verdict in verdicts if verdict.passed]


def golden_summary(result: "DiffResult") -> str:
    """Formats a line about a golden table, with the changes if it was replaced."""
    from mjrun.diff.sentences import golden_versions

    assert result.golden
    path, count, versions = clean(result.a), len(result.differences), golden_versions(result.golden)
    if not result.golden.updated:
        return f"{path}: {'agrees' if result.equal else 'differs'}; {versions}"
    if result.table is None and result.equal:
        return f"{path}: made"
    changes = [f"  {sentence}" for sentence in result.differences[:LISTED]]
    more = [f"  … and {count - LISTED} more"] if count > LISTED else []
    changed = "" if count else ", and nothing changed"
    return "\n".join([f"{path}: updated; {versions}{changed}", *changes, *more])


def plot(result: "PlotResult") -> str:
    width, height = result.size
    return f"{clean(result.path)}: {width}x{height}, {result.samples} samples"


def table_plot(result: "TablePlotResult") -> str:
    width, height = result.size
    curves = f"{counted(result.curves, 'curve')} in " if result.curves else ""  # heat maps have none
    size = f"{width}x{height}, {curves}{counted(len(result.panels), 'panel')}"
    paths: list[str] = [result.path, *([result.html] if result.html else [])]
    made = f"{', '.join(map(clean, dict.fromkeys(paths)))}: {size}, {counted(sum(result.rows), 'row')}"
    return "\n".join([made, *_assertions(result.assertions)])


def recording(result: "RecordingResult") -> str:
    return f"{clean(result.path)}: {result.states} states of {result.size} numbers, {result.simulated:.6g} s"


def keyframe(result: "KeyframeResult") -> str:
    return f"{clean(result.path)}: keyframe {clean(result.name)} of step {result.step}, {result.time:.6g} s"


def export(result: "ExportResult") -> str:
    frames = counted(result.frames, "frame")
    length = f"{frames}, {result.duration:.4g} s at {_figure(result.fps, 4)} fps"
    size = f", {byte_size(result.size)}" if result.size else ""
    return f"{clean(result.path)}: {result.format}, {length}{size}; made in {result.wall:.1f} s"


SUMMARIES: "dict[str, Callable[[Any], str]]" = {
    "VideoResult": video,
    "ImageResult": image,
    "TraceResult": trace,
    "PlotResult": plot,
    "TablePlotResult": table_plot,
    "RecordingResult": recording,
    "KeyframeResult": keyframe,
    "ExportResult": export,
}


def summary(result: "OutputResult | TablePlotResult") -> str:
    """Formats the summary of a result of any kind."""
    return SUMMARIES[type(result).__name__](result)
