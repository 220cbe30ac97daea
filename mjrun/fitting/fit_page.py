"""The page about a fit: fitted values, their uncertainty, and measured signals beside those of the model."""

from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

import numpy as np

from mjrun.errors import clean
from mjrun.fitting.comparison import HORIZON, comparison_columns
from mjrun.model.table_column import Column
from mjrun.options.plot import FigureOptions
from mjrun.plotting.figure_plan import FigurePlan, TableColumns
from mjrun.plotting.figure_writer import page_svg
from mjrun.plotting.html_page import Page, PageFactTable, PageFigure
from mjrun.plotting.page_writer import MAKER, PageWriter
from mjrun.probe.scanner import spelled

if TYPE_CHECKING:
    from mjrun.fitting.result import FitResult


def write_fit_page(
    stack: ExitStack,
    path: str,
    model: str,
    result: "FitResult",
    signals: Sequence[Column],
    rows: np.ndarray,
    logs: Sequence[str],
) -> PageWriter:
    """Writes the page, to be published by the caller; `stack` discards it otherwise.

    Args:
      model: name of the model.
      signals: measured columns.
      rows: rows of the comparison, `(n, columns)`.
      logs: names of the measured tables.

    Raises:
      FileError: the page cannot be written.
    """
    figures = [_figure(name, signals, rows[rows[:, -1] == log]) for log, name in enumerate(logs)]
    facts = [_parameters(result), *_inertias(result), _errors(result), *_correlations(result), _about(result)]
    writer = stack.enter_context(PageWriter(path))
    writer.write(Page(f"Fit of {clean(model)}", MAKER, figures, facts=facts))
    return writer


def _parameters(result: "FitResult") -> PageFactTable:
    rows = [
        (
            p.path,
            _number(p.start),
            _number(p.value),
            _interval(p.low, p.high),
            f"at its {p.bound} bound" if p.bound else "",
        )
        for p in result.parameters
    ]
    heads = ("Parameter", "Before", "Fitted", _confidence(result), "")
    return PageFactTable("Parameters", "Free parameters of the model", heads, rows, (1, 2, 3))


def _inertias(result: "FitResult") -> list[PageFactTable]:
    rows = [
        (f"{each.body} {q.name}", _number(q.start), _number(q.value), _interval(q.low, q.high), q.unit)
        for each in result.inertias
        for q in each.quantities
    ]
    heads = ("Quantity", "Before", "Fitted", _confidence(result), "Unit")
    caption = "Mass, centre of mass in the frame of the body, and principal moments of inertia"
    return [PageFactTable("Inertias", caption, heads, rows, (1, 2, 3))] if rows else []


def _errors(result: "FitResult") -> PageFactTable:
    rows = [
        (
            each.name,
            f"{_number(each.noise)} {each.unit}".rstrip(),
            _number(each.misfit),
            *(_share(e) for e in (each.nominal, each.fitted, each.holdout_nominal, each.holdout_fitted)),
        )
        for each in result.signals
    ]
    heads = ("Signal", "Residual", "Over noise", "Before", "Fitted", "Held out, before", "Held out, fitted")
    caption = "Root mean square errors of predictions, relative to the standard deviation of the signal"
    if result.loss != "linear":
        caption = f"Errors of predictions over the spread of the signal, by medians because the loss is {result.loss}"
    return PageFactTable("Errors", caption, heads, rows, range(1, 7))


def _correlations(result: "FitResult") -> list[PageFactTable]:
    paths = [each.path for each in result.parameters]
    if len(paths) < 2:
        return []
    rows = [
        (path, *(f"{value:.2f}".replace("-", "−") for value in row[: i + 1]), *[""] * (len(paths) - i - 1))
        for i, (path, row) in enumerate(zip(paths, result.correlation, strict=True))
    ]
    caption = "Near 1 or −1, two parameters compensate for each other: only their difference or sum is well determined"
    return [PageFactTable("Correlations", caption, ["", *paths], rows, range(1, len(paths) + 1))]


def _about(result: "FitResult") -> PageFactTable:
    rows = [
        ("fitted", f"{result.rows:,} rows in {result.segments} segment{'' if result.segments == 1 else 's'}"),
        ("simulated", f"{result.rollouts:,} rollouts"),
        ("searched", ", then ".join(result.ways)),
        ("condition", f"{result.condition:.4g}"),
        ("reduced χ²", f"{result.reduced_chi2:.4g}"),
        *(("changed", text) for text in result.changes),
        *(("remark", text) for text in result.remarks),
    ]
    return PageFactTable("About the fit", "Fitted data, and changes of the model", ("Fact", "Value"), rows)


def _figure(log: str, signals: Sequence[Column], rows: np.ndarray) -> PageFigure:
    """Plots every signal as measured and predicted, and its residuals."""
    panels: list[str] = []
    for signal in signals:
        measured, nominal, fitted = (spelled(f"{signal.name}{end}") for end in ("", "/nominal", "/fitted"))
        unit = f" [{signal.unit}]" if signal.unit else ""
        panels += [
            f"{signal.name}: before{unit}={nominal}, measured{unit}={measured}, fitted{unit}={fitted}",
            f"residual of {signal.name}: residual{unit}={fitted} - {measured}",
        ]
    held = rows[rows[:, -2] > 0, 0]
    marks = [f"x:held out={held[0]:.9g}"] if len(held) else []
    options = FigureOptions(y=panels, mark=marks, columns=2)
    columns = comparison_columns(signals)
    plan = FigurePlan(options, [TableColumns(log, {column.name: column.unit for column in columns})])
    collector = plan.collector(0)
    collector.feed({column.name: values for column, values in zip(columns, rows.T, strict=True)})
    svg = page_svg(plan.drawing([collector]), plan.page_grid(), options.style)
    description = f"{clean(log)}: measured, predicted by the original model, and predicted by the fitted model"
    segments = f"Each segment begins in the state that fits best; held-out data begin again about every {HORIZON} rows."
    return PageFigure(svg, description, [*plan.notes, *collector.notes(), segments])


def _confidence(result: "FitResult") -> str:
    return f"{100 * result.confidence:g} % interval"


def _interval(low: float, high: float) -> str:
    return f"{_number(low)} … {_number(high)}" if low < high else ""


def _number(value: float) -> str:
    return f"{value:.5g}".replace("-", "−")


def _share(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.3g} %"
