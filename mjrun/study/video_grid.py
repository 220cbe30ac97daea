"""Contact sheets: videos of points in a grid, at the same simulated time, with parameter values as captions."""

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import count
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.formats.codecs import encoding
from mjrun.formats.ffmpeg import VideoWriter
from mjrun.formats.image_and_video_reader import read_video
from mjrun.rendering.text import stamp

MOST = 36  # cells
LARGEST = 3840  # pixels per side; cells shrink to stay below
SHAPE = 16 / 9  # preferred ratio of width to height
GAP = 4  # between cells [pixels]
GROUND = 14  # grey between cells and in empty ones
DIMMED = 0.35  # brightness of a cell whose simulation became unstable


@dataclass(frozen=True)
class VideoCell:
    """A cell: a video, its caption, and a note that appears when the video ends; empty for none."""

    video: Path
    caption: str
    ending: str = ""


@dataclass(frozen=True)
class SheetLayout:
    """Arrangement of cells.

    Attributes:
      columns, rows: number of columns and rows.
      width, height: size of a cell [pixels], even.
      shrink: pixels of a video per pixel of the sheet, in each direction.
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
        """Returns the rows and columns of the pixels of a cell."""
        row, column = divmod(index, self.columns)
        top, left = row * (self.height + GAP), column * (self.width + GAP)
        return slice(top, top + self.height), slice(left, left + self.width)


def sheet_layout(cells: int, size: tuple[int, int]) -> SheetLayout:
    """Chooses the layout of videos of one `size`: close to `SHAPE`, with few empty cells.

    Cells have the size of the videos, or are a whole number of times smaller where the sheet would be too large.
    """

    def badness(columns: int) -> float:
        rows = -(-cells // columns)
        shape = columns * size[0] / (rows * size[1])
        return abs(math.log(shape / SHAPE)) + (columns * rows - cells) / cells

    columns = min(range(1, cells + 1), key=badness)
    rows = -(-cells // columns)

    def layout(shrink: int) -> SheetLayout:
        width, height = (-(-(side // shrink) // 2) * 2 for side in size)
        return SheetLayout(columns, rows, width, height, shrink)

    return next(each for each in map(layout, count(1)) if max(each.size) <= LARGEST)


def write_contact_sheet(output: str, cells: Sequence[VideoCell], fps: Fraction, speed: Fraction) -> list[Path]:
    """Writes the videos of `cells`, which have one size and frame rate, into one video.

    Frame k of the sheet shows frame k of every video, which are of the same simulated time. A video that has ended
    stays on its last frame, dimmed where its cell has a note; a last frame shows the notes of those that end the sheet.

    Returns:
      The file.

    Raises:
      FileError: a video cannot be read, or the sheet cannot be written; an existing one is untouched.
      UsageError: the format does not support the size or the frame rate.
    """
    videos = [read_video(cell.video) for cell in cells]
    layout = sheet_layout(len(cells), videos[0].size)
    clock_scale = (layout.height / layout.size[1]) ** 0.6  # in proportion to the captions, not to the sheet
    with VideoWriter(output, encoding(output), layout.size, fps) as writer:
        for index, frame in enumerate(_frames(cells, [iter(video) for video in videos], layout)):
            stamp(frame, f"{float(index * speed / fps):.2f} s", "bottom-right", clock_scale)
            writer.write(frame)
        writer.count = writer.written
        return writer.publish()


def _frames(
    cells: Sequence[VideoCell], videos: Sequence[Iterator[np.ndarray]], layout: SheetLayout
) -> Iterator[np.ndarray]:
    """Yields the frames of the sheet until all videos have ended, and one more if that adds a note."""
    width, height = layout.size
    running = set(range(len(cells)))
    sheet = np.full((height, width, 3), GROUND, np.uint8)
    while running:
        is_noted = False
        for index in sorted(running):
            frame = next(videos[index], None)
            place = sheet[layout.place(index)]
            if frame is None:
                running.discard(index)
                is_noted |= bool(cells[index].ending)
                if cells[index].ending:
                    place[...] = np.round(place * DIMMED)
                    stamp(place, cells[index].caption, "top-left")
                    stamp(place, cells[index].ending, "bottom-left")
                continue
            place[...] = _shrunk(frame, layout)
            stamp(place, cells[index].caption, "top-left")
        if running or is_noted:
            yield sheet.copy()


def _shrunk(frame: np.ndarray, layout: SheetLayout) -> np.ndarray:
    """Shrinks a frame to the size of a cell by averaging its pixels; repeats the last pixels of an odd side."""
    step, height, width = layout.shrink, frame.shape[0] // layout.shrink, frame.shape[1] // layout.shrink
    if step > 1:
        blocks = frame[: height * step, : width * step].reshape(height, step, width, step, 3)
        frame = np.round(blocks.mean(axis=(1, 3))).astype(np.uint8)
    return np.pad(frame, ((0, layout.height - height), (0, layout.width - width), (0, 0)), "edge")
