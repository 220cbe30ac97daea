"""Measures of two frames, beside scikit-image on whole frames."""

import importlib.util

import numpy as np
import pytest
import skimage

from mjrun.diff.images_and_videos import EQUAL, compare_frames, decibels
from mjrun.diff.tolerances import Tolerance

FRAME = np.random.default_rng(6).integers(0, 256, (24, 33, 3), np.uint8)
EXACT = Tolerance()


def noisy(spread: int) -> np.ndarray:
    change = np.random.default_rng(spread).integers(-spread, spread + 1, FRAME.shape)
    return np.clip(FRAME + change, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("spread", [1, 9, 200])
def test_measures_are_those_of_scikit_image(spread: int) -> None:
    other = noisy(spread)
    found = compare_frames(FRAME, other, EXACT)
    assert found.mean_square == pytest.approx(skimage.metrics.mean_squared_error(FRAME, other))
    assert found.psnr == pytest.approx(skimage.metrics.peak_signal_noise_ratio(FRAME, other))
    luma = [np.dot(frame, [0.299, 0.587, 0.114]) for frame in (FRAME, other)]
    assert found.ssim == pytest.approx(skimage.metrics.structural_similarity(*luma, data_range=255), abs=1e-4)
    assert found.changed == np.any(other != FRAME, axis=2).mean()
    assert found.maximum == np.abs(FRAME.astype(int) - other).max()
    assert skimage.color.rgb2gray(FRAME).shape == luma[0].shape


def test_pixels_within_the_tolerance_have_not_changed() -> None:
    other = FRAME.copy()
    other[3, 4] = np.where(FRAME[3, 4] > 128, FRAME[3, 4] - 3, FRAME[3, 4] + 3)
    assert compare_frames(FRAME, other, EXACT).changed == 1 / (24 * 33)
    assert compare_frames(FRAME, other, Tolerance(3)).changed == 0
    assert compare_frames(FRAME, other, Tolerance(2, 10)).changed == 0
    assert compare_frames(FRAME, FRAME.copy(), EXACT) == EQUAL


def test_numbers_are_compared_as_numbers() -> None:
    a = np.array([[1, 2, np.inf], [np.nan, 5, 6]], np.float32)
    b = np.array([[1, 2.5, np.inf], [np.nan, 5, np.inf]], np.float32)
    found = compare_frames(a, b, Tolerance(0.5))
    assert (found.changed, found.maximum, found.ssim) == (1 / 6, np.inf, None)
    found = compare_frames(np.array([[1, 60000]], np.uint16), np.array([[5, 60000]], np.uint16), EXACT)
    assert (found.changed, found.maximum, found.mean_square) == (0.5, 4, 8)


def test_an_image_without_a_fourth_channel_is_opaque() -> None:
    translucent = np.dstack([FRAME, np.full(FRAME.shape[:2], 255, np.uint8)])
    assert compare_frames(FRAME, translucent, EXACT).changed == 0
    translucent[0, 0, 3] = 254
    for pair in ((FRAME, translucent), (translucent, FRAME)):
        assert compare_frames(*pair, EXACT).maximum == 1


def test_small_frames_and_a_missing_library_have_no_similarity(monkeypatch: pytest.MonkeyPatch) -> None:
    assert compare_frames(FRAME[:6], noisy(3)[:6], EXACT).ssim is None
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert compare_frames(FRAME, noisy(3), EXACT).ssim is None
    assert decibels(0) == np.inf
