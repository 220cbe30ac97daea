"""The formats of figures."""

import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.formats.figure_format import figure_format, suffixes


@pytest.mark.parametrize(
    ("output", "named", "name"),
    [
        ("a.png", None, "png"),
        ("a.SVG", None, "svg"),
        ("a.pdf", None, "pdf"),
        ("a.jpg", None, "jpeg"),
        ("a.pdf", "pdf", "pdf"),
        ("a", "svg", "svg"),
        (None, None, "png"),
        (None, "pdf", "pdf"),
        (None, ".svg", "svg"),
    ],
)
def test_the_suffix_or_the_option_decides(output: str | None, named: str | None, name: str) -> None:
    assert figure_format(output, named) == name


@pytest.mark.parametrize(
    ("output", "named", "kind", "message"),
    [
        ("a.png", "svg", UsageError, "format svg and the suffix of a.png disagree"),
        ("a.svg", "png", UsageError, "format png and the suffix of a.svg disagree"),
        ("a.svg", "pdf", UsageError, "disagree"),
        ("a.npy", None, UsageError, "npy cannot hold"),
        ("a.gif", None, UnknownNameError, r"no figure format '.gif' in a.gif"),
        (None, "bmp", UnknownNameError, "no figure format 'bmp' in format"),
    ],
)
def test_what_holds_no_figure_is_refused(output: str | None, named: str | None, kind: type, message: str) -> None:
    with pytest.raises(kind, match=message):
        figure_format(output, named)


def test_every_suffix_has_a_format() -> None:
    assert {".png", ".svg", ".pdf"} <= set(suffixes())
    assert all(figure_format(f"a{suffix}") for suffix in suffixes())
