"""Numbers as text, for the formats with a row on each line."""

import itertools
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import orjson

from mjrun.errors import FileError
from mjrun.formats.column_checks import shown
from mjrun.model.column import Column

PIECE = 2**16  # values turned into text at a time
ROWS = 2**9  # rows turned into numbers at a time, while they are in the processor's cache
BYTES = 2**16  # of text read at a time
LINE = 2**24  # bytes in a line of text, at most


def pieces(block: np.ndarray) -> Iterator[np.ndarray]:
    """The rows of `block` `(n, columns)`, a few at a time, contiguous in memory."""
    rows = max(1, PIECE // block.shape[1])
    for start in range(0, len(block), rows):
        yield np.ascontiguousarray(block[start : start + rows])


def number_text(piece: np.ndarray) -> bytes:
    """`a,b],[c,d` for the rows `(a, b), (c, d)`, each number the shortest text that reads back; not finite: `null`."""
    return orjson.dumps(piece, option=orjson.OPT_SERIALIZE_NUMPY)[2:-2]


def label_text(columns: Sequence[Column], encode: Callable[[str], bytes], empty: bytes) -> dict[int, np.ndarray]:
    """The encoded labels of each text column, by its index; `empty` comes last, for −1."""
    return {i: np.array([*map(encode, c.labels), empty], object) for i, c in enumerate(columns) if c.labels}


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


def whole_lines(path: Path, file: BinaryIO, before: int) -> Iterator[tuple[int, bytes]]:
    """Pieces of `file` that end where a line does, each with the number of lines before it.

    Raises:
      FileError: a line has too many bytes.
    """
    while piece := file.read(BYTES):
        rest = file.readline(LINE)
        _require_end(path, before + piece.count(b"\n") + 1, rest)
        piece += rest
        yield before, piece
        before += piece.count(b"\n")


def _require_end(path: Path, number: int, line: bytes) -> None:
    if len(line) == LINE and not line.endswith(b"\n"):
        raise FileError(f"{path}:{number}", f"is a line of more than {LINE} bytes")


def number_blocks(
    path: Path,
    rows: Iterator[tuple[int, Any]],
    keys: Mapping[str, Hashable],
    convert: Callable[[list[Any]], np.ndarray],
) -> Iterator[np.ndarray]:
    """Blocks of float64 `(n, columns)` from rows of cells.

    Args:
      rows: each with its line number.
      keys: what each column is called in a row, by name.
      convert: turns cells into float64, or raises ValueError.

    Raises:
      FileError: a cell is not a number; the message says on which line.
    """
    while chunk := list(itertools.islice(rows, ROWS)):
        columns = np.empty((len(keys), len(chunk)))
        try:
            for column, key in zip(columns, keys.values(), strict=True):
                column[:] = convert([row[key] for _, row in chunk])
        except ValueError:
            cells = ((line, name, row[key]) for line, row in chunk for name, key in keys.items())
            line, name, cell = next(cell for cell in cells if not is_number(cell[2], convert))
            raise FileError(f"{path}:{line}", f"column {shown(name)}: {_described(cell)} is not a number") from None
        yield columns.T


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
