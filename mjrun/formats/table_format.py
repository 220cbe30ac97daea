"""What a table format is: its suffixes, its writer, its reader, and the library it needs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

from mjrun.model.column import Column
from mjrun.packages import require

if TYPE_CHECKING:
    import numpy as np

    from mjrun.formats.text_columns import LinePieces

ColumnFilter = Callable[[str], bool]


class Cells(IntEnum):
    """What the cells of a table may be.

    Attributes:
      NUMBERS: numbers, finite or not.
      GAPS: also empty, which is NaN.
      ANY: also texts, and integers that float64 does not hold; a block with such a cell has the type object, and its
        cells are float, int and str.
    """

    NUMBERS = 0
    GAPS = 1
    ANY = 2


class RowWriter(Protocol):
    """Writes rows in one format. Its methods raise OSError when the file cannot be written."""

    def write(self, block: np.ndarray) -> None:
        """Adds the rows of `block`, float64 `(n, columns)`, n ≥ 1."""
        ...

    def finish(self, manifest: str) -> None:
        """Completes the file; `manifest` is JSON, for a format that writes it last."""
        ...

    def close(self) -> None:
        """Frees resources, after `finish` or instead of it."""
        ...


@dataclass(frozen=True, eq=False)
class TableContents:
    """An open table.

    Attributes:
      names: of the columns that were asked for, in the order of the file.
      blocks: their rows, float64 or object `(n, columns)` (see `Cells`), n ≥ 1, each of bounded size; read as they are
        asked for.
      units: by name, as far as the file says.
      manifest: what mjrun wrote into the file about how it was made; None if there is nothing.
      lines: of the file, from which the blocks are made, where the format has a row on each; else None.
    """

    names: Sequence[str]
    blocks: Iterator[np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)
    manifest: dict[str, Any] | None = None
    lines: LinePieces | None = None


class ContentsReader(Protocol):
    """Begins to read a table from an open file."""

    def __call__(self, path: Path, file: BinaryIO, wanted: ColumnFilter, cells: Cells) -> TableContents:
        """Reads the names, and returns before the rows are read.

        Args:
          path: what the table is called in messages.
          file: stays open until the last block is read.
          wanted: the columns to read.
          cells: what they may be.

        Raises:
          FileError: it is no such table; so may be raised with every block.
        """
        ...


@dataclass(frozen=True)
class TableFormat:
    """A table format; each module in `mjrun.formats.tables` has one, called `FORMAT`.

    Attributes:
      name: as in the option format.
      suffixes: those of its files, the usual one first.
      writer: makes one, given an open file, the columns, and the manifest as JSON.
      reader: reads the columns that a filter accepts; None for a format that can only be written.
      pipe: whether it can be written to standard output, and read from standard input.
      holds_manifest: whether its files can hold the manifest.
      library, extra: the library it needs, and the extra of mjrun that installs it.
      reads_alone: whether only writing needs the library.
    """

    name: str
    suffixes: Sequence[str]
    writer: Callable[[BinaryIO, Sequence[Column], str], RowWriter]
    reader: ContentsReader | None
    pipe: bool = False
    holds_manifest: bool = True
    library: str = ""
    extra: str = ""
    reads_alone: bool = False

    def require_library(self, purpose: str) -> None:
        """Raises MissingExtraError or WrongVersionError if its library is unusable; `purpose`: `writing .parquet`."""
        if self.library:
            require(purpose, self.extra, self.library)
