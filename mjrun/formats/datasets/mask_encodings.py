"""Masks as run lengths and as polygons."""

from collections.abc import Sequence

import numpy as np


def mask_of(counts: Sequence[int], size: tuple[int, int]) -> np.ndarray:
    """Returns the mask `(h, w)` bool of run lengths without and with it, column by column."""
    width, height = size
    values = np.zeros(width * height, bool)
    ends = np.cumsum(counts)
    for start, end in zip(ends[0::2], ends[1::2], strict=False):
        values[start:end] = True
    return values.reshape(width, height).T


def polygons(mask: np.ndarray) -> list[np.ndarray]:
    """Returns the outlines `(n, 2)` of the parts of a mask, x and y in pixels from the corner of the image.

    They run along the borders of pixels, so that filling them gives the mask; holes are filled.
    """
    from contourpy import contour_generator

    padded = np.pad(mask.astype(float), 1)
    # A pixel is a square around its sample: its corners, doubled, make the outline follow its border.
    fine = np.kron(padded, np.ones((2, 2)))
    lines = contour_generator(z=fine, name="serial").lines(0.5)
    outlines = list[np.ndarray]()
    for line in lines:
        points = np.asarray(line)
        if _area(points) > 0:  # holes run the other way
            outlines.append(_corners(np.clip((points[:-1] + 0.5) / 2 - 1, 0, [mask.shape[1], mask.shape[0]])))
    return outlines


def _corners(points: np.ndarray) -> np.ndarray:
    """Returns a closed polygon without the points on straight lines."""
    before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    turns: np.ndarray = before[:, 0] * after[:, 1] != before[:, 1] * after[:, 0]
    return points[turns]


def _area(points: np.ndarray) -> float:
    """Returns the area of a closed polygon, positive if it runs counter-clockwise with y up."""
    x, y = points.T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y)) / 2
