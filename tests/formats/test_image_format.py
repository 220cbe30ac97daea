"""Image formats: which files can hold which images, and what the names of outputs mean."""

import re

import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.formats.image_format import FIGURES, FORMATS, figure_format, image_format, suffixes
from tests.cases import cases


@cases("output, view, asked, name")
def test_the_suffix_and_the_view_choose_the_format(output: str | None, view: str, asked: str | None, name: str) -> None:
    assert image_format(output, view, asked) == name


@pytest.mark.parametrize(
    ("output", "view", "asked", "kind", "message"),
    [
        ("a.bmp", "rgb", None, UnknownNameError, "in a.bmp (did you mean '.webp'?)\nimage formats: .png, .jpg, "),
        ("a.pgn", "seg", None, UnknownNameError, "in a.pgn (did you mean '.png'"),
        ("still", "rgb", None, UnknownNameError, "no image format '' in still\nimage formats: .png, "),
        ("a.png", "normals", None, UnknownNameError, "no view 'normals'\nviews: rgb, depth, seg"),
        ("a.png", "rgb", "gif", UnknownNameError, "no format 'gif'\nformats: png, jpeg, webp, tiff"),
        (
            "a.jpg",
            "depth",
            None,
            UsageError,
            "a.jpg: a .jpg cannot hold exact depth\n.png, .npy, .exr, .tiff, .tif can",
        ),
        ("a.webp", "seg", None, UsageError, "a .webp cannot hold exact segmentation\n.png, .npy, .json can"),
        ("a.exr", "rgb", None, UsageError, "a .exr cannot hold colours\n.png, .jpg, .jpeg, .webp, .tiff, .tif can"),
        (None, "depth", "jpeg", UsageError, "format jpeg cannot hold exact depth\npng, npy, exr, tiff can"),
        ("a.png", "rgb", "palette", UsageError, "format palette cannot hold colours\npng, jpeg, webp, tiff can"),
        ("a.png", "depth", "exr", UsageError, "format exr and the suffix of a.png disagree"),
        ("a.jpg", "depth", "npy", UsageError, "format npy and the suffix of a.jpg disagree"),
        ("\x1b[2J.jpg", "depth", None, UsageError, r"\x1b[2J.jpg: a .jpg cannot"),
    ],
)
def test_what_does_not_fit_is_refused_with_what_does(
    output: str | None, view: str, asked: str | None, kind: type[UsageError], message: str
) -> None:
    with pytest.raises(kind, match=re.escape(message)) as caught:
        image_format(output, view, asked, "THE HINT")
    assert str(caught.value).endswith("\nTHE HINT") == ("cannot" in message)


def test_suffixes_are_those_of_the_table() -> None:
    assert suffixes("rgb") == [".png", ".jpg", ".jpeg", ".webp", ".tiff", ".tif"]
    for view, known in FORMATS.items():
        assert all(image_format(f"a{suffix}", view) in known for suffix in suffixes(view))


@cases("output, named, name")
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
        (None, "bmp", UnknownNameError, "no format 'bmp'\nformats: png, jpeg, webp, tiff, svg, pdf"),
    ],
)
def test_what_holds_no_figure_is_refused(output: str | None, named: str | None, kind: type, message: str) -> None:
    with pytest.raises(kind, match=message):
        figure_format(output, named)


def test_every_suffix_has_a_format() -> None:
    assert {"png", "svg", "pdf"} <= FIGURES.keys()
    for name, form in FIGURES.items():
        assert [figure_format(f"a{suffix}") for suffix in form.suffixes] == [name] * len(form.suffixes)
