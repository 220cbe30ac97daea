"""Trajectories of single points over time, overlaid: the traces that a study has kept."""

import re
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase

import numpy as np

from mjrun.formats.point_manifest import point_values, values_in_words
from mjrun.formats.study_results import StudyResults
from mjrun.formats.table import Table
from mjrun.formats.table_reader import open_table, read_table
from mjrun.plotting.study.drawing import GraphPanel, Scale, Series, scale, y_scale

TIME = "time"
POINTS = 100  # trajectories in a panel, at most
NAMED = 8  # of them, up to which each has a colour and an entry in the key
FAINT = 0.4  # opacity of a line among many
PANELS = 4  # where nobody chooses
ROWS = 4000  # of a trajectory: more than a figure has pixels


class Trajectories:
    """The traces that are kept of the points of a study.

    Attributes:
      notes: what the user may want to know, after `panels`.
    """

    def __init__(self, results: StudyResults) -> None:
        self._results, self.notes = results, list[str]()
        self._traces = results.traces
        first = next(iter(self._traces.values()), None)
        self._columns: Sequence[str] = ()
        if first is not None:
            with open_table(str(first)) as table:
                self._columns = [name for name in table.names if name != TIME]

    def matching(self, text: str) -> list[str]:
        """The columns that a name or a wildcard stands for."""
        return [text] if text in self._columns else [name for name in self._columns if fnmatchcase(name, text)]

    @property
    def usual(self) -> list[str]:
        """The columns that the metrics read; the first of all where they read none of these."""
        texts = " ".join(self._results.metric_texts.values())
        read = [name for name in self._columns if re.search(rf"(?<![\w/]){re.escape(name)}(?![\w/])", texts)]
        return (read or list(self._columns))[:PANELS]

    def panels(self, names: Sequence[str]) -> list[GraphPanel]:
        """A panel over time for each of these columns."""
        if not names:
            return []
        tables = self._tables(names)
        times = scale("time [s]", np.concatenate([table[TIME] for table in tables.values()]), edge=0.0)
        labels = self._labels(list(tables))
        return [self._panel(name, times, tables, labels) for name in names]

    def _panel(self, name: str, times: Scale, tables: Mapping[int, Table], labels: Sequence[str]) -> GraphPanel:
        colours = range(len(tables)) if any(labels) else [0] * len(tables)
        opacity = 1.0 if len(tables) <= NAMED else FAINT
        series = [
            Series(label, table[TIME], table[name], dots=False, colour=colour, opacity=opacity)
            for label, colour, table in zip(labels, colours, tables.values(), strict=True)
        ]
        unit = next(iter(tables.values())).units.get(name, "")
        values = np.concatenate([each.y for each in series])
        return GraphPanel(times, y_scale(f"{name} [{unit}]" if unit else name, values, log=False), series, ())

    def _tables(self, names: Sequence[str]) -> dict[int, Table]:
        """The traces of the points that are shown."""
        points = list(self._traces)
        if len(points) > POINTS:
            self.notes.append(f"{POINTS} of {len(points)} points that have traces have a line, evenly chosen")
            points = [points[i] for i in np.linspace(0, len(points) - 1, POINTS).round().astype(int)]
        return {point: _thinned(read_table(str(self._traces[point]), [TIME, *names])) for point in points}

    def _labels(self, points: Sequence[int]) -> list[str]:
        """What each trajectory is called in the key; nothing where they are too many."""
        if not 1 < len(points) <= NAMED:
            return [""] * len(points)
        return [", ".join(values_in_words(point_values(self._traces[point].parent))) for point in points]


def _thinned(table: Table) -> Table:
    """Every k-th row, so that there are not many more than a figure can show, and the last."""
    count = len(next(iter(table.columns.values())))
    rows = np.append(np.arange(0, count - 1, max(1, count // ROWS)), count - 1)
    return Table({name: values[rows] for name, values in table.columns.items()}, table.units)
