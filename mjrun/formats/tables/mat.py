"""MATLAB 5: one column vector `(rows, 1)` for each column; text columns are cells of texts.

Columns are double, those of integers int64 unless a number is missing.

Variables are named as MATLAB allows: `qpos/knee` is `qpos_knee`. The cells `columns`, `variables` and `units` hold
the exact names, the variables and the units in order; the text `manifest` is JSON. The format holds 2 GiB for each
variable; more rows are refused as they arrive, counting every text as the longest label.

When reading a file that mjrun did not write, every variable is a column. scipy writes, `mat_file` reads.
"""

from __future__ import annotations

import errno
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from mjrun.errors import FileError
from mjrun.formats.table_format import Cells, ColumnFilter, TableContents, TableFormat
from mjrun.model.column import Column

if TYPE_CHECKING:
    import numpy as np

    from mjrun.formats.mat_parser import MatParser, Matrix

PIECE = 2**17  # values in a block that is read
LIMIT = 2**31  # bytes in one variable
CELL = 64  # bytes that a text in a cell takes besides its characters, of which each takes at most 4
LONGEST_NAME = 63  # characters in the name of a variable
RESERVED = ("columns", "variables", "units", "manifest")
HEADER = 116  # bytes of text at the start of the file


class MatWriter:
    """Writes the variables once all rows are there; they wait in an unnamed file beside the table."""

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        import scipy.io  # noqa: F401  (a broken installation shows before the first step)

        from mjrun.formats.row_groups import ColumnSpill

        self._file, self._columns = file, columns
        self._spill = ColumnSpill(Path(file.name).parent, len(columns))
        self._widest = max([8, *(CELL + 4 * len(label) for column in columns for label in column.labels)])

    def write(self, block: np.ndarray) -> None:
        if self._widest * (self._spill.rows + len(block)) >= LIMIT:
            raise OSError(errno.EFBIG, "a .mat file holds at most 2 GiB per column; .parquet and .npz hold more")
        self._spill.write(block)

    def finish(self, manifest: str) -> None:
        import numpy as np

        self._spill.end()
        variables = identifiers([column.name for column in self._columns])
        for index, (variable, column) in enumerate(zip(variables, self._columns, strict=True)):
            values = np.concatenate([np.empty(0), *self._spill.column(index)])[:, None]
            if column.integer and self._spill.is_complete(index):
                values = values.astype(np.int64)
            self._save(variable, _cells([*column.labels, ""])[values.astype(int)] if column.labels else values)
        self._save("columns", _cells(column.name for column in self._columns))
        self._save("variables", _cells(variables))
        self._save("units", _cells(column.unit for column in self._columns))
        self._save("manifest", manifest)
        self._file.seek(0)  # scipy writes the time of day there
        self._file.write(b"MATLAB 5.0 MAT-file, written by mjrun".ljust(HEADER))

    def close(self) -> None:
        self._spill.close()

    def _save(self, variable: str, value: np.ndarray | str) -> None:
        import scipy.io

        scipy.io.savemat(self._file, {variable: value}, oned_as="column")  # appends, after the first


def identifiers(names: Sequence[str]) -> list[str]:
    """A MATLAB variable for each name, no two alike, and none of `RESERVED`."""
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


def _cells(texts: Iterable[str]) -> np.ndarray:
    import numpy as np

    return np.array(list(texts), object)


def read(path: Path, file: BinaryIO, wanted: ColumnFilter, cells: Cells) -> TableContents:
    """The columns that the filter accepts. A variable is whole in memory, as it may be compressed."""
    from mjrun.expansion import require_expandable
    from mjrun.formats.column_checks import (
        number_cells,
        require_equal_lengths,
        select,
        side_by_side,
        text_cells,
        unreadable,
    )
    from mjrun.formats.input_file import decoding
    from mjrun.formats.manifest import parse_manifest
    from mjrun.formats.mat_parser import MatParser

    with decoding(path, unreadable(path)):
        mat = MatParser(file)
        variables, units, manifest = mat.columns(), mat.units(), parse_manifest(mat.manifest())
        columns = [
            (column, index, part) for name, index in variables for part, column in enumerate(_names(mat, name, index))
        ]
    chosen = [columns[at] for at in select(path, [column for column, _, _ in columns], wanted).values()]

    with decoding(path, unreadable(path)):
        shapes = [mat.header(index).shape for index in {index: None for _, index, _ in chosen}]
        require_expandable(path, 8 * sum(map(math.prod, shapes)))

    def blocks() -> Iterator[np.ndarray]:
        values: dict[str, np.ndarray] = {}
        for index, group in groupby(chosen, key=lambda column: column[1]):
            parts = {column: part for column, _, part in group}
            with decoding(path, unreadable(path)):
                matrix = mat.read(index)
                if cells is Cells.ANY and (texts := mat.texts(matrix)) is not None:
                    array = text_cells(texts)[:, None]
                else:
                    array = _numbers(path, next(iter(parts)), matrix)
            values |= {column: array[:, part] for column, part in parts.items()}
        require_equal_lengths(path, {name: len(column) for name, column in values.items()})

        size = max(1, PIECE // max(1, len(values)))
        for start in range(0, max(map(len, values.values()), default=0), size):
            pieces = [column[start : start + size] for column in values.values()]
            columns = [piece if piece.dtype == object else number_cells(piece, cells) for piece in pieces]
            yield side_by_side(columns, len(columns[0]))

    return TableContents([column for column, _, _ in chosen], blocks(), units, manifest)


def _names(mat: MatParser, name: str, index: int) -> list[str]:
    """The columns of a variable: one for a vector, lying or standing, and for what is no matrix of numbers."""
    from mjrun.formats.column_checks import column_names
    from mjrun.formats.mat_parser import NUMERIC_KINDS

    matrix = mat.header(index)
    return column_names(name, matrix.shape) if matrix.kind in NUMERIC_KINDS and 1 not in matrix.shape else [name]


def _numbers(path: Path, name: str, matrix: Matrix) -> np.ndarray:
    """The columns of a matrix of numbers of any type, `(n, columns)`."""
    from mjrun.formats.column_checks import column_names, shown
    from mjrun.formats.mat_parser import KINDS, NUMERIC_KINDS

    if matrix.kind not in NUMERIC_KINDS or matrix.imaginary:
        content = "complex values" if matrix.imaginary else KINDS.get(matrix.kind, "objects")
        raise FileError(path, f"column {shown(name)} holds {content}, not numbers")
    vector = len(matrix.shape) == 2 and 1 in matrix.shape
    if not vector and len(column_names("", matrix.shape)) == 1:
        raise FileError(path, f"column {shown(name)} has the shape {matrix.shape}, not (n, 1), (1, n) or (n, k)")
    _, values = next(matrix.parts)
    if values.size != math.prod(matrix.shape):
        raise ValueError("the size of a matrix is not that of its shape")
    columns = values.reshape((1, -1) if vector else matrix.shape[::-1])  # MATLAB stores column after column
    return columns.T


FORMAT = TableFormat("mat", (".mat",), MatWriter, read, library="scipy", extra="mat", reads_alone=True)
