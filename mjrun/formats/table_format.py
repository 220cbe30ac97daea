"""What a table format is: its suffixes, its writer, its reader, and the library it needs."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Protocol

from mjrun.errors import MissingExtraError
from mjrun.formats.table import Table
from mjrun.model.column import Column

if TYPE_CHECKING:
    import numpy as np

ColumnFilter = Callable[[str], bool]


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


@dataclass(frozen=True)
class TableFormat:
    """A table format; each module in `mjrun.formats.tables` has one, called `FORMAT`.

    Attributes:
      name: as in the option format.
      suffixes: those of its files, the usual one first.
      writer: makes one, given an open file, the columns, and the manifest as JSON.
      reader: reads the columns that a filter accepts; None for a format that can only be written.
      pipe: whether it can be written to standard output.
      library, extra: the library it needs, and the extra of mjrun that installs it.
    """

    name: str
    suffixes: Sequence[str]
    writer: Callable[[BinaryIO, Sequence[Column], str], RowWriter]
    reader: Callable[[Path, ColumnFilter], Table] | None
    pipe: bool = False
    library: str = ""
    extra: str = ""

    def require_library(self, purpose: str) -> None:
        """Raises MissingExtraError if its library is not installed; `purpose`: `writing .parquet`."""
        if self.library and importlib.util.find_spec(self.library) is None:
            raise MissingExtraError(purpose, self.library, self.extra)
