"""Encodes OpenEXR with one channel of float32, bit for bit: Pillow cannot, and ffmpeg would need a process per image.

The layout is that of "OpenEXR File Layout" (openexr.com), version 2: a single part of scan lines, compressed by ZIP.
"""

import struct
import zlib
from collections.abc import Mapping

import numpy as np

MAGIC = struct.pack("<ii", 20000630, 2)
ZIP = 3
BLOCK_LINES = 16  # in a block of ZIP compression
FLOAT = 2


def encode_exr(values: np.ndarray, tags: Mapping[str, str] | None = None, channel: str = "Y") -> bytes:
    """A file of `values` `(h, w)` float32, infinities and NaN included.

    Args:
      tags: texts, stored as attributes of these names, in UTF-8.
      channel: its name. ffmpeg reads a single channel if it is called `Y`, but not `Z`.
    """
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
    halves = np.concatenate([raw[::2], raw[1::2]])  # bytes of like meaning lie together, and differ little
    steps = halves.copy()
    steps[1:] = halves[1:] - halves[:-1] + 128
    packed = zlib.compress(steps.tobytes())
    data = packed if len(packed) < raw.size else raw.tobytes()
    return struct.pack("<ii", y, len(data)) + data
