"""False colours: depth by a colour map, segments by a palette; and a colour bar and a legend to read them by."""

import math
import zlib
from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np

from mjrun.errors import UnknownNameError
from mjrun.model.rendered_view import Segment
from mjrun.rendering.text import (
    INK,
    baseline,
    blend,
    crisp,
    fitted,
    letters,
    place,
    plate,
    rounded,
    spacing,
    text_size,
    width_of,
    write,
)

UNSEEN = (34, 35, 38)  # the background

# Published tables at 33 even steps, red, green and blue in hex. Turbo: A. Mikhailov, Google, 2019, Apache-2.0.
# Viridis and inferno: N. Smith and S. van der Walt, matplotlib, 2015, CC0.
_STOPS = {
    "turbo": (
        "30123b392a734040a14456c7466be3467ff64293ff37a7fa29bbec1dcdd818dcc31ee8b031f2994cf97e6bfd648aff4da3fd3c"
        "b8f735cced34dee037edd03af8c03afdae35fe982cfb8022f56817ec520fe04009d23105c02302ac1701950d017a0403"
    ),
    "viridis": (
        "440154470d6048186a482374472d7b4536814240863f49893b528b375a8d33638d2f6a8e2c728e297a8e26818e23898e21908c"
        "1f988b1f9f8821a68528ae8031b57b3ebc744cc26c5dc9636ece5882d34c96d83fabdc32c0df24d5e21aeae51afde725"
    ),
    "inferno": (
        "0000040403120b0724150b37210c4a2e0a5a3c09654a0c6b57106d63146e70196e7d1e6d89226a962766a32b61af315cbb3755"
        "c63e4dd14644db4f3be35932eb6528f1711ef67f14f98d0afb9c06fcab0ffbba1ff9ca32f5d949f2e865f3f586fcffa4"
    ),
    "grey": "404040ffffff",
}
COLORMAPS = tuple(_STOPS)

_CLIPPED = 0.5  # percent of the pixels at either end of the depths that a range leaves out
_ROWS = 16  # coloured at once: as many as fit in the cache
_CHOICES = 1024  # colours of the palette; after those they repeat
_ROOM = 16  # the smallest number of colours that a segment chooses from


@lru_cache
def colormap_table(colormap: str = "turbo") -> np.ndarray:
    """The 256 colours `(256, 3)` uint8 of a colour map.

    Raises:
      UnknownNameError: it is not one of `COLORMAPS`.
    """
    if colormap not in _STOPS:
        raise UnknownNameError("colour map", colormap, COLORMAPS)
    stops = np.frombuffer(bytes.fromhex(_STOPS[colormap]), np.uint8).reshape(-1, 3)
    at = np.linspace(0, len(stops) - 1, 256)
    return np.round(np.stack([np.interp(at, range(len(stops)), c) for c in stops.T], axis=1)).astype(np.uint8)


def depth_range(depths: Iterable[np.ndarray]) -> tuple[float, float]:
    """The nearest and farthest depth [m] to colour in depth images, each `(h, w)`.

    Half a percent of the pixels may be nearer. Outliers (J. Tukey's "far out": more than three interquartile ranges
    above the upper quartile), such as a floor that extends to the horizon, are left out: a tenth of the pixels at most.
    """
    samples = [depth.ravel()[:: max(1, depth.size // 40_000)] for depth in depths]
    values = np.concatenate([s[np.isfinite(s)] for s in samples]) if samples else np.empty(0)
    if not values.size:
        return 0.0, 1.0
    shares = (_CLIPPED, 25, 75, 90, 100 - _CLIPPED)
    near, low, high, most, far = map(float, np.percentile(values, shares))
    far = min(far, max(most, high + 3 * (high - low)))
    return (near, far) if far - near > 1e-3 * far else (near * 0.95, near * 1.05)


def depth_colors(depth: np.ndarray, near: float, far: float, colormap: str = "turbo") -> np.ndarray:
    """Colours `(h, w, 3)` uint8 of depths `(h, w)` [m], from `near` to `far`; clipped to the ends of the map."""
    table = _with_unseen(colormap_table(colormap))
    scale = np.float32(255 / max(far - near, 1e-9))
    colors = np.empty((*depth.shape, 3), np.uint8)
    for top in range(0, len(depth), _ROWS):
        rows = depth[top : top + _ROWS]
        shades = np.clip((rows - np.float32(near)) * scale, 0, 255) + np.float32(0.5)
        shades[~np.isfinite(rows)] = 256
        # Without `mode` numpy checks the indices first, which is three times slower.
        np.take(table, shades.astype(np.intp), axis=0, mode="clip", out=colors[top : top + _ROWS])
    return colors


def seg_colors(ids: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Colours `(h, w, 3)` uint8 of an image of ids `(h, w)`, which index `colors` `(n, 3)`; −1 is the background."""
    return np.take(_with_unseen(colors), ids, axis=0, mode="wrap")


def _with_unseen(colors: np.ndarray) -> np.ndarray:
    return np.vstack([colors, UNSEEN]).astype(np.uint8)


def oklab(rgb: np.ndarray) -> np.ndarray:
    """Oklab lightness and colour axes `(…, 3)` of sRGB `(…, 3)` from 0 to 255; distances are perceived differences.

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
    """`n` colours `(n, 3)` uint8, as far as can be from one another and from the background; repeated after 1,024."""
    return _palette()[np.arange(n) % _CHOICES]


@lru_cache(maxsize=1)
def _palette() -> np.ndarray:
    steps = np.arange(0, 256, 15)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    # Integers, so that equal distances do not depend on the rounding of a machine.
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


def colors_of(legend: Sequence[Segment]) -> np.ndarray:
    """A colour for each segment, `(n, 3)` uint8: all different up to 1,024, and the fewer, the farther apart.

    The hash of its type and name ranks the palette's first colours for each segment. Segments choose in the order of
    the legend, each from twice as many colours as have been taken. So a segment keeps its colour from run to run,
    whatever is added after it, and mostly even when something is added before it.
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
    """Hashes of integers: the final step of splitmix64 (G. Steele and others, 2014)."""
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        values = (values ^ (values >> np.uint64(shift))) * np.uint64(factor)
    return (values ^ (values >> np.uint64(31))) | np.uint64(1)


def in_view(ids: np.ndarray) -> np.ndarray:
    """The ids in an image `(h, w)`, in ascending order."""
    return np.flatnonzero(np.bincount(ids[ids >= 0]))


def ticks(low: float, high: float, least: float) -> tuple[np.ndarray, float]:
    """The multiples from `low` to `high` of a step, and that step: the first of 1, 2, 5, 10, 20, … from `least` on."""
    power = math.floor(math.log10(least))
    step = next(s for s in (float(f"{factor}e{power}") for factor in (1, 2, 5, 10, 20)) if s >= least * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return np.arange(first, last + 1) * step, step


def figures(values: Sequence[float] | np.ndarray, step: float) -> list[str]:
    """Values as text, all with as many decimals as `step` has."""
    places = -math.floor(math.log10(step) + 1e-9)
    largest = max((abs(v) for v in values), default=0.0)
    if places <= 4 and largest < 1e5:
        shown = [f"{v:.{max(0, places)}f}" for v in values]
        return [s.removeprefix("-") if not s.strip("-0.") else s for s in shown]
    digits = max(0, places + math.floor(math.log10(largest))) if largest else 0
    shown = [f"{v:.{digits}e}".split("e") for v in values]
    return [f"{mantissa}e{int(power)}" if v else "0" for v, (mantissa, power) in zip(values, shown, strict=True)]


def colour_bar(image: np.ndarray, near: float, far: float, colormap: str = "turbo") -> None:
    """Draws the colour bar of `depth_colors` at the right of `image` `(h, w, 3)`, with round depths [m] marked.

    An image too small for it is not changed.
    """
    height, width = image.shape[:2]
    size = crisp(0.9 * text_size(height))
    margin, across, _, line = spacing(size)
    length, thick, dash, hair = round(0.5 * height), round(0.8 * size), round(0.45 * size), max(1, round(size / 12))
    marks, step = ticks(near, far, (far - near) * max(1.5 * line / length, 0.12))
    labels = [letters(text) for text in figures(marks, step)]
    unit = " m"  # on the uppermost mark only
    right = thick + round(1.7 * dash) + max((width_of(label, size) for label in labels), default=0)  # end of the labels

    box = 2 * across + math.ceil(right + width_of(unit, size)), length + 2 * (line // 2)
    if box[0] > width - 2 * margin or box[1] > height - 2 * margin:
        return

    x, y = width - margin - box[0], (height - box[1]) // 2
    plate(image, (x, y, *box), round(0.35 * size))
    x, y = x + across, y + line // 2
    blend(image, np.full((length + 2 * hair, thick + 2 * hair), 90, np.uint8), x - hair, y - hair, INK)
    shades = np.linspace(255, 0, length).round().astype(int)
    image[y : y + length, x : x + thick] = colormap_table(colormap)[shades][:, None]

    for row, (mark, label) in enumerate(zip(marks, labels, strict=True)):
        v = y + 0.5 + (far - mark) / (far - near) * (length - 1)
        top = min(y + length - hair, max(y, round(v - hair / 2)))
        blend(image, np.full((hair, dash), 230, np.uint8), x + thick + hair - dash // 2, top, INK)
        write(image, label, (x + right, baseline(top, hair, size)), size, align=1.0)
        if row == len(labels) - 1:
            write(image, unit, (x + right, baseline(top, hair, size)), size)


def legend(image: np.ndarray, segments: Sequence[Segment], colors: np.ndarray, corner: str = "bottom-left") -> None:
    """Lists `segments` in a corner of `image` `(h, w, 3)`, each beside its colour, a row of `colors` `(n, 3)`.

    As many as fit in 60 % of the height and 40 % of the width; the last line gives the number of the others.
    """
    height, width = image.shape[:2]
    size = crisp(0.86 * text_size(height))
    margin, across, down, line = spacing(size)
    swatch, gap = round(0.75 * size), round(0.45 * size)
    rows = int(0.6 * height - 2 * (margin + down)) // line
    room = 0.4 * width - 2 * across - swatch - gap
    shown = len(segments) if len(segments) <= rows else rows - 1
    names = [fitted(letters(segment.name), size, room) for segment in segments[: max(0, shown)]]
    if not any(names):
        return
    more = fitted(letters(f"… {len(segments) - shown} more"), size, room) if shown < len(segments) else ""
    texts = [*names, more] if more else names

    box = (
        2 * across + swatch + gap + math.ceil(max(width_of(text, size) for text in texts)),
        2 * down + line * len(texts),
    )
    x, y = place(image, *box, corner, margin)
    plate(image, (x, y, *box), round(0.35 * size))

    for row, text in enumerate(texts):
        top = y + down + row * line
        if row < shown:
            red, green, blue = map(int, colors[row])
            mark = rounded(swatch, swatch, round(0.2 * size))
            blend(image, mark, x + across, top + (line - swatch) // 2, (red, green, blue))
        write(image, text, (x + across + swatch + gap, baseline(top, line, size)), size)
