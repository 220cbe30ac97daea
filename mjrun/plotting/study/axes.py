"""Axes of the panels of a study: their places, ticks and labels."""

from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FixedLocator

from mjrun.plotting.canvas import POINT, Canvas, rgb
from mjrun.plotting.study.drawing import Scale
from mjrun.plotting.ticks import Ticks, linear_ticks, log_ticks

SMALL = 0.92  # letters of ticks [em]
COLOUR_MAP = "viridis"  # perceptually uniform


@dataclass(frozen=True)
class Box:
    """A rectangle [pixels from the top left]."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def width(self) -> float:
        return self.right - self.left

    @property
    def height(self) -> float:
        return self.bottom - self.top


@dataclass(frozen=True)
class Sheet:
    """What a figure is drawn on: the canvas, and the size of its letters [pixels]."""

    canvas: Canvas
    em: float

    @property
    def hair(self) -> float:
        """The width of thin lines [points]."""
        return max(0.8, self.em / 16) * POINT

    @property
    def weight(self) -> float:
        """The width of curves [points]."""
        return max(1.25, 0.125 * self.em) * self.canvas.theme.weight * POINT

    def axes(self, box: Box) -> Axes:
        """Axes without ticks, with lines on the left and below."""
        theme = self.canvas.theme
        axes = self.canvas.figure.add_axes(self.canvas.box(box.left, box.top, box.right, box.bottom))
        axes.set_facecolor("none")
        axes.set_axisbelow(True)
        for side, spine in axes.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color(rgb(theme.zero))
            spine.set_linewidth(self.hair)
        pad, size = 0.35 * self.em * POINT, SMALL * self.em * POINT
        axes.tick_params(length=0, pad=pad, labelsize=size, labelcolor=rgb(theme.grey))
        for axis in (axes.xaxis, axes.yaxis):
            set_ticks(axis, Ticks([], []))
        return axes

    def title(self, text: str, box: Box, room: float, axis: str = "") -> None:
        """A label above a panel, and after it what its y axis shows, if that is something else."""
        theme, y = self.canvas.theme, box.top - 0.85 * self.em
        fitted = self.canvas.fitted(text, room, self.em, bold=bool(axis))
        self.canvas.text(fitted, box.left, y, self.em, theme.ink, bold=bool(axis))
        if axis:
            left = self.canvas.measure(fitted, self.em, bold=True) + self.em
            self.canvas.text(
                self.canvas.fitted(f"↑ {axis}", room - left, self.em), box.left + left, y, self.em, theme.grey
            )

    def x_label(self, text: str, box: Box) -> None:
        """A label below the ticks of a panel, in its middle."""
        fitted = self.canvas.fitted(text, box.width, self.em)
        left = (box.left + box.right - self.canvas.measure(fitted, self.em)) / 2
        self.canvas.text(fitted, left, box.bottom + 2.35 * self.em, self.em, self.canvas.theme.ink)

    def tick_width(self, ticks: Ticks) -> float:
        """The width of the longest label of ticks [pixels]."""
        return max((self.canvas.measure(label, SMALL * self.em) for label in ticks.labels), default=0.0)

    def x_ticks(self, scale: Scale, width: float) -> Ticks:
        """Ticks for an x axis so wide."""
        if scale.categories:
            room = width / len(scale.categories) - 0.6 * self.em
            texts = [self.canvas.fitted(text, room, SMALL * self.em) for text in scale.categories]
            return Ticks(range(len(texts)), texts)
        return number_ticks(scale, min(10, width / (5 * self.em)))

    def y_ticks(self, scale: Scale, height: float) -> Ticks:
        """Ticks for a y axis so high."""
        return number_ticks(scale, min(8, height / (2.3 * self.em)))


def number_ticks(scale: Scale, most: float) -> Ticks:
    """Ticks of numbers."""
    return (log_ticks if scale.log else linear_ticks)(scale.low, scale.high, most)


def set_ticks(axis: Axis, ticks: Ticks, *, shown: bool = True) -> None:
    """Gives an axis exactly these ticks."""
    axis.set_major_locator(FixedLocator(list(ticks.values)))
    axis.set_minor_locator(FixedLocator([]))
    axis.set_ticklabels(list(ticks.labels) if shown else [""] * len(ticks.values))
