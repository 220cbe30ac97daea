"""Text on pictures: where its pixels are, and whether it can be read there."""

from pathlib import Path

import numpy as np
import pytest
from fontTools.ttLib import TTFont
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw, ImageFont

from mjrun.errors import UnknownNameError
from mjrun.rendering import text
from mjrun.rendering.colormaps import oklab
from mjrun.rendering.text import (
    CORNERS,
    INK,
    MISSING,
    SMALLEST,
    blend,
    crisp,
    fitted,
    letters,
    spacing,
    stamp,
    text_size,
    width_of,
    write,
)

FONT = Path(text.__file__).parent / "fonts" / "Inter.ttf"
GLYPHS = TTFont(FONT)
X_HEIGHT = 0.546  # of Inter [em]
CHARACTERS = set(GLYPHS.getBestCmap() or ())
SIZE = crisp(12)
sizes = st.tuples(st.integers(1, 400), st.integers(1, 300))
corners = st.sampled_from(sorted(CORNERS))


def picture(width: int, height: int, shade: int = 128) -> np.ndarray:
    return np.full((height, width, 3), shade, np.uint8)


def stamped(text: str, width: int = 320, height: int = 240, corner: str = "top-left", shade: int = 128) -> np.ndarray:
    image = picture(width, height, shade)
    stamp(image, text, corner)
    return image


def extent(image: np.ndarray, shade: int = 128) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of what is not `shade`."""
    rows, columns = np.nonzero((image != shade).any(axis=2))
    return columns.min(), rows.min(), columns.max() + 1, rows.max() + 1


def drawn(text: str, width: int = 300, size: float = SIZE) -> np.ndarray:
    """The coverage of a line that begins at 20."""
    image = picture(width, 40, 0)
    write(image, letters(text), (20, 28), size, (255, 255, 255))
    return image[..., 0]


@given(st.text("0123456789", min_size=1, max_size=8), st.data())
def test_figures_have_one_width_whatever_they_are(number: str, data: st.DataObject) -> None:
    other = data.draw(st.text("0123456789", min_size=len(number), max_size=len(number)))
    assert width_of(letters(number), SIZE) == width_of(letters(other), SIZE)
    assert width_of("0.00", SIZE) == width_of("8.88", SIZE)


@pytest.mark.parametrize("size", [9.0, 12.0, 29.5])
@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("t = 0.00 s", "t = 8.88 s"),
        ("x = -1.25 m", "x =  1.25 m"),
        ("x = -1.25 m", "x = +7.31 m"),
        ("  1.25 m", "101.25 m"),
        ("1e-05 N", "1e+07 N"),
    ],
)
def test_what_follows_a_number_stands_still_while_the_number_runs(size: float, one: str, other: str) -> None:
    size = crisp(size)
    unit = round(20 + width_of(letters(one)[:-1], size)) - 1
    first, second = drawn(one, size=size), drawn(other, size=size)
    assert not np.array_equal(first, second)
    assert first[:, unit:].any()
    assert np.array_equal(first[:, unit:], second[:, unit:])


def test_a_minus_is_as_long_as_a_plus_is_wide_and_a_hyphen_stays_one() -> None:
    assert letters("-1 3e-05 -.5 (-2)") == "−1 3e−05 −.5 (−2)"
    assert letters("left-2 a-b - 2026-05-01 --x") == "left-2 a-b - 2026-05-01 --x"
    minus, plus = drawn("-1")[:, 20:27], drawn("+1")[:, 20:27]
    ink = [np.flatnonzero(glyph.max(axis=0) > 40) for glyph in (minus, plus)]
    assert np.array_equal(ink[0], ink[1])
    bar = minus.max(axis=1) > 40
    assert 1 <= bar.sum() <= 2
    centre = [np.average(np.arange(40), weights=glyph[:, ink[0][1]].astype(float)) for glyph in (minus, plus)]
    assert centre[0] == pytest.approx(centre[1], abs=0.1)


def test_letters_are_those_of_pillow() -> None:
    size, text = 48, "Humanoid"
    canvas = Image.new("L", (300, 70))
    font = ImageFont.truetype(FONT, size)
    ImageDraw.Draw(canvas).text((20, 50), text, 255, font, anchor="ls")
    expected = np.asarray(canvas) / 255
    image = picture(300, 70, 0)
    write(image, text, (20, 50), size, (255, 255, 255))
    found = (image[..., 0] / 255) ** (1 / 0.75)  # as they are drawn bolder
    assert abs(width_of(text, size) - font.getlength(text)) < 5  # Pillow rounds each advance, and kerns
    assert found.sum() == pytest.approx(expected.sum(), rel=0.03)
    assert np.abs(found[:, :50] - expected[:, :50]).mean() < 0.02  # the first letter, before advances differ


@given(sizes, corners, st.text(max_size=60), st.sampled_from([0.5, 1.0, 3.0]))
@settings(max_examples=30, deadline=None)
def test_nothing_is_drawn_in_the_margin_of_the_picture(
    size: tuple[int, int], corner: str, text: str, scale: float
) -> None:
    image = picture(*size)
    stamp(image, text, corner, scale)
    changed = (image != 128).any(axis=2)
    margin = spacing(crisp(0))[0]
    assert not changed[:margin].any()
    assert not changed[-margin:].any()
    assert not changed[:, :margin].any()
    assert not changed[:, -margin:].any()


@pytest.mark.parametrize("corner", CORNERS)
@pytest.mark.parametrize(("width", "height"), [(320, 240), (1920, 1080)])
def test_text_stands_in_its_corner_at_one_distance_from_both_sides(corner: str, width: int, height: int) -> None:
    left, top, right, bottom = extent(stamped("t = 0.5 s\nspeed", width, height, corner))
    margin = spacing(crisp(text_size(height)))[0]
    across, down = CORNERS[corner]
    assert (left if across < 1 else width - right) == (margin if across != 0.5 else left)
    assert abs(left - (width - right)) <= 1 or across != 0.5
    assert (top if down == 0 else height - bottom) == margin


@pytest.mark.parametrize("corner", CORNERS)
def test_lines_are_flush_with_their_side(corner: str) -> None:
    image = stamped("wide wide wide\nI", corner=corner, shade=0)
    left, top, right, bottom = extent(image, 0)
    ink = image[top:bottom, left:right, 0] > 120
    upper, lower = ink[: len(ink) // 2], ink[len(ink) // 2 :]
    ends = [(np.flatnonzero(part.any(axis=0))[[0, -1]]) for part in (upper, lower)]
    side = {0.0: lambda e: e[0], 1.0: lambda e: e[1], 0.5: lambda e: e.mean()}[CORNERS[corner][0]]
    assert abs(side(ends[0]) - side(ends[1])) <= 2


@pytest.mark.parametrize("shade", [0, 90, 128, 200, 255])
@pytest.mark.parametrize(("width", "height"), [(320, 240), (1920, 1080)])
def test_text_is_legible_on_any_ground(shade: int, width: int, height: int) -> None:
    image = stamped("t = 0.50 s", width, height, shade=shade)
    left, top, right, bottom = extent(image, shade)
    panel = image[top:bottom, left:right] / 255
    luminance = np.where(panel <= 0.04045, panel / 12.92, ((panel + 0.055) / 1.055) ** 2.4)[..., 0]
    ratio = (np.percentile(luminance, 99) + 0.05) / (np.median(luminance) + 0.05)  # WCAG 2.2, contrast ratio
    assert ratio > 4.5


def test_the_size_follows_the_picture_and_never_falls_below_what_can_be_read() -> None:
    heights = [extent(stamped("H", 16 * h // 9, h))[3] for h in (120, 240, 480, 1080, 2160)]
    assert heights == sorted(heights)
    assert crisp(text_size(240)) * X_HEIGHT == pytest.approx(6, rel=0.001)
    assert crisp(0.1) * X_HEIGHT == pytest.approx(SMALLEST, rel=0.001)
    assert crisp(text_size(1080)) * X_HEIGHT > 15


def test_long_text_is_set_smaller_then_cut() -> None:
    def height(text: str) -> int:
        _, top, _, bottom = extent(stamped(text))
        return bottom - top

    assert height("x" * 58) < height("x" * 30) == height("x")
    left, _, right, _ = extent(stamped("x" * 1000))
    margin = spacing(crisp(0))[0]
    assert left >= margin
    assert right <= 320 - margin


def test_lines_too_many_are_cut() -> None:
    few, many = stamped("a\nb"), stamped("\n".join("abcdefghij" * 9))
    assert extent(few)[3] < 60
    assert 200 < extent(many)[3] <= 234


@given(st.text("abW .,1", max_size=40), st.floats(1, 200))
def test_cut_text_is_the_longest_beginning_that_fits(text: str, width: float) -> None:
    text = letters(text)
    cut = fitted(text, SIZE, width)
    assert width_of(cut, SIZE) <= width
    if cut != text:
        assert width_of(text, SIZE) > width
        kept = len(cut.removesuffix("…"))
        assert cut.removesuffix("…") == text[:kept]
        longer = text[: kept + 1].rstrip()
        assert width_of(f"{longer}…", SIZE) > width or len(longer) <= kept or not cut


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[31mred\n\t", "\\x1b[31mred\\n\\t"),
        ("a\u202eb\u2028", "a\\u202eb\\u2028"),
        ("fu\u0308r", "für"),
        ("q\u0307 θ\u0308", "q\u0307 θ\u0308"),
        ("τ⋅ω", "τ·ω"),
        ("５ ﬀ", "5 ff"),
        ("机器人", MISSING * 3),
        ("\ue000\U0001f600", MISSING * 2),
        ("a  b", "a \u2007b"),
        (" 1", "\u20071"),
    ],
)
def test_what_the_font_lacks_is_shown_by_what_it_has(text: str, shown: str) -> None:
    assert letters(text) == shown


ALPHABETS = {
    "Latin": "".join(map(chr, [*range(0x20, 0x7F), *range(0xA1, 0xAD), *range(0xAE, 0x149), *range(0x14A, 0x180)])),
    "Greek": "ΑΒΓΔΕΖΗΘΙΚΛΜΝΞΟΠΡΣΤΥΦΧΨΩαβγδεζηθικλμνξοπρστυφχψωςάέήίόύώϊϋ",
    "Cyrillic": "".join(map(chr, range(0x400, 0x460))),
    "symbols": "°·×÷−±≤≥≠≈→←↑↓∑∏∫∂√∞µΩ∆•–—…‘’“”‰′″✓✗●▲■",
    "raised and lowered": "⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ⁿ₀₁₂₃₄₅₆₇₈₉₊₋",
}


@pytest.mark.parametrize("alphabet", ALPHABETS.values(), ids=ALPHABETS)
def test_alphabets_are_drawn_as_they_are(alphabet: str) -> None:
    assert set(map(ord, alphabet)) <= CHARACTERS
    assert [letter for letter in alphabet if letters(f"a{letter}") != f"a{letter}"] == []
    assert [letter for letter in alphabet.lstrip() if drawn(letter).max() < 60] == []


@given(st.characters(codec="utf-8", exclude_categories=("C", "Z", "M")))
def test_what_is_reported_to_be_in_the_font_is_in_it(letter: str) -> None:
    assert text._has(letter) == (ord(letter) in CHARACTERS)


def test_the_box_is_drawn_for_what_is_missing() -> None:
    box = drawn("机")
    assert np.array_equal(box, drawn(MISSING))
    assert box.max() > 200


@pytest.mark.parametrize("letter", ["q", "θ", "Ω", "l"])
def test_an_accent_is_over_the_middle_of_its_letter(letter: str) -> None:
    plain, dotted = (drawn(shown, size=24.0) for shown in (letter, f"{letter}\u0307"))
    dot = np.nonzero(dotted > plain)
    ink = np.nonzero(plain)
    assert dot[0].max() < ink[0].min() + 1
    assert dot[1].mean() == pytest.approx((ink[1].min() + ink[1].max()) / 2, abs=1)
    assert width_of(f"{letter}\u0307", SIZE) == width_of(letter, SIZE)


def test_a_superscript_is_small_and_raised() -> None:
    normal, raised = drawn("2"), drawn("²")
    rows = [np.flatnonzero(ink.max(axis=1) > 60) for ink in (normal, raised)]
    assert abs(rows[0][0] - rows[1][0]) <= 1
    assert len(rows[1]) < 0.75 * len(rows[0])
    assert width_of("²", 1) < width_of("2", 1)


def test_text_is_the_same_every_time_and_leaves_the_rest_alone() -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (240, 320, 3), np.uint8)
    one, other = noise.copy(), noise.copy()
    stamp(one, "t = 1.50 s")
    stamp(picture(640, 480), "something else")
    stamp(other, "t = 1.50 s")
    assert np.array_equal(one, other)
    left, top, right, bottom = extent(stamped("t = 1.50 s"))
    one[top:bottom, left:right] = noise[top:bottom, left:right]
    assert np.array_equal(one, noise)


@pytest.mark.parametrize("text", ["", " ", "\n", " \n "])
def test_no_text_draws_no_letters(text: str) -> None:
    assert stamped(text).max() == 128


def test_an_unknown_corner_is_refused() -> None:
    with pytest.raises(UnknownNameError, match=r"no corner 'topleft' \(did you mean 'top-left'"):
        stamp(picture(64, 64), "x", "topleft")


@given(st.integers(-30, 30), st.integers(-30, 30))
def test_blending_is_clipped_and_rounds_to_the_nearest(x: int, y: int) -> None:
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (20, 16, 3), np.uint8)
    mask = rng.integers(0, 256, (9, 12), np.uint8)
    expected = image.astype(float)
    for row, column in np.ndindex(mask.shape):
        v, u = y + row, x + column
        if 0 <= v < 20 and 0 <= u < 16:
            share = mask[row, column] / 255
            expected[v, u] = expected[v, u] * (1 - share) + np.array(INK) * share
    blend(image, mask, x, y, INK)
    assert np.abs(image - expected).max() <= 0.5


def test_ink_is_light() -> None:
    assert oklab(np.array(INK))[0] > 0.95
