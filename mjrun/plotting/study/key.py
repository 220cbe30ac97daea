"""The key of a figure: samples with their names, in lines above the panels."""

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from mjrun.plotting.canvas import Canvas

LINE, SAMPLE, GAP, APART = 1.5, 1.6, 0.45, 1.6  # [em]


@dataclass(frozen=True)
class KeyEntry:
    """A name, and a line or a rectangle that looks like what it names."""

    name: str
    sample: Line2D | Rectangle


class Key:
    """Entries side by side, in as many lines as they need.

    Args:
      width: of a line [pixels].

    Attributes:
      height: of all [pixels]; 0 without any.
    """

    def __init__(self, canvas: Canvas, entries: Sequence[KeyEntry], width: float, em: float) -> None:
        self._canvas, self._size = canvas, 0.92 * em
        self._places = list[tuple[KeyEntry, str, float, float]]()
        x = y = 0.0
        before = (SAMPLE + GAP) * self._size
        for entry in entries:
            text = canvas.fitted(entry.name, width - before, self._size)
            needed = before + canvas.measure(text, self._size)
            if x and x + needed > width:
                x, y = 0.0, y + LINE * self._size
            self._places.append((entry, text, x, y))
            x += needed + APART * self._size
        self.height = y + LINE * self._size if entries else 0.0

    def draw(self, left: float, top: float) -> None:
        """Draws all entries, from a corner on [pixels]."""
        for entry, text, x, y in self._places:
            middle = top + y + 0.5 * LINE * self._size
            self._draw_sample(entry.sample, left + x, middle)
            place = left + x + (SAMPLE + GAP) * self._size
            self._canvas.text(text, place, middle, self._size, self._canvas.theme.ink)

    def _draw_sample(self, sample: Line2D | Rectangle, x: float, middle: float) -> None:
        width, canvas = SAMPLE * self._size, self._canvas
        if isinstance(sample, Line2D):
            canvas.line(sample, x, middle, width)
            return
        height = 0.5 * width
        sample.set_bounds(
            x / canvas.width, 1 - (middle + height / 2) / canvas.height, width / canvas.width, height / canvas.height
        )
        sample.set_transform(canvas.figure.transFigure)
        canvas.figure.add_artist(sample)
