"""A parser of MATLAB files, versions 5 to 7.2, that checks every size.

scipy's own reader follows types and sizes in the file unchecked: one flipped byte can crash the process.
The format is described in MathWorks' "MAT-File Format".
"""

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import BinaryIO

import numpy as np

from mjrun.expansion import largest_expansion

HEAD = 128  # bytes before the first variable
BEGIN = 2**12  # bytes of a variable that hold its name
ORDERS = {b"\0\1IM": "<", b"\1\0MI": ">"}  # version and byte order
MATRIX, COMPRESSED = 14, 15  # types of data
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
CODECS = {1: "utf-8", 2: "utf-8", 4: "utf-16-{}", 16: "utf-8", 17: "utf-16-{}", 18: "utf-32-{}"}
NUMERIC_KINDS, OPAQUE = range(6, 16), 17  # kinds of matrices
KINDS = {1: "cells", 2: "a structure", 4: "text", 5: "a sparse matrix"}
IMAGINARY = 0x800


@dataclass(frozen=True)
class Matrix:
    """A MATLAB array: what its header says, and the type and content of each part after it."""

    kind: int
    imaginary: bool
    shape: tuple[int, ...]
    name: str
    parts: Iterator[tuple[int, np.ndarray]]


class MatParser:
    """The variables of a file of MATLAB 5 to 7.2, which also scipy and Octave write.

    Raises:
      ValueError: it is something else, or not complete.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file, end = file, file.seek(0, os.SEEK_END)
        self._largest = largest_expansion(end)
        file.seek(0)
        self._order = ORDERS.get(file.read(HEAD)[-4:], "")
        if not self._order:
            raise ValueError("it is not of MATLAB 5 to 7.2; MATLAB saves one with -v7")
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
        """Columns by name, with the index of their variable: those that mjrun's cells name, or else all variables."""
        indices = {name: index for index, name in enumerate(self._names)}
        names, variables = self._cell("columns"), self._cell("variables")
        if len(names) == len(variables) > 0:
            if not indices.keys() >= set(variables):
                raise ValueError("a column has no variable")
            return [(name, indices[variable]) for name, variable in zip(names, variables, strict=True)]
        return [(name, index) for index, name in enumerate(self._names) if name]  # without: of MATLAB's own

    def units(self) -> dict[str, str]:
        """The units of columns, if mjrun wrote the file."""
        names = self._cell("columns")
        units = self._cell("units") if names else []
        return dict(zip(names, units, strict=True)) if len(names) == len(units) else {}

    def manifest(self) -> str | None:
        """The text of the variable `manifest`, if mjrun wrote the file."""
        if not self._cell("columns") or "manifest" not in self._names:
            return None
        matrix = self.read(self._names.index("manifest"))
        return "".join(map(self._text, matrix.parts)) if matrix.kind == 4 else None

    def header(self, index: int) -> Matrix:
        """The variable with this index, of which only the beginning is read."""
        return self._matrix(self._body(index, BEGIN))

    def read(self, index: int) -> Matrix:
        """The variable with this index, whole."""
        return self._matrix(self._body(index))

    @cached_property
    def _names(self) -> list[str]:
        """The names of all variables."""
        return [self._matrix(self._body(index, BEGIN)).name for index in range(len(self._places))]

    def _cell(self, name: str) -> list[str]:
        """The texts in the cell array `name`; none if there is no such variable, or it is something else."""
        if name not in self._names:
            return []
        cell = self.read(len(self._names) - 1 - self._names[::-1].index(name))  # MATLAB takes the last of a name
        return self.texts(cell) or []

    def texts(self, cell: Matrix) -> list[str] | None:
        """The texts in a cell array; None if it is something else, or holds something else."""
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
        """The content of a variable, of which the first `limit` bytes are enough."""
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

    def _matrix(self, body: "bytes | np.ndarray") -> Matrix:
        parts = self._parts(np.frombuffer(body, np.uint8))
        _, (flags, *_) = next(parts)
        kind = int(flags) & 0xFF
        shape = () if kind == OPAQUE else tuple(next(parts)[1].tolist())
        _, name = next(parts)
        return Matrix(kind, bool(flags & IMAGINARY), shape, name.tobytes().decode("utf-8", "replace"), parts)

    def _parts(self, body: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Type and content of each data element in `body`."""
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
