"""The size of a figure and the positions of its panels."""

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, option

WIDTHS = (1280, 1600, 1920)  # default width of a figure, by panels side by side [pixels]
PAGE_WIDTH, PAGE_FONT = 640, 8.6  # width [pixels] and letters [pt] of a figure that a phone shows whole
LEAST_WIDTH, LEAST_HEIGHT = 140, 56  # minimum size of a panel with everything around it [pixels]
LEAST_BELOW = 40  # minimum height for the x axis [pixels]
MOST_SIDE, MOST_PIXELS = 2**16 - 1, 10**8  # limits of drawing in about 400 MB
DPI = 96  # pixels per inch, as in CSS, so that an svg has the requested size
POINT = 72 / DPI  # [points per pixel]
ABOVE, BELOW = 2.6, 5.0  # room above the panels if there is a title, and below them [em]


@dataclass(frozen=True)
class FigureCounts:
    """The number of panels, the number of names in the largest legend, and whether there is a title."""

    panels: int
    names: int
    titled: bool


@dataclass(frozen=True)
class PanelGrid:
    """Panels in rows, from left to right.

    Attributes:
      size: width and height of the figure [pixels].
      columns, rows: numbers of columns and rows.
      em: size of letters [pixels].
    """

    size: tuple[int, int]
    columns: int
    rows: int
    em: float


def panel_grid(
    count: FigureCounts,
    size: tuple[int, int] | None,
    columns: int | None,
    font_size: float | None = None,
    *,
    in_page: bool = False,
) -> PanelGrid:
    """Returns the grid of these panels, in `size` pixels, `columns` and letters of `font_size` points if set.

    Args:
      in_page: whether a page shows the figure, below others and also on phones.

    Raises:
      BadValueError: the panels do not fit, or the figure has too many pixels.
    """
    side = min(count.panels, columns or _columns(count.panels, size[0] if size else None))
    rows = -(-count.panels // side)
    width = size[0] if size else WIDTHS[min(side, len(WIDTHS)) - 1]
    if in_page and not size:
        width, font_size = PAGE_WIDTH, font_size or PAGE_FONT
    em = 6 + width / (150 + 30 * (side > 1)) if font_size is None else font_size / POINT
    if size is None:
        panel = min(max(12.5, 3.5 + 1.02 * count.names), 16.5)  # [em], so that a legend has room
        height = max(0.5625 * width, (rows * panel + BELOW + ABOVE * count.titled) * em)
        size = width, 2 * round(height / 2)
    least = LEAST_WIDTH * side, LEAST_HEIGHT * rows + LEAST_BELOW
    if size[0] < least[0] or size[1] < least[1]:
        panels = f"{count.panels} panel{'s' if count.panels > 1 else ''}"
        raise BadValueError(option("size"), f"{size[0]}x{size[1]}", f"at least {least[0]}x{least[1]} for {panels}")
    if max(size) > MOST_SIDE or size[0] * size[1] > MOST_PIXELS:
        most = f"at most {MOST_SIDE} a side and {MOST_PIXELS // 10**6} megapixels"
        raise BadValueError(option("size"), f"{size[0]}x{size[1]}", most)
    if font_size is None:
        em = min(em, max(8.0, (size[1] - 20) / rows / 7))
    return PanelGrid(size, side, rows, em)


def _columns(panels: int, width: int | None) -> int:
    """Returns the number of panels side by side: one if they are few, as many as fit if they are many."""
    if panels <= 4 or (width is not None and width < 700):
        return 1
    return 3 if panels > 15 and (width is None or width >= 1500) else 2
