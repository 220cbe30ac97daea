"""Numbers as text, for the formats with a row on each line."""

import itertools
import math
import re
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from mjrun.errors import CellError
from mjrun.formats.table_read_stream import EXACT, shown, side_by_side
from mjrun.model.table_column import Column

PIECE = 2**16  # values turned into text at a time
ROWS = 2**9  # rows turned into numbers at a time, which fit in the processor's cache
ROW_END = b"],["  # between the rows of `number_text`
WHOLE = re.compile(r"[+-]?[0-9]{1,4000}")  # Python's int accepts a few digits more


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
