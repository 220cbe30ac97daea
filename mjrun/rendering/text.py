"""Text on pictures: antialiased, legible on any ground, in figures that all have one width.

The font is Aileron (public domain), which Pillow brings along, so that text looks the same everywhere.
It has ASCII and little more; what it lacks is drawn from what it has, or as a box. Letters are drawn eight
times larger and averaged, and set at quarters of a pixel: even spacing, which hinting at small sizes spoils.
"""

import math
import re
import unicodedata
from functools import lru_cache
from itertools import accumulate

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from mjrun.errors import UnknownNameError, clean

# Where text may stand: the share of the free width and height that is left of it and above it.
CORNERS = {
    "top-left": (0.0, 0.0),
    "top": (0.5, 0.0),
    "top-right": (1.0, 0.0),
    "bottom-left": (0.0, 1.0),
    "bottom": (0.5, 1.0),
    "bottom-right": (1.0, 1.0),
}
INK = (242, 243, 245)
DARK = (14, 15, 18)
SHADE = 0.7  # opacity of a plate
SMALLEST = 5  # height of an x [pixels], below which letters close up

_X_HEIGHT, _ASCENT, _DESCENT, LINE = 0.53, 0.82, 0.24, 1.32  # [em]
_OVERHANG = 0.12  # what a letter may reach beyond its advance [em]
_SAMPLES, _PHASES = 8, 4
_WEIGHT = 0.75  # exponent on coverage: light letters on a dark ground look thinner than they are
_SHRINK = (1.0, 0.86, 0.72, 0.6)
_FIGURES = "0123456789+−\u2007"
_SUPERSCRIPTS = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789", strict=True))
_RAISED = (0.62, 0.34)  # size and height of a superscript [em]
_STANDINS = str.maketrans({"–": "-", "—": "-", "×": "x", "µ": "u", "μ": "u", "•": "·", "\xa0": " ", "\u202f": " "})
_OWN = frozenset("©«°±´·»…’“”−\u2007") | frozenset(_SUPERSCRIPTS) | frozenset(map(chr, range(32, 127)))
_MINUS = re.compile(r"(?<!\w)-(?=\.?\d)|(?<=\de)-(?=\d)")
_PADDING = re.compile(r"(?<=\s)\s|^\s", re.MULTILINE)


def text_size(height: int) -> float:
    """The size of text that suits a picture `height` pixels high [pixels per em]: 12 at 240, 29 at 1080."""
    return 12 * (height / 240) ** 0.6


def crisp(size: float) -> float:
    """The size next to `size` at which the height of an x is whole pixels."""
    return max(SMALLEST, round(size * _X_HEIGHT)) / _X_HEIGHT


def letters(text: str) -> str:
    """`text`, one line of it, as the font can show it: cleaned, with true minus signs, padding as wide as figures."""
    shown = clean(text).translate(_STANDINS)
    shown = _PADDING.sub("\u2007", _MINUS.sub("−", shown))
    return "".join(c if c in _OWN else _plain(c) for c in shown)


def width_of(text: str, size: float) -> float:
    """How far `text`, from `letters`, advances [pixels]."""
    return sum(_advance(c) for c in text) * size


def fitted(text: str, size: float, width: float) -> str:
    """`text`, from `letters`, or its beginning and `…`, no wider than `width` [pixels]; empty if nothing fits."""
    text = text[: max(0, int(width)) + 1]  # no letter is narrower than a pixel
    if width_of(text, size) <= width:
        return text
    room = width / size - _advance("…")
    for kept, letter in enumerate(text):
        room -= _advance(letter)
        if room < 0:
            return f"{text[:kept].rstrip()}…" if kept else ""
    return ""


def write(
    image: np.ndarray,
    text: str,
    at: tuple[float, float],
    size: float,
    colour: tuple[int, int, int] = INK,
    align: float = 0.0,
) -> None:
    """Draws `text`, from `letters`, in `image` `(h, w, 3)`; what lies outside is left out.

    Args:
      at: where the text begins and its baseline [pixels]; `align` 0.5: where its middle is, 1: its end.
      size: from `crisp` [pixels per em].
    """
    pen = round((at[0] - align * width_of(text, size)) * _PHASES)
    blend(image, _line(text, size, pen % _PHASES), pen // _PHASES - _margin(size), round(at[1]) - _above(size), colour)


def blend(image: np.ndarray, mask: np.ndarray, x: int, y: int, colour: tuple[int, int, int]) -> None:
    """Covers `image` `(h, w, 3)` with `colour` as far as `mask` `(m, n)` uint8 says, its corner at `x`, `y`."""
    height, width = image.shape[:2]
    left, top = max(0, -x), max(0, -y)
    mask = mask[top : max(0, height - y), left : max(0, width - x), None].astype(np.uint16)
    if not mask.size:
        return
    region = image[y + top : y + top + mask.shape[0], x + left : x + left + mask.shape[1]]
    # At most 255² + 127, so 16 bits do.
    region[...] = (region * (255 - mask) + np.array(colour, np.uint16) * mask + 127) // 255


def plate(image: np.ndarray, box: tuple[int, int, int, int], radius: int) -> None:
    """Darkens `box` (x, y, width, height), with round corners, so that light text is legible on it."""
    x, y, width, height = box
    blend(image, rounded(width, height, radius, SHADE), x, y, DARK)


@lru_cache(maxsize=64)
def rounded(width: int, height: int, radius: float, opacity: float = 1.0) -> np.ndarray:
    """The coverage `(height, width)` uint8 of a rectangle with round corners, or a disc."""
    v, u = (np.abs(np.arange(n) + 0.5 - n / 2)[s] for n, s in ((height, np.s_[:, None]), (width, np.s_[None])))
    beyond = np.hypot(np.maximum(u - width / 2 + radius, 0), np.maximum(v - height / 2 + radius, 0))
    return np.round(np.clip(radius - beyond + 0.5, 0, 1) * opacity * 255).astype(np.uint8)


def stamp(image: np.ndarray, text: str, corner: str = "top-left", scale: float = 1.0) -> None:
    """Writes lines of `text` into a corner of `image` `(h, w, 3)` uint8, on a dark translucent plate.

    Text that is too wide or too high is set smaller, down to 60 %, then cut. Nothing outside the picture's margin
    is touched; a picture too small for a letter stays as it is.

    Args:
      corner: one of `CORNERS`; lines are set flush with that side.
      scale: size, as a multiple of what suits the picture's height.

    Raises:
      UnknownNameError: there is no such corner.
    """
    if corner not in CORNERS:
        raise UnknownNameError("corner", corner, list(CORNERS))
    height, width = image.shape[:2]
    # More lines or letters than pixels are never seen.
    lines = [letters(line[:width]) for line in text.split("\n")[:height]]
    sizes = [crisp(text_size(height) * scale * shrink) for shrink in _SHRINK]
    size = next((size for size in sizes if _fits(image, lines, size)), sizes[-1])
    room, rows = _room(image, size)
    if len(lines) > rows > 0:
        lines = [*lines[: rows - 1], f"{lines[rows - 1]}…"]
    lines = [fitted(line, size, room) for line in lines[: max(0, rows)]]
    if any(lines):
        _panel(image, lines, size, corner)


def spacing(size: float) -> tuple[int, int, int, int]:
    """What surrounds text of a size [pixels]: margin, horizontal and vertical padding, distance of baselines."""
    return round(0.6 * size), round(0.5 * size), round(0.3 * size), round(LINE * size)


def place(image: np.ndarray, width: int, height: int, corner: str, margin: int) -> tuple[int, int]:
    """The corner x, y of a box that stands in a `corner` of `image`."""
    right, down = CORNERS[corner]
    return (
        round(margin + right * (image.shape[1] - 2 * margin - width)),
        round(margin + down * (image.shape[0] - 2 * margin - height)),
    )


def baseline(top: float, height: float, size: float) -> int:
    """The baseline at which figures are centred between `top` and `top + height`."""
    return round(top + height / 2 + 0.345 * size)


def _room(image: np.ndarray, size: float) -> tuple[int, int]:
    """The width [pixels] and the number of lines that fit."""
    margin, across, down, line = spacing(size)
    height, width = image.shape[:2]
    return width - 2 * (margin + across), (height - 2 * (margin + down)) // line


def _fits(image: np.ndarray, lines: list[str], size: float) -> bool:
    room, rows = _room(image, size)
    return len(lines) <= rows and all(width_of(line, size) <= room for line in lines)


def _panel(image: np.ndarray, lines: list[str], size: float, corner: str) -> None:
    margin, across, down, line = spacing(size)
    widths = [width_of(text, size) for text in lines]
    width, height = math.ceil(max(widths)) + 2 * across, len(lines) * line + 2 * down
    x, y = place(image, width, height, corner, margin)
    plate(image, (x, y, width, height), round(0.35 * size))
    align = CORNERS[corner][0]
    pen = x + across + align * (width - 2 * across)
    for row, text in enumerate(lines):
        write(image, text, (pen, baseline(y + down + row * line, line, size)), size, align=align)


def _plain(letter: str) -> str:
    """What stands for a letter that the font lacks: its base without accents, or a box."""
    base = "".join(c for c in unicodedata.normalize("NFKD", letter) if not unicodedata.combining(c))
    return base if base and all(c in _OWN for c in base) else "\ufffd"


@lru_cache(maxsize=256)
def _font(size: float) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont), "Pillow was built without FreeType"
    return font


@lru_cache(maxsize=1024)
def _advance(letter: str) -> float:
    """How far a letter advances [em]; signs and padding as far as figures, which are all alike."""
    if letter in _SUPERSCRIPTS:
        return _RAISED[0] * _advance("0")
    return _font(1000).getlength("0" if letter in _FIGURES else letter) / 1000


def _margin(size: float) -> int:
    return math.ceil(_OVERHANG * size)


def _above(size: float) -> int:
    return math.ceil(_ASCENT * size)


@lru_cache(maxsize=512)
def _line(text: str, size: float, phase: int) -> np.ndarray:
    """The coverage of a line, as `_glyph` has that of a letter."""
    pens = [phase + round(x) for x in accumulate((_advance(c) * size * _PHASES for c in text), initial=0.0)]
    height, margin = _above(size) + math.ceil(_DESCENT * size), _margin(size)
    mask = np.zeros((height, pens[-1] // _PHASES + 4 * margin + 2), np.uint8)
    for letter, pen in zip(text, pens, strict=False):
        if letter in " \u2007":  # the font has no figure space
            continue
        glyph = _glyph(letter, size, pen % _PHASES)
        under = mask[:, pen // _PHASES :][:, : glyph.shape[1]]
        np.maximum(under, glyph, out=under)
    return mask


@lru_cache(maxsize=8192)
def _glyph(letter: str, size: float, phase: int) -> np.ndarray:
    """The coverage of a letter that begins `phase` quarters of a pixel right of a margin; all of a size are as high."""
    above, below, margin = _above(size), math.ceil(_DESCENT * size), _margin(size)
    width, height = math.ceil(_advance(letter) * size) + 2 * margin + 1, above + below
    share, rise = _RAISED if letter in _SUPERSCRIPTS else (1.0, 0.0)
    canvas = Image.new("L", (width * _SAMPLES, height * _SAMPLES))
    at = ((margin + phase / _PHASES) * _SAMPLES, (above - rise * size) * _SAMPLES)
    drawn = {"−": "+"}.get(letter, _SUPERSCRIPTS.get(letter, letter))
    ImageDraw.Draw(canvas).text(at, drawn, 255, _font(size * share * _SAMPLES), anchor="ls")
    fine = np.asarray(canvas)
    if letter == "−":  # the bar of a plus: as wide, and where figures expect it
        fine = fine * (fine[:, [int(at[0] + 0.12 * size * _SAMPLES)]] > 127)
    coverage = fine.reshape(height, _SAMPLES, width, _SAMPLES).mean(axis=(1, 3)) / 255
    return np.round(coverage**_WEIGHT * 255).astype(np.uint8)
