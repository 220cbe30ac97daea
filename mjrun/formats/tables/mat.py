"""MATLAB 5: one column vector `(rows, 1)` for each column; text columns are cells of texts.

Columns are double; columns of integers are int64, unless a number is missing.

Variables are named as MATLAB allows: `qpos/knee` is `qpos_knee`. The cells `columns`, `variables` and `units` hold
the exact names, the variables and the units in order; the text `manifest` is JSON. The format holds 2 GiB for each
variable; more rows are refused as they arrive, counting every text as the longest label.

In a file that mjrun did not write, every variable is a column. scipy writes the files. It does not read them, as it
follows types and sizes in the file unchecked, and one flipped byte can crash the process; the parser here checks them.
The format is described in MathWorks' "MAT-File Format".
"""

import errno
import math
import os
import re
import struct
import zlib
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.decompression_limits import largest_expansion, require_expandable
from mjrun.formats import table_read_stream as tables
from mjrun.formats.input_file import decoding, parse_manifest
from mjrun.formats.table_writer import WholeColumnWriter
from mjrun.model.table_column import Column

LIMIT = 2**31  # bytes in one variable
CELL = 64  # bytes of a text in a cell beyond its characters, each of which takes at most 4
LONGEST_NAME = 63  # characters in the name of a variable
RESERVED = ("columns", "variables", "units", "manifest")
HEADER = 116  # bytes of text at the start of the file
HEAD = 128  # bytes before the first variable
BEGIN = 2**12  # bytes of a variable that hold its name
ORDERS = {b"\0\1IM": "<", b"\1\0MI": ">"}  # version and byte order
MATRIX, COMPRESSED = 14, 15  # types of data
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
CODECS = {1: "utf-8", 2: "utf-8", 4: "utf-16-{}", 16: "utf-8", 17: "utf-16-{}", 18: "utf-32-{}"}
NUMERIC_KINDS, OPAQUE = range(6, 16), 17  # kinds of matrices
KINDS = {1: "cells", 2: "a structure", 4: "text", 5: "a sparse matrix"}
IMAGINARY = 0x800


class MatWriter(WholeColumnWriter):
    """A writer of variables, once all rows are stored."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import scipy.io  # which reading does without; a broken installation is reported before the first step

        super().__init__(file, columns, manifest)
        self._widest = max([8, *(CELL + 4 * len(label) for column in columns for label in column.labels)])
        self._savemat = scipy.io.savemat

    def write(self, block: np.ndarray) -> None:
        if self._widest * (self.rows + len(block)) >= LIMIT:
            raise OSError(errno.EFBIG, "a .mat file holds at most 2 GiB per column; .parquet and .npz hold more")
        super().write(block)

    def end(self, manifest: str) -> None:
        variables = identifiers([column.name for column in self.columns])
        for index, variable in enumerate(variables):
            kind, pieces = self.cells(index)
            values = np.concatenate([np.empty(0, kind), *pieces])[:, None]
            self._save(variable, values.astype(object) if kind.kind == "U" else values)
        self._save("columns", np.array([column.name for column in self.columns], object))
        self._save("variables", np.array(variables, object))
        self._save("units", np.array([column.unit for column in self.columns], object))
        self._save("manifest", manifest)
        self.file.seek(0)  # scipy writes the time of day there
        self.file.write(b"MATLAB 5.0 MAT-file, written by mjrun".ljust(HEADER))

    def _save(self, variable: str, value: np.ndarray | str) -> None:
        self._savemat(self.file, {variable: value}, oned_as="column")  # appends, after the first


def identifiers(names: Sequence[str]) -> list[str]:
    """Returns a MATLAB variable for each name, no two alike, and none of `RESERVED`."""
    taken: dict[str, None] = dict.fromkeys(RESERVED)
    for name in names:
        base = re.sub(r"\W", "_", name, flags=re.ASCII)
        base = base if base[:1].isalpha() else f"x{base}"
        variable, count = base[:LONGEST_NAME], 1
        while variable in taken:
            count += 1
            variable = f"{base[: LONGEST_NAME - len(str(count)) - 1]}_{count}"
        taken[variable] = None
    return list(taken)[len(RESERVED) :]


def read(
    path: Path, file: BinaryIO, wanted: tables.ColumnFilter, cells: tables.AcceptedCells
) -> tables.TableReadStream:
    """Reads the accepted columns. A variable is whole in memory, as it may be compressed."""
    with decoding(path):
        mat = MatParser(file)
        units, manifest = mat.units(), parse_manifest(mat.manifest())
        arrays = [(name, _shape(mat.header(index)), index) for name, index in mat.columns()]
    columns = tables.select_parts(path, arrays, wanted)
    with decoding(path):
        shapes = [mat.header(index).shape for index in {index: None for index, _ in columns.values()}]
        require_expandable(path, 8 * sum(map(math.prod, shapes)), file)

    def opened(name: str, index: int) -> tables.ArrayInFile:
        return _MatrixReader(path, name, mat, index, cells)

    return tables.array_contents(path, columns, cells, opened, units, manifest)


def _shape(matrix: "MatlabArray") -> tuple[int, ...]:
    """Returns the shape of a matrix of numbers; empty for a row or column vector, and for anything else."""
    return matrix.shape if matrix.kind in NUMERIC_KINDS and 1 not in matrix.shape else ()


class _MatrixReader:
    """A variable; its values are read with its first rows."""

    def __init__(self, path: Path, name: str, mat: "MatParser", index: int, cells: tables.AcceptedCells) -> None:
        matrix = mat.read(index)
        texts = mat.texts(matrix) if cells is tables.AcceptedCells.ANY else None
        if texts is not None:
            self._values = np.array([*texts, None], object)[:-1, None]
        else:
            self._values = _numbers(path, name, matrix)
        self.rows, self.width = self._values.shape

    def read(self, start: int, count: int) -> np.ndarray:
        return self._values[start : start + count]


def _numbers(path: Path, name: str, matrix: "MatlabArray") -> np.ndarray:
    """Returns the columns of a matrix of numbers of any type, `(n, columns)`."""
    if matrix.kind not in NUMERIC_KINDS or matrix.imaginary:
        content = "complex values" if matrix.imaginary else KINDS.get(matrix.kind, "objects")
        raise tables.not_numbers(path, name, content)
    tables.require_vector(path, name, matrix.shape, row_vectors=True)
    _, values = next(matrix.parts)
    if values.size != math.prod(matrix.shape):
        raise ValueError("the size of a matrix is not that of its shape")
    columns = values.reshape((1, -1) if 1 in matrix.shape else matrix.shape[::-1])  # MATLAB stores column after column
    return columns.T


@dataclass(frozen=True)
class MatlabArray:
    """A MATLAB array: the fields of its header, and the type and content of each part after it."""

    kind: int
    imaginary: bool
    shape: tuple[int, ...]
    name: str
    parts: Iterator[tuple[int, np.ndarray]]


class MatParser:
    """A parser of files of MATLAB 5 to 7.2, a format that scipy and Octave also write.

    Raises:
      ValueError: it is something else, or not complete.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file, end = file, file.seek(0, os.SEEK_END)
        self._largest = largest_expansion(end)
        file.seek(0)
        self._order = ORDERS.get(file.read(HEAD)[-4:], "")
        if not self._order:
            raise ValueError("it is not a MAT-file of version 5 to 7.2; save it with -v7 in MATLAB")
        self._places: list[tuple[int, int, int]] = []  # type, begin and size of each variable
        at = HEAD
        while at < end:
            file.seek(at)
            kind, size = self._tag(file.read(8))
            self._places.append((kind, at + 8, size))
            at += 8 + size
        if at > end:
            raise ValueError("it is cut off")

    def columns(self) -> list[tuple[str, int]]:
        """Returns columns and the index of their variable: those that mjrun's cells name, or else all variables."""
        indices = {name: index for index, name in enumerate(self._names)}
        names, variables = self._cell("columns"), self._cell("variables")
        if len(names) == len(variables) > 0:
            if not indices.keys() >= set(variables):
                raise ValueError("a column has no variable")
            return [(name, indices[variable]) for name, variable in zip(names, variables, strict=True)]
        return [(name, index) for index, name in enumerate(self._names) if name]  # without: of MATLAB's own

    def units(self) -> dict[str, str]:
        """Returns the units of columns, if mjrun wrote the file."""
        names = self._cell("columns")
        units = self._cell("units") if names else []
        return dict(zip(names, units, strict=True)) if len(names) == len(units) else {}

    def manifest(self) -> str | None:
        """Returns the text of the variable `manifest`, if mjrun wrote the file."""
        if not self._cell("columns") or "manifest" not in self._names:
            return None
        matrix = self.read(self._names.index("manifest"))
        return "".join(map(self._text, matrix.parts)) if matrix.kind == 4 else None

    def header(self, index: int) -> "MatlabArray":
        """Returns the variable with this index, of which only the beginning is read."""
        return self._matrix(self._body(index, BEGIN))

    def read(self, index: int) -> "MatlabArray":
        """Returns the variable with this index, whole."""
        return self._matrix(self._body(index))

    @cached_property
    def _names(self) -> list[str]:
        """The names of all variables."""
        return [self._matrix(self._body(index, BEGIN)).name for index in range(len(self._places))]

    def _cell(self, name: str) -> list[str]:
        """Returns the texts in the cell array `name`; none if the variable is missing or something else."""
        if name not in self._names:
            return []
        cell = self.read(len(self._names) - 1 - self._names[::-1].index(name))  # MATLAB takes the last of a name
        return self.texts(cell) or []

    def texts(self, cell: "MatlabArray") -> list[str] | None:
        """Returns the texts in a cell array; None if it is something else, or holds something else."""
        if cell.kind != 1:
            return None
        inner = [self._matrix(part) for kind, part in cell.parts if kind == MATRIX]
        if any(matrix.kind not in (4, 6) or (matrix.kind == 6 and 0 not in matrix.shape) for matrix in inner):
            return None
        return ["".join(map(self._text, matrix.parts)) if matrix.kind == 4 else "" for matrix in inner]

    def _text(self, part: tuple[int, np.ndarray]) -> str:
        kind, content = part
        return content.tobytes().decode(CODECS[kind].format("le" if self._order == "<" else "be"))

    def _body(self, index: int, limit: int = 2**32) -> bytes:
        """Returns the content of a variable, or its first `limit` bytes."""
        kind, begin, size = self._places[index]
        self._file.seek(begin)
        if kind == MATRIX:
            return self._file.read(min(size, limit))
        if kind != COMPRESSED:
            raise ValueError(f"it holds data of the unknown type {kind}")
        packed = zlib.decompressobj()
        _, size = self._tag(packed.decompress(self._file.read(min(size, 2 * limit)), 8))
        if min(size, limit) > self._largest:
            raise ValueError(f"a variable would expand to {size / 1e9:,.3g} GB in memory")
        body = packed.decompress(packed.unconsumed_tail, min(size, limit) + 1)  # one more, to see the end
        if size <= limit and (len(body) != size or not packed.eof):
            raise ValueError("a variable is cut off")
        return body[:limit]

    def _matrix(self, body: bytes | np.ndarray) -> "MatlabArray":
        parts = self._parts(np.frombuffer(body, np.uint8))
        _, (flags, *_) = next(parts)
        kind = int(flags) & 0xFF
        shape = () if kind == OPAQUE else tuple(next(parts)[1].tolist())
        _, name = next(parts)
        return MatlabArray(kind, bool(flags & IMAGINARY), shape, name.tobytes().decode("utf-8", "replace"), parts)

    def _parts(self, body: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Yields type and content of each data element in `body`."""
        at = 0
        while at < len(body):
            kind, size = self._tag(body[at : at + 8].tobytes())
            begin, after = at + 8, at + 8 + size + -size % 8
            if kind >> 16:  # a small one, in the tag itself
                kind, size, begin, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
            if begin + size > min(after, len(body)):
                raise ValueError("a part of a variable is longer than that")
            yield kind, body[begin : begin + size].view(self._order + TYPES.get(kind, "u1"))
            at = after

    def _tag(self, head: bytes) -> tuple[int, int]:
        return struct.unpack(self._order + "II", head)
