"""Sizes of figures."""

import pytest

from mjrun.options.number_kinds import FigureSizeKind
from mjrun.options.schema_validation import InvalidValueError


@pytest.mark.parametrize(
    ("text", "expected"),
    [("1280x720", (1280, 720)), ("85mmx60mm", (321, 227)), ("85x60mm", (321, 227)), ("25.4mmx50.8mm", (96, 192))],
)
def test_sizes_are_in_pixels_or_millimetres(text: str, expected: tuple[int, int]) -> None:
    assert FigureSizeKind().parse(text) == expected


@pytest.mark.parametrize("text", ["85mmx60", "85mm", "x60mm", "0x0mm", "1.2.3x4mm", "85cmx60cm"])
def test_other_texts_are_refused(text: str) -> None:
    with pytest.raises(InvalidValueError):
        FigureSizeKind().parse(text)
