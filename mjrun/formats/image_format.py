"""The image formats: one table of what each view can be saved as, and what the name of an output means in it.

| view  | format  | suffix         | holds                                                                       |
|-------|---------|----------------|-----------------------------------------------------------------------------|
| rgb   | png     | `.png`         | the pixels                                                                  |
|       | jpeg    | `.jpg .jpeg`   | nearly the pixels: quality 95, colour at full size                          |
|       | webp    | `.webp`        | the pixels                                                                  |
|       | tiff    | `.tiff .tif`   | the pixels                                                                  |
| depth | png     | `.png`         | millimetres to the nearest, uint16, 1 to 65535; 0 where nothing is seen     |
|       | npy     | `.npy`         | metres, float32; infinite where nothing is seen                             |
|       | exr     | `.exr`         | the same, channel `Y`                                                       |
|       | tiff    | `.tiff .tif`   | the same                                                                    |
| seg   | png     | `.png`         | index in the legend + 1, uint16; 0 where nothing is seen; labels            |
|       | palette | `.png`         | the same in 8 bits with a colour for each, at most 255 segments; labels     |
|       | npy     | `.npy`         | index in the legend, int32; −1 where nothing is seen; labels                |
|       | coco    | `.json`        | masks of one or more images, see `coco`                                     |

Labels are a second file, `NAME.labels.json`, published with the image; on standard output there are none.

Encoders import numpy and Pillow when they are called, so that help, which lists the suffixes, loads neither.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.errors import UnknownNameError, UsageError, clean, option

if TYPE_CHECKING:
    import numpy as np
    from PIL import Image

CONTENTS = {"rgb": "colours", "depth": "exact depth", "seg": "exact segmentation"}
BLACK = bytes(3)
MAGIC = struct.pack("<ii", 20000630, 2)
ZIP = 3
BLOCK_LINES = 16  # in a block of ZIP compression
FLOAT = 2
DRAWINGS = ("svg", "pdf")  # each with the suffix of its name


@dataclass(frozen=True)
class ImageData:
    """What an image file is encoded from.

    Attributes:
      pixels: rgb `(h, w, 3)` uint8, depth `(h, w)` float32 [m] or ids `(h, w)` int32.
      segments: how many segments the ids tell apart.
      colours: of the segments, `(n, 3)` uint8.
      tags: texts to embed where the format can hold them.
    """

    pixels: np.ndarray
    segments: int
    colours: np.ndarray | None
    tags: Mapping[str, str]


@dataclass(frozen=True)
class ImageFormat:
    """An image format of one view.

    Attributes:
      suffixes: those of its files, the usual one first.
      encode: makes the file; None for a document of any number of images.
      largest: pixels a side, if it has a limit.
      segments: how many it tells apart, if it has a limit.
      nothing: its value where nothing is seen, if labels go with it.
      clipped: the share of what is seen in the pixels that is beyond its range.
    """

    suffixes: Sequence[str]
    encode: Callable[[ImageData], bytes] | None
    largest: int | None = None
    segments: int | None = None
    nothing: int | None = None
    clipped: Callable[[np.ndarray], float] = lambda pixels: 0.0


def _rgb_png(image: ImageData) -> bytes:
    return _png(image.pixels, image.tags)


def _jpeg(image: ImageData) -> bytes:
    return _saved(image.pixels, "JPEG", quality=95, subsampling=0)


def _webp(image: ImageData) -> bytes:
    return _saved(image.pixels, "WEBP", lossless=True)


def _tiff(image: ImageData) -> bytes:
    description = image.tags.get("description", "")
    return _saved(image.pixels, "TIFF", compression="tiff_adobe_deflate", description=description)


def _millimetre_png(image: ImageData) -> bytes:
    from mjrun.formats.uint16_pixels import depth_millimetres

    return _png(depth_millimetres(image.pixels), image.tags)


def _clipped_share(pixels: np.ndarray) -> float:
    from mjrun.formats.uint16_pixels import clipped_share

    return clipped_share(pixels)


def _exr(image: ImageData) -> bytes:

    return encode_exr(image.pixels, image.tags)


def _npy(image: ImageData) -> bytes:
    import numpy as np

    buffer = io.BytesIO()
    np.save(buffer, image.pixels, allow_pickle=False)
    return buffer.getvalue()


def _id_png(image: ImageData) -> bytes:
    from mjrun.formats.uint16_pixels import segment_numbers

    return _png(segment_numbers(image.pixels, image.segments), image.tags)


def _palette_png(image: ImageData) -> bytes:
    if image.colours is None:
        raise ValueError("a palette needs colours")
    import numpy as np
    from PIL import Image

    indexed = Image.fromarray((image.pixels + 1).astype(np.uint8))
    # Filled up to 256: Pillow would pack the pixels of a shorter palette into fewer bits.
    indexed.putpalette((BLACK + image.colours.tobytes()).ljust(3 * 256, b"\0"))
    return _png(indexed, image.tags)


def _png(image: np.ndarray | Image.Image, tags: Mapping[str, str]) -> bytes:
    from PIL import PngImagePlugin

    chunks = PngImagePlugin.PngInfo()
    for name, text in tags.items():
        chunks.add_itxt(name.capitalize(), text)  # the keywords that PNG defines: Title, Comment, Description
    return _saved(image, "PNG", pnginfo=chunks)


def _saved(image: np.ndarray | Image.Image, kind: str, **settings: object) -> bytes:
    from PIL import Image

    buffer, picture = io.BytesIO(), image if isinstance(image, Image.Image) else Image.fromarray(image)
    picture.save(buffer, kind, **settings)
    return buffer.getvalue()


FORMATS = {
    "rgb": {
        "png": ImageFormat((".png",), _rgb_png),
        "jpeg": ImageFormat((".jpg", ".jpeg"), _jpeg, largest=65500),
        "webp": ImageFormat((".webp",), _webp, largest=16383),
        "tiff": ImageFormat((".tiff", ".tif"), _tiff),
    },
    "depth": {
        "png": ImageFormat((".png",), _millimetre_png, clipped=_clipped_share),
        "npy": ImageFormat((".npy",), _npy),
        "exr": ImageFormat((".exr",), _exr),
        "tiff": ImageFormat((".tiff", ".tif"), _tiff),
    },
    "seg": {
        "png": ImageFormat((".png",), _id_png, segments=2**16 - 1, nothing=0),
        "palette": ImageFormat((".png",), _palette_png, segments=255, nothing=0),
        "npy": ImageFormat((".npy",), _npy, nothing=-1),
        "coco": ImageFormat((".json",), None),
    },
}


def suffixes(view: str) -> list[str]:
    """The suffixes of images that can hold `view`."""
    return list(dict.fromkeys(suffix for known in FORMATS[view].values() for suffix in known.suffixes))


def image_format(output: str | None, view: str, format: str | None = None, hint: str = "") -> str:  # noqa: A002
    """The name in `FORMATS[view]` of the format meant by the suffix of `output` or by the option `format`.

    A suffix of several formats means the first; `format` may be a suffix without its dot.

    Args:
      output: a file, or None for standard output, which is png by default.
      hint: what else the user can do if the view cannot be held.

    Raises:
      UnknownNameError: there is no such view, format or suffix; the message lists those there are.
      UsageError: the format cannot hold the view, or the suffix is that of another format.
    """
    if view not in FORMATS:
        raise UnknownNameError("view", view, list(FORMATS))
    named = None if format is None else _named(format, view, hint)
    if output is None:
        return named or "png"

    suffix = Path(output).suffix.lower()
    meant = [name for name, known in FORMATS[view].items() if suffix in known.suffixes]
    if named and (named in meant or not _is_known(suffix)):
        return named
    if named:
        raise UsageError(f"{option('format')} {named} and the suffix of {clean(output)} disagree")
    if not meant and _is_known(suffix):
        raise _cannot_hold(f"{clean(output)}: a {suffix}", view, suffixes(view), hint)
    if not meant:
        raise UnknownNameError("image format", suffix, suffixes(view), where=output)
    return meant[0]


def _named(name: str, view: str, hint: str) -> str:
    for known, form in FORMATS[view].items():
        if name == known or f".{name}" in form.suffixes:
            return known
    if any(name in known for known in FORMATS.values()) or _is_known(f".{name}"):
        raise _cannot_hold(f"{option('format')} {name}", view, list(FORMATS[view]), hint)
    raise UnknownNameError("format", name, list(FORMATS[view]))


def _is_known(suffix: str) -> bool:
    return any(suffix in suffixes(view) for view in FORMATS)


def _cannot_hold(what: str, view: str, valid: Sequence[str], hint: str) -> UsageError:
    return UsageError(f"{what} cannot hold {CONTENTS[view]}\n{', '.join(valid)} can" + (f"\n{hint}" if hint else ""))


def encode_exr(values: np.ndarray, tags: Mapping[str, str] | None = None, channel: str = "Y") -> bytes:
    """A file of `values` `(h, w)` float32, infinities and NaN included.

    Args:
      tags: texts, stored as attributes of these names, in UTF-8.
      channel: its name. ffmpeg reads a single channel if it is called `Y`, but not `Z`.
    """
    import numpy as np

    height, width = values.shape
    lines = np.ascontiguousarray(values, "<f4").view(np.uint8).reshape(height, -1)
    blocks = [_block(y, lines[y : y + BLOCK_LINES].ravel()) for y in range(0, height, BLOCK_LINES)]
    head = MAGIC + _header(width, height, channel, tags or {})
    sizes = [len(head) + 8 * len(blocks), *map(len, blocks)]
    return b"".join([head, np.cumsum(sizes, dtype="<u8")[:-1].tobytes(), *blocks])


def _header(width: int, height: int, channel: str, tags: Mapping[str, str]) -> bytes:
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    required = [
        ("channels", "chlist", channel.encode() + b"\0" + struct.pack("<iB3xii", FLOAT, 0, 1, 1) + b"\0"),
        ("compression", "compression", bytes([ZIP])),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", 1)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1)),
    ]
    texts = [(name, "string", text.encode("utf-8", "replace")) for name, text in tags.items()]
    attributes = [
        f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value for name, kind, value in required + texts
    ]
    return b"".join(attributes) + b"\0"


def _block(y: int, raw: np.ndarray) -> bytes:
    """A chunk of the file: its first line, its size, and its bytes compressed, or as they are if that is shorter."""
    import numpy as np

    halves = np.concatenate([raw[::2], raw[1::2]])  # bytes of like meaning lie together, and differ little
    steps = halves.copy()
    steps[1:] = halves[1:] - halves[:-1] + 128
    packed = zlib.compress(steps.tobytes())
    data = packed if len(packed) < raw.size else raw.tobytes()
    return struct.pack("<ii", y, len(data)) + data


def figure_suffixes() -> list[str]:
    """The suffixes of figures."""
    return [*suffixes("rgb"), *(f".{name}" for name in DRAWINGS)]


def figure_format(output: str | None, format: str | None = None) -> str:  # noqa: A002
    """The name of the format meant by the suffix of `output` or by the option `format`.

    Args:
      output: a file, or None for standard output, which is png by default.

    Raises:
      UnknownNameError: there is no such format or suffix; the message lists those there are.
      UsageError: the format cannot hold a figure, or the suffix is that of another format.
    """
    suffix = "" if output is None else Path(output).suffix.lower()
    by_suffix = suffix[1:] if suffix[1:] in DRAWINGS else None
    named = format.lower().removeprefix(".") if format is not None else None
    if named in DRAWINGS or (by_suffix and named is None):
        drawing = named or by_suffix
        if suffix in figure_suffixes() and drawing != by_suffix:
            raise UsageError(f"{option('format')} {drawing} and the suffix of {clean(str(output))} disagree")
        assert drawing
        return drawing
    if by_suffix:
        raise UsageError(f"{option('format')} {clean(str(format))} and the suffix of {clean(str(output))} disagree")
    try:
        return image_format(output, "rgb", format)
    except UnknownNameError as error:
        where = f"{option('format')} {error.name}" if error.name == format else clean(str(output))
        raise UnknownNameError("figure format", error.name, figure_suffixes(), where=where) from None
