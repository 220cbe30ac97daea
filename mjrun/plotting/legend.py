"""The names beside the curves of a panel: at the heights where those end while they have room, else in columns."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from matplotlib.lines import Line2D

from mjrun.plotting.canvas import Canvas

BESIDE = 6  # names that stand where their curves end
SMALLEST = 0.75  # of the usual letters
LINE = 1.32  # [em]
SAMPLE, GAP = 1.5, 0.4  # length of a line before a name, and what is between them [em]


@dataclass(frozen=True)
class Entry:
    """A name, a sample of its line, and its height [pixels from the top]."""

    name: str
    line: Line2D
    y: float


@dataclass(frozen=True)
class Rows:
    """Entries in columns, at their heights; `scale` is that of the letters."""

    columns: Sequence[Sequence[Entry]]
    scale: float


def legend_rows(entries: Sequence[Entry], top: float, bottom: float, line: float) -> Rows:
    """The entries of a panel between `top` and `bottom`, at least a `line` apart [pixels]."""
    room = max(1, int((bottom - top) / line))
    if len(entries) <= min(BESIDE, room):
        return Rows([_spread(sorted(entries, key=lambda entry: entry.y), top, bottom, line)], 1.0)
    scale = max(SMALLEST, min(1.0, (bottom - top) / line / len(entries)))
    line *= scale
    rows = max(1, int((bottom - top) / line + 1e-6))  # they may fit exactly
    count = -(-len(entries) // rows)
    rows = -(-len(entries) // count)
    columns = [entries[start : start + rows] for start in range(0, len(entries), rows)]
    step = min(1.25 * line, (bottom - top) / rows)
    return Rows([[replace(e, y=top + (i + 0.5) * step) for i, e in enumerate(column)] for column in columns], scale)


def _spread(entries: Sequence[Entry], top: float, bottom: float, line: float) -> list[Entry]:
    """Entries in the order of their heights, moved apart as little as need be: clusters share their mean."""
    clusters: list[tuple[float, list[Entry]]] = []
    for entry in entries:
        cluster = [entry]
        centre = _within(entry.y, 1, top, bottom, line)
        while clusters and clusters[-1][0] + line * len(clusters[-1][1]) / 2 > centre - line * len(cluster) / 2:
            cluster = clusters.pop()[1] + cluster
            centre = _within(sum(e.y for e in cluster) / len(cluster), len(cluster), top, bottom, line)
        clusters.append((centre, cluster))
    return [
        replace(entry, y=centre + (index - (len(cluster) - 1) / 2) * line)
        for centre, cluster in clusters
        for index, entry in enumerate(cluster)
    ]


def _within(centre: float, count: int, top: float, bottom: float, line: float) -> float:
    half = count * line / 2
    return min(max(centre, top + half), bottom - half)


class Legend:
    """The names of a panel, drawn from anywhere on.

    Args:
      edges: top and bottom of what they stand beside [pixels].
      room: their width, at most [pixels].
      em: size of letters, unless they have to be smaller [pixels].

    Attributes:
      width: of all [pixels]; 0 without any.
      is_cut: whether some name has no room as it is.
    """

    def __init__(
        self, canvas: Canvas, entries: Sequence[Entry], edges: tuple[float, float], room: float, em: float
    ) -> None:
        self.entries, self._canvas, self._margin = entries, canvas, 0.5 * em
        self.width, self.is_cut = 0.0, False
        if not entries:
            return
        rows = legend_rows(entries, *edges, LINE * em)
        self._rows, self._size = rows.columns, rows.scale * 0.95 * em
        before, after = (SAMPLE + GAP) * self._size, 0.7 * self._size
        most = room / len(rows.columns) - before - after
        self._texts = [[canvas.fitted(e.name, most, self._size) for e in column] for column in rows.columns]
        names = [[canvas.shown(e.name) for e in column] for column in rows.columns]
        self.is_cut = self._texts != names
        self._widths = [
            max(canvas.measure(text, self._size) for text in texts) + before + after for texts in self._texts
        ]
        self.width = sum(self._widths) + 2 * self._margin

    def draw(self, x: float) -> None:
        """Draws all names, from x on [pixels]."""
        if not self.entries:
            return
        x += self._margin
        for column, texts, width in zip(self._rows, self._texts, self._widths, strict=True):
            for entry, text in zip(column, texts, strict=True):
                self._canvas.line(entry.line, x, entry.y, SAMPLE * self._size)
                place = x + (SAMPLE + GAP) * self._size
                self._canvas.text(text, place, entry.y, self._size, self._canvas.theme.ink)
            x += width
