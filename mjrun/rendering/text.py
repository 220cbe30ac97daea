"""Text on images: antialiased, legible on any background, with digits of equal width.

The font is Inter (SIL Open Font License), which comes with mjrun, so that text looks the same everywhere. It has
Latin, Greek, Cyrillic and common symbols; a missing character is drawn without its accents, or as a box. Letters
are drawn at eight times their size and averaged, and placed at quarters of a pixel, for even spacing: hinting would
degrade it at small sizes.
"""

import math
import re
import string
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from itertools import accumulate
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, option, quoted

# Positions for text: the shares of the free width and height to the left of it and above it.
CORNERS = {
    "top-left": (0.0, 0.0),
    "top": (0.5, 0.0),
    "top-right": (1.0, 0.0),
    "bottom-left": (0.0, 1.0),
    "bottom": (0.5, 1.0),
    "bottom-right": (1.0, 1.0),
}
INK = (242, 243, 245)
BACKGROUND = (24, 25, 28)  # between images, in empty cells of a grid, and behind graphs
DARK = (14, 15, 18)
SHADE = 0.7  # opacity of the plate behind text
MISSING = "□"  # replaces a character that the font lacks
# Values in texts over frames that are not columns, with their formats.
BUILTIN = {"time": ".2f", "frame": "d", "step": "d", "speed": "g"}
DEFAULT_FORMAT = ".4g"
SMALLEST = 5  # x-height [pixels] below which letters fill in

_FILE = Path(__file__).parent / "fonts" / "Inter.ttf"  # made by scripts/make_font.py
_X_HEIGHT, _DIGIT_HEIGHT, _ASCENT, _DESCENT, LINE = 0.546, 0.727, 1.11, 0.33, 1.32  # [em]
_OVERHANG = 0.12  # maximum extent of a letter beyond its advance [em]
_SAMPLES, _PHASES = 8, 4
_WEIGHT = 0.75  # exponent of coverage: light letters on a dark background look thinner than they are
_SHRINK = (1.0, 0.86, 0.72, 0.6)
_SUBSTITUTES = str.maketrans({"\xa0": " ", "\u202f": " ", "⋅": "·", "∥": "‖"})
_ACCENTS = r"\u0300-\u036f\u1ab0-\u1aff\u1dc0-\u1dff\u20d0-\u20ff"  # the combining characters of Unicode
_CLUSTER = re.compile(f"[^{_ACCENTS}][{_ACCENTS}]*|.")  # a letter and the accents that follow it
_MINUS = re.compile(r"(?<!\w)-(?=\.?\d)|(?<=\de)-(?=\d)")
_VAST = re.compile(r"[1-9]\d{3}")  # a width or a precision of more than 999 characters
_PADDING = re.compile(r"(?<=\s)\s|^\s", re.MULTILINE)


def text_size(height: int) -> float:
    """Returns the text size that suits an image `height` pixels high [pixels per em]: 12 at 240, 29 at 1080."""
    return 11.6 * (height / 240) ** 0.6


def crisp(size: float) -> float:
    """Returns the size closest to `size` whose x-height is a whole number of pixels."""
    return max(SMALLEST, round(size * _X_HEIGHT)) / _X_HEIGHT


def letters(text: str) -> str:
    """Prepares one line of text for the font: cleaned, with true minus signs, and padding as wide as digits."""
    shown = unicodedata.normalize("NFC", clean(text)).translate(_SUBSTITUTES)
    shown = _PADDING.sub("\u2007", _MINUS.sub("−", shown))
    return "".join(map(_available, shown))


def width_of(text: str, size: float) -> float:
    """Returns the width of `text`, from `letters` [pixels]."""
    return sum(_advance(c) for c in text) * size


def fitted(text: str, size: float, width: float) -> str:
    """Cuts off `text`, from `letters`, with `…` if it is wider than `width` [pixels]; empty if nothing fits."""
    text = text[: max(0, int(width)) + 1]  # no letter is narrower than a pixel
    if width_of(text, size) <= width:
        return text
    room = width / size - _advance("…")
    for length, letter in enumerate(text):
        room -= _advance(letter)
        if room < 0:
            return f"{text[:length].rstrip()}…" if length else ""
    return ""


def fitted_ends(text: str, size: float, width: float) -> str:
    """Cuts out the middle of `text`, from `letters`, as `fitted` does its end."""
    if width_of(text, size) <= width:
        return text
    room, start = (width / size - _advance("…")) / 2, len(text)
    while start and _advance(text[start - 1]) <= room:
        start -= 1
        room -= _advance(text[start])
    end = text[start:]
    begin = fitted(text, size, width - width_of(end, size))
    return begin + end if begin else fitted(text, size, width)


def write(
    image: np.ndarray,
    text: str,
    at: tuple[float, float],
    size: float,
    colour: tuple[int, int, int] = INK,
    align: float = 0.0,
) -> None:
    """Draws `text`, from `letters`, on `image` `(h, w, 3)`, clipped to it.

    Args:
      at: x and the baseline's y [pixels].
      size: text size from `crisp` [pixels per em].
      align: the point of the text at x: 0 its beginning, 0.5 its middle, 1 its end.
    """
    pen = round((at[0] - align * width_of(text, size)) * _PHASES)
    blend(image, _line(text, size, pen % _PHASES), pen // _PHASES - _margin(size), round(at[1]) - _above(size), colour)


def blend(image: np.ndarray, mask: np.ndarray, x: int, y: int, colour: tuple[int, int, int]) -> None:
    """Blends `colour` into `image` `(h, w, 3)` with opacities `mask` `(m, n)` uint8, whose corner is at `x`, `y`."""
    height, width = image.shape[:2]
    left, top = max(0, -x), max(0, -y)
    mask = mask[top : max(0, height - y), left : max(0, width - x), None].astype(np.uint16)
    if not mask.size:
        return
    region = image[y + top : y + top + mask.shape[0], x + left : x + left + mask.shape[1]]
    # At most 255² + 127, which 16 bits hold.
    region[...] = (region * (255 - mask) + np.array(colour, np.uint16) * mask + 127) // 255


def plate(image: np.ndarray, box: tuple[int, int, int, int], radius: int) -> None:
    """Darkens `box` (x, y, width, height), with rounded corners, so that light text is legible on it."""
    x, y, width, height = box
    blend(image, rounded(width, height, radius, SHADE), x, y, DARK)


@lru_cache(maxsize=64)
def rounded(width: int, height: int, radius: float, opacity: float = 1.0) -> np.ndarray:
    """Returns the coverage `(height, width)` uint8 of a rectangle with rounded corners, or of a disc."""
    v, u = (np.abs(np.arange(n) + 0.5 - n / 2)[s] for n, s in ((height, np.s_[:, None]), (width, np.s_[None])))
    beyond = np.hypot(np.maximum(u - width / 2 + radius, 0), np.maximum(v - height / 2 + radius, 0))
    return np.round(np.clip(radius - beyond + 0.5, 0, 1) * opacity * 255).astype(np.uint8)


def stamp(image: np.ndarray, text: str, corner: str = "top-left", scale: float = 1.0) -> None:
    """Writes lines of `text` into a corner of `image` `(h, w, 3)` uint8, on a dark translucent plate.

    Text that is too wide or too high is made smaller, down to 60 %, and then cut off. The margin of the image is left
    free; an image too small for a single letter is left unchanged.

    Args:
      corner: one of `CORNERS`; lines are aligned with that side.
      scale: text size as a multiple of the usual one for the image's height.

    Raises:
      UnknownNameError: the corner is unknown.
    """
    if corner not in CORNERS:
        raise UnknownNameError("corner", corner, list(CORNERS))
    height, width = image.shape[:2]
    # More lines or letters than pixels never fit.
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
    """Returns the spacing of text [pixels]: margin, horizontal and vertical padding, distance between baselines."""
    return round(0.6 * size), round(0.5 * size), round(0.3 * size), round(LINE * size)


def place(image: np.ndarray, width: int, height: int, corner: str, margin: int) -> tuple[int, int]:
    """Returns the upper left corner x, y of a box placed in a `corner` of `image`."""
    right, down = CORNERS[corner]
    return (
        round(margin + right * (image.shape[1] - 2 * margin - width)),
        round(margin + down * (image.shape[0] - 2 * margin - height)),
    )


def baseline(top: float, height: float, size: float) -> int:
    """Returns the baseline at which digits are vertically centred between `top` and `top + height`."""
    return round(top + height / 2 + _DIGIT_HEIGHT / 2 * size)


def _room(image: np.ndarray, size: float) -> tuple[int, int]:
    """Returns the width [pixels] and the number of lines available."""
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


@lru_cache(maxsize=4096)
def _available(letter: str) -> str:
    """Returns the letter; if the font lacks it, the letter without accents, or a box."""
    if _has(letter):
        return letter
    base = "".join(c for c in unicodedata.normalize("NFKD", letter) if not unicodedata.combining(c))
    return base if base and all(map(_has, base)) else MISSING


def _has(letter: str) -> bool:
    """Returns whether the font has the letter, by comparing its shape to the one for missing letters."""
    return _shape(letter) != _shape("\uffff")


def _shape(letter: str) -> bytes:
    canvas = Image.new("L", (64, 64))
    ImageDraw.Draw(canvas).text((16, 48), letter, 255, _font(32), anchor="ls")
    return canvas.tobytes()


@lru_cache(maxsize=256)
def _font(size: float) -> ImageFont.FreeTypeFont:
    # Letters are placed singly, so the layout engine that shapes words is not needed.
    return ImageFont.truetype(_FILE, size, layout_engine=ImageFont.Layout.BASIC)


@lru_cache(maxsize=1024)
def _advance(letter: str) -> float:
    """Returns the advance of a letter [em]; digits, signs and padding all have the same."""
    return _font(1000).getlength(letter) / 1000


def _margin(size: float) -> int:
    return math.ceil(_OVERHANG * size)


def _above(size: float) -> int:
    return math.ceil(_ASCENT * size)


@lru_cache(maxsize=512)
def _line(text: str, size: float, phase: int) -> np.ndarray:
    """Returns the coverage of a line of text, laid out like that of `_glyph`."""
    clusters = _CLUSTER.findall(text)
    pens = [phase + round(x) for x in accumulate((_advance(c[0]) * size * _PHASES for c in clusters), initial=0.0)]
    height, margin = _above(size) + math.ceil(_DESCENT * size), _margin(size)
    mask = np.zeros((height, pens[-1] // _PHASES + 4 * margin + 2), np.uint8)
    for cluster, pen in zip(clusters, pens, strict=False):
        if cluster in " \u2007":
            continue
        glyph = _glyph(cluster, size, pen % _PHASES)
        under = mask[:, pen // _PHASES :][:, : glyph.shape[1]]
        np.maximum(under, glyph, out=under)
    return mask


@lru_cache(maxsize=8192)
def _glyph(cluster: str, size: float, phase: int) -> np.ndarray:
    """Returns the coverage of a letter, with its accents, that begins `phase` quarters of a pixel after a margin.

    All coverages are equally high.
    """
    letter, accents = cluster[0], cluster[1:]
    above, below, margin = _above(size), math.ceil(_DESCENT * size), _margin(size)
    width, height = math.ceil(_advance(letter) * size) + 2 * margin + 1, above + below
    canvas = Image.new("L", (width * _SAMPLES, height * _SAMPLES))
    x, y = (margin + phase / _PHASES) * _SAMPLES, above * _SAMPLES
    pen, font = ImageDraw.Draw(canvas), _font(size * _SAMPLES)
    pen.text((x, y), letter, 255, font, anchor="ls")

    for accent in accents:
        left, top, right = _ink(letter, font)
        first, highest, last = _ink(accent, font)
        # Accents are designed for low letters; those above a letter (highest < 0) rise with it.
        rise = max(0.0, -top - _X_HEIGHT * size * _SAMPLES) if highest < 0 else 0.0
        pen.text((x + (left + right - first - last) / 2, y - rise), accent, 255, font, anchor="ls")

    coverage = np.asarray(canvas).reshape(height, _SAMPLES, width, _SAMPLES).mean(axis=(1, 3)) / 255
    return np.round(coverage**_WEIGHT * 255).astype(np.uint8)


def _ink(letter: str, font: ImageFont.FreeTypeFont) -> tuple[int, int, int]:
    """Returns the left, top and right of a letter's ink, from its origin on the baseline [pixels]."""
    mask, (across, down) = font.getmask2(letter, anchor="ls")
    left, top, right, _ = mask.getbbox() or (0, 0, 0, 0)
    return across + left, down + top, across + right


@dataclass(frozen=True)
class OverlayTextPart:
    """Literal text, then a value by name and format, if any."""

    literal: str
    name: str = ""
    form: str = ""


@dataclass(frozen=True)
class OverlayText:
    """A text with values in braces: `{time:.2f} s  {qpos/knee:.1f}`; `\\n` begins a line, `{{` is a brace."""

    parts: Sequence[OverlayTextPart]

    @property
    def columns(self) -> list[str]:
        """The columns that the text shows, without duplicates."""
        return list(dict.fromkeys(part.name for part in self.parts if part.name and part.name not in BUILTIN))

    def filled(self, values: Mapping[str, float]) -> str:
        """Returns the text with `values` inserted by name."""
        texts: list[str] = []
        for part in self.parts:
            value = format(values[part.name], part.form) if part.name else ""
            texts.append(part.literal + value)
        return "".join(texts)


def parse_template(text: str, columns: Sequence[str], is_column: Callable[[str], bool] | None = None) -> OverlayText:
    """Parses a template.

    Args:
      columns: the columns that can be measured.
      is_column: returns whether a name that is not listed is a column, too: there are too many pairs to list them.

    Raises:
      UnknownNameError: a value is unknown.
      UsageError: a brace is not closed, or a format does not suit numbers.
    """
    try:
        parsed = list(string.Formatter().parse(text.replace("\\n", "\n")))
    except ValueError as error:
        raise UsageError(
            f"{option('text')} {quoted(text)}: {error}\nwrite a value as {{time:.2f}} and a brace as {{{{"
        ) from None
    valid = [*BUILTIN, *columns]
    fields = map(_unconverted, parsed)
    return OverlayText([_part(literal, name, form, valid, is_column) for literal, name, form in fields])


def _unconverted(
    part: tuple[str, str | None, str | None, str | None],
) -> tuple[str, str | None, str | None]:
    """Returns a part of a format whose name holds what Python takes for a conversion, as in `qpos/a!r`."""
    literal, name, form, conversion = part
    return literal, f"{name}!{conversion}" if conversion else name, form


def _part(
    literal: str,
    name: str | None,
    form: str | None,
    valid: Sequence[str],
    is_column: Callable[[str], bool] | None,
) -> OverlayTextPart:
    if name is None:
        return OverlayTextPart(literal)
    whole = f"{name}:{form}" if form else name  # a column may hold a colon itself, as in qpos/joint:0
    column = max((column for column in valid if whole == column or whole.startswith(f"{column}:")), key=len, default="")
    if not column and is_column is not None:
        ends = [len(whole), *(index for index in range(len(whole) - 1, 0, -1) if whole[index] == ":")]
        column = next((whole[:end] for end in ends if is_column(whole[:end])), "")
    if not column:
        raise UnknownNameError("value", name, valid, where=option("text"))
    form = whole[len(column) + 1 :] or BUILTIN.get(column, DEFAULT_FORMAT)
    if problem := _problem(form, 1 if column in ("frame", "step") else 1.0):
        raise UsageError(f"{option('text')}: {quoted(form)} cannot format {quoted(column)}: {problem}")
    return OverlayTextPart(literal, column, form)


def _problem(form: str, example: float) -> str:
    """Returns why numbers such as `example` cannot be written in a format; empty if they can."""
    if _VAST.search(form):
        return "a value has at most 999 characters"
    if form.endswith("c"):  # not every number is a character
        return "it is a number, not a character"
    try:
        format(example, form)
    except ValueError as error:
        return str(error)
    return ""
