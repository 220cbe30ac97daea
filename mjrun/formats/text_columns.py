"""Numbers as text, for the formats with a row on each line.

numpy and orjson are imported inside functions, as help, which lists the formats, loads neither.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from mjrun.errors import CellError, FileError
from mjrun.formats.table_format import EXACT, shown, side_by_side
from mjrun.model.column import Column

if TYPE_CHECKING:
    import numpy as np

PIECE = 2**16  # values turned into text at a time
ROWS = 2**9  # rows turned into numbers at a time, while they are in the processor's cache
BYTES = 2**16  # of text read at a time
NEWLINE = ord("\n")
COMPARED = 2**20  # bytes of two files compared at a time
PATIENCE = 63  # pieces that are parsed, at most, before equal lines are looked for again
WHOLE = re.compile(r"[+-]?[0-9]{1,4000}")  # as many digits as Python's int takes, or a few less
LINE = 2**24  # bytes in a line of text, at most


def pieces(block: np.ndarray) -> Iterator[np.ndarray]:
    """The rows of `block` `(n, columns)`, a few at a time, contiguous in memory."""
    import numpy as np

    rows = max(1, PIECE // block.shape[1])
    for start in range(0, len(block), rows):
        yield np.ascontiguousarray(block[start : start + rows])


def number_text(piece: np.ndarray) -> bytes:
    """`a,b],[c,d` for the rows `(a, b), (c, d)`, each number the shortest text that reads back; not finite: `null`."""
    import orjson

    return orjson.dumps(piece, option=orjson.OPT_SERIALIZE_NUMPY)[2:-2]


def label_text(columns: Sequence[Column], encode: Callable[[str], bytes], empty: bytes) -> dict[int, np.ndarray]:
    """The encoded labels of each text column, by its index; `empty` comes last, for −1."""
    import numpy as np

    return {i: np.array([*map(encode, c.labels), empty], object) for i, c in enumerate(columns) if c.labels}


def integer_text(values: np.ndarray, nan: bytes) -> list[bytes]:
    """Whole numbers `(n,)` without a decimal point; `nan` where there is none."""
    return [nan if math.isnan(value) else b"%d" % value for value in values.tolist()]


def lines(path: Path, file: BinaryIO, before: int = 0) -> Iterator[bytes]:
    """The lines of `file`, of which `before` were read already.

    Raises:
      FileError: one has more than `LINE` bytes.
    """
    for number in itertools.count(before + 1):
        line = file.readline(LINE)
        if not line:
            return
        _require_end(path, number, line)
        yield line


class LinePieces:
    """Pieces of a file that end where a line does, each with the number of lines before it.

    Args:
      before: lines that were read already.
      layout: the cells of a line, and those that are read; lines of the same bytes are the same rows if it is, too.

    Raises:
      FileError: a line has too many bytes.
    """

    def __init__(self, path: Path, file: BinaryIO, before: int, layout: tuple[int, tuple[int, ...]]) -> None:
        self._path, self._file, self._before, self._layout = path, file, before, layout
        self._attempt, self._wait = 0, 0  # to pass over equal lines

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        return self

    def __next__(self) -> tuple[int, bytes]:
        import numpy as np

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

    def skip_equal(self, other: LinePieces) -> int:
        """Passes over lines that have the same bytes in both, without parsing them, and returns how many.

        It passes over whole lines with the right number of cells, none of them in quotes, and only now and then tries
        where files differ everywhere.
        """
        self._attempt += 1
        if self._layout != other._layout or self._attempt <= self._wait:
            return 0
        skipped = 0
        while count := self._skip_piece(other):
            skipped += count
        self._attempt = 0
        self._wait = 0 if skipped else min(2 * self._wait + 1, PATIENCE)
        return skipped

    def _skip_piece(self, other: LinePieces) -> int:
        files = self._file, other._file
        if not all(file.seekable() for file in files):
            return 0
        begins = [file.tell() for file in files]
        a, b = (file.read(COMPARED) for file in files)
        end = a.rfind(b"\n", 0, len(a) if a == b else _common(a, b)) + 1
        lines = _plain_lines(a, end, self._layout[0])
        for file, begin, piece in zip(files, begins, (a, b), strict=True):
            if not lines or end < len(piece):
                file.seek(begin + (end if lines else 0))
        self._before += lines
        other._before += lines
        return lines


def _plain_lines(piece: bytes, end: int, width: int) -> int:
    """How many lines end before `end`; 0 unless all have so many cells, more than one, and none is in quotes."""
    import numpy as np

    if width < 2 or piece.find(b'"', 0, end) >= 0:
        return 0
    characters = np.frombuffer(piece, np.uint8, end)  # which numpy counts faster than bytes do, where there are many
    lines = int(np.count_nonzero(characters == NEWLINE))
    return lines if np.count_nonzero(characters == ord(",")) == lines * (width - 1) else 0


def _common(a: bytes, b: bytes) -> int:
    """How many bytes are the same at the beginning."""
    import numpy as np

    length = min(len(a), len(b))
    differ = np.frombuffer(a, np.uint8, length) != np.frombuffer(b, np.uint8, length)
    return int(differ.argmax()) if differ.any() else length


def _require_end(path: Path, number: int, line: bytes) -> None:
    if len(line) == LINE and not line.endswith(b"\n"):
        raise FileError(f"{path}:{number}", f"is a line of more than {LINE} bytes")


def number_blocks(
    path: Path,
    rows: Iterator[tuple[int, Any]],
    keys: Mapping[str, Hashable],
    convert: Callable[[list[Any]], np.ndarray],
) -> Iterator[np.ndarray]:
    """Blocks `(n, columns)` from rows of cells.

    Args:
      rows: each with its line number.
      keys: what each column is called in a row, by name.
      convert: turns cells into float64 or objects, or raises ValueError.

    Raises:
      CellError: a cell is not a number; the message says on which line.
    """
    while chunk := list(itertools.islice(rows, ROWS)):
        try:
            columns = [convert([row[key] for _, row in chunk]) for key in keys.values()]
        except ValueError:
            cells = ((line, name, row[key]) for line, row in chunk for name, key in keys.items())
            line, name, cell = next(cell for cell in cells if not is_number(cell[2], convert))
            raise CellError(f"{path}:{line}", f"column {shown(name)}: {_described(cell)} is not a number") from None
        yield side_by_side(columns, len(chunk))


def exact_cells(cells: Sequence[Any], convert: Callable[[list[Any]], np.ndarray]) -> np.ndarray:
    """Cells as float64, or as objects where there is an integer that float64 does not hold, or a text.

    Args:
      convert: turns numbers and gaps into float64, or raises ValueError.
    """
    import numpy as np

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
    """Whether `convert` takes `cell`."""
    try:
        convert([cell])
    except ValueError:
        return False
    return True


def _described(cell: Any) -> str:
    if isinstance(cell, str):
        return shown(cell) if cell else "an empty cell"
    return "null" if cell is None else "a list" if isinstance(cell, list) else "an object"
