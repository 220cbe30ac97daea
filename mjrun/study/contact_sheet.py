"""A contact sheet: videos of points side by side, at the same simulated time, with their values as captions."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import count
from pathlib import Path

import numpy as np

from mjrun.formats.codecs import encoding
from mjrun.formats.video_reader import read_video
from mjrun.formats.video_writer import VideoWriter
from mjrun.rendering.text import stamp

MOST = 36  # cells
LARGEST = 3840  # pixels a side; cells are made smaller to stay below
SHAPE = 16 / 9  # that a sheet comes close to
GAP = 4  # between cells [pixels]
GROUND = 14  # grey between cells and in empty ones
DIMMED = 0.35  # brightness of a cell that became unstable


@dataclass(frozen=True)
class SheetCell:
    """A cell: a video, its caption, and what is written into it when it ends before the others, if anything is."""

    video: Path
    caption: str
    ending: str = ""


@dataclass(frozen=True)
class SheetLayout:
    """Where cells stand.

    Attributes:
      columns, rows: how many there are.
      width, height: of a cell [pixels], even.
      shrink: how many pixels of a video become one, each way.
    """

    columns: int
    rows: int
    width: int
    height: int
    shrink: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the sheet [pixels], even."""
        return (
            self.columns * self.width + (self.columns - 1) * GAP,
            self.rows * self.height + (self.rows - 1) * GAP,
        )

    def place(self, index: int) -> tuple[slice, slice]:
        """The pixels of a cell: rows and columns."""
        row, column = divmod(index, self.columns)
        top, left = row * (self.height + GAP), column * (self.width + GAP)
        return slice(top, top + self.height), slice(left, left + self.width)


def sheet_layout(cells: int, size: tuple[int, int]) -> SheetLayout:
    """The layout of so many videos of a `size`: the one closest to `SHAPE` among those with the fewest empty cells.

    Each is as large as it is, or a whole number of times smaller where the sheet would be too large.
    """

    def unlikeness(columns: int) -> float:
        rows = -(-cells // columns)
        shape = columns * size[0] / (rows * size[1])
        return abs(math.log(shape / SHAPE)) + (columns * rows - cells) / cells

    columns = min(range(1, cells + 1), key=unlikeness)
    rows = -(-cells // columns)
    layouts = (SheetLayout(columns, rows, *_shrunk_size(size, shrink), shrink) for shrink in count(1))
    return next(layout for layout in layouts if max(layout.size) <= LARGEST)


def write_contact_sheet(output: str, cells: Sequence[SheetCell], fps: Fraction, speed: Fraction) -> list[Path]:
    """Writes the videos of `cells`, which have one size and frame rate, into one.

    Frame k of the sheet shows frame k of every video, which is of the same simulated time; one that has ended stays
    on its last frame, dimmed where it says so.

    Returns:
      The file.

    Raises:
      FileError: a video cannot be read, or the sheet cannot be written; an existing one is untouched.
      UsageError: the format cannot hold it.
    """
    videos = [read_video(cell.video) for cell in cells]
    layout = sheet_layout(len(cells), videos[0].size)
    clock_scale = (layout.height / layout.size[1]) ** 0.6  # as large as the captions, whatever the height of the sheet
    how = encoding(output)
    with VideoWriter(output, how, layout.size, fps) as writer:
        for index, frame in enumerate(_frames(cells, [iter(video) for video in videos], layout)):
            stamp(frame, f"{float(index * speed / fps):.2f} s", "bottom-right", clock_scale)
            writer.write(frame)
        writer.count = writer.written
        return writer.publish()


def _frames(
    cells: Sequence[SheetCell], videos: Sequence[Iterator[np.ndarray]], layout: SheetLayout
) -> Iterator[np.ndarray]:
    """The frames of the sheet, while any of the videos goes on."""
    width, height = layout.size
    running = set(range(len(cells)))
    sheet = np.full((height, width, 3), GROUND, np.uint8)
    while True:
        for index in sorted(running):
            frame = next(videos[index], None)
            place = sheet[layout.place(index)]
            if frame is None:
                running.discard(index)
                if cells[index].ending:
                    place[...] = np.round(place * DIMMED)
                    stamp(place, cells[index].caption, "top-left")
                    stamp(place, cells[index].ending, "bottom-left")
                continue
            place[...] = _shrunk(frame, layout)
            stamp(place, cells[index].caption, "top-left")
        if not running:
            return
        yield sheet.copy()


def _shrunk_size(size: tuple[int, int], shrink: int) -> tuple[int, int]:
    """Width and height of a cell, even."""
    width, height = (-(-(side // shrink) // 2) * 2 for side in size)
    return width, height


def _shrunk(frame: np.ndarray, layout: SheetLayout) -> np.ndarray:
    """A frame in the size of a cell: the mean of its pixels, and its last ones again for a side that is odd."""
    step, height, width = layout.shrink, frame.shape[0] // layout.shrink, frame.shape[1] // layout.shrink
    if step > 1:
        blocks = frame[: height * step, : width * step].reshape(height, step, width, step, 3)
        frame = np.round(blocks.mean(axis=(1, 3))).astype(np.uint8)
    return np.pad(frame, ((0, layout.height - height), (0, layout.width - width), (0, 0)), "edge")
