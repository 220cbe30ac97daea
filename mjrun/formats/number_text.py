"""Numbers as text, for the formats with a row on each line."""

import itertools
import math
import re
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import orjson

from mjrun.errors import CellError, FileError
from mjrun.formats.table_read_stream import EXACT, shown, side_by_side
from mjrun.model.table_column import Column

PIECE = 2**16  # values turned into text at a time
ROWS = 2**9  # rows turned into numbers at a time, which fit in the processor's cache
BYTES = 2**16  # of text read at a time
NEWLINE = ord("\n")
ROW_END = b"],["  # between the rows of `number_text`
COMPARED = 2**20  # bytes of two files that are compared at a time
PATIENCE = 63  # largest number of pieces that are parsed before equal lines are searched again
WHOLE = re.compile(r"[+-]?[0-9]{1,4000}")  # Python's int accepts a few digits more
LINE = 2**24  # bytes in a line of text, at most


def pieces(block: np.ndarray) -> Iterator[np.ndarray]:
    """Yields the rows of `block` `(n, columns)`, a few at a time, contiguous in memory."""
    rows = max(1, PIECE // block.shape[1])
    for start in range(0, len(block), rows):
        yield np.ascontiguousarray(block[start : start + rows])


def number_text(piece: np.ndarray) -> bytes:
    """Returns `a,b],[c,d` for the rows `(a, b), (c, d)`, in shortest text that reads back; `null` if not finite."""
    return orjson.dumps(piece, option=orjson.OPT_SERIALIZE_NUMPY)[2:-2]


def label_text(columns: Sequence[Column], encode: Callable[[str], bytes], empty: bytes) -> dict[int, np.ndarray]:
    """Returns the encoded labels of each text column, by its index; `empty` comes last, for −1."""
    return {
        index: np.array([*map(encode, column.labels), empty], object)
        for index, column in enumerate(columns)
        if column.labels
    }


def integer_text(values: np.ndarray, nan: bytes) -> list[bytes]:
    """Returns whole numbers `(n,)` without a decimal point; `nan` for NaN."""
    return [nan if math.isnan(value) else b"%d" % value for value in values.tolist()]


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


def number_blocks(
    path: Path,
    rows: Iterator[tuple[int, Any]],
    keys: Mapping[str, Hashable],
    convert: Callable[[list[Any]], np.ndarray],
) -> Iterator[np.ndarray]:
    """Yields blocks `(n, columns)` from rows of cells.

    Args:
      rows: rows with their line numbers.
      keys: key of each column in a row, by name.
      convert: turns cells into float64 or objects, or raises ValueError.

    Raises:
      CellError: a cell is not a number; the message names the line.
    """
    while chunk := list(itertools.islice(rows, ROWS)):
        try:
            columns = [convert([row[key] for _, row in chunk]) for key in keys.values()]
        except ValueError:
            cells = ((line, name, row[key]) for line, row in chunk for name, key in keys.items())
            line, name, cell = next(cell for cell in cells if not is_number(cell[2], convert))
            is_decimal = isinstance(cell, str) and cell.count(",") == 1 and is_number(cell.replace(",", "."), convert)
            reason = f"is not a number{'; decimals need a point' if is_decimal else ''}"
            raise CellError(f"{path}:{line}", f"column {shown(name)}: {_described(cell)} {reason}") from None
        yield side_by_side(columns, len(chunk))


def exact_cells(cells: Sequence[Any], convert: Callable[[list[Any]], np.ndarray]) -> np.ndarray:
    """Returns cells as float64; as objects if texts, or integers beyond those of float64, are among them.

    Args:
      convert: turns numbers and gaps into float64, or raises ValueError.
    """
    try:
        numbers = convert([*cells])
        if not (np.abs(numbers) >= EXACT).any():
            return numbers
    except (ValueError, OverflowError):
        pass
    column = np.empty(len(cells), object)
    column[:] = [_exact_cell(cell, convert) for cell in cells]
    return column


def _exact_cell(cell: Any, convert: Callable[[list[Any]], np.ndarray]) -> float | int | str:
    text = cell.strip() if isinstance(cell, str) else str(cell)
    if type(cell) is not float and WHOLE.fullmatch(text) and abs(whole := int(text)) > EXACT:
        return whole
    try:
        return float(convert([cell])[0])
    except ValueError:
        if isinstance(cell, str):
            return cell
        raise


def is_number(cell: Any, convert: Callable[[list[Any]], np.ndarray]) -> bool:
    """Returns whether `convert` accepts `cell`."""
    try:
        convert([cell])
    except ValueError:
        return False
    return True


def _described(cell: Any) -> str:
    if isinstance(cell, str):
        return shown(cell) if cell else "an empty cell"
    return "null" if cell is None else "a list" if isinstance(cell, list) else "an object"
