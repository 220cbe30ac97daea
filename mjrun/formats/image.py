"""Still pictures: the pixels of one view in, one published picture out, in the format that its suffix means."""

import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from PIL import Image, PngImagePlugin

from mjrun.errors import BadValueError, ClosedPipeError, FileError, clean
from mjrun.formats.coco import Coco
from mjrun.formats.exr import exr
from mjrun.formats.image_format import FORMATS, Format
from mjrun.formats.labels import labels, labels_beside
from mjrun.formats.publishing import Completable, Destination, StagedFile, StandardOutput
from mjrun.model.rendered_view import Segment
from mjrun.model.uint16_pixels import check_segment_count, depth_millimetres, segment_numbers

NOTHING = np.zeros((1, 3), np.uint8)  # black, the first colour of a palette

# What a view's pixels are: their shape after height and width, and their type.
PIXELS = {"rgb": ((3,), np.uint8), "depth": ((), np.float32), "seg": ((), np.int32)}


@dataclass(frozen=True)
class Still:
    """What goes into one file.

    Attributes:
      pixels: of the view, as in `RenderedView`.
      things: how many the ids tell apart.
      colours: of the things, `(n, 3)` uint8.
      tags: texts to embed where the format can hold them.
    """

    pixels: np.ndarray
    things: int
    colours: np.ndarray | None
    tags: Mapping[str, str]


def _rgb_png(still: Still) -> bytes:
    return _png(Image.fromarray(still.pixels), still.tags)


def _jpeg(still: Still) -> bytes:
    return _saved(Image.fromarray(still.pixels), "JPEG", quality=95, subsampling=0)


def _webp(still: Still) -> bytes:
    return _saved(Image.fromarray(still.pixels), "WEBP", lossless=True)


def _tiff(still: Still) -> bytes:
    about = still.tags.get("description", "")
    return _saved(Image.fromarray(still.pixels), "TIFF", compression="tiff_adobe_deflate", description=about)


def _millimetre_png(still: Still) -> bytes:
    return _png(Image.fromarray(depth_millimetres(still.pixels)), still.tags)


def _exr(still: Still) -> bytes:
    return exr(still.pixels, still.tags)


def _npy(still: Still) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, still.pixels, allow_pickle=False)
    return buffer.getvalue()


def _id_png(still: Still) -> bytes:
    return _png(Image.fromarray(segment_numbers(still.pixels, still.things)), still.tags)


def _palette_png(still: Still) -> bytes:
    if still.colours is None:
        raise ValueError("a palette needs colours")
    image = Image.fromarray((still.pixels + 1).astype(np.uint8))
    # Filled up to 256: Pillow would pack the pixels of a shorter palette into fewer bits.
    image.putpalette(np.concatenate([NOTHING, still.colours]).tobytes().ljust(3 * 256, b"\0"))
    return _png(image, still.tags)


ENCODERS: dict[str, dict[str, Callable[[Still], bytes]]] = {
    "rgb": {"png": _rgb_png, "jpeg": _jpeg, "webp": _webp, "tiff": _tiff},
    "depth": {"png": _millimetre_png, "npy": _npy, "exr": _exr, "tiff": _tiff},
    "seg": {"png": _id_png, "palette": _palette_png, "npy": _npy},
}


class ImageWriter(Completable):
    """Writes one picture; in a `coco` document, any number of them. Nothing is published until `publish`.

    Opening it proves that the output can be written. Leave the context without `publish` and no trace
    of the picture is left; on standard output, what is written is written.

    Args:
      output: a file, or None for standard output.
      view: `rgb` for colours of any origin, `depth` or `seg`.
      format: a name from `image_format`.
      size: width and height [pixels].
      tags: title, comment and description, embedded in PNG and EXR; TIFF holds the description only.

    Attributes:
      clipped: the share of what is seen that lies farther than the format can say, once written.

    Raises:
      FileError: the output, or the labels beside it, cannot be written.
      BadValueError: the format cannot hold so large a picture.
    """

    def __init__(
        self,
        output: str | None,
        view: str,
        format: str,  # noqa: A002
        size: tuple[int, int],
        tags: Mapping[str, str] | None = None,
    ) -> None:
        self.clipped = 0.0
        self._view, self._name, self._size = view, format, size
        self._format = FORMATS[view][format]
        self._tags = {name: clean(text) for name, text in (tags or {}).items()}
        self._coco, self._written = Coco(), 0
        largest = self._format.largest
        if largest and max(size) > largest:
            raise BadValueError("--size", f"{size[0]}x{size[1]}", f"at most {largest} a side, as {format} holds")
        with ExitStack() as opened:
            self._target, self._labels = _targets(output, self._format, opened)
            self._opened = opened.pop_all()

    def check_things(self, count: int) -> None:
        """Raises UsageError when the format cannot tell so many things apart; `write` looks, too."""
        if self._format.things is not None:
            check_segment_count(count, self._format.things)

    def write(
        self,
        pixels: np.ndarray,
        legend: Sequence[Segment] = (),
        colours: np.ndarray | None = None,
        image: Mapping[str, Any] | None = None,
    ) -> None:
        """Writes the picture.

        Args:
          pixels: of the view: rgb `(h, w, 3)` uint8, depth `(h, w)` float32 [m], ids `(h, w)` int32.
          legend: what ids mean.
          colours: of the legend, `(n, 3)` uint8, for labels and a palette.
          image: what a COCO document says of the image: `file_name`, and anything else such as `camera` and `time`.

        Raises:
          UsageError: the format cannot tell so many things apart.
          FileError: the disk is full.
          ClosedPipeError: whoever read standard output is gone.
        """
        self._check(pixels, legend, colours)
        self.check_things(len(legend))
        self._written += 1
        if self._format.several:
            stem = self._target.shown.stem if self._target.stdout is None else "image"
            self._coco.add(pixels, legend, {"file_name": f"{stem}.png", **(image or {})})
            return
        if self._written > 1:
            raise ValueError(f"{self._name} holds one picture")
        self.clipped = self._format.clipped(pixels)
        _put(self._target, ENCODERS[self._view][self._name](Still(pixels, len(legend), colours, self._tags)))
        if self._labels and self._format.nothing is not None:
            said = labels(self._target.shown.name, self._size, legend, self._format.nothing, colours, pixels)
            _put(self._labels, said.encode())

    def complete(self) -> None:
        if not self._written:
            raise ValueError("there is no picture yet")
        if self._format.several:
            _put(self._target, self._coco.document().encode())

    def publish(self) -> list[Path]:
        """Puts the picture, and labels, in their place, and says which files these are.

        Raises:
          FileError: it cannot be put in its place.
          ClosedPipeError: whoever read standard output is gone.
        """
        self.finish()
        said = self._labels.publish() if self._labels else []
        return [*self._target.publish(), *said]

    def close(self) -> None:
        """Removes what is not published."""
        self._opened.close()

    def __enter__(self) -> "ImageWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check(self, pixels: np.ndarray, legend: Sequence[Segment], colours: np.ndarray | None) -> None:
        """Raises ValueError when these are not pixels of the view and size, or do not fit together."""
        shape, kind = (self._size[1], self._size[0], *PIXELS[self._view][0]), PIXELS[self._view][1]
        if pixels.shape != shape or pixels.dtype != kind:
            raise ValueError(f"{self._view} must be {kind.__name__} {shape}, not {pixels.dtype} {pixels.shape}")
        if self._view == "seg" and not -1 <= pixels.min() <= pixels.max() < len(legend):
            raise ValueError(f"ids must be from −1 to {len(legend) - 1}")
        if colours is not None and (colours.shape != (len(legend), 3) or colours.dtype != np.uint8):
            raise ValueError(f"colours must be uint8 {(len(legend), 3)}, not {colours.dtype} {colours.shape}")


def _targets(output: str | None, kind: Format, opened: ExitStack) -> tuple[Destination, Destination | None]:
    """Where the picture goes, and its labels."""
    if output is None:
        return StandardOutput(terminal=kind.several), None  # a document is text, and may go to a terminal
    picture = StagedFile(Path(output))
    opened.callback(picture.discard)
    if kind.nothing is None:
        return picture, None
    beside = StagedFile(Path(labels_beside(output)))
    opened.callback(beside.discard)
    return picture, beside


def _put(target: Destination, data: bytes) -> None:
    """Writes a whole file."""
    path = target.path if target.stdout is None else target.stdout
    try:
        with open(path, "wb", closefd=target.stdout is None) as file:
            file.write(data)
    except BrokenPipeError:
        raise ClosedPipeError from None
    except OSError as error:
        raise FileError(target.shown, f"cannot be written: {error.strerror or error}") from None


def _png(image: Image.Image, tags: Mapping[str, str]) -> bytes:
    chunks = PngImagePlugin.PngInfo()
    for name, text in tags.items():
        chunks.add_itxt(name.capitalize(), text)  # PNG's own keywords are Title, Comment, Description
    return _saved(image, "PNG", pnginfo=chunks)


def _saved(image: Image.Image, kind: str, **settings: object) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **settings)
    return buffer.getvalue()
