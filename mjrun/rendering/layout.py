"""The layout of several images of one size in one image."""

import math
from collections.abc import Sequence

import numpy as np

from mjrun.errors import UnknownNameError
from mjrun.options.rendering import LAYOUTS
from mjrun.rendering.text import stamp

BACKGROUND = (24, 25, 28)  # between images, and in empty cells of a grid
ASPECT = 16 / 9  # target ratio of width to height of a grid, unless many cells would be empty


def gap(height: int) -> int:
    """Returns the gap between images of a height [pixels]: 2 at 240, 8 at 1080; even, so that even sizes stay even."""
    return 2 * max(1, round(height / 240))


def columns(count: int, size: tuple[int, int], layout: str = "row") -> int:
    """Returns the number of images of a size (width, height) in a row.

    Raises:
      UnknownNameError: the layout is not one of `LAYOUTS`.
    """
    if layout not in LAYOUTS:
        raise UnknownNameError("layout", layout, LAYOUTS)
    if layout != "grid":
        return count if layout == "row" else 1
    # Deviation from the target shape, and share of empty cells, as logarithms. Ties: the fullest, then the widest.
    costs: dict[int, tuple[float, int, int]] = {}
    for across in range(1, count + 1):
        width, height = _extent(count, size, across)
        taken = -(-count // across) * across
        costs[across] = round(abs(math.log(width / height / ASPECT)) + 1.5 * math.log(taken / count), 2), taken, -across
    return min(costs, key=lambda across: costs[across])


def layout_size(count: int, size: tuple[int, int], layout: str = "row") -> tuple[int, int]:
    """Returns the width and height of `count` composed images of a size (width, height)."""
    return _extent(count, size, columns(count, size, layout))


def places(count: int, size: tuple[int, int], layout: str = "row") -> list[tuple[int, int]]:
    """Returns the upper left corners x, y of the images, row by row."""
    across, between = columns(count, size, layout), gap(size[1])
    return [((i % across) * (size[0] + between), (i // across) * (size[1] + between)) for i in range(count)]


def compose(images: Sequence[np.ndarray], layout: str = "row", labels: Sequence[str] | None = None) -> np.ndarray:
    """Composes images `(h, w, 3)` of one size into one image `(H, W, 3)` uint8 of size `layout_size`.

    Args:
      labels: text for the upper left corner of each image; empty for none.

    Raises:
      ValueError: images differ in size, or in number from labels.
      UnknownNameError: the layout is not one of `LAYOUTS`.
    """
    height, width = images[0].shape[:2]
    size, count = (width, height), len(images)
    total = layout_size(count, size, layout)
    whole = np.empty((total[1], total[0], 3), np.uint8)
    if math.prod(total) > count * width * height:
        whole[:] = BACKGROUND
    for image, label, (x, y) in zip(images, labels or [""] * count, places(count, size, layout), strict=True):
        if image.shape != images[0].shape:
            raise ValueError(f"images must have the same size, not {images[0].shape} and {image.shape}")
        panel = whole[y : y + height, x : x + width]
        panel[:] = image
        if label:
            stamp(panel, label)
    return whole


def _extent(count: int, size: tuple[int, int], across: int) -> tuple[int, int]:
    down, between = -(-count // across), gap(size[1])
    return across * size[0] + (across - 1) * between, down * size[1] + (down - 1) * between
