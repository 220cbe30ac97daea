"""The options of exports."""

from fractions import Fraction

from mjrun.options.export import ExportOptions
from mjrun.options.option import options_of
from mjrun.options.rendering import ImageContentOptions


def test_options_about_pixels_alone_are_missing() -> None:
    names = {each.name for each in options_of(ExportOptions)}
    assert names.isdisjoint(each.name for each in options_of(ImageContentOptions))
    assert {"fps", "speed", "camera", "stage", "geoms", "show", "geomgroup", "ghost"} <= names


def test_rates_are_exact() -> None:
    assert ExportOptions(None, "a.glb", fps="30000/1001").fps == Fraction(30000, 1001)


def test_exports_have_thirty_frames_per_second_by_default() -> None:
    assert ExportOptions(None, "a.glb").fps == 30
