"""Reads images: colours, and the numbers of depth and segmentation."""

import math
from pathlib import Path

import numpy as np
from PIL import Image

from mjrun.decompression_limits import require_expandable
from mjrun.errors import FileError, UnknownNameError
from mjrun.formats import ffmpeg, npy_reader
from mjrun.formats.input_file import decoding, require_file

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".tiff", ".tif", ".npy", ".exr")
# Decoders of Pillow by suffix: it would otherwise choose one by the content, and start Ghostscript on PostScript.
DECODERS = {
    ".png": "PNG",
    ".jpg": "JPEG",
    ".jpeg": "JPEG",
    ".webp": "WEBP",
    ".tiff": "TIFF",
    ".tif": "TIFF",
    ".gif": "GIF",
    ".apng": "PNG",
}
PIXEL = 4  # most bytes of a pixel in memory
NUMBERS = ("I", "F")  # first letters of the modes of Pillow whose pixels have more than 8 bits


def read_image(path: str | Path, *, indices: bool = False) -> np.ndarray:
    """Reads an image.

    Args:
      indices: whether to read the indices of a palette, such as segment numbers, instead of its colours.

    Returns:
      Colours, uint8 `(height, width, 3)`, with a fourth channel if the image is translucent; or numbers
      `(height, width)` of the type in the file: metres, millimetres, segments.

    Raises:
      FileError: the file does not exist, or cannot be decoded.
      UnknownNameError: images with this suffix cannot be read.
    """
    path = Path(path)
    require_file(path, "image", SUFFIXES)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise UnknownNameError("image format", suffix, SUFFIXES, where=str(path))
    with decoding(path):
        if suffix == ".npy":
            return _npy(path)
        return _exr(path) if suffix == ".exr" else _picture(path, indices)


def read_palette(path: str | Path) -> bytes:
    """Returns the palette of an image whose pixels are indices into it; empty for any other."""
    path = Path(path)
    if path.suffix.lower() != ".png":
        return b""
    with decoding(path), open_image(path) as image:
        return bytes(image.getpalette() or b"") if image.mode == "P" else b""


def open_image(path: Path) -> Image.Image:
    """Opens an image or an animation in the format of its suffix, one of `DECODERS`.

    Raises:
      FileError: it would need far more memory than its size on disk suggests.
    """
    image = Image.open(path, formats=[DECODERS[path.suffix.lower()]])
    try:
        require_expandable(path, math.prod(image.size) * PIXEL)
    except FileError:
        image.close()
        raise
    return image


def _picture(path: Path, indices: bool) -> np.ndarray:
    with open_image(path) as image:
        if image.mode.startswith(NUMBERS) or (indices and image.mode == "P"):
            return np.array(image)
        return np.array(image.convert("RGBA" if image.has_transparency_data else "RGB"))


def _npy(path: Path) -> np.ndarray:
    with path.open("rb") as file:
        shape, by_column, dtype = npy_reader.read_header(file)
        if dtype.kind not in npy_reader.NUMERIC:
            raise ValueError(f"it holds {npy_reader.content_name(dtype)}, not numbers")
        if len(shape) != 2 and not (len(shape) == 3 and shape[2] in (3, 4) and dtype == np.uint8):
            raise ValueError(f"it has the shape {shape}, not (height, width)")
        values = np.frombuffer(file.read(), dtype)
    return values.reshape(shape, order="F" if by_column else "C")


def _exr(path: Path) -> np.ndarray:
    """Reads one channel of float32 with ffmpeg, which decodes every bit, and states the size in a PFM header."""
    options, name = ffmpeg.source(path, "exr")
    line = (*options, "-i", name, "-frames:v", "1", "-pix_fmt", "grayf32le", "-f", "image2pipe", "-c:v", "pfm", "-")
    done = ffmpeg.run(*line)
    kind, size, scale, *_ = [*done.stdout.split(b"\n", 3), b"", b"", b""]
    if kind != b"Pf":
        raise ValueError(done.log.strip() or "ffmpeg cannot decode it")
    width, height = map(int, size.split())
    values = np.frombuffer(done.stdout[-4 * width * height :], "<f4" if scale.startswith(b"-") else ">f4")
    return values.reshape(height, width)[::-1].astype(np.float32)  # PFM begins at the bottom
