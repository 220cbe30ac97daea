"""The plan of a figure: its panels and curves, from options and the columns of tables.

Every name is resolved before the first row is read.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby, takewhile

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UsageError, concerning, counted, listing, option, quoted
from mjrun.model.names import FREE, QPOS_COMPONENTS, QVEL_COMPONENTS
from mjrun.model.table_column import split_column, with_unit
from mjrun.model.units import DATA_UNITS
from mjrun.options.plot import FigureOptions
from mjrun.plotting import curve_syntax
from mjrun.plotting.curve_syntax import CurveSpec, PanelSpec, parse_curves, parse_panel
from mjrun.plotting.figure_data import (
    MARGIN,
    CurvePoints,
    DrawnCurve,
    DrawnFigure,
    DrawnPanel,
    Envelope,
    PanelGrid,
    XRangeFilter,
    in_turn,
    panel_grid,
)
from mjrun.probe.derived import derived_units
from mjrun.probe.fields import DOF_UNITS
from mjrun.probe.row_expression import Condition, RisingEdgeDetector, named_condition, parse_condition
from mjrun.probe.vocabularies import TableVocabulary

CURVES = 12  # maximum number of curves in a panel that the user did not choose
_TIMES = ("time", "t")  # names of the x axis
NUMBERING = ("point", "seed")  # columns that number simulations: each row of such a table is the result of one
_POSITIONS = {name: "m" for name in QPOS_COMPONENTS[FREE] if not name.startswith("q")}
PANELS = 48  # maximum number of panels that the user did not choose
PAGE_PANELS = 12  # maximum number of panels in one column of a page
EVENTS = 200  # maximum number of marked events per condition and table


@dataclass(frozen=True)
class PanelCurve:
    """A curve of a panel: its name in the legend, its unit, and its expression over the columns."""

    name: str
    unit: str
    text: CurveSpec


@dataclass(frozen=True)
class Panel:
    """A panel: the quantity on its y axis, its unit, and its curves."""

    title: str
    unit: str
    curves: tuple[PanelCurve, ...]

    @property
    def label(self) -> str:
        """The label of the y axis."""
        return with_unit(self.title, self.unit)


def time_column(names: Iterable[str]) -> str | None:
    """Returns the column that holds the time, if any."""
    known = list(names)
    if "time" in known:
        return "time"
    return next((name for name in known if split_column(name)[0].strip().casefold() in _TIMES), None)


def chosen_panels(texts: Sequence[str], units: Mapping[str, str], x: str | None = None) -> list[Panel]:
    """Parses the panels in the option y, over columns with `units`; wildcards omit the column x."""
    panels: list[Panel] = []
    for index, text in enumerate(texts):
        with concerning("y", index):
            panels.append(_chosen(parse_panel(text, list(units), x), units))
    return panels


def panels_by_unit(names: Sequence[str], units: Mapping[str, str], *, apart: bool = False) -> list[Panel]:
    """Groups the columns `names` into a panel for each group and unit.

    Args:
      apart: whether every column has a separate panel.
    """
    groups: dict[str, dict[str, list[str]]] = {}
    for name in names:
        group = name.partition("/")[0] if "/" in name else ""
        groups.setdefault(group, {}).setdefault(units[name], []).append(name)
    panels: list[Panel] = []
    for group, by_unit in groups.items():
        for unit, same in by_unit.items():
            parts = [[name] for name in same] if apart else _parts(same)
            panels += _numbered([_panel(group, unit, [_curve(name, units) for name in part]) for part in parts])
    return panels


def _numbered(panels: Sequence[Panel]) -> Iterator[Panel]:
    """Yields the panels, numbered if several have one title: `qpos 1/2`."""
    counts, seen = Counter(panel.title for panel in panels), Counter[str]()
    for panel in panels:
        seen[panel.title] += 1
        several = counts[panel.title] > 1
        number = f"{panel.title or 'columns'} {seen[panel.title]}/{counts[panel.title]}"
        yield replace(panel, title=number) if several else panel


def _parts(names: list[str]) -> list[list[str]]:
    """Splits names into few lists of similar length, at most `CURVES` each; components of an object stay together."""
    objects = [list(same) for _, same in groupby(names, key=lambda name: name.rpartition("/")[0])]
    objects = [[name] for name in names] if len(objects) == 1 else objects
    count = -(-len(names) // CURVES)
    parts: list[list[str]] = [[]]
    for same in objects:
        if parts[-1] and len(parts[-1]) + len(same) > min(CURVES, -(-len(names) // count) + len(same) // 2):
            parts.append([])
        parts[-1] += same
    return [part[start : start + CURVES] for part in parts for start in range(0, len(part), CURVES)]


def _curve(name: str, units: Mapping[str, str]) -> PanelCurve:
    (text,) = parse_curves(name, [name], "")
    return PanelCurve(name, units[name], text)


def _chosen(panel: PanelSpec, units: Mapping[str, str]) -> Panel:
    curves = [PanelCurve(text.name, _unit(text, panel, units), text) for text in panel.curves]
    kinds = {curve.unit for curve in curves}
    return _panel(panel.title or "", kinds.pop() if len(kinds) == 1 else "", curves, titled=panel.title is not None)


def _unit(text: CurveSpec, panel: PanelSpec, units: Mapping[str, str]) -> str:
    if text.unit is not None:
        return text.unit
    if panel.unit is not None:
        return panel.unit
    return units[text.column] if text.column is not None else ""


def _panel(title: str, unit: str, curves: Sequence[PanelCurve], *, titled: bool = False) -> Panel:
    """Creates a panel whose title holds the common prefix of the names, which the legend then omits."""
    names = [split_column(curve.name)[0] if curve.text.column else curve.name for curve in curves]
    if len(names) == 1 and not titled:
        return Panel(names[0], unit, tuple(curves))
    prefix = _common(names) if all(curve.text.column == curve.name for curve in curves) else ""
    short = [name.removeprefix(prefix) for name in names]
    # If units differ, each curve shows its own.
    units = [f" [{curve.unit}]" if curve.unit and curve.unit != unit else "" for curve in curves]
    shown = [replace(c, name=name + u) for c, name, u in zip(curves, short, units, strict=True)]
    return Panel(title if titled else prefix.rstrip("/") or title, unit, tuple(shown))


def _common(names: Sequence[str]) -> str:
    """Returns the common prefix of all names, up to a slash."""
    parents = zip(*(name.split("/")[:-1] for name in names), strict=False)
    return "".join(f"{parts[0]}/" for parts in takewhile(lambda parts: len(set(parts)) == 1, parents))


def with_units(names: Sequence[str], units: Mapping[str, str]) -> dict[str, str]:
    """Returns the unit of every column: the table's, the one after the name, or mjrun's for its columns.

    An mjrun column has a unit by its name if that is the same for every model: `energy/total` is in joules,
    `qpos/knee` may be in radians or metres. Time is in seconds in a table that has grouped columns.
    """
    grouped = any("/" in name for name in names)
    return {name: units.get(name) or split_column(name)[1] or _usual(name, grouped) for name in names}


def _usual(name: str, grouped: bool) -> str:
    if name == "time":
        return "s" if grouped else ""
    group, _, rest = name.partition("/")
    component = rest.rpartition("/")[2] if "/" in rest else ""
    if group == "qpos":
        return _POSITIONS.get(component, "")
    if group in DOF_UNITS and component in QVEL_COMPONENTS[FREE]:
        return DOF_UNITS[group][component.startswith("w")]
    return DATA_UNITS.get(group) or derived_units().get(group, "")


@dataclass(frozen=True)
class TableColumns:
    """The columns of a table: the table's name in a legend, and the units by name."""

    name: str
    units: dict[str, str]


@dataclass(frozen=True)
class MarkedCondition:
    """A condition whose onsets are marked."""

    label: str
    condition: Condition


class FigurePlan:
    """The plan of a figure of tables with known columns.

    Args:
      options: the content of the figure.
      tables: one or more tables.
      panels: panels to show unless the options choose some; by default a panel for each group and unit.

    Attributes:
      panels: the panels, in order.
      grid: their size and positions.
      notes: notes for the user.

    Raises:
      UsageError: a name is unknown, an expression malformed, or the size too small.
    """

    def __init__(
        self, options: FigureOptions, tables: Sequence[TableColumns], panels: Sequence[Panel] | None = None
    ) -> None:
        self.options, self.tables = options, tables
        self.notes: list[str] = []
        self._units: dict[str, str] = {}  # of the columns of all tables; the first table with a unit decides
        for table in tables:
            for name, unit in with_units(list(table.units), table.units).items():
                self._units[name] = self._units.get(name) or unit
        self.x = self._x_axis()
        self.panels = self._panels(panels)
        self.log_x, self.log_y = curve_syntax.parse_log(options.log, len(self.panels))
        self.ylim = curve_syntax.parse_ylim(options.ylim, len(self.panels))
        for axis, limits in (("xlim", [options.xlim] if self.log_x else []), ("ylim", map(self.ylim.get, self.log_y))):
            if any(limit and limit[0] <= 0 for limit in limits):
                raise UsageError(f"{option(axis)}: a logarithmic axis starts above 0")
        self.marks = curve_syntax.parse_marks(options.mark, len(self.panels))
        self.ylabels = curve_syntax.parse_ylabel(options.ylabel, len(self.panels))
        self._events = self._event_marks()
        names = max(len(panel.curves) for panel in self.panels) * len(tables) + len(self.marks)
        self._grid = partial(panel_grid, len(self.panels), names, bool(options.title), font_size=options.font_size)
        self.grid = self._grid(options.size, options.columns)

    @property
    def columns(self) -> list[str]:
        """The columns to read, of any table."""
        texts = [curve.text.expression for panel in self.panels for curve in panel.curves]
        texts += [self.x.expression] if self.x else []
        read = [name for text in texts for name in text.columns]
        return list(dict.fromkeys([*read, *(name for event in self._events for name in event.condition.columns)]))

    def page_grid(self) -> PanelGrid:
        """Returns the grid in a page, which is narrow and may be long: a single column unless panels are many."""
        if self.options.size or self.options.columns or len(self.panels) > PAGE_PANELS:
            return self.grid
        return self._grid(None, 1, in_page=True)

    def collector(self, table: int) -> "TableCollector":
        """Returns the collector of a table's rows."""
        return TableCollector(self, table, self._events)

    def drawing(self, collectors: Sequence["TableCollector"]) -> DrawnFigure:
        """Returns the data of the figure from the collectors, one for each table."""
        points = [collector.points() for collector in collectors]
        panels = [self._drawn(index, panel, points) for index, panel in enumerate(self.panels)]
        events = [mark for collector in collectors for mark in collector.marks]
        vertical = [mark for mark in self.marks if mark.vertical]
        margin = 0.0 if self.breaks else MARGIN / 2
        marks = [*vertical, *events]
        return DrawnFigure(
            title=self.options.title or "",
            x_label=self.options.xlabel or self._x_label(),
            log_x=self.log_x,
            panels=panels,
            marks=marks,
            x_margin=margin,
            x_limits=self.options.xlim,
            legend_title=self.options.legend_title or "",
        )

    def _drawn(self, index: int, panel: Panel, points: Sequence[dict[tuple[int, int], CurvePoints]]) -> DrawnPanel:
        several, curves = len(self.tables) > 1, list[DrawnCurve]()
        for number, curve in enumerate(panel.curves):
            for table, drawn in enumerate(points):
                if (index, number) not in drawn:
                    continue
                label = self.tables[table].name if several else curve.name
                label = f"{label} {curve.name}" if several and len(panel.curves) > 1 else label
                colour, variant = (table, number) if several else (number, 0)
                curves.append(DrawnCurve(label, drawn[index, number], colour, variant))
        if several:
            curves = in_turn(curves)
        marks = [mark for mark in self.marks if not mark.vertical and mark.panel in (None, index + 1)]
        ylabel = self.ylabels.get(index, "")
        return DrawnPanel(panel.label, curves, index in self.log_y, marks, self.ylim.get(index), ylabel)

    def _x_axis(self) -> curve_syntax.CurveSpec | None:
        """Returns the x axis; None for the number of the row."""
        if self.options.x is not None:
            curves = curve_syntax.parse_curves(self.options.x, list(self._units), option("x"))
            if len(curves) != 1:
                raise BadValueError(option("x"), self.options.x, f"one column, it is {len(curves)}")
            return curves[0]
        times = {time_column(table.units) for table in self.tables}
        if len(times) > 1:
            known = ", ".join("none" if time is None else quoted(time) for time in sorted(times, key=str))
            raise UsageError(f"the tables have different time columns: {known}; choose the x axis with {option('x')}")
        (time,) = times
        if time is None:
            self.notes.append(
                f"no column is called time: x is the number of the row, counted from 0; see {option('x')}"
            )
            return None
        (curve,) = curve_syntax.parse_curves(time, [time], option("x"))
        return curve

    @property
    def breaks(self) -> bool:
        """True if a line breaks where x decreases, as time does in joined tables."""
        return self.options.x is None

    def _x_label(self) -> str:
        if self.x is None:
            return "row"
        unit = self._units[self.x.column] if self.x.unit is None and self.x.column else self.x.unit
        name = split_column(self.x.name)[0] if self.x.column else self.x.name
        return with_unit(name, unit)

    def _panels(self, panels: Sequence[Panel] | None) -> list[Panel]:
        if self.options.y:
            return chosen_panels(self.options.y, self._units, self.x.column if self.x else None)
        if panels is not None:
            return list(panels)
        names = [name for name in self._units if not (self.x and name == self.x.column)]
        if "" in names:
            names.remove("")
            self.notes.append(f"a column without a name is left out; choose with {option('y')}")
        if not names:
            raise UsageError(f"nothing to plot: the only column is {listing(list(self._units))}")
        panels = panels_by_unit(names, self._units, apart=len(self.tables) > 1)
        if len(panels) > PANELS:
            left = [curve.text.name for panel in panels[PANELS:] for curve in panel.curves]
            self.notes.append(f"{len(left)} columns are left out, {listing(left)}; choose with {option('y')}")
        return panels[:PANELS]

    def _event_marks(self) -> list[MarkedCondition]:
        events: list[MarkedCondition] = []
        for index, text in enumerate(self.options.mark_event):
            with concerning("mark_event", index):
                label, condition = named_condition(text)
                vocabulary = TableVocabulary(list(self._units))
                events.append(MarkedCondition(label, parse_condition(condition, vocabulary, option("mark_event"))))
        return events


class TableCollector:
    """A collector of the visible part of one table's rows, block by block.

    Attributes:
      rows: number of rows so far.
      marks: events so far, at most `EVENTS` for each condition.
      has_curves: whether the table has any column of the figure.
    """

    def __init__(self, plan: FigurePlan, table: int, events: Sequence[MarkedCondition]) -> None:
        self._plan, self._name = plan, plan.tables[table].name
        names = set(plan.tables[table].units)
        self._is_path = time_column(plan.tables[table].units) is not None or names.isdisjoint(NUMBERING)
        x = plan.x.expression if plan.x else None
        known = x is None or names.issuperset(x.columns)
        self._curves = {
            (index, number): curve
            for index, panel in enumerate(plan.panels)
            for number, curve in enumerate(panel.curves)
            if known and names.issuperset(curve.text.expression.columns)
        }
        chosen = [curve for panel in plan.panels for curve in panel.curves] if plan.options.y else []
        self._missing = [curve.text.name for curve in chosen if curve not in self._curves.values()]
        self._x = x.evaluator() if x and known else None
        self._y = [curve.text.expression.evaluator() for curve in self._curves.values()]
        self._log = np.array([index in plan.log_y for index, _ in self._curves], bool)
        bins = 1 << (2 * plan.grid.size[0] - 1).bit_length()
        self._envelope = Envelope(len(self._curves), bins, log=plan.log_x, breaks=plan.breaks)
        self._window = XRangeFilter(*plan.options.xlim) if plan.options.xlim else None
        self._events = [event for event in events if names.issuperset(event.condition.columns)]
        self._edges = [RisingEdgeDetector() for _ in self._events]
        self._seen = [0 for _ in self._events]
        self.rows, self.marks = 0, list[curve_syntax.ReferenceLine]()
        self._lost = {"without x": 0, "with x at or below zero": 0}
        self._negative = np.zeros(len(self._curves), int)

    @property
    def has_curves(self) -> bool:
        return bool(self._curves)

    def feed(self, columns: dict[str, np.ndarray]) -> None:
        """Adds rows, `(n,)` each by name."""
        count = len(next(iter(columns.values())))
        if not count or not self._curves:
            self.rows += count
            return
        x = self._x.feed(columns) if self._x else np.arange(self.rows, self.rows + count, dtype=float)
        y = np.empty((count, len(self._y)))
        for number, evaluator in enumerate(self._y):
            y[:, number] = evaluator.feed(columns)
        self._mark(columns, x)
        self.rows += count

        y[~np.isfinite(y)] = np.nan
        if self._log.any():
            below = (y <= 0) & self._log
            self._negative += below.sum(axis=0)
            y[below] = np.nan
        usable = np.isfinite(x)
        self._lost["without x"] += int(count - usable.sum())
        if self._plan.log_x:
            self._lost["with x at or below zero"] += int((usable & ~(x > 0)).sum())
            usable &= x > 0
        if not usable.all():
            x, y = x[usable], y[usable]
        if not self._is_path:
            x, y = _separated(x, y)
        self._envelope.feed(*(self._window.feed(x, y) if self._window else (x, y)))

    def points(self) -> dict[tuple[int, int], CurvePoints]:
        """Returns the points of every curve, keyed by the indices of its panel and of the curve."""
        return dict(zip(self._curves, self._envelope.curves(), strict=True))

    def notes(self) -> list[str]:
        """Returns notes for the user, after the last row."""
        where = f"{self._name}: " if len(self._plan.tables) > 1 else ""
        notes = [f"{where}the table lacks {listing(self._missing)}"] if self._missing and self._curves else []
        notes += [f"{where}{_are(count, 'row', what)} left out" for what, count in self._lost.items() if count]
        for curve, count in zip(self._curves.values(), self._negative.tolist(), strict=True):
            if count:
                values = _are(count, "value", "at or below zero")
                notes.append(f"{where}{curve.text.name}: {values} not on a logarithmic axis")
        drawn = zip(self._curves.values(), self._envelope.curves(), strict=True)
        empty = [curve.text.name for curve, points in drawn if not np.isfinite(points.y).any()]
        notes += [f"{where}{listing(empty)}: no values to draw"] if empty and self.rows else []
        for event, count in zip(self._events, self._seen, strict=True):
            if count > EVENTS:
                notes.append(f"{where}{event.label}: the first {EVENTS} of {count} are marked")
            elif not count:
                notes.append(f"{where}{event.label} never happens")
        if self._plan.breaks and not self._envelope.ascends:
            notes.append(f"{where}time decreases; curves break there")
        return notes

    def _mark(self, columns: dict[str, np.ndarray], x: np.ndarray) -> None:
        for index, (event, detector) in enumerate(zip(self._events, self._edges, strict=True)):
            detector.feed(event.condition.holds(columns))
            places = x[np.array(detector.indices, int) - self.rows]
            detector.indices.clear()
            room = max(0, EVENTS - self._seen[index])
            self._seen[index] += len(places)
            self.marks += [
                curve_syntax.ReferenceLine(event.label, float(place), vertical=True) for place in places[:room]
            ]


def _separated(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inserts a gap after each row, so that a dot shows it, and no line joins it to the next."""
    gaps = np.full((2 * len(y), y.shape[1]), np.nan)
    gaps[::2] = y
    return np.repeat(x, 2), gaps


def _are(count: int, noun: str, which: str) -> str:
    """Returns the beginning of a sentence about some of many: `1 row without x is`."""
    return f"{counted(count, noun)} {which} {'is' if count == 1 else 'are'}"
