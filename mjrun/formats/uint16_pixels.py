"""Depth and segmentation as the whole numbers of a 16-bit image."""

import numpy as np

from mjrun.errors import UsageError

UINT16_MAX = 65535


def depth_millimetres(depth: np.ndarray) -> np.ndarray:
    """`depth` [m], rounded to millimetres, as uint16; 0 for the background, where depth is not finite.

    Everything else is at least 1, however near, and at most 65535, however far: see `clipped_share`.
    """
    seen = np.isfinite(depth)
    rounded = np.clip(_round_millimetres(np.where(seen, depth, 0)), 1, UINT16_MAX)
    return np.where(seen, rounded, 0).astype(np.uint16)


def clipped_share(depth: np.ndarray) -> float:
    """The share of the finite pixels of `depth` [m] that lie beyond 65.535 m, the range of `depth_millimetres`."""
    seen = depth[np.isfinite(depth)]
    return float(np.mean(_round_millimetres(seen) > UINT16_MAX)) if seen.size else 0.0


def segment_numbers(ids: np.ndarray, count: int) -> np.ndarray:
    """`ids` of `count` segments plus one, as uint16; 0 for the background.

    Raises:
      UsageError: there are more segments than 16 bits can number.
    """
    check_segment_count(count, UINT16_MAX)
    return (ids + 1).astype(np.uint16)


def check_segment_count(count: int, most: int) -> None:
    """Raises UsageError if an image cannot number so many segments."""
    if count > most:
        raise UsageError(f"a segmentation of {count} objects does not fit an image that can hold {most}")


def _round_millimetres(depth: np.ndarray) -> np.ndarray:
    return np.rint(depth.astype(np.float64) * 1000)
