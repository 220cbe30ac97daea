"""The comparison of videos and images, frame by frame, with two frames and the worst pair in memory."""

import importlib.util
import math
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.diff.result import SSIM_WINDOW, FrameDifference, VideoOrImageDifference
from mjrun.diff.tolerances import Tolerance, finite_or_none
from mjrun.errors import FileError, option
from mjrun.formats.image_and_video_reader import VideoReader, read_image, read_palette, read_video
from mjrun.formats.input_file import is_folder
from mjrun.options.diff import PictureDiffOptions
from mjrun.packages import require

LIBRARY, EXTRA = "skimage", "diff"
PEAK = 255  # of colours
LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # of red, green and blue: ITU-R BT.601


@dataclass(frozen=True)
class FramePairComparison:
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


EQUAL = FramePairComparison(0.0, 0.0, 0.0, 1.0)


def decibels(mean_square: float) -> float:
    """Returns the peak signal-to-noise ratio of colours with this mean square difference [dB]."""
    return 10 * math.log10(PEAK**2 / mean_square) if mean_square else math.inf


def is_colour(frame: np.ndarray) -> bool:
    """Returns whether a frame has colours `(height, width, channels)`, and not numbers `(height, width)`."""
    return frame.ndim == 3


def compare_frames(a: np.ndarray, b: np.ndarray, tolerance: Tolerance) -> FramePairComparison:
    """Compares two frames of one size, both colours or both numbers."""
    if a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes():
        return EQUAL
    if not is_colour(a):
        return _compare_numbers(a, b, tolerance)
    one, other = _same_channels(a, b)
    size = np.abs(one.astype(np.int16) - other)
    beyond = size > (tolerance.atol + tolerance.rtol * other if tolerance.rtol else tolerance.atol)
    square = float(np.mean(np.square(size, dtype=np.float32), dtype=np.float64))
    return FramePairComparison(float(beyond.any(axis=2).mean()), float(size.max()), square, _similarity(one, other))


def _compare_numbers(a: np.ndarray, b: np.ndarray, tolerance: Tolerance) -> FramePairComparison:
    one, other = a.astype(np.float64), b.astype(np.float64)
    same = (one == other) | (np.isnan(one) & np.isnan(other))
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.where(same, 0.0, np.abs(one - other))
        size[np.isnan(size)] = math.inf
        square = float(np.mean(size**2))
    return FramePairComparison(float((~(same | tolerance.agree(one, other))).mean()), float(size.max()), square, None)


def _same_channels(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns both with the channels of the one that has more; a missing alpha channel is opaque."""
    if a.shape[2] == b.shape[2]:
        return a, b
    opaque = np.full((*a.shape[:2], 1), PEAK, np.uint8)
    return (np.dstack([a, opaque]), b) if a.shape[2] < b.shape[2] else (a, np.dstack([b, opaque]))


def require_library(options: PictureDiffOptions) -> None:
    """Raises MissingExtraError or WrongVersionError if a requested similarity cannot be computed."""
    if options.min_ssim is not None:
        require(option("min_ssim"), EXTRA, LIBRARY)


def has_similarity() -> bool:
    """Returns whether the library that computes structural similarity is installed."""
    return importlib.util.find_spec(LIBRARY) is not None


def _similarity(a: np.ndarray, b: np.ndarray) -> float | None:
    if min(a.shape[:2]) < SSIM_WINDOW or not has_similarity():
        return None
    from skimage.metrics import structural_similarity

    return float(structural_similarity(a[..., :3] @ LUMA, b[..., :3] @ LUMA, data_range=PEAK, win_size=SSIM_WINDOW))


class _ImageFrames:
    """Image files as frames: one, or all in a folder, in the order of their names."""

    fps: float | None = None  # frames per second; unknown

    def __init__(self, paths: list[Path], *, indices: bool) -> None:
        self._paths, self._indices = paths, indices
        self._first = read_image(paths[0], indices=indices)
        self.size = _size(self._first)

    def __iter__(self) -> Iterator[np.ndarray]:
        yield self._first
        for path in self._paths[1:]:
            frame = read_image(path, indices=self._indices)
            if _size(frame) != self.size or is_colour(frame) != is_colour(self._first):
                raise FileError(path, "differs in size or kind from the images before it")
            yield frame


Frames = VideoReader | _ImageFrames  # of one size, decoded again with each iteration


@dataclass(frozen=True)
class WorstFramePair:
    """The pair of frames with the largest mean square difference; the first pair if nothing differs."""

    a: np.ndarray
    b: np.ndarray


def compare_images(a: str, b: str, tolerance: Tolerance) -> tuple[VideoOrImageDifference, WorstFramePair | None]:
    """Compares two images. Images with the same palette are compared by its indices, as numbers.

    Raises:
      FileError: one cannot be read.
      UnknownNameError: images with this suffix cannot be read.
    """
    indices = bool(read_palette(a)) and read_palette(a) == read_palette(b)
    one, other = (_ImageFrames([Path(path)], indices=indices) for path in (a, b))
    return compare(one, other, tolerance)


def compare_videos(a: str, b: str, tolerance: Tolerance) -> tuple[VideoOrImageDifference, WorstFramePair | None]:
    """Compares two videos, or folders of images.

    Raises:
      FileError: one cannot be read, or a folder contains no images, or images of several sizes or kinds.
      UsageError: the format can be written, but not read.
    """
    return compare(_frames(a), _frames(b), tolerance)


def compare(a: Frames, b: Frames, tolerance: Tolerance) -> tuple[VideoOrImageDifference, WorstFramePair | None]:
    """Returns the differences of two videos or images, and the worst pair of frames; None if sizes or kinds differ."""
    summary = _FrameDifferenceAccumulator(a, b)
    for one, other in zip_longest(a, b):
        if one is not None and other is not None and summary.are_comparable(one, other):
            summary.add(one, other, compare_frames(one, other, tolerance))
        summary.count(one is not None, other is not None)
    return summary.result(), summary.worst_frames


class _FrameDifferenceAccumulator:
    """The accumulated differences of pairs of frames.

    Attributes:
      worst_frames: the pair with the largest mean square difference; None before the first pair.
    """

    def __init__(self, a: Frames, b: Frames) -> None:
        self.worst_frames: WorstFramePair | None = None
        self._a, self._b = a, b
        self._fps = a.fps or b.fps
        self._kinds: dict[str, None] = {}
        self._counts = [0, 0]
        self._frames = self._differing = 0
        self._changed = self._squares = self._similarity = 0.0
        self._first: FrameDifference | None = None
        # The worst frames by mean square, by similarity and by changed pixels.
        self._worst: FrameDifference | None = None
        self._least_similar: FrameDifference | None = None
        self._most_changed: FrameDifference | None = None
        self._worst_square, self._least_ssim = -1.0, 1.0

    def are_comparable(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Returns whether two frames have the same size, and are both colours or both numbers."""
        self._kinds |= {"colours" if is_colour(frame) else "numbers": None for frame in (a, b)}
        return self._a.size == self._b.size and is_colour(a) == is_colour(b)

    def count(self, in_a: bool, in_b: bool) -> None:
        """Counts a frame of either."""
        self._counts[0] += in_a
        self._counts[1] += in_b

    def add(self, a: np.ndarray, b: np.ndarray, comparison: FramePairComparison) -> None:
        """Adds the next pair of frames."""
        difference = self._difference(comparison, is_colour(a))
        if comparison.mean_square > self._worst_square:
            self._worst_square, self.worst_frames = comparison.mean_square, WorstFramePair(a, b)
            self._worst = difference if comparison.mean_square else None
        if comparison.changed:
            self._first = self._first or difference
            if self._most_changed is None or comparison.changed > self._most_changed.changed:
                self._most_changed = difference
        if comparison.ssim is not None and comparison.ssim < self._least_ssim:
            self._least_ssim, self._least_similar = comparison.ssim, difference
        self._frames += 1
        self._differing += comparison.changed > 0
        self._changed += comparison.changed
        self._squares += comparison.mean_square
        self._similarity += math.nan if comparison.ssim is None else comparison.ssim

    def result(self) -> VideoOrImageDifference:
        """Returns the differences in all frames."""
        frames = max(1, self._frames)
        kinds = " and ".join(sorted(self._kinds))
        return VideoOrImageDifference(
            pixels=kinds,
            size_a=self._a.size,
            size_b=self._b.size,
            fps_a=self._a.fps,
            fps_b=self._b.fps,
            frames_a=self._counts[0],
            frames_b=self._counts[1],
            frames=self._frames,
            differing=self._differing,
            changed=self._changed / frames,
            psnr=finite_or_none(decibels(self._squares / frames)) if kinds == "colours" else None,
            ssim=finite_or_none(self._similarity / frames) if kinds == "colours" and self._frames else None,
            first=self._first,
            worst=self._worst,
            least_similar=self._least_similar,
            most_changed=self._most_changed,
        )

    def _difference(self, comparison: FramePairComparison, colours: bool) -> FrameDifference:
        return FrameDifference(
            frame=self._frames,
            time=self._frames / self._fps if self._fps else None,
            changed=comparison.changed,
            maximum=finite_or_none(comparison.maximum),
            psnr=finite_or_none(comparison.psnr) if colours else None,
            ssim=comparison.ssim if colours else None,
        )


def _frames(path: str) -> Frames:
    if not is_folder(path):
        return read_video(path)
    images = sorted(each for each in Path(path).iterdir() if each.suffix.lower() == ".png")
    if not images:
        raise FileError(path, "contains no .png images")
    return _ImageFrames(images, indices=False)


def _size(frame: np.ndarray) -> tuple[int, int]:
    return frame.shape[1], frame.shape[0]
