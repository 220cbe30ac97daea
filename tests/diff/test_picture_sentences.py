"""Differences of pictures as sentences, and the limits that allow them."""

import importlib.util
from dataclasses import replace

import pytest

from mjrun.diff.images_and_videos import require_library
from mjrun.diff.result import FrameDifference, VideoOrImageDifference
from mjrun.diff.sentences import percent, picture_sentences
from mjrun.errors import MissingExtraError, UsageError
from mjrun.options.diff import PictureDiffOptions

FIRST = FrameDifference(1, 0.1, 0.0004, 3.0, 61.2, 0.999)
WORST = FrameDifference(4, 0.4, 0.25, 99.0, 31.234, 0.91)
VIDEO = VideoOrImageDifference(
    "colours", (64, 48), (64, 48), 10, 10, 6, 6, 6, 2, 0.1, 35, 0.9, FIRST, WORST, WORST, WORST
)
EXACT = PictureDiffOptions()


def test_frames_that_differ_are_reported() -> None:
    assert picture_sentences(VIDEO, "a", "b", EXACT) == [
        "2 of 6 frames differ",
        "first frame 1, time 0.1 s: PSNR 61.20 dB, SSIM 0.9990, 0.04 % of the pixels changed, by 3 at most",
        "worst frame 4, time 0.4 s: PSNR 31.23 dB, SSIM 0.9100, 25 % of the pixels changed, by 99 at most",
    ]
    image = replace(WORST, frame=0, time=None, psnr=None, ssim=None, maximum=None)
    found = replace(VIDEO, frames_a=1, frames_b=1, frames=1, fps_a=None, fps_b=None, first=image, worst=image)
    assert picture_sentences(found, "a", "b", EXACT) == ["25 % of the pixels changed, by a non-finite value"]


def test_limits_allow_what_they_say() -> None:
    assert picture_sentences(VIDEO, "a", "b", PictureDiffOptions(min_psnr=31)) == []
    assert picture_sentences(VIDEO, "a", "b", PictureDiffOptions(min_ssim=0.9, max_changed=0.3)) == []
    assert picture_sentences(VIDEO, "a", "b", PictureDiffOptions(min_psnr=40, min_ssim=0.95, max_changed=0.01)) == [
        "frame 4, time 0.4 s: PSNR 31.234 dB is less than 40 dB",
        "frame 4, time 0.4 s: SSIM 0.91 is less than 0.95",
        "frame 4, time 0.4 s: 25 % of the pixels changed, more than 1 %",
    ]


def test_what_differs_besides_the_pixels_is_reported_whatever_the_limits() -> None:
    other = replace(VIDEO, size_b=(32, 24), fps_b=12.5, frames_b=7, frames=0)
    assert picture_sentences(other, "a", "b", PictureDiffOptions(min_psnr=0)) == [
        "the size is 64x48 in a, 32x24 in b",
        "the rate is 10 frames per second in a, 12.5 in b",
        "the number of frames is 6 in a, 7 in b",
    ]
    mixed = replace(VIDEO, pixels="colours and numbers", frames=0)
    assert picture_sentences(mixed, "a", "b", EXACT) == ["one of a and b has colours, the other one numbers"]


def test_a_limit_that_does_not_fit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="min_psnr applies to colours; numbers are compared within atol and rtol"):
        picture_sentences(replace(VIDEO, pixels="numbers"), "a", "b", PictureDiffOptions(min_psnr=30))
    with pytest.raises(UsageError, match="min_ssim requires images of at least 7x7 pixels"):
        picture_sentences(replace(VIDEO, size_a=(64, 6)), "a", "b", PictureDiffOptions(min_ssim=0.9))
    require_library(PictureDiffOptions(min_ssim=0.9))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    require_library(PictureDiffOptions(min_psnr=9))
    with pytest.raises(MissingExtraError, match=r"min_ssim needs scikit-image.*\n.*mjrun\[diff\]"):
        require_library(PictureDiffOptions(min_ssim=0.9))


def test_a_share_is_never_nothing() -> None:
    assert [percent(share) for share in (0.0, 1e-9, 0.123456, 1.0)] == ["0 %", "1e-07 %", "12.3 %", "100 %"]
