"""MP4 files as lists of samples: the encoded frames of several videos are joined into one without encoding them again.

Frame k of a joined file is presented at exactly k / fps: presentation times are whole numbers of ticks, there are no
edit lists, and no frame is presented in another order than it is decoded in. ISO/IEC 14496-12 specifies the boxes.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, file_errors

TICKS = 512  # per frame, as ffmpeg has: a low number of ticks per second confuses some players
BLOCK = 2**20  # bytes that are copied at once
IDENTITY = struct.pack(">9i", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)  # the matrix of an upright image
MOST_TICKS = 2**32  # in a file: headers of version 0 have 32 bits


@dataclass(frozen=True)
class Mp4Samples:
    """The samples of the video track of a file, one per frame.

    Attributes:
      path: path of the file.
      description: the box that describes the codec, which all samples of a track share.
      size: width and height [pixels].
      offsets, lengths: position and size of each sample in the file [bytes], `(n,)` each.
      keyframes: whether each sample can be decoded without the one before `(n,)` bool.
    """

    path: Path
    description: bytes
    size: tuple[int, int]
    offsets: np.ndarray
    lengths: np.ndarray
    keyframes: np.ndarray

    def __len__(self) -> int:
        return len(self.lengths)

    def part(self, first: int, last: int) -> "Mp4Samples":
        """Returns the samples from number `first` up to `last`, which is not included."""
        span = slice(first, last)
        return Mp4Samples(
            self.path, self.description, self.size, self.offsets[span], self.lengths[span], self.keyframes[span]
        )


def read_samples(path: Path) -> Mp4Samples:
    """Reads the tables of a file with one video track, whose frames are presented in the order of decoding.

    Raises:
      FileError: it is not such a file, or cannot be read.
    """
    try:
        with file_errors(path), path.open("rb") as file:
            size = file.seek(0, 2)
            return _samples(path, dict(_boxes(file, 0, size)), size)
    except (struct.error, ValueError, IndexError, RecursionError):
        raise FileError(path, "is not an MP4 file, or is damaged") from None


def _samples(path: Path, boxes: Mapping[bytes, bytes], size: int) -> Mp4Samples:
    """Returns the samples of a file of `size` bytes, from the boxes of its track."""
    chunks = _chunk_offsets(boxes)
    if chunks is None or any(kind not in boxes for kind in (b"stsd", b"stts", b"stsz", b"stsc")):
        raise FileError(path, "has no video track")
    if b"ctts" in boxes:
        raise FileError(path, "presents its frames in another order than it decodes them (B-frames)")
    uniform, count = struct.unpack_from(">II", boxes[b"stsz"], 4)
    if count * max(1, uniform) > size:
        raise FileError(path, "is damaged: it states more frames than it has bytes")
    lengths = np.full(count, uniform) if uniform else np.frombuffer(boxes[b"stsz"], ">u4", count, 12).astype(np.int64)
    keyframes = np.full(count, b"stss" not in boxes)
    if not keyframes.all():
        keyframes[np.frombuffer(boxes[b"stss"], ">u4", -1, 8).astype(np.int64) - 1] = True
    description = boxes[b"stsd"]
    shape = struct.unpack_from(">HH", description, 40)  # of the first entry: 8 + 8 bytes of boxes, 24 of its fields
    return Mp4Samples(path, description, shape, _sample_offsets(boxes, chunks, lengths), lengths, keyframes)


def join(file: BinaryIO, parts: Sequence[Mp4Samples], fps: Fraction) -> None:
    """Writes the samples of `parts` as one video, from the position 0 of an empty file; memory does not grow with it.

    Raises:
      ValueError: the parts have different descriptions, or are too long.
      OSError: a file cannot be read or written.
    """
    first = parts[0]
    count = sum(map(len, parts))
    if any(part.description != first.description for part in parts):
        raise ValueError("videos of different codecs, settings or sizes cannot be joined")
    if count * TICKS * fps.denominator >= MOST_TICKS:
        raise ValueError(f"{count} frames are too many for one file")
    start = _box(b"ftyp", b"isom", struct.pack(">I", 512), b"isomiso2mp41")
    lengths = np.concatenate([part.lengths for part in parts])
    keyframes = np.concatenate([part.keyframes for part in parts])
    header = _movie(first, lengths, keyframes, fps, 0)
    begin = len(start) + len(header) + 16  # with the header of the last box, whose size takes 64 bits
    file.write(start + _movie(first, lengths, keyframes, fps, begin))
    file.write(struct.pack(">I4sQ", 1, b"mdat", 16 + int(lengths.sum())))
    for part in parts:
        _copy(part, file)


def _copy(part: Mp4Samples, file: BinaryIO) -> None:
    """Copies the samples of a part, neighbours at once."""
    ends = part.offsets + part.lengths
    breaks = np.flatnonzero(ends[:-1] != part.offsets[1:]) + 1
    with part.path.open("rb") as source:
        for first, last in zip([0, *breaks], [*breaks, len(part)], strict=True):
            source.seek(int(part.offsets[first]))
            left = int(ends[last - 1] - part.offsets[first])
            while left:
                block = source.read(min(left, BLOCK))
                if not block:
                    raise OSError(f"{part.path} ended early")
                file.write(block)
                left -= len(block)


def _boxes(file: BinaryIO, start: int, end: int) -> Iterator[tuple[bytes, bytes]]:
    """Yields kind and content of all boxes that describe the first track, without their headers of 8 bytes."""
    while start < end:
        file.seek(start)
        length, kind = struct.unpack(">I4s", file.read(8))
        header = 8
        if length == 1:
            (length,), header = struct.unpack(">Q", file.read(8)), 16
        length = length or end - start
        if length < header or start + length > end:
            raise struct.error
        if kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
            yield from _boxes(file, start + header, start + length)
        elif kind != b"mdat":
            yield kind, file.read(length - header)
        start += length


def _chunk_offsets(boxes: Mapping[bytes, bytes]) -> np.ndarray | None:
    """Returns the position of each chunk of samples."""
    for kind, numbers in ((b"stco", ">u4"), (b"co64", ">u8")):
        if kind in boxes:
            return np.frombuffer(boxes[kind], numbers, -1, 8).astype(np.int64)
    return None


def _sample_offsets(boxes: Mapping[bytes, bytes], chunks: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Returns the position of each sample: chunks follow each other, and in a chunk the samples."""
    runs = np.frombuffer(boxes[b"stsc"], ">u4", -1, 8).reshape(-1, 3).astype(np.int64)  # first chunk, samples in each
    repeats = np.diff([*(runs[:, 0] - 1), len(chunks)])
    firsts = np.concatenate([[0], np.cumsum(np.repeat(runs[:, 1], repeats))])
    ends = np.concatenate([[0], np.cumsum(lengths)])
    offsets = np.empty(len(lengths), np.int64)
    for chunk, (first, last) in enumerate(pairwise(firsts)):
        offsets[first:last] = chunks[chunk] + ends[first:last] - ends[first]
    return offsets


def _movie(video: Mp4Samples, lengths: np.ndarray, keyframes: np.ndarray, fps: Fraction, begin: int) -> bytes:
    """Returns the box that describes a video whose samples follow each other from the position `begin` on."""
    width, height = video.size
    rate, ticks = fps.numerator * TICKS, fps.denominator * TICKS
    duration = len(lengths) * ticks
    track = struct.pack(">IIIII", 0, 0, 1, 0, duration) + bytes(16) + IDENTITY
    media = struct.pack(">IIIIHH", 0, 0, rate, duration, 0x55C4, 0)  # of no language
    handler = struct.pack(">I4s12s", 0, b"vide", b"") + b"video\0"
    everywhere = _full(b"dref", 0, struct.pack(">I", 1), _full(b"url ", 1))
    tables = [
        _box(b"stsd", video.description),
        _full(b"stts", 0, struct.pack(">III", 1, len(lengths), ticks)),
        *([] if keyframes.all() else [_counted(b"stss", (np.flatnonzero(keyframes) + 1).astype(">u4"))]),
        _full(b"stsc", 0, struct.pack(">IIII", 1, 1, len(lengths), 1)),
        _full(b"stsz", 0, struct.pack(">II", 0, len(lengths)), lengths.astype(">u4").tobytes()),
        _full(b"co64", 0, struct.pack(">IQ", 1, begin)),
    ]
    information = _box(
        b"minf",
        _full(b"vmhd", 1, bytes(8)),
        _box(b"dinf", everywhere),
        _box(b"stbl", *tables),
    )
    movie = struct.pack(">IIIIIHH8s", 0, 0, rate, duration, 0x10000, 0x100, 0, b"") + IDENTITY
    return _box(
        b"moov",
        _full(b"mvhd", 0, movie, bytes(24), struct.pack(">I", 2)),
        _box(
            b"trak",
            _full(b"tkhd", 3, track, struct.pack(">II", width << 16, height << 16)),
            _box(b"mdia", _full(b"mdhd", 0, media), _full(b"hdlr", 0, handler), information),
        ),
    )


def _box(kind: bytes, *contents: bytes) -> bytes:
    return struct.pack(">I4s", 8 + sum(map(len, contents)), kind) + b"".join(contents)


def _full(kind: bytes, flags: int, *contents: bytes) -> bytes:
    """Returns a box of version 0 with flags."""
    return _box(kind, struct.pack(">I", flags), *contents)


def _counted(kind: bytes, numbers: np.ndarray) -> bytes:
    return _full(kind, 0, struct.pack(">I", len(numbers)), numbers.tobytes())
