"""Options of videos."""

from fractions import Fraction

import pytest

from mjrun.errors import BadValueError, UsageError
from mjrun.formats.codecs import CODECS
from mjrun.formats.format_lists import with_formats
from mjrun.options.option import options_of
from mjrun.options.output import CODECS as CODEC_LIST
from mjrun.options.video import PLOT_SIDES, VideoOptions
from mjrun.rendering.graph import graph_size


def test_a_plot_under_a_frame_is_as_wide_and_one_beside_it_as_high() -> None:
    under, beside = (graph_size((640, 480), side) for side in PLOT_SIDES)
    assert (under[0], beside[1]) == (640, 480)


def test_a_plot_and_separate_views_exclude_each_other() -> None:
    with pytest.raises(UsageError, match=r"^plot and separate exclude each other"):
        VideoOptions(None, "a.mp4", plot="energy", separate=True)


def test_rates_are_exact_and_positive() -> None:
    video = VideoOptions(None, "a.mp4", fps="30000/1001", speed=0.1)
    assert (video.fps, video.speed) == (Fraction(30000, 1001), Fraction(1, 10))
    with pytest.raises(BadValueError, match=r"^speed: '0' is not a positive number"):
        VideoOptions(None, "a.mp4", speed=0)


def test_jobs_are_a_number_or_auto() -> None:
    assert [VideoOptions(None, "a.mp4", jobs=jobs).jobs for jobs in (1, "auto")] == [1, "auto"]
    with pytest.raises(BadValueError, match=r"^jobs: '0' is not a number of processes from 1 on, or auto"):
        VideoOptions(None, "a.mp4", jobs=0)


def test_a_preset_may_be_a_number_as_av1_has_them() -> None:
    assert VideoOptions(None, "a.mp4", preset=8).preset == "8"
    assert "8" in CODECS["av1"].presets


def test_help_lists_codecs_that_a_user_can_choose() -> None:
    (declared,) = (each for each in options_of(VideoOptions) if each.name == "codec")
    assert CODEC_LIST in declared.help
    assert {"h264", "h265", "av1", "vp9", "prores", "ffv1"} <= set(with_formats(CODEC_LIST).split(", ")) <= set(CODECS)
