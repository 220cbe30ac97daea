"""Trajectories of single points over time, overlaid: the stored traces of a study."""

from collections.abc import Mapping, Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.formats.study_reader import StudyResults, point_names, point_values
from mjrun.formats.table_reader import NumericTable, open_table, read_table
from mjrun.model.table_column import with_unit
from mjrun.plotting.curve_syntax import CurveSpec, parse_panel
from mjrun.plotting.figure_data import MARGIN, ParameterAxis, scale
from mjrun.plotting.study.figure_data import GraphPanel, Series

TIME = "time"
POINTS = 100  # maximum number of trajectories in a panel
NAMED = 8  # maximum number of trajectories that each have a colour and an entry in the key
FAINT = 0.4  # opacity of a line among many
PANELS = 4  # maximum number of panels that the user did not choose
ROWS = 4000  # rows of a trajectory: more than the pixels of a figure
NOISE = 1e-14  # share of the largest value with the same unit below which curves are rounding errors


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


class Trajectories:
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

    def panels(self, curves: Sequence[CurveSpec]) -> list[GraphPanel]:
        """Returns a panel over time for each of these curves."""
        if not curves:
            return []
        tables = self._tables([*dict.fromkeys(name for curve in curves for name in curve.expression.columns)])
        times = scale("time [s]", np.concatenate([table[TIME] for table in tables.values()]), edge=0.0)
        labels = self._labels(list(tables))
        drawn = [self._curve(curve, tables) for curve in curves]
        largest = dict[str, float]()
        for each in drawn:
            largest[each.unit] = max(largest.get(each.unit, 0.0), each.largest)
        return [self._panel(each, times, tables, labels, largest[each.unit]) for each in drawn]

    def _curve(self, curve: CurveSpec, tables: Mapping[int, NumericTable]) -> "_Curve":
        unit = next(iter(tables.values())).units.get(curve.column or "", "") if curve.unit is None else curve.unit
        return _Curve(curve.name, unit, [curve.expression.values(table.columns) for table in tables.values()])

    def _panel(
        self,
        curve: "_Curve",
        times: ParameterAxis,
        tables: Mapping[int, NumericTable],
        labels: Sequence[str],
        largest: float,
    ) -> GraphPanel:
        colours = range(len(tables)) if any(labels) else [0] * len(tables)
        opacity = 1.0 if len(tables) <= NAMED else FAINT
        series = [
            Series(label, table[TIME], values, dots=False, colour=colour, opacity=opacity)
            for label, colour, table, values in zip(labels, colours, tables.values(), curve.values, strict=True)
        ]
        name = with_unit(curve.name, curve.unit)
        values = np.concatenate(curve.values)
        if curve.largest < NOISE * largest:
            values = np.array([-largest, largest])
        return GraphPanel(times, scale(name, values, edge=MARGIN), series, ())

    def _tables(self, names: Sequence[str]) -> dict[int, NumericTable]:
        """Reads the traces of the points to show."""
        points = list(self._traces)
        if len(points) > POINTS:
            self.notes.append(f"{POINTS} of {len(points)} points with traces have a line, evenly chosen")
            points = [points[i] for i in np.linspace(0, len(points) - 1, POINTS).round().astype(int)]
        return {point: _thinned(read_table(str(self._traces[point]), [TIME, *names])) for point in points}

    def _labels(self, points: Sequence[int]) -> list[str]:
        """Returns the name of each trajectory in the key; empty if they are too many."""
        if not 1 < len(points) <= NAMED:
            return [""] * len(points)
        return point_names([point_values(self._traces[point].parent) for point in points], self._results.units)


def _thinned(table: NumericTable) -> NumericTable:
    """Selects every k-th row, about as many as a figure can show, and the last."""
    count = len(next(iter(table.columns.values())))
    rows = np.append(np.arange(0, count - 1, max(1, count // ROWS)), count - 1)
    return NumericTable({name: values[rows] for name, values in table.columns.items()}, table.units)
