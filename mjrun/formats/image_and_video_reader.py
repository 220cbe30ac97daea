"""Reads images and videos: colours, and the numbers of depth and segmentation.

A video is read one frame at a time, or as an array.
"""

import contextlib
import math
import traceback
import warnings
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
from PIL import Image, ImageSequence

from mjrun.decompression_limits import require_expandable
from mjrun.errors import FileError, UnknownNameError, UsageError, clean
from mjrun.formats import codecs, ffmpeg, npy_reader
from mjrun.formats.input_file import decoding, require_file

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".tiff", ".tif", ".npy", ".exr")
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
    require_file(path, "image", IMAGE_SUFFIXES)
    suffix = path.suffix.lower()
    if suffix not in IMAGE_SUFFIXES:
        raise UnknownNameError("image format", suffix, IMAGE_SUFFIXES, where=str(path))
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


ANIMATIONS = (".gif", ".apng", ".webp")  # read by Pillow, which knows how long each frame lasts
RAW = ".rgb"  # pixels only: the file does not hold their size
SEVERAL = 1.5  # duration of a frame that replaces several, relative to the shortest one
ROUNDED = 1.0  # largest difference of the errors of times [ms]
USUAL_RATES = (*range(1, 101), 24000 / 1001, 30000 / 1001, 60000 / 1001)  # frames per second
BYTES_OF_PIXEL = 3  # of a decoded frame, at most


def read_video(path: str | Path) -> "VideoReader":
    """Opens a video: iterate over it for one frame at a time, or get all of them as `.frames`.

    Raises:
      FileError: the file does not exist, or cannot be decoded.
      UsageError: the format can be written, but not read.
    """
    return VideoReader(Path(path))


class VideoReader:
    """A reader of the frames of a video.

    Each iteration decodes the file again and holds one frame at a time: uint8 `(height, width, 3)`, or uint16
    `(height, width)` for a video of 16-bit numbers.

    Attributes:
      fps: frames per second, as the file states. Frames of an animation that last several times as long as its
        shortest ones are repeated.
      size: width and height [pixels].
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._suffix = path.suffix.lower()
        require_file(path, "video", codecs.suffixes())
        if self._suffix == RAW:
            raise UsageError(
                f"{clean(str(path))}: mjrun writes {RAW} videos, but cannot read them: they do not contain their size"
            )
        self._repeats: list[int] = []
        self._is_numbers = False
        with self._decoding():
            if self._suffix in ANIMATIONS:
                self.fps, self.size = self._read_animation()
            else:
                with contextlib.closing(self._ffmpeg_frames()) as frames:
                    properties = next(frames)
                self.fps, self.size = float(properties["fps"]), tuple[int, int](properties["size"])
                self._is_numbers = properties["pix_fmt"].startswith("gray16")
                require_expandable(path, math.prod(self.size) * BYTES_OF_PIXEL)

    @property
    def frames(self) -> np.ndarray:
        """All frames, `(n, height, width, 3)` uint8 or `(n, height, width)` uint16.

        Raises:
          FileError: the file cannot be decoded.
        """
        return np.stack(list(self))

    def __iter__(self) -> Iterator[np.ndarray]:
        decode = self._animation if self._suffix in ANIMATIONS else self._numbers if self._is_numbers else self._colours
        frames = decode()
        while True:
            with self._decoding():
                frame = next(frames, None)
            if frame is None:
                return
            yield frame

    def _colours(self) -> Iterator[np.ndarray]:
        options, _ = ffmpeg.source(self._path, self._suffix[1:])
        import imageio.v3 as iio  # slow to import, and not needed for images

        # An absolute path, as imageio takes other names for addresses.
        yield from iio.imiter(self._path.absolute(), plugin="FFMPEG", input_params=options)

    def _numbers(self) -> Iterator[np.ndarray]:
        """Yields frames of 16-bit numbers, which imageio would turn into colours."""
        with contextlib.closing(self._ffmpeg_frames("gray16le", 16)) as frames:
            next(frames)  # the properties
            for content in frames:
                yield np.frombuffer(content, "<u2").astype(np.uint16).reshape(self.size[::-1])

    def _ffmpeg_frames(self, pixels: str = "rgb24", bits: int = 24) -> Generator[Any, None, None]:
        """Yields the properties of the video, and then the bytes of each frame."""
        options, name = ffmpeg.source(self._path, self._suffix[1:])
        return imageio_ffmpeg.read_frames(name, pix_fmt=pixels, bits_per_pixel=bits, input_params=options)

    def _animation(self) -> Iterator[np.ndarray]:
        with open_image(self._path) as file:
            for repeats, frame in zip(self._repeats, ImageSequence.Iterator(file), strict=True):
                for _ in range(repeats):
                    yield np.array(frame.convert("RGB"))

    def _read_animation(self) -> tuple[float, tuple[int, int]]:
        durations = []  # [ms]
        with open_image(self._path) as file:
            for frame in ImageSequence.Iterator(file):
                frame.load()  # sets the duration
                durations.append(float(frame.info.get("duration", 0)))
            size = file.size
        if min(durations) <= 0:
            raise ValueError("a frame has no duration")
        period = _period(durations)
        self._repeats = [round(duration / period) for duration in durations]
        return 1000 * sum(self._repeats) / sum(durations), size

    @contextlib.contextmanager
    def _decoding(self) -> Iterator[None]:
        try:
            with decoding(self._path):
                yield
        except FileError as error:
            if error.__cause__:  # the stack frames of imageio-ffmpeg keep pipes open
                with warnings.catch_warnings(action="ignore"):
                    traceback.clear_frames(error.__cause__.__traceback__)
            raise


def _period(durations: Sequence[float]) -> float:
    """Returns the time from one frame to the next [ms] of an animation, whose long frames replace several equal ones.

    Files round times to milliseconds, too roughly to count the frames of a long rest. If all times are those of a usual
    rate, it is meant.
    """
    short = [duration for duration in durations if duration < SEVERAL * min(durations)]
    mean = sum(short) / len(short)
    starts = np.cumsum([0, *durations[:-1]])

    def explains(period: float) -> bool:
        counts = np.cumsum([0, *(round(duration / period) for duration in durations[:-1])])
        return bool(np.ptp(counts * period - starts) <= ROUNDED)

    near = (1000 / rate for rate in USUAL_RATES if abs(1000 / rate - mean) < ROUNDED)
    return min(filter(explains, near), key=lambda period: abs(period - mean), default=mean)
