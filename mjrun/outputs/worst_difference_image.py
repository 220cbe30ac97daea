"""The worst frame of a comparison: A, B and their difference side by side, labelled."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mjrun.diff.images_and_videos import WorstFrames, is_colour
from mjrun.diff.result import FrameDifference
from mjrun.diff.sentences import percent
from mjrun.formats.image_format import image_format
from mjrun.formats.image_writer import ImageWriter
from mjrun.rendering.colormaps import UNSEEN, colormap_table
from mjrun.rendering.text import INK, baseline, crisp, fitted, letters, spacing, text_size, write

GAP = 8  # pixels between the images
LEGIBLE = 240  # minimum width and height of an image [pixels]: smaller ones are enlarged
BACKGROUND = (24, 25, 28)
FAINT = (168, 170, 176)  # the second line of a label
GAINS = (1, 2, 4, 8, 16, 32, 64, 128, 255)  # factors that make a difference visible
TYPICAL = 99.0  # percentile of the differences that amplification must not clip
COMMON = (1, 92)  # percentiles at the ends of the colour scale: the horizon is far away
MAP, DIFFERENCE_MAP = "turbo", "inferno"


def write_worst_frame(output: str, frames: WorstFrames, names: Sequence[str], frame: FrameDifference | None) -> None:
    """Writes the comparison image.

    Args:
      output: path of a colour image.
      names: names of A and B for the labels.
      frame: the difference of the two frames; None if they are equal.

    Raises:
      FileError: the image cannot be written.
      UnknownNameError, UsageError: the suffix does not suit a colour image.
    """
    picture = worst_frame(frames, names, frame)
    form = image_format(output, "rgb")
    with ImageWriter(output, "rgb", form, (picture.shape[1], picture.shape[0])) as writer:
        writer.write(picture)
        writer.publish()


def worst_frame(frames: WorstFrames, names: Sequence[str], frame: FrameDifference | None) -> np.ndarray:
    """Returns the comparison image, `(height, width, 3)` uint8."""
    shown, difference, scale = shown_frames(frames)
    factor = max(1, math.ceil(LEGIBLE / min(frames.a.shape[:2])))
    panels = [_enlarged(panel, factor) for panel in (*shown, difference)]
    when = "" if frame is None or frame.time is None else f"frame {frame.frame}, {frame.time:.6g} s"
    labels = [("A", Path(names[0]).name, when), ("B", Path(names[1]).name, when), ("difference", scale, _facts(frame))]
    return _side_by_side(panels, labels)


def shown_frames(frames: WorstFrames) -> tuple[list[np.ndarray], np.ndarray, str]:
    """Returns A and B and their difference as colours, `(height, width, 3)` uint8 each, and the scale of the latter."""
    return (_colours if is_colour(frames.a) else _numbers)(frames.a, frames.b)


def _facts(frame: FrameDifference | None) -> str:
    if frame is None:
        return "none"
    psnr = "" if frame.psnr is None else f"{frame.psnr:.1f} dB"
    ssim = "" if frame.ssim is None else f"SSIM {frame.ssim:.3f}"
    return ", ".join(filter(None, (psnr, ssim, f"{percent(frame.changed)} changed")))


def _colours(a: np.ndarray, b: np.ndarray) -> tuple[list[np.ndarray], np.ndarray, str]:
    """Returns both images, their amplified difference, and the gain."""
    one, other = a[..., :3], b[..., :3]
    size = np.abs(one.astype(np.int16) - other)
    # The few pixels that differ most may be clipped, so that the others become visible.
    large = float(np.percentile(size[size > 0], TYPICAL)) if size.any() else 255.0
    gain = max((gain for gain in GAINS if gain * large <= 255), default=1)
    return [one, other], np.minimum(size * gain, 255).astype(np.uint8), f"× {gain}"


def _numbers(a: np.ndarray, b: np.ndarray) -> tuple[list[np.ndarray], np.ndarray, str]:
    """Maps both to one colour scale and their difference to another; values that are not finite are grey."""
    one, other = a.astype(np.float64), b.astype(np.float64)
    finite = np.concatenate([one[np.isfinite(one)], other[np.isfinite(other)]])
    low, high = np.percentile(finite, COMMON).tolist() if finite.size else (0.0, 0.0)
    with np.errstate(invalid="ignore"):
        size = np.where(one == other, 0.0, np.abs(one - other))
    changed = size[np.isfinite(size) & (size > 0)]
    large = float(np.percentile(changed, TYPICAL)) if changed.size else 0.0
    shown = [_mapped(values, low, high, MAP) for values in (one, other)]
    return shown, _mapped(size, 0.0, large, DIFFERENCE_MAP), f"0 to {large:.3g}"


def _mapped(values: np.ndarray, low: float, high: float, colormap: str) -> np.ndarray:
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.nan_to_num((values - low) / (high - low), nan=0.0, posinf=0.0, neginf=0.0)
    colours = colormap_table(colormap)[np.round(255 * share.clip(0, 1)).astype(int)]
    colours[~np.isfinite(values)] = UNSEEN
    return colours


def _enlarged(image: np.ndarray, factor: int) -> np.ndarray:
    return image.repeat(factor, axis=0).repeat(factor, axis=1)


def _side_by_side(panels: Sequence[np.ndarray], labels: Sequence[tuple[str, str, str]]) -> np.ndarray:
    """Places images of one size side by side, each under two lines: a word with a name, and facts."""
    height, width = panels[0].shape[:2]
    size = crisp(text_size(height))
    _, _, _, line = spacing(size)
    top = 2 * line + 2 * GAP
    canvas = np.full((top + height + GAP, GAP + len(panels) * (width + GAP), 3), BACKGROUND, np.uint8)
    for index, (panel, (word, name, facts)) in enumerate(zip(panels, labels, strict=True)):
        left = GAP + index * (width + GAP)
        canvas[top : top + height, left : left + width] = panel
        for row, (text, colour) in enumerate(((f"{word}  {name}", INK), (facts, FAINT))):
            shown = fitted(letters(text), size, width)
            write(canvas, shown, (left, baseline(GAP + row * line, line, size)), size, colour)
    return canvas
