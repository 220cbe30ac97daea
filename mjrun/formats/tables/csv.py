"""CSV: RFC 4180 in UTF-8, a header with the names of the columns, then rows of numbers and `nan`, `inf`, `-inf`.

Written names are cleaned of control characters, and quoted where necessary. A name that a spreadsheet would read as a
formula is quoted too, but not changed: in mjrun's own columns a group such as `qpos/` precedes every name from a model,
so that none of them is a formula.

A label may be any name from a model. It is cleaned and quoted in the same way; if a spreadsheet would read it as a
formula, even in quotes, it gets the customary apostrophe: `=1+1` becomes `'=1+1`. A missing text is an empty cell, an
empty label `""`.

Units are in a comment line below the header on request, `# units: s,rad`, or in metadata beside the file.

Reading removes spaces around names, and rejects empty cells unless gaps are accepted.
"""

import codecs
import csv
import io
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np
import orjson

from mjrun.errors import FileError, clean
from mjrun.formats import number_text, text_lines
from mjrun.formats.number_text import ROW_END
from mjrun.formats.table_read_stream import EXACT, AcceptedCells, ColumnFilter, TableReadStream, select, shown
from mjrun.formats.table_writer import RowWriter, units_beside
from mjrun.formats.text_lines import WholeLinePieces
from mjrun.model.table_column import Column

FORMULA = ("=", "+", "-", "@")  # first characters of a cell that a spreadsheet reads as a formula
# The same in full width, as in Japan, and after a semicolon, which separates cells where a comma is decimal.
LABEL_FORMULA = re.compile(r"(^|;)(?=\s*[=+\-@＝＋－＠])")

# Absent from lines of numbers; JSON would read them as texts, lists, objects, true, false and null.
NOT_NUMBERS = tuple(bytes([byte]) for byte in b'"[{tfn')
NEGATIVE_ZERO = re.compile(rb"-0\s*(,|\n|\Z)")
LONE_RETURN = re.compile(rb"\r(?!\n)")
UNITS = "# units:"  # begins the line below the header
WIDE = 16  # columns from which NumPy finds the ends of rows faster


class CsvWriter(RowWriter):
    """A writer that writes the header with the first row, so that an earlier failure prints nothing."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        self._file = file
        self._header = b",".join(_cell(column.name) for column in columns) + b"\n"
        self._labels = number_text.label_text(
            columns, lambda label: _cell(LABEL_FORMULA.sub(r"\1'", clean(label))), b""
        )
        self._integers = {i for i, column in enumerate(columns) if column.integer}
        self._gaps = {i for i, column in enumerate(columns) if column.has_gaps}

    def write(self, block: np.ndarray) -> None:
        self._write_header()
        for piece in number_text.pieces(block):
            mixed = self._labels or self._integers or self._gaps
            lines = _mixed_lines(piece, self._labels, self._integers, self._gaps) if mixed else _lines(piece)
            self._file.write(lines)

    def finish(self, manifest: str) -> None:
        self._write_header()

    def _write_header(self) -> None:
        self._file.write(self._header)
        self._header = b""


class CommentedCsvWriter(CsvWriter):
    """A writer that states the units in a comment line, each below the name of its column."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        super().__init__(file, columns, manifest)
        self._header += (
            f"{UNITS} ".encode() + b",".join(_cell(column.unit) if column.unit else b"" for column in columns) + b"\n"
        )


def _cell(name: str) -> bytes:
    cell = clean(name)
    if not cell or cell.startswith(FORMULA) or any(c in cell for c in ',;"'):
        cell = '"' + cell.replace('"', '""') + '"'
    return cell.encode()


def _lines(piece: np.ndarray) -> bytes:
    return b"\n".join([*_number_rows(piece), b""])


def _number_rows(piece: np.ndarray) -> list[bytes]:
    """Returns the cells of each row of a piece."""
    text = _numbers(piece)
    if piece.shape[1] < WIDE:
        return text.split(ROW_END)
    # Bytes search for several characters more slowly than NumPy for the one that occurs only between rows.
    ends = np.flatnonzero(np.frombuffer(text, np.uint8) == ROW_END[0]).tolist()
    starts = [0, *(end + len(ROW_END) for end in ends)]
    return [text[start:end] for start, end in zip(starts, [*ends, None], strict=True)]


def _numbers(piece: np.ndarray) -> bytes:
    """Returns the cells of the rows of a piece, with `ROW_END` between rows."""
    text = number_text.number_text(piece)
    not_finite = piece[~np.isfinite(piece)]
    if not not_finite.size:
        return text

    words = np.array([b"inf", b"-inf", b"nan"])[np.where(np.isnan(not_finite), 2, not_finite < 0)]
    between = text.split(b"null")
    parts = [b""] * (2 * len(between) - 1)
    parts[::2], parts[1::2] = between, words.tolist()
    return b"".join(parts)


def _mixed_lines(
    piece: np.ndarray, labels: Mapping[int, np.ndarray], integers: Set[int], gaps: Set[int] = frozenset()
) -> bytes:
    """Returns the lines of a piece with texts, integers and gaps; the cells between these are printed together."""
    cells: list[list[bytes]] = []
    kinds = ((i in labels, i if i in integers or i in gaps else -1) for i in range(piece.shape[1]))
    for (are_texts, alone), run in itertools.groupby(enumerate(kinds), key=lambda each: each[1]):
        columns = [index for index, _ in run]
        values = np.ascontiguousarray(piece[:, columns])
        if alone in integers:
            cells.append(number_text.integer_text(values[:, 0], b"" if alone in gaps else b"nan"))
        elif alone in gaps:
            cells.append([b"" if cell == b"nan" else cell for cell in _number_rows(values)])
        elif are_texts:
            cells.append(_label_lines(values, [labels[column].tolist() for column in columns]))
        else:
            cells.append(_number_rows(values))
    return b"\n".join(map(b",".join, zip(*cells, strict=True))) + b"\n"


def _label_lines(values: np.ndarray, labels: Sequence[Sequence[bytes]]) -> list[bytes]:
    """Returns the lines of text columns; the same texts are joined once."""
    rows = values.astype("<i4").view(f"V{4 * len(labels)}")[:, 0].tolist()
    lines: dict[bytes, bytes] = {}
    for row in set(rows):
        texts = zip(labels, np.frombuffer(row, "<i4").tolist(), strict=True)
        lines[row] = b",".join([known[index] for known, index in texts])
    return [lines[row] for row in rows]


def read(path: Path, file: io.BufferedReader, wanted: ColumnFilter, cells: AcceptedCells) -> TableReadStream:
    """Reads the accepted columns."""
    lines = _Lines(path, file)
    line, header = next(_rows(path, lines), (1, []))
    names = [name.strip(" \t") for name in header]
    _require_header(path, line, names)
    keys = select(path, names, wanted)
    units = _commented_units(path, lines, names) if file.peek(1).startswith(b"#") else {}
    pieces = WholeLinePieces(path, file, lines.count, (len(names), tuple(keys.values())))
    blocks = _blocks(path, file, lines, pieces, keys, len(names), cells)
    return TableReadStream(list(keys), blocks, units or units_beside(path), lines=None if lines.buffered else pieces)


def _commented_units(path: Path, lines: "_Lines", names: Sequence[str]) -> dict[str, str]:
    """Reads the units of columns from the next line, unless that is not the comment with the units."""
    if lines.buffered or (line := next(lines, None)) is None:
        return {}
    if not line.startswith(UNITS):
        lines.put_back(line)
        return {}
    _, units = next(_rows(path, [line.removeprefix(UNITS)], lines.count - 1), (0, []))
    return dict(zip(names, map(str.strip, units), strict=False))


class _Lines:
    """The lines of a file as text.

    Attributes:
      count: number of lines so far.
      buffered: whether lines that were read from the file are still waiting: a carriage return alone ends a line too.
    """

    def __init__(self, path: Path, file: BinaryIO, before: int = 0) -> None:
        self.count = before
        self.buffered = False
        self._texts: Iterator[str] = self._split(path, file)

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        text = next(self._texts)
        self.count += 1
        return text

    def put_back(self, line: str) -> None:
        """Returns the last line to those that wait."""
        self._texts = itertools.chain([line], self._texts)
        self.count -= 1
        self.buffered = True

    def _split(self, path: Path, file: BinaryIO) -> Iterator[str]:
        for line in text_lines.lines(path, file, self.count):
            self.buffered = b"\r" in line[:-2]
            yield from _texts(line if self.count else line.removeprefix(codecs.BOM_UTF8))


def _texts(lines: bytes) -> io.StringIO:
    # Columns that are not read may hold bytes that are not UTF-8: an older spreadsheet writes its own code page.
    return io.StringIO(lines.decode("utf-8", "surrogateescape"), newline="")


def _blocks(
    path: Path,
    file: BinaryIO,
    header: _Lines,
    pieces: WholeLinePieces,
    keys: Mapping[str, int],
    width: int,
    cells: AcceptedCells,
) -> Iterator[np.ndarray]:
    """Yields the rows after the header: plain numbers are parsed piece by piece, anything else cell by cell."""
    convert = (_floats, _floats_or_nan, partial(number_text.exact_cells, convert=_floats_or_nan))[cells]

    def parse(lines: Iterable[str], before: int) -> Iterator[np.ndarray]:
        return number_text.number_blocks(path, _rows(path, lines, before, width), keys, convert)

    if header.buffered:
        yield from parse(header, header.count)
    for before, piece in pieces:
        block = _plain_block(piece, list(keys.values()), width)
        if block is not None and not (cells is AcceptedCells.ANY and (np.abs(block) >= EXACT).any()):
            yield block
        elif b'"' in piece:  # a cell may end in a later piece, so that the rest is read line by line
            lines = itertools.chain(_texts(piece), _Lines(path, file, before + piece.count(b"\n")))
            yield from _marked(parse(lines, before), pieces)
        else:
            yield from _marked(parse(_texts(piece), before), pieces)


def _marked(blocks: Iterator[np.ndarray], pieces: WholeLinePieces) -> Iterator[np.ndarray]:
    """Yields blocks of the last piece; all but the last one are yielded while rows wait."""
    block = next(blocks, None)
    while block is not None:
        following = next(blocks, None)
        pieces.has_waiting_rows = following is not None
        yield block
        block = following


def _plain_block(piece: bytes, indices: list[int], width: int) -> np.ndarray | None:
    """Returns the columns with these indices of lines of JSON numbers, which orjson turns into the same bits.

    None if the lines hold anything else, or have another width.
    """
    if any(mark in piece for mark in NOT_NUMBERS):
        return None
    lines = piece.replace(b"\r\n", b"\n") if b"\r" in piece else piece
    try:
        rows = orjson.loads(b"[[" + lines.removesuffix(b"\n").replace(b"\n", ROW_END) + b"]]")
    except orjson.JSONDecodeError:
        return None
    if set(map(len, rows)) != {width}:
        return None

    block = np.array([[row[i] for i in indices] for row in rows] if len(indices) < width else rows, np.float64)
    # A carriage return alone, which ends a line, is a space in JSON; and the integer -0 loses its sign there.
    differs = (b"\r" in piece and LONE_RETURN.search(piece)) or ((block == 0).any() and NEGATIVE_ZERO.search(piece))
    return None if differs else block


def _rows(path: Path, lines: Iterable[str], before: int = 0, width: int = -1) -> Iterator[tuple[int, list[str]]]:
    """Yields the header and every row of its length, each with its first line; blank lines are skipped.

    Args:
      before: number of lines before these.
      width: width of the header, if that is not among them.
    """
    reader = csv.reader(lines, skipinitialspace=True, strict=True)
    while True:
        line = before + reader.line_num + 1
        try:
            row = next(reader, None)
        except csv.Error as error:
            raise FileError(f"{path}:{line}", f"cannot be read as .csv: {clean(str(error))}") from None
        if row is None:
            return
        if len(row) == width:
            yield line, row
        elif row not in ([], [""]):
            if width >= 0:
                expected = f"{width} cell{'s' * (width > 1)}, as in the header"
                raise FileError(f"{path}:{line}", f"expected {expected}, got {len(row)}")
            width = len(row)
            yield line, row


def _require_header(path: Path, line: int, names: Sequence[str]) -> None:
    """Raises FileError if `names` cannot be a header."""
    place = f"{path}:{line}"
    if not names:
        raise FileError(path, "is empty: a table begins with the names of its columns")
    if any("\0" in name for name in names):
        raise FileError(place, "is not text in UTF-8")
    if len(names) == 1 and any(separator in names[0] for separator in ";\t"):
        raise FileError(place, f"{shown(names[0])} is one column: separate columns by commas, decimals by points")
    if all(number_text.is_number(name, _floats) for name in names):
        raise FileError(place, "holds numbers: a table begins with the names of its columns")


def _floats(cells: list[str]) -> np.ndarray:
    text = "".join(cells)
    if "_" in text or not text.isascii():  # Python's float accepts 1_000 and the digits of any script
        raise ValueError
    return np.array(list(map(float, cells)))


def _floats_or_nan(cells: list[str]) -> np.ndarray:
    return _floats([cell.strip() or "nan" for cell in cells])
