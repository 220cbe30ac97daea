"""Encoders of images: the functions that the declarations in `image_format` name.

Depth and segmentation become whole numbers in images of 16 bits. Pillow is imported by the encoders that need it.
"""

import io
import struct
import zlib
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError

if TYPE_CHECKING:
    from PIL import Image

UINT16_MAX = 65535
BLACK = bytes(3)
MAGIC = struct.pack("<ii", 20000630, 2)  # of OpenEXR, as the constants below
ZIP = 3
BLOCK_LINES = 16  # in a block of ZIP compression
FLOAT = 2
CHANNEL = b"Y"  # which ffmpeg reads, unlike `Z`


@dataclass(frozen=True)
class ImageData:
    """The content of an image file.

    Attributes:
      pixels: rgb `(h, w, 3)` uint8, depth `(h, w)` float32 [m] or ids `(h, w)` int32.
      segments: number of segments that the ids distinguish.
      colours: colours of the segments, `(n, 3)` uint8.
      tags: texts to embed where the format can hold them.
    """

    pixels: np.ndarray
    segments: int
    colours: np.ndarray | None
    tags: Mapping[str, str]


def png(image: ImageData) -> bytes:
    """Returns a PNG of colours, of depth in millimetres, or of segment numbers, both uint16."""
    pixels = image.pixels
    if pixels.dtype == np.float32:
        pixels = depth_millimetres(pixels)
    elif pixels.dtype == np.int32:
        pixels = segment_numbers(pixels, image.segments)
    return _png(pixels, image.tags)


def jpeg(image: ImageData) -> bytes:
    """Returns a JPEG of quality 95, without subsampling of colour."""
    return _saved(image.pixels, "JPEG", quality=95, subsampling=0)


def webp(image: ImageData) -> bytes:
    """Returns a lossless WebP."""
    return _saved(image.pixels, "WEBP", lossless=True)


def tiff(image: ImageData) -> bytes:
    """Returns a TIFF of colours, or of metres as float32."""
    description = image.tags.get("description", "")
    return _saved(image.pixels, "TIFF", compression="tiff_adobe_deflate", description=description)


def palette_png(image: ImageData) -> bytes:
    """Returns a PNG of segment numbers with a palette."""
    from PIL import Image

    if image.colours is None:
        raise ValueError("a palette needs colours")
    indexed = Image.fromarray((image.pixels + 1).astype(np.uint8))
    # Filled up to 256: Pillow would pack the pixels of a shorter palette into fewer bits.
    indexed.putpalette((BLACK + image.colours.tobytes()).ljust(3 * 256, b"\0"))
    return _png(indexed, image.tags)


def npy(image: ImageData) -> bytes:
    """Returns an .npy file of the pixels."""
    buffer = io.BytesIO()
    np.save(buffer, np.ascontiguousarray(image.pixels), allow_pickle=False)
    return buffer.getvalue()


def exr(image: ImageData) -> bytes:
    """Returns an OpenEXR file of metres."""
    return encode_exr(image.pixels, image.tags)


def _png(image: "np.ndarray | Image.Image", tags: Mapping[str, str]) -> bytes:
    from PIL import PngImagePlugin

    chunks = PngImagePlugin.PngInfo()
    for name, text in tags.items():
        chunks.add_itxt(name.capitalize(), text)  # the keywords that PNG defines: Title, Comment, Description
    return _saved(image, "PNG", pnginfo=chunks)


def _saved(image: "np.ndarray | Image.Image", kind: str, **settings: object) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    (image if isinstance(image, Image.Image) else Image.fromarray(image)).save(buffer, kind, **settings)
    return buffer.getvalue()


def depth_millimetres(depth: np.ndarray) -> np.ndarray:
    """Returns `depth` [m], rounded to millimetres, as uint16; 0 for the background, where depth is not finite.

    Everything else is clipped to the range from 1 to 65535; see `clipped_share`.
    """
    seen = np.isfinite(depth)
    rounded = np.clip(_round_millimetres(np.where(seen, depth, 0)), 1, UINT16_MAX)
    return np.where(seen, rounded, 0).astype(np.uint16)


def clipped_share(depth: np.ndarray) -> float:
    """Returns the share of finite pixels of `depth` [m] beyond 65.535 m, the range of `depth_millimetres`."""
    seen = depth[np.isfinite(depth)]
    return float(np.mean(_round_millimetres(seen) > UINT16_MAX)) if seen.size else 0.0


def _round_millimetres(depth: np.ndarray) -> np.ndarray:
    return np.rint(depth.astype(np.float64) * 1000)


def segment_numbers(ids: np.ndarray, count: int) -> np.ndarray:
    """Returns `ids` of `count` segments plus one, as uint16; 0 for the background.

    Raises:
      UsageError: there are more segments than 16 bits can number.
    """
    check_segment_count(count, UINT16_MAX)
    return (ids + 1).astype(np.uint16)


def check_segment_count(count: int, most: int) -> None:
    """Raises UsageError if an image cannot number `count` segments."""
    if count > most:
        raise UsageError(f"a segmentation of {count} objects does not fit in an image that can hold at most {most}")


def encode_exr(values: np.ndarray, tags: Mapping[str, str] | None = None) -> bytes:
    """Returns an OpenEXR file of `values` `(h, w)` float32, infinities and NaN included.

    Args:
      tags: texts, stored as attributes of these names, in UTF-8.
    """
    height, width = values.shape
    lines = np.ascontiguousarray(values, "<f4").view(np.uint8).reshape(height, -1)
    blocks = [_block(y, lines[y : y + BLOCK_LINES].ravel()) for y in range(0, height, BLOCK_LINES)]
    head = MAGIC + _header(width, height, tags or {})
    sizes = [len(head) + 8 * len(blocks), *map(len, blocks)]
    return b"".join([head, np.cumsum(sizes, dtype="<u8")[:-1].tobytes(), *blocks])


def _header(width: int, height: int, tags: Mapping[str, str]) -> bytes:
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    required = [
        ("channels", "chlist", CHANNEL + b"\0" + struct.pack("<iB3xii", FLOAT, 0, 1, 1) + b"\0"),
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
    """Returns a chunk of the file: its first line, its size, and its bytes, compressed if that is shorter."""
    halves = np.concatenate([raw[::2], raw[1::2]])  # bytes with the same role are adjacent, and differ little
    steps = halves.copy()
    steps[1:] = halves[1:] - halves[:-1] + 128
    packed = zlib.compress(steps.tobytes())
    data = packed if len(packed) < raw.size else raw.tobytes()
    return struct.pack("<ii", y, len(data)) + data
