"""Measures of the similarity of two frames."""

import importlib.util
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjrun.diff.tolerances import Tolerance

LIBRARY, EXTRA = "skimage", "diff"
PEAK = 255  # of colours
LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # of red, green and blue: ITU-R BT.601
WINDOW = 7  # pixels per side, over which structural similarity is computed


@dataclass(frozen=True)
class FrameComparison:
    """The comparison of two frames of one size.

    Attributes:
      changed: the share of the pixels that differ beyond the tolerance.
      maximum: the largest absolute difference; infinite where only one of two numbers is finite.
      mean_square: the mean square of the differences.
      ssim: the structural similarity, 1 for equal frames; None if it cannot be computed.
    """

    changed: float
    maximum: float
    mean_square: float
    ssim: float | None

    @property
    def psnr(self) -> float:
        """The peak signal-to-noise ratio of colours [dB], infinite if they are equal."""
        return decibels(self.mean_square)


EQUAL = FrameComparison(0.0, 0.0, 0.0, 1.0)


def decibels(mean_square: float) -> float:
    """Returns the peak signal-to-noise ratio of colours with this mean square difference [dB]."""
    return 10 * math.log10(PEAK**2 / mean_square) if mean_square else math.inf


def is_colour(frame: np.ndarray) -> bool:
    """Returns whether a frame has colours `(height, width, channels)`, and not numbers `(height, width)`."""
    return frame.ndim == 3


def compare_frames(a: np.ndarray, b: np.ndarray, tolerance: Tolerance) -> FrameComparison:
    """Compares two frames of one size, both colours or both numbers."""
    if a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes():
        return EQUAL
    if not is_colour(a):
        return _compare_numbers(a, b, tolerance)
    one, other = _same_channels(a, b)
    size = np.abs(one.astype(np.int16) - other)
    beyond = size > (tolerance.atol + tolerance.rtol * other if tolerance.rtol else tolerance.atol)
    square = float(np.mean(np.square(size, dtype=np.float32), dtype=np.float64))
    return FrameComparison(float(beyond.any(axis=2).mean()), float(size.max()), square, _similarity(one, other))


def _compare_numbers(a: np.ndarray, b: np.ndarray, tolerance: Tolerance) -> FrameComparison:
    one, other = a.astype(np.float64), b.astype(np.float64)
    same = (one == other) | (np.isnan(one) & np.isnan(other))
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.where(same, 0.0, np.abs(one - other))
        size[np.isnan(size)] = math.inf
        square = float(np.mean(size**2))
    return FrameComparison(float((~(same | tolerance.agree(one, other))).mean()), float(size.max()), square, None)


def _same_channels(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns both with the channels of the one that has more; a missing alpha channel is opaque."""
    if a.shape[2] == b.shape[2]:
        return a, b
    opaque = np.full((*a.shape[:2], 1), PEAK, np.uint8)
    return (np.dstack([a, opaque]), b) if a.shape[2] < b.shape[2] else (a, np.dstack([b, opaque]))


def has_similarity() -> bool:
    """Returns whether the library that computes structural similarity is installed."""
    return importlib.util.find_spec(LIBRARY) is not None


def _similarity(a: np.ndarray, b: np.ndarray) -> float | None:
    if min(a.shape[:2]) < WINDOW or not has_similarity():
        return None
    from skimage.metrics import structural_similarity

    similarity: Any = structural_similarity(a[..., :3] @ LUMA, b[..., :3] @ LUMA, data_range=PEAK, win_size=WINDOW)
    return float(similarity)
