"""JSON Lines: one object for each row, `{"time":0.0,"qpos/knee":0.5}`.

Numbers that are not finite, and missing texts, are null. A name or label with control characters is escaped, so that it
reads back exactly and cannot control a terminal. In a table that is read, the keys of the first row are the columns.
"""

import codecs
import contextlib
import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, KeysView, Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import orjson

from mjrun.errors import FileError, clean
from mjrun.formats import number_text, text_lines
from mjrun.formats.table_read_stream import AcceptedCells, ColumnFilter, TableReadStream, select, shown
from mjrun.formats.table_writer import RowWriter
from mjrun.model.table_column import Column

LONG_INTEGER = re.compile(rb"\d{19}")


class JsonlWriter(RowWriter):
    """A writer of an object with the same keys for each row."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        self._file = file
        first, *others = (_string(column.name) + b":" for column in columns)
        self._before = [b"}\n{" + first, *(b"," + key for key in others)]
        self._labels = number_text.label_text(columns, _string, b"null")
        self._integers = [i for i, column in enumerate(columns) if column.integer]

    def write(self, block: np.ndarray) -> None:
        for piece in number_text.pieces(block):
            parts = [b""] * (2 * piece.size)
            parts[::2] = self._before * len(piece)
            parts[1::2] = number_text.number_text(piece).replace(number_text.ROW_END, b",").split(b",")
            for index, labels in self._labels.items():
                parts[2 * index + 1 :: 2 * piece.shape[1]] = labels[piece[:, index].astype(int)].tolist()
            for index in self._integers:
                parts[2 * index + 1 :: 2 * piece.shape[1]] = number_text.integer_text(piece[:, index], b"null")
            parts[0] = parts[0].removeprefix(b"}\n")
            self._file.write(b"".join(parts) + b"}\n")


def _string(text: str) -> bytes:
    return json.dumps(text, ensure_ascii=clean(text) != text).encode()


def read(path: Path, file: BinaryIO, wanted: ColumnFilter, cells: AcceptedCells) -> TableReadStream:
    """Reads the accepted columns. If gaps are accepted, a key may be missing too."""
    rows = _rows(path, file, cells)
    first = next(rows, None)
    if first is None:
        raise FileError(path, "is empty: its first row has the names of the columns")
    names = first[1].keys()
    keys = {name: name for name in select(path, list(names), wanted)}
    alike = itertools.chain([first], _with_keys(path, rows, names, wanted, cells >= AcceptedCells.GAPS))
    convert = (_floats, _floats_or_nan, partial(number_text.exact_cells, convert=_floats_or_nan))[cells]
    return TableReadStream(list(keys), number_text.number_blocks(path, alike, keys, convert))


def _rows(path: Path, file: BinaryIO, cells: AcceptedCells) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yields every object with its line; skips blank lines, and checks that the keys of the first row are unique."""
    first = True
    for number, text in enumerate(text_lines.lines(path, file), 1):
        line = text.removeprefix(codecs.BOM_UTF8) if number == 1 else text
        if not line.strip():
            continue
        place = f"{path}:{number}"
        try:
            row = orjson.loads(line)
        except orjson.JSONDecodeError as error:
            raise FileError(place, f"cannot be read as JSON: {clean(error.msg)}, character {error.pos + 1}") from None
        if cells is AcceptedCells.ANY and LONG_INTEGER.search(line):  # which orjson reads as a float
            with contextlib.suppress(ValueError, RecursionError):
                row = json.loads(line)
        if not isinstance(row, dict):
            raise FileError(place, 'is not an object, as in {"time": 0.0}')
        if first:
            _require_unique_keys(place, line)
            first = False
        yield number, row


def _require_unique_keys(place: str, line: bytes) -> None:
    """Raises FileError if two keys of the object in `line` are alike; orjson would keep the last of them."""
    with contextlib.suppress(RecursionError):  # orjson accepts deeper nesting
        names = Counter(name for name, _ in json.loads(line, object_pairs_hook=list, parse_int=float))
        name, count = names.most_common(1)[0] if names else ("", 0)
        if count > 1:
            raise FileError(place, f"two columns are called {shown(name)}")


def _with_keys(
    path: Path, rows: Iterable[tuple[int, dict[str, Any]]], names: KeysView[str], wanted: ColumnFilter, gaps: bool
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yields `rows`, checking that their wanted keys are `names`; if gaps are accepted, missing ones become None."""
    for line, row in rows:
        if row.keys() != names:
            for name in (*names, *row):
                if (name in names) != (name in row) and wanted(name) and not (gaps and name in names):
                    reason = "is not in the first row" if name in row else "is missing"
                    raise FileError(f"{path}:{line}", f"column {shown(name)} {reason}")
            row = dict.fromkeys(names) | row
        yield line, row


def _floats(cells: list[Any]) -> np.ndarray:
    if not {int, float, bool}.issuperset(map(type, cells)):
        raise ValueError
    return np.array(cells, np.float64)


def _floats_or_nan(cells: list[Any]) -> np.ndarray:
    return _floats([math.nan if cell is None else cell for cell in cells])
