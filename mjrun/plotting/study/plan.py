"""The plan of a study's figure: the kind that suits its results, and its numbers.

If the results include traces, the kind may be trajectories: single points over time, overlaid.
"""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, listing, option, quoted
from mjrun.formats.study_reader import StudyResults, point_names, point_values
from mjrun.formats.table_reader import NumericTable, open_table, read_table
from mjrun.model.table_column import with_unit
from mjrun.options.plot import FigureOptions
from mjrun.plotting.curve_syntax import (
    CurveSpec,
    ReferenceLine,
    parse_curves,
    parse_log,
    parse_marks,
    parse_panel,
    parse_ylabel,
    parse_ylim,
)
from mjrun.plotting.figure_data import MARGIN, AxisScale, scale
from mjrun.plotting.study.figure_data import (
    DrawnStudyFigure,
    FailedPoints,
    GraphPanel,
    HeatmapPanel,
    ParallelCoordinatesPanel,
    SensitivityPanel,
    Series,
    StudyPanel,
    in_turn,
    spans_decades,
)
from mjrun.plotting.study.statistics import (
    SEED,
    Parameter,
    dependences,
    is_grid,
    parameter_of,
    quantiles,
    rank_correlations,
    ranks,
    summary,
)
from mjrun.probe.expression import expression_unit

LINES = 6  # maximum number of curves of another parameter in one panel
FEW = 3  # maximum number of parameters that have a scatter plot each
GRAPHS = 24  # maximum number of panels
DRAWN = 4000  # maximum number of lines of parallel coordinates
# Names in the key of two indices of sensitivity.
INDICES = {
    ("first", "total"): ("alone (first order)", "with interactions (total)"),
    ("mu_star", "sigma"): ("mean magnitude μ*", "deviation σ"),
}
RANKED = 40  # maximum number of parameters in a panel of rank correlations
TIME = "time"
POINTS = 100  # maximum number of trajectories in a panel
NAMED = 8  # maximum number of trajectories that each have a colour and an entry in the key
FAINT = 0.4  # opacity of a line among many
PANELS = 4  # maximum number of panels that the user did not choose
ROWS = 4000  # rows of a trajectory: more than the pixels of a figure
NOISE = 1e-14  # share of the largest value with the same unit below which curves are rounding errors


@dataclass(frozen=True)
class MetricValues:
    """A metric or an expression over metrics: its name with its unit, and its values `(n,)`, NaN if missing."""

    name: str
    values: np.ndarray
    log: bool


class StudyFigurePlan:
    """The plan of a figure of a study.

    Args:
      results: results of the study.
      options: x chooses the parameter, y the metrics.

    Attributes:
      notes: notes for the user.

    Raises:
      UsageError: there is nothing to show, or a name is unknown.
    """

    def __init__(self, results: StudyResults, options: FigureOptions) -> None:
        self._results, self._options = results, options
        self.notes: list[str] = []
        varying = [parameter_of(results, name) for name in results.parameters]
        self._parameters = [each for each in varying if len(each.levels) > 1]
        self._trajectories, self._over_time = _PointTraces(results), list[CurveSpec]()
        metrics = self._chosen_metrics()
        panels = len(metrics) + len(self._over_time)
        self._log_x, self._log_y = parse_log(options.log, panels)
        self._metrics = [
            MetricValues(name, values, index in self._log_y if options.log else spans_decades(values))
            for index, (name, values) in enumerate(metrics)
        ]
        self._marks = parse_marks(options.mark, panels)
        self._ylim = parse_ylim(options.ylim, panels)
        self._ylabels = parse_ylabel(options.ylabel, panels)
        limits = [options.xlim] if self._log_x else []
        if any(low <= 0 for low, _ in filter(None, limits)):
            raise UsageError(f"{option('xlim')}: a logarithmic axis starts above 0")

    @cached_property
    def drawing(self) -> DrawnStudyFigure:
        """The data of the figure."""
        curves = self._over_time or ([] if self._options.y else self._trajectories.usual)
        over_time = self._trajectory_panels(curves)
        self.notes += self._trajectories.notes
        if not self._metrics:
            return self._drawn(over_time)
        summary = self._summary()
        return replace(summary, panels=[*summary.panels, *over_time])

    def _summary(self) -> DrawnStudyFigure:
        """Chooses the figure of the metrics of all points."""
        x = self._x()
        main = [each for each in self._parameters if each.name != SEED] or self._parameters
        if x is not None:
            return self._over(x)
        if panels := self._sensitivity_panels():
            self._refuse_curve_options("indices of sensitivity", has_values=False)
            return self._drawn(panels, min(3, len(panels)))
        if len(main) == 1:
            return self._over(main[0])
        numbers = [each for each in main if not each.categories or len(each.levels) > LINES]
        if len(main) == 2 and len(numbers) == 1 and is_grid(*main):
            return self._over(numbers[0])  # a curve for each text
        if len(main) == 2 and is_grid(*main):
            return self._heat_maps(*main)
        listed = [each for each in main if each.is_listed]
        if len(listed) == 1 and len(main) == 2:
            return self._over(listed[0])
        if len(main) <= FEW:
            return self._scatter(main)
        return self._parallel(main)

    # --- chosen values ------------------------------------------------------------------------------

    def _chosen_metrics(self) -> list[tuple[str, np.ndarray]]:
        """Returns the names and values of the chosen metrics; the chosen columns over time become `_over_time`."""
        known = {name: values for name, values in self._results.numbers.items() if name in self._results.metrics}
        texts = self._options.y or tuple(known)
        if not texts and self._trajectories.usual:
            self._over_time = self._trajectories.usual
            return []
        if not texts:
            raise UsageError(f"{self._results.folder}: the study has no metrics to plot; see {option('metric')}")
        metrics: list[tuple[str, np.ndarray]] = []
        columns = {**{each.name: each.values for each in self._parameters}, **known}
        for index, text in enumerate(texts):
            with concerning("y", index):
                if text in known:
                    metrics.append((self._results.with_unit(text), known[text]))
                    continue
                try:
                    self._over_time += parse_panel(text, self._trajectories.columns).curves
                except UnknownNameError:
                    for curve in self._curves(text, list(columns)):
                        metrics.append((self._named(curve), curve.expression.values(columns)))
        return metrics

    def _named(self, curve: CurveSpec) -> str:
        """Returns the name of an expression with its unit."""
        units = self._results.units
        unit = expression_unit(curve.expression.root, units) if curve.unit is None else curve.unit
        return with_unit(curve.name, unit)

    def _curves(self, text: str, columns: list[str]) -> Sequence[CurveSpec]:
        """Parses curves over metrics and parameters; an error about columns over time alone is specific."""
        try:
            return parse_panel(text, columns).curves
        except UnknownNameError:
            all_columns = [*columns, *self._trajectories.columns]
            try:
                parse_panel(text, all_columns)
            except UnknownNameError as error:
                error.add_note(self._hint())
                raise
            raise UsageError(f"{option('y')}: {quoted(text)} reads both metrics and columns over time") from None

    def _hint(self) -> str:
        """Returns how to get more columns over time."""
        if self._results.is_of_evaluation:
            return "an evaluation keeps none over time; `mjrun trace TASK --policy POLICY` has those of an episode"
        folder = clean(shlex.quote(str(self._results.folder)))
        return f"mjrun sweep {folder} --keep trace --probe NAME stores more columns over time"

    def _x(self) -> Parameter | None:
        """Returns the chosen x: a parameter, or an expression over the metrics."""
        if self._options.x is None:
            if not self._parameters:
                raise UsageError(f"{self._results.folder}: no parameter varies: there is one point, or all are equal")
            return None
        named = {each.name: each for each in self._parameters}
        if self._options.x in named:
            return named[self._options.x]
        metrics = {name: self._results.numbers[name] for name in self._results.metrics}
        columns = {**{name: each.values for name, each in named.items()}, **metrics}
        try:
            curves = parse_curves(self._options.x, list(columns), option("x"))
        except UnknownNameError:
            raise UnknownNameError("parameter", self._options.x, list(columns), where=option("x")) from None
        if len(curves) != 1:
            raise BadValueError(option("x"), self._options.x, f"one parameter, it is {len(curves)}")
        values = curves[0].expression.values(columns)
        levels = np.unique(values[np.isfinite(values)])
        return Parameter(curves[0].name, values, levels, label=self._named(curves[0]))

    # --- kinds of figures ----------------------------------------------------------------------------

    def _over(self, x: Parameter) -> DrawnStudyFigure:
        """Plans curves over one parameter, with bands if points share its values; otherwise dots."""
        others = [each for each in self._parameters if each.name not in (x.name, SEED)]
        if x.name == SEED and others:
            others = []
        is_parameter = any(each is x for each in self._parameters)
        if not x.is_listed and (others or not is_parameter):
            return self._scatter([x])
        lines = others[0] if len(others) == 1 and len(others[0].levels) <= LINES else None
        axis = self._axis(x)
        panels = [self._graph(x, axis, metric, lines) for metric in self._shown(self._metrics)]
        return self._drawn(panels)

    def _axis(self, x: Parameter) -> AxisScale:
        """Returns the axis of a parameter, with the range and the label that are requested."""
        return self._with_options(x.scale(True if self._log_x else None))

    def _with_options(self, axis: AxisScale) -> AxisScale:
        options = self._options
        if options.xlim and not axis.categories:
            low, high = options.xlim
            axis = replace(axis, low=low, high=high, log=axis.log and low > 0)
        return replace(axis, name=options.xlabel) if options.xlabel else axis

    def _panel(
        self, x: AxisScale, metric: MetricValues, drawn: np.ndarray, series: Sequence[Series], failures: np.ndarray
    ) -> GraphPanel:
        """Returns a panel of a metric, with its marks.

        Args:
          drawn: the values that the y axis shows.
          failures: x of all points `(n,)`.
        """
        index = next(number for number, each in enumerate(self._metrics) if each is metric)
        marks = [mark for mark in self._marks if mark.vertical or mark.panel in (None, index + 1)]
        y = self._y_axis(index, metric.name, drawn, marks, log=metric.log)
        label = self._ylabels.get(index, "")
        return GraphPanel(x, y, self._in_turn(series, y), self._failures(failures), marks, label)

    def _in_turn(self, series: Sequence[Series], y: AxisScale) -> list[Series]:
        """Gives curves that coincide alternating dashes, and notes their names."""
        drawn = in_turn(series, y)
        if hidden := [each.name for each in drawn if each.turn[1] > 1]:
            self.notes.append(f"{y.name}: curves coincide, and their dashes alternate: {listing(hidden)}")
        return drawn

    def _y_axis(
        self, index: int, name: str, drawn: np.ndarray, marks: Sequence[ReferenceLine], *, log: bool
    ) -> AxisScale:
        """Returns the y axis of the panel `index`, which shows values and marks, with the range that is requested."""
        heights = [mark.value for mark in marks if not mark.vertical]
        y = scale(name, np.append(drawn, heights), log=log, edge=MARGIN)
        if limit := self._ylim.get(index):
            y = replace(y, low=limit[0], high=limit[1], log=y.log and limit[0] > 0)
        return y

    def _trajectory_panels(self, curves: Sequence[CurveSpec]) -> list[GraphPanel]:
        """Plans a panel over time for each of these curves.

        Options of panels apply to those that are chosen; options of the x axis, if there are no metrics over another.
        """
        if not self._metrics and self._options.x not in (None, TIME):
            raise UsageError(f"{option('x')} does not apply to columns over time, whose x axis is the time")
        panels = list[GraphPanel]()
        limits = None if self._metrics else self._options.xlim
        for index, each in enumerate(self._trajectories.overlays(curves, limits), len(self._metrics)):
            x, marks = scale("time [s]", each.times, edge=0.0), []
            if self._over_time:
                marks = [mark for mark in self._marks if not mark.vertical and mark.panel in (None, index + 1)]
            if not self._metrics:
                marks += [mark for mark in self._marks if mark.vertical]
                x = self._with_options(scale(x.name, each.times, log=self._log_x, edge=0.0))
            y = self._y_axis(index, each.name, each.values, marks, log=index in self._log_y)
            series = self._in_turn(each.series, y)
            panels.append(GraphPanel(x, y, series, (), marks, self._ylabels.get(index, "")))
        return panels

    def _graph(self, x: Parameter, axis: AxisScale, metric: MetricValues, lines: Parameter | None) -> GraphPanel:
        groups = [("", np.ones(len(x.values), bool))]
        if lines is not None:
            groups = [
                (label if self._options.legend_title else f"{lines.name} = {label}", lines.places == place)
                for place, label in enumerate(lines.labels)
            ]
        series = [summary(name, x, metric.values, chosen, i) for i, (name, chosen) in enumerate(groups)]
        drawn = [each for s in series for each in (s.y, *(end for band in s.bands for end in (band.low, band.high)))]
        return self._panel(axis, metric, np.concatenate(drawn), series, x.values)

    def _scatter(self, parameters: Sequence[Parameter]) -> DrawnStudyFigure:
        """Plans dots, in a column of panels for each parameter."""
        metrics = self._metrics[: max(1, GRAPHS // len(parameters))]
        panels: list[StudyPanel] = []
        for metric in self._shown(metrics):
            for x in parameters:
                dots = Series("", x.values, metric.values, joined=False)
                panels.append(self._panel(self._axis(x), metric, metric.values, [dots], x.values))
        return self._drawn(panels, len(parameters))

    def _heat_maps(self, across: Parameter, up: Parameter) -> DrawnStudyFigure:
        """Plans a cell for each pair of values: the median of its points."""
        self._refuse_curve_options("heat maps")
        shape = (len(up.levels), len(across.levels))
        cells = up.places * shape[1] + across.places
        count = np.bincount(cells, minlength=shape[0] * shape[1])
        good = np.bincount(cells[self._results.status == "ok"], minlength=len(count))
        panels: list[StudyPanel] = []
        for metric in self._shown(self._metrics):
            (values,) = quantiles(cells, metric.values, len(count), [0.5])
            failed = (count > 0) & (good == 0) & np.isnan(values)
            ends = scale(metric.name, values, log=metric.log, edge=0.0)
            colours = replace(ends, log=metric.log and ends.low > 0)
            grid = values.reshape(shape), failed.reshape(shape)
            panels.append(HeatmapPanel(metric.name, across.cells(), up.cells(), *grid, colours))
        return self._drawn(panels)

    def _parallel(self, parameters: Sequence[Parameter]) -> DrawnStudyFigure:
        """Plans parallel coordinates, and how much each metric depends on each parameter."""
        self._refuse_curve_options("parallel coordinates")
        first = next((each for each in self._metrics if np.isfinite(each.values).any()), self._metrics[0])
        values = np.column_stack([*(each.values for each in parameters), first.values])
        from_middle = np.nan_to_num(np.abs(ranks(first.values) - 0.5), nan=-1.0)
        order = np.argsort(from_middle, kind="stable")  # failed points first, and the extremes last, on top
        if len(order) > DRAWN:
            self.notes.append(f"{DRAWN} of {len(order)} points have a line, evenly chosen")
            order = order[np.linspace(0, len(order) - 1, DRAWN).round().astype(int)]
        scales = [each.scale() for each in parameters]
        last = scale(first.name, first.values, log=first.log, edge=0.0)
        above = ParallelCoordinatesPanel([*scales, last], values[order], np.isnan(values[order, -1]))

        ordinal = [each for each in parameters if len(each.categories) <= 2]
        left = [each.name for each in parameters if each not in ordinal]
        if left:
            self.notes.append(f"{listing(left)}: texts without an order have no rank correlation")
        panels = self._rank_panels(ordinal)
        return self._drawn(panels, min(3, len(panels)), above)

    def _rank_panels(self, parameters: Sequence[Parameter]) -> list[SensitivityPanel]:
        """Returns a panel for each metric, with the parameters ordered by their strongest correlation with any."""
        metrics, values = self._shown(self._metrics), [each.values for each in parameters]
        correlations = np.array([rank_correlations(values, metric.values) for metric in metrics])
        shares = np.array([dependences(values, metric.values) for metric in metrics])
        strength = np.nan_to_num(np.maximum(np.abs(correlations), shares), nan=-1.0).max(axis=0)
        order = np.argsort(-strength, kind="stable")[:RANKED]
        if len(order) < len(parameters):
            self.notes.append(f"of {len(parameters)} parameters, the {RANKED} with the strongest relations have bars")
        names = [parameters[i].ordinal_name for i in order]
        rows = zip(metrics, correlations, shares, strict=True)
        return [SensitivityPanel(metric.name, names, ranked[order], share[order]) for metric, ranked, share in rows]

    def _sensitivity_panels(self) -> list[SensitivityPanel]:
        """Returns a panel of the indices of each chosen metric; none if there are no indices of all of them."""
        known, names = self._results.sensitivity, self._options.y or self._results.metrics
        if not known or not all(name in known for name in names):
            return []
        pair = next((pair for pair in INDICES if pair[0] in known[names[0]]), None)
        if pair is None:  # all are undefined
            return []
        first, second = pair
        shares = [known[name][first] for name in names]
        defined = [each for each in shares if not np.isnan([*each.values()]).any()]
        strength = {
            parameter: max((abs(each[parameter]) / (max(map(abs, each.values())) or 1) for each in defined), default=0)
            for parameter in shares[0]
        }
        parameters = sorted(strength, key=lambda name: -strength[name])[:RANKED]
        panels = list[SensitivityPanel]()
        for name in names:
            bars, rings = (np.array([known[name][index][each] for each in parameters]) for index in (first, second))
            intervals = np.array(
                [[self._interval(name, index, each) for each in parameters] for index in (first, second)]
            )
            drawn = np.nan_to_num(np.concatenate([bars, rings, intervals.ravel()]))
            is_share = first == "first"
            most = float(drawn.max(initial=1.0 if is_share else 0.0)) or 1.0
            ends = (float(drawn.min(initial=0.0)) - 0.3 * most, 1.1 * most)
            title = name if is_share else self._results.with_unit(name)
            axis = "share of the variance" if is_share else "effect over the range"
            panels.append(
                SensitivityPanel(title, parameters, bars, rings, INDICES[first, second], axis, ends, intervals)
            )
        return panels

    def _interval(self, metric: str, index: str, parameter: str) -> list[float]:
        """Returns the ends of the confidence interval of an index of sensitivity; NaN without one."""
        known = self._results.sensitivity[metric]
        return [known.get(f"{index}_{end}", {}).get(parameter, np.nan) for end in ("low", "high")]

    # --- parts ---------------------------------------------------------------------------------------

    def _drawn(
        self, panels: Sequence[StudyPanel], columns: int | None = None, above: ParallelCoordinatesPanel | None = None
    ) -> DrawnStudyFigure:
        options = self._options
        columns = options.columns or columns
        return DrawnStudyFigure(options.title or "", panels, columns, above, options.legend_title or "")

    def _refuse_curve_options(self, kind: str, *, has_values: bool = True) -> None:
        """Raises UsageError if an option is given that applies to curves and dots only.

        Figures that show values of metrics, which may be logarithmic, have `log` for y.
        """
        options = self._options
        given = {
            "mark": options.mark,
            "xlim": options.xlim,
            "ylim": options.ylim,
            "xlabel": options.xlabel,
            "ylabel": options.ylabel,
            "log": self._log_x or (not has_values and options.log),
        }
        for name, value in given.items():
            if value:
                other = f"{option('x')} PARAMETER draws curves or dots over one of them"
                axis = " x" if name == "log" and has_values else ""
                raise UsageError(
                    f"{option(name)}{axis} does not apply to {kind}, which show several parameters\n{other}"
                )

    def _shown(self, metrics: Sequence[MetricValues]) -> list[MetricValues]:
        """Returns the metrics to draw, those with values if there are any, and notes the others."""
        filled = [each for each in metrics if np.isfinite(each.values).any()]
        empty = [each.name for each in metrics if each not in filled]
        if empty:
            self.notes.append(f"{listing(empty)}: no point has a value")
        left = [each.name for each in self._metrics if each not in metrics]
        if left:
            self.notes.append(f"{listing(left)} left out; choose with {option('y')}")
        return filled or list(metrics)

    def _failures(self, x: np.ndarray) -> list[FailedPoints]:
        """Returns the failed points, by status."""
        status = self._results.status
        return [FailedPoints(str(kind), x[status == kind]) for kind in dict.fromkeys(status.tolist()) if kind != "ok"]


@dataclass(frozen=True)
class _Curve:
    """A column or an expression over time: its values `(rows,)` at each point."""

    name: str
    unit: str
    values: Sequence[np.ndarray]

    @property
    def largest(self) -> float:
        """The largest finite magnitude; 0 if no value is finite."""
        magnitudes = np.abs(np.concatenate(self.values))
        return float(magnitudes[np.isfinite(magnitudes)].max(initial=0.0))


@dataclass(frozen=True)
class _Overlay:
    """The trajectories of a panel: the name of the curve with its unit, all times and values `(n,)`, and the curves."""

    name: str
    times: np.ndarray
    values: np.ndarray
    series: Sequence[Series]


class _PointTraces:
    """The stored traces of a study's points.

    Attributes:
      columns: columns of the first trace, which all others share.
      notes: notes for the user, after `panels`.
    """

    def __init__(self, results: StudyResults) -> None:
        self._results, self.notes = results, list[str]()
        self._traces = results.traces
        first = next(iter(self._traces.values()), None)
        self.columns: Sequence[str] = ()
        if first is not None:
            with open_table(str(first)) as table:
                self.columns = [name for name in table.names if name != TIME]

    @property
    def usual(self) -> list[CurveSpec]:
        """The columns that the metrics read; in a study without metrics, the first of all columns."""
        read = set(self._results.metric_columns)
        names = [name for name in self.columns if name in read or not self._results.metrics]
        return [curve for name in names[:PANELS] for curve in parse_panel(name, self.columns).curves]

    def overlays(self, curves: Sequence[CurveSpec], limits: tuple[float, float] | None) -> "list[_Overlay]":
        """Returns the trajectories of all points for each of these curves.

        Args:
          limits: range of the time to show [s]; None for all.
        """
        if not curves:
            return []
        names = [*dict.fromkeys(name for curve in curves for name in curve.expression.columns)]
        tables = self._tables(names, limits)
        labels = self._labels(list(tables))
        drawn = [self._curve(curve, tables) for curve in curves]
        largest = dict[str, float]()
        for each in drawn:
            largest[each.unit] = max(largest.get(each.unit, 0.0), each.largest)
        return [self._overlay(each, tables, labels, largest[each.unit]) for each in drawn]

    def _curve(self, curve: CurveSpec, tables: Mapping[int, NumericTable]) -> "_Curve":
        unit = next(iter(tables.values())).units.get(curve.column or "", "") if curve.unit is None else curve.unit
        return _Curve(curve.name, unit, [curve.expression.values(table.columns) for table in tables.values()])

    def _overlay(
        self, curve: "_Curve", tables: Mapping[int, NumericTable], labels: Sequence[str], largest: float
    ) -> "_Overlay":
        colours = range(len(tables)) if any(labels) else [0] * len(tables)
        opacity = 1.0 if len(tables) <= NAMED else FAINT
        series = [
            Series(label, table[TIME], values, dots=False, colour=colour, opacity=opacity)
            for label, colour, table, values in zip(labels, colours, tables.values(), curve.values, strict=True)
        ]
        values = np.concatenate(curve.values)
        if curve.largest < NOISE * largest:
            values = np.array([-largest, largest])
        times = np.concatenate([table[TIME] for table in tables.values()])
        return _Overlay(with_unit(curve.name, curve.unit), times, values, series)

    def _tables(self, names: Sequence[str], limits: tuple[float, float] | None) -> dict[int, NumericTable]:
        """Reads the traces of the points to show."""
        points = list(self._traces)
        if len(points) > POINTS:
            self.notes.append(f"{POINTS} of {len(points)} points with traces have a line, evenly chosen")
            points = [points[i] for i in np.linspace(0, len(points) - 1, POINTS).round().astype(int)]
        return {point: _thinned(read_table(str(self._traces[point]), [TIME, *names]), limits) for point in points}

    def _labels(self, points: Sequence[int]) -> list[str]:
        """Returns the name of each trajectory in the key; empty if they are too many."""
        if not 1 < len(points) <= NAMED:
            return [""] * len(points)
        return point_names([point_values(self._traces[point].parent) for point in points], self._results.units)


def _thinned(table: NumericTable, limits: tuple[float, float] | None) -> NumericTable:
    """Selects every k-th row within a range of time, about as many as a figure can show, and the first and last of all.

    A row on either side of the range is selected, too: lines lead to them. Expressions may refer to the first row.
    """
    times = table[TIME]
    low, high = limits or (-np.inf, np.inf)
    shown = np.flatnonzero((times >= low) & (times <= high))
    ends = (0, len(times) - 1)
    first, last = np.clip([shown[0] - 1, shown[-1] + 1], *ends) if len(shown) else ends
    step = max(1, (last - first + 1) // ROWS)
    rows = np.unique([*ends, *range(first, last, step), last])
    return NumericTable({name: values[rows] for name, values in table.columns.items()}, table.units)
