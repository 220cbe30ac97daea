"""Writes images: the pixels of one view become one published file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mjrun.errors import BadValueError, clean, option
from mjrun.formats.image_encoding import ImageData, check_segment_count, clipped_share
from mjrun.formats.image_format import FORMATS
from mjrun.formats.output_writer import OutputWriter, StagedFile, StandardOutput
from mjrun.formats.segmentation_labels import CocoDocument, LabelsWriter
from mjrun.model.camera_images import SegmentedObject

# Pixels of each view: their shape after height and width, and their type.
PIXELS = {"rgb": ((3,), np.uint8), "depth": ((), np.float32), "seg": ((), np.int32)}


class ImageWriter(OutputWriter):
    """A writer of one image, or of any number to a COCO document; nothing is published until `publish`.

    Opening it checks that the output can be written.

    Args:
      output: a file, or None for standard output.
      view: `rgb` for colours of any kind, `depth` or `seg`.
      format: a name from `image_format`.
      size: width and height [pixels].
      tags: title, comment and description, embedded in PNG and EXR; TIFF holds the description only.

    Attributes:
      clipped: share of the visible pixels beyond the range of the format, known once the image is written.

    Raises:
      FileError: the output, or the labels beside it, cannot be written.
      BadValueError: the format cannot hold so large an image.
    """

    def __init__(
        self,
        output: str | None,
        view: str,
        format: str,  # noqa: A002  (the option's name)
        size: tuple[int, int],
        tags: Mapping[str, str] | None = None,
    ) -> None:
        self.clipped = 0.0
        self._view = view
        self._name = format
        self._size = size
        self._format = FORMATS[view][format]
        self._tags = {name: clean(text) for name, text in (tags or {}).items()}
        self._coco = CocoDocument()
        self._written = 0
        largest = self._format.largest
        if largest and max(size) > largest:
            raise BadValueError(
                option("size"), f"{size[0]}x{size[1]}", f"at most {largest} pixels per side for {format}"
            )

        is_text = not self._format.encoder  # which may go to a terminal
        super().__init__(StandardOutput(terminal=is_text) if output is None else StagedFile(Path(output)))
        with self.opening():
            self._labels: LabelsWriter | None = None
            if output is not None and self._format.nothing is not None:
                self._labels = self.resources.enter_context(LabelsWriter(output))

    def check_segments(self, count: int) -> None:
        """Raises UsageError if the format cannot distinguish `count` segments; `write` checks it, too."""
        if self._format.segments is not None:
            check_segment_count(count, self._format.segments)

    def write(
        self,
        pixels: np.ndarray,
        legend: Sequence[SegmentedObject] = (),
        colours: np.ndarray | None = None,
        image: Mapping[str, Any] | None = None,
    ) -> None:
        """Writes the image.

        Args:
          pixels: rgb `(h, w, 3)` uint8, depth `(h, w)` float32 [m], or ids `(h, w)` int32.
          legend: segments of the ids.
          colours: colours of the legend, `(n, 3)` uint8, for labels and a palette.
          image: entries of the image in a COCO document: `file_name`, and others such as `camera` and `time`.

        Raises:
          UsageError: the format cannot distinguish this number of segments.
          FileError: the disk is full.
          ClosedPipeError: the reader of standard output closed the pipe.
        """
        self._check(pixels, legend, colours)
        self.check_segments(len(legend))
        self._written += 1
        if not self._format.encoder:
            stem = Path(self.destination.shown).stem if self.destination.stdout is None else "image"
            self._coco.add(pixels, legend, {"file_name": f"{stem}.png", **(image or {})})
            return
        if self._written > 1:
            raise ValueError(f"{self._name} holds one image")
        self.clipped = clipped_share(pixels) if self._format.is_clipped else 0.0
        self.write_file(self._format.encode(ImageData(pixels, len(legend), colours, self._tags)))
        if self._labels:
            self._labels.write(self._size, legend, colours, self._format.nothing or 0, pixels)

    def finish(self) -> None:
        if not self._written:
            raise ValueError("there is no image yet")
        if not self._format.encoder:
            self.write_file(self._coco.document().encode())
        super().finish()
        if self._labels:
            self._labels.finish()

    @property
    def together(self) -> Sequence[OutputWriter]:
        """This writer, and the writer of the labels."""
        return [self, *([self._labels] if self._labels else [])]

    def _check(self, pixels: np.ndarray, legend: Sequence[SegmentedObject], colours: np.ndarray | None) -> None:
        """Raises ValueError if these are not pixels of the view and size, or do not fit together."""
        inner, kind = PIXELS[self._view]
        shape = (self._size[1], self._size[0], *inner)
        if pixels.shape != shape or pixels.dtype != kind:
            raise ValueError(f"{self._view} must be {kind.__name__} {shape}, not {pixels.dtype} {pixels.shape}")
        if self._view == "seg" and not -1 <= pixels.min() <= pixels.max() < len(legend):
            raise ValueError(f"ids must be from −1 to {len(legend) - 1}")
        if colours is not None and (colours.shape != (len(legend), 3) or colours.dtype != np.uint8):
            raise ValueError(f"colours must be uint8 {(len(legend), 3)}, not {colours.dtype} {colours.shape}")
