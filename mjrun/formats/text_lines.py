"""Lines of text files, one by one or in pieces."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from mjrun.errors import FileError

BYTES = 2**16  # of text read at a time
NEWLINE = ord("\n")
COMPARED = 2**20  # bytes of two files that are compared at a time
PATIENCE = 63  # largest number of pieces that are parsed before equal lines are searched again
LINE = 2**24  # bytes in a line of text, at most


def lines(path: Path, file: BinaryIO, before: int = 0) -> Iterator[bytes]:
    """Yields the lines of `file` that follow the first `before` lines.

    Raises:
      FileError: a line has more than `LINE` bytes.
    """
    for number in itertools.count(before + 1):
        line = file.readline(LINE)
        if not line:
            return
        _require_end(path, number, line)
        yield line


class WholeLinePieces:
    """Pieces of a file that end with a line, each with the number of lines before it.

    Args:
      before: number of lines that were already read.
      layout: number of cells of a line, and indices of those that are read. If it is the same in two files, lines with
        the same bytes are the same rows.

    Attributes:
      has_waiting_rows: whether rows of the last piece are still to be yielded, so that none may be skipped.

    Raises:
      FileError: a line has too many bytes.
    """

    def __init__(self, path: Path, file: BinaryIO, before: int, layout: tuple[int, tuple[int, ...]]) -> None:
        self._path = path
        self._file = file
        self._before = before
        self._layout = layout
        self.has_waiting_rows = False
        self._attempt = self._wait = 0  # attempts to skip equal lines, and how many to leave out

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        return self

    def __next__(self) -> tuple[int, bytes]:
        piece = self._file.read(BYTES)
        if not piece:
            raise StopIteration
        if not piece.endswith(b"\n"):
            rest = self._file.readline(LINE)
            if len(rest) == LINE:
                _require_end(self._path, self._before + piece.count(b"\n") + 1, rest)
            piece += rest
        before = self._before
        self._before += int(np.count_nonzero(np.frombuffer(piece, np.uint8) == NEWLINE))  # faster than bytes count
        return before, piece

    def skip_equal(self, other: "WholeLinePieces") -> int:
        """Skips lines that have the same bytes in both files, without parsing them, and returns their number.

        Skips only lines with the right number of cells, none of them in quotes. Where files differ everywhere, most
        calls return 0 without comparing.
        """
        if self.has_waiting_rows or other.has_waiting_rows:
            return 0
        self._attempt += 1
        if self._layout != other._layout or self._attempt <= self._wait:
            return 0
        skipped = 0
        while count := self._skip_piece(other):
            skipped += count
        self._attempt = 0
        self._wait = 0 if skipped else min(2 * self._wait + 1, PATIENCE)
        return skipped

    def _skip_piece(self, other: "WholeLinePieces") -> int:
        files = self._file, other._file
        if not all(file.seekable() for file in files):
            return 0
        begins = [file.tell() for file in files]
        parts = [file.read(COMPARED) for file in files]
        end = parts[0].rfind(b"\n", 0, _common(*parts)) + 1
        lines = _plain_lines(parts[0], end, self._layout[0])
        for file, begin, part in zip(files, begins, parts, strict=True):
            if not lines or end < len(part):
                file.seek(begin + (end if lines else 0))
        self._before += lines
        other._before += lines
        return lines


def _plain_lines(piece: bytes, end: int, width: int) -> int:
    """Returns the number of lines that end before `end`; 0 unless all have `width` > 1 cells, none in quotes."""
    if width < 2 or piece.find(b'"', 0, end) >= 0:
        return 0
    characters = np.frombuffer(piece, np.uint8, end)  # which numpy counts faster than bytes do, where there are many
    lines = int(np.count_nonzero(characters == NEWLINE))
    return lines if np.count_nonzero(characters == ord(",")) == lines * (width - 1) else 0


def _common(one: bytes, other: bytes) -> int:
    """Returns the number of equal bytes at the beginning."""
    length = min(len(one), len(other))
    if one[:length] == other[:length]:  # faster than numpy
        return length
    differ = np.frombuffer(one, np.uint8, length) != np.frombuffer(other, np.uint8, length)
    return int(differ.argmax())


def _require_end(path: Path, number: int, line: bytes) -> None:
    if len(line) == LINE and not line.endswith(b"\n"):
        raise FileError(f"{path}:{number}", f"is a line of more than {LINE} bytes")
