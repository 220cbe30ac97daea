"""False colours: colour maps for depth, a palette for segments, and the colour bar and legend that explain them."""

import math
import zlib
from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np

from mjrun.model.camera_images import SegmentedObject
from mjrun.rendering import text

UNSEEN = (34, 35, 38)  # the background

# Published tables at 33 even steps, red, green and blue in hex. Turbo: A. Mikhailov, Google, 2019, Apache-2.0.
# Inferno: N. Smith and S. van der Walt, matplotlib, 2015, CC0.
_STOPS = {
    "turbo": (
        "30123b392a734040a14456c7466be3467ff64293ff37a7fa29bbec1dcdd818dcc31ee8b031f2994cf97e6bfd648aff4da3fd3c"
        "b8f735cced34dee037edd03af8c03afdae35fe982cfb8022f56817ec520fe04009d23105c02302ac1701950d017a0403"
    ),
    "inferno": (
        "0000040403120b0724150b37210c4a2e0a5a3c09654a0c6b57106d63146e70196e7d1e6d89226a962766a32b61af315cbb3755"
        "c63e4dd14644db4f3be35932eb6528f1711ef67f14f98d0afb9c06fcab0ffbba1ff9ca32f5d949f2e865f3f586fcffa4"
    ),
}

_CLIPPED = 0.5  # percentage of the pixels that the colour range excludes at either end
_ROWS = 16  # rows coloured at once: as many as fit in the cache
_CHOICES = 1024  # colours of the palette, after which they repeat
_ROOM = 16  # the minimum number of colours that a segment chooses from


@lru_cache
def colormap_table(colormap: str = "turbo") -> np.ndarray:
    """Returns the 256 colours `(256, 3)` uint8 of the colour map `turbo` or `inferno`."""
    stops = np.frombuffer(bytes.fromhex(_STOPS[colormap]), np.uint8).reshape(-1, 3)
    at = np.linspace(0, len(stops) - 1, 256)
    return np.round(np.stack([np.interp(at, range(len(stops)), c) for c in stops.T], axis=1)).astype(np.uint8)


def depth_range(depths: Iterable[np.ndarray]) -> tuple[float, float]:
    """Returns the nearest and farthest depth [m] to colour in depth images `(h, w)`.

    Half a percent of the pixels may be nearer. Outliers (J. Tukey's "far out": more than three interquartile ranges
    above the upper quartile), such as a floor that extends to the horizon, are excluded: at most a tenth of the pixels.
    """
    samples = [depth.ravel()[:: max(1, depth.size // 40_000)] for depth in depths]
    values = np.concatenate([s[np.isfinite(s)] for s in samples]) if samples else np.empty(0)
    if not values.size:
        return 0.0, 1.0
    shares = (_CLIPPED, 25, 75, 90, 100 - _CLIPPED)
    near, low, high, most, far = map(float, np.percentile(values, shares))
    far = min(far, max(most, high + 3 * (high - low)))
    return (near, far) if far - near > 1e-3 * far else (near * 0.95, near * 1.05)


def depth_colors(depth: np.ndarray, near: float, far: float) -> np.ndarray:
    """Colours depths `(h, w)` [m] from `near` to `far` as `(h, w, 3)` uint8, clipped to the ends of the map."""
    table = _with_unseen(colormap_table())
    scale = np.float32(255 / max(far - near, 1e-9))
    colors = np.empty((*depth.shape, 3), np.uint8)
    for top in range(0, len(depth), _ROWS):
        rows = depth[top : top + _ROWS]
        shades = np.clip((rows - np.float32(near)) * scale, 0, 255) + np.float32(0.5)
        shades[~np.isfinite(rows)] = 256
        # Without `mode` numpy checks the indices first, which triples the time.
        np.take(table, shades.astype(np.intp), axis=0, mode="clip", out=colors[top : top + _ROWS])
    return colors


def seg_colors(ids: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Colours an image of ids `(h, w)`, which index `colors` `(n, 3)`, as `(h, w, 3)` uint8; −1 is the background."""
    return np.take(_with_unseen(colors), ids, axis=0, mode="wrap")


def _with_unseen(colors: np.ndarray) -> np.ndarray:
    return np.vstack([colors, UNSEEN]).astype(np.uint8)


def oklab(rgb: np.ndarray) -> np.ndarray:
    """Returns Oklab lightness and colour axes `(…, 3)` of sRGB `(…, 3)`, 0 to 255; distances are perceived differences.

    B. Ottosson, "A perceptual color space for image processing", 2020.
    """
    c = np.asarray(rgb) / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    cones = linear @ [
        [0.4122214708, 0.2119034982, 0.0883024619],
        [0.5363325363, 0.6806995451, 0.2817188376],
        [0.0514459929, 0.1073969566, 0.6299787005],
    ]
    return np.cbrt(cones) @ [
        [0.2104542553, 1.9779984951, 0.0259040371],
        [0.7936177850, -2.4285922050, 0.7827717662],
        [-0.0040720468, 0.4505937099, -0.8086757660],
    ]


def segmentation_palette(n: int) -> np.ndarray:
    """Returns `n` colours `(n, 3)` uint8, as far apart as possible, and from the background; 1,024 are distinct."""
    return _palette()[np.arange(n) % _CHOICES]


@lru_cache(maxsize=1)
def _palette() -> np.ndarray:
    steps = np.arange(0, 256, 15)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    # Integers, so that equal distances do not depend on a machine's rounding.
    lab = np.round(oklab(np.vstack([grid, UNSEEN])) * 10_000).astype(np.int64)

    lightness, chroma = lab[:-1, 0], np.hypot(lab[:-1, 1], lab[:-1, 2])
    pleasant = (lightness > 4800) & (lightness < 9200) & (chroma < 1700)
    grid, lab, background = grid[pleasant], lab[:-1][pleasant], lab[-1]
    distance = ((lab - background) ** 2).sum(axis=1) // 4  # away from the background, but not from all dark colours
    chosen = [int(np.abs(lab - oklab(np.array([60, 150, 240])) * 10_000).sum(axis=1).argmin())]
    while len(chosen) < _CHOICES:
        distance = np.minimum(distance, ((lab - lab[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(distance.argmax()))
    return grid[chosen].astype(np.uint8)


def colors_of(legend: Sequence[SegmentedObject]) -> np.ndarray:
    """Returns a colour for each segment, `(n, 3)` uint8: distinct up to 1,024, and farther apart if there are fewer.

    The hash of its type and name ranks the palette's first colours for each segment. Segments choose in legend order,
    each from twice as many colours as are already taken. A segment thus keeps its colour from run to run, whatever is
    added after it, and mostly even when something is added before it.
    """
    palette = _palette()
    candidates = np.arange(_CHOICES, dtype=np.uint64)
    free = np.ones(_CHOICES, bool)
    choices = []
    for position, segment in enumerate(legend):
        if position % _CHOICES == 0:
            free[:] = True
        room = min(_CHOICES, max(_ROOM, 2 * (position % _CHOICES)))
        # Highest random weight (D. Thaler and C. Ravishankar, 1998): more candidates change few choices.
        key = np.uint64(zlib.crc32(f"{segment.type}\0{segment.name}".encode()))
        weights = _mixed(candidates[:room] + (key << 10))
        choices.append(int(np.where(free[:room], weights, 0).argmax()))
        free[choices[-1]] = False
    return palette[np.array(choices, int)]


def _mixed(values: np.ndarray) -> np.ndarray:
    """Hashes integers with the final step of splitmix64 (G. Steele and others, 2014)."""
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        values = (values ^ (values >> np.uint64(shift))) * np.uint64(factor)
    return (values ^ (values >> np.uint64(31))) | np.uint64(1)


def in_view(ids: np.ndarray) -> np.ndarray:
    """Returns the ids in an image `(h, w)`, in ascending order."""
    return np.flatnonzero(np.bincount(ids[ids >= 0]))


def ticks(low: float, high: float, least: float) -> tuple[np.ndarray, float]:
    """Returns multiples of a step from `low` to `high`, and the step: the first of 1, 2, 5, 10, … from `least` on."""
    power = math.floor(math.log10(least))
    step = next(s for s in (float(f"{factor}e{power}") for factor in (1, 2, 5, 10, 20)) if s >= least * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return np.arange(first, last + 1) * step, step


def figures(values: Sequence[float] | np.ndarray, step: float) -> list[str]:
    """Formats values with as many decimals as `step` has."""
    places = -math.floor(math.log10(step) + 1e-9)
    largest = max((abs(v) for v in values), default=0.0)
    if places <= 4 and largest < 1e5:
        shown = [f"{v:.{max(0, places)}f}" for v in values]
        return [s.removeprefix("-") if not s.strip("-0.") else s for s in shown]
    digits = max(0, places + math.floor(math.log10(largest))) if largest else 0
    shown = [f"{v:.{digits}e}".split("e") for v in values]
    return [f"{mantissa}e{int(power)}" if v else "0" for v, (mantissa, power) in zip(values, shown, strict=True)]


def colour_bar(image: np.ndarray, near: float, far: float) -> None:
    """Draws the colour bar of `depth_colors` at the right of `image` `(h, w, 3)`, with round depths [m] marked.

    An image too small for the bar is left unchanged.
    """
    height, width = image.shape[:2]
    size = text.crisp(0.9 * text.text_size(height))
    margin, across, _, line = text.spacing(size)
    length, thick, dash, hair = round(0.5 * height), round(0.8 * size), round(0.45 * size), max(1, round(size / 12))
    marks, step = ticks(near, far, (far - near) * max(1.5 * line / length, 0.12))
    labels = [text.letters(number) for number in figures(marks, step)]
    unit = " m"  # on the uppermost mark only
    right = (
        thick + round(1.7 * dash) + max((text.width_of(label, size) for label in labels), default=0)
    )  # end of the labels

    box = 2 * across + math.ceil(right + text.width_of(unit, size)), length + 2 * (line // 2)
    if box[0] > width - 2 * margin or box[1] > height - 2 * margin:
        return

    x, y = width - margin - box[0], (height - box[1]) // 2
    text.plate(image, (x, y, *box), round(0.35 * size))
    x, y = x + across, y + line // 2
    text.blend(image, np.full((length + 2 * hair, thick + 2 * hair), 90, np.uint8), x - hair, y - hair, text.INK)
    shades = np.linspace(255, 0, length).round().astype(int)
    image[y : y + length, x : x + thick] = colormap_table()[shades][:, None]

    for row, (mark, label) in enumerate(zip(marks, labels, strict=True)):
        v = y + 0.5 + (far - mark) / (far - near) * (length - 1)
        top = min(y + length - hair, max(y, round(v - hair / 2)))
        text.blend(image, np.full((hair, dash), 230, np.uint8), x + thick + hair - dash // 2, top, text.INK)
        text.write(image, label, (x + right, text.baseline(top, hair, size)), size, align=1.0)
        if row == len(labels) - 1:
            text.write(image, unit, (x + right, text.baseline(top, hair, size)), size)


def legend(image: np.ndarray, segments: Sequence[SegmentedObject], colors: np.ndarray) -> None:
    """Lists `segments` at the lower left of `image` `(h, w, 3)`, each beside its colour, a row of `colors` `(n, 3)`.

    The list takes at most 60 % of the height and 40 % of the width; a last line gives the number of omitted segments.
    """
    height, width = image.shape[:2]
    size = text.crisp(0.86 * text.text_size(height))
    margin, across, down, pitch = text.spacing(size)
    swatch, gap = round(0.75 * size), round(0.45 * size)
    rows = int(0.6 * height - 2 * (margin + down)) // pitch
    room = 0.4 * width - 2 * across - swatch - gap
    shown = len(segments) if len(segments) <= rows else rows - 1
    names = [text.fitted(text.letters(segment.name), size, room) for segment in segments[: max(0, shown)]]
    if not any(names):
        return
    counts = (f"… {len(segments) - shown}{words}" for words in (" more", "")) if shown < len(segments) else ()
    more = next((count for count in counts if text.width_of(text.letters(count), size) <= room), "")
    lines = [*names, more] if more else names

    box = (
        2 * across + swatch + gap + math.ceil(max(text.width_of(line, size) for line in lines)),
        2 * down + pitch * len(lines),
    )
    x, y = text.place(image, *box, "bottom-left", margin)
    text.plate(image, (x, y, *box), round(0.35 * size))

    for row, line in enumerate(lines):
        top = y + down + row * pitch
        if row < shown:
            red, green, blue = map(int, colors[row])
            mark = text.rounded(swatch, swatch, round(0.2 * size))
            text.blend(image, mark, x + across, top + (pitch - swatch) // 2, (red, green, blue))
        text.write(image, line, (x + across + swatch + gap, text.baseline(top, pitch, size)), size)
