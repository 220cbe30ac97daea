"""Depth and ids as the whole numbers that a 16-bit picture holds."""

import numpy as np

from mjrun.errors import UsageError

MOST = 65535  # what 16 bits hold


def millimetres(depth: np.ndarray) -> np.ndarray:
    """`depth` [m] to the nearest millimetre, uint16; 0 where nothing is seen, that is where it is not finite.

    What is seen is at least 1, however near, and at most 65535, however far: see `clipped`.
    """
    seen = np.isfinite(depth)
    return np.where(seen, np.clip(_rounded(np.where(seen, depth, 0)), 1, MOST), 0).astype(np.uint16)


def clipped(depth: np.ndarray) -> float:
    """The share of what is seen in `depth` [m] that lies beyond 65.535 m, which is all that `millimetres` can say."""
    seen = depth[np.isfinite(depth)]
    return float(np.mean(_rounded(seen) > MOST)) if seen.size else 0.0


def numbered(ids: np.ndarray, things: int) -> np.ndarray:
    """`ids` of `things` things plus one, uint16; 0 where nothing is seen.

    Raises:
      UsageError: there are more things than 16 bits tell apart.
    """
    check_things(things, MOST)
    return (ids + 1).astype(np.uint16)


def check_things(things: int, most: int) -> None:
    """Raises UsageError when a picture cannot tell so many things apart."""
    if things > most:
        raise UsageError(f"{things} things cannot be told apart in a picture that holds {most}")


def _rounded(depth: np.ndarray) -> np.ndarray:
    return np.rint(depth.astype(np.float64) * 1000)
