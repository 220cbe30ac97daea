"""Writes tables: rows arrive in blocks, and one file is published at the end."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mjrun.formats import tables
from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.destinations import StagedFile, StandardOutput
from mjrun.formats.row_writer import RowWriter
from mjrun.model.column import Column


class TableWriter(OutputWriter):
    """Streams rows to a table; nothing is published until `publish`, except on standard output.

    Opening it checks that the output can be written.

    Args:
      output: a file, or None for standard output, which for a table may be a terminal.
      format: a name in `tables.FORMATS`.
      columns: one for each number of a row; no two have the same name.
      manifest: how the table was made; plain values, for JSON. Embedded where the format can hold it.

    Attributes:
      rows: number of rows written so far.

    Raises:
      FileError: the output cannot be written.
    """

    def __init__(
        self,
        output: str | None,
        format: str,  # noqa: A002  (the option's name)
        columns: Sequence[Column],
        manifest: Mapping[str, Any] | None = None,
    ) -> None:
        assert len({column.name for column in columns}) == len(columns) > 0
        super().__init__(StandardOutput(terminal=True) if output is None else StagedFile(Path(output)))
        self.rows = 0
        self._width = len(columns)
        self._manifest = _json(manifest)
        with self.opening():
            self._file = self.open_file()
            known = tables.FORMATS[format]
            self._rows: RowWriter = getattr(known.module, known.writer)(self._file, columns, self._manifest)
            self.resources.callback(self._rows.close)

    def write(self, block: np.ndarray) -> None:
        """Adds rows: `block` is float64 `(n, columns)` in any memory layout, and may be reused afterwards.

        Raises:
          FileError: the disk is full, or the format cannot hold more.
          ClosedPipeError: the reader of standard output closed the pipe.
        """
        if block.ndim != 2 or block.shape[1] != self._width or block.dtype != np.float64:
            raise ValueError(f"rows must be float64 (n, {self._width}), not {block.dtype} {block.shape}")
        if not len(block):
            return
        with self.writing():
            self._rows.write(block)
            if self.destination.stdout is not None:
                self._file.flush()
        self.rows += len(block)

    def complete(self) -> None:
        with self.writing():
            self._rows.finish(self._manifest)
            self._file.close()

    def publish(self, manifest: Mapping[str, Any] | None = None) -> list[Path]:
        """Finishes the table, moves it to its final place, and returns its files.

        Args:
          manifest: replaces the one given at opening, except in feather, if the table is not finished yet.

        Raises:
          FileError: the output cannot be written.
          ClosedPipeError: the reader of standard output closed the pipe.
        """
        if manifest is not None:
            self._manifest = _json(manifest)
        return super().publish()


def _json(manifest: Mapping[str, Any] | None) -> str:
    return json.dumps(dict(manifest or {}), default=str)
