"""Writers of tables: `TableWriter`, and the interface and bases of the writers of each format.

Rows arrive in blocks. For formats that hold a table by column, they are transposed in groups of bounded size. Parquet
and Feather write one group after another; npz, mat and hdf5 need whole columns, so their groups wait in an unnamed file
beside the table.

The units of `run.csv`, and the meanings of its columns, are in `run.csv-metadata.json`, as in "CSV on the Web" of the
W3C: https://www.w3.org/TR/tabular-metadata/. They belong to the titles of columns, whatever program wrote them.
"""

import contextlib
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from mjrun.errors import FileError, clean
from mjrun.formats import tables
from mjrun.formats.input_file import is_file, opened, parse_manifest
from mjrun.formats.local_and_remote_folders import destination_at, written_file
from mjrun.formats.output_writer import OutputWriter, StandardOutput
from mjrun.model.table_column import Column
from mjrun.options.trace import COMMENT, METADATA

GROUP = 2**21  # values in a group: 16 MiB
FIRST_ROWS = 2**9  # rows that fit at first: a short table needs little memory
CONTEXT = "http://www.w3.org/ns/csvw"
UNIT, MEANING = "schema:unitText", "dc:description"
MOST_METADATA = 2**24  # bytes that are read, at most


class RowWriter:
    """A writer of rows in one format, given the open file, the columns, and the manifest as JSON.

    Its methods raise OSError when the file cannot be written.
    """

    def write(self, block: np.ndarray) -> None:
        """Adds the rows of `block`, float64 `(n, columns)`, n ≥ 1."""
        raise NotImplementedError

    def finish(self, manifest: str) -> None:
        """Completes the file; `manifest` is JSON, for a format that writes it last."""

    def close(self) -> None:
        """Frees resources, after `finish` or instead of it."""


class RowGroupBuffer:
    """A buffer of rows, which returns groups `(columns, rows)` of at most `GROUP` values, each valid until the next."""

    def __init__(self, columns: int) -> None:
        self._rows = max(1, GROUP // columns)  # in a full group
        self._group = np.empty((columns, min(self._rows, FIRST_ROWS)))
        self._filled = 0

    def add(self, block: np.ndarray) -> Iterator[np.ndarray]:
        """Adds the rows of `block` `(n, columns)` and yields every group that they fill."""
        while len(block):
            part, block = block[: self._rows - self._filled], block[self._rows - self._filled :]
            end = self._filled + len(part)
            if end > self._group.shape[1]:  # as more rows are to come, room for twice as many
                before = self._group
                self._group = np.empty((len(before), min(self._rows, max(end, 2 * before.shape[1]))))
                self._group[:, : self._filled] = before[:, : self._filled]
            self._group[:, self._filled : end] = part.T
            self._filled = end
            if self._filled == self._rows:
                self._filled = 0
                yield self._group

    def rest(self) -> Iterator[np.ndarray]:
        """Yields the rows that fill no group, if any."""
        if self._filled:
            yield self._group[:, : self._filled]
            self._filled = 0

    def close(self) -> None:
        """Frees the memory, which would otherwise last as long as anything refers to the writer of the table."""
        self._group = self._group[:0, :0].copy()


class RowGroupWriter(RowWriter):
    """Base of the writers that write one group after another.

    Attributes:
      writer: writer of the library or file, which `close` closes after any failure too.
    """

    writer: Any

    def __init__(self, columns: Sequence[Column]) -> None:
        self.columns = columns
        self._groups = RowGroupBuffer(len(columns))

    def write(self, block: np.ndarray) -> None:
        for group in self._groups.add(block):
            self.write_group(group)

    def finish(self, manifest: str) -> None:
        for group in self._groups.rest():
            self.write_group(group)
        self.end(manifest)
        self.writer.close()

    def close(self) -> None:
        self._groups.close()
        with contextlib.suppress(Exception):  # it may have stopped anywhere
            self.writer.close()

    def write_group(self, group: np.ndarray) -> None:
        """Writes the rows of `group` `(columns, rows)`."""
        raise NotImplementedError

    def end(self, manifest: str) -> None:
        """Writes what follows the last group."""


class WholeColumnWriter(RowGroupWriter):
    """Base of the writers that need whole columns.

    Rows wait in a file without a name, which no failure leaves behind. It is in the folder of the table, whose disk
    needs the space.

    Attributes:
      writer: the file without a name; `end` writes the table, once all rows are in it.
      rows: number of rows so far.
    """

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        super().__init__(columns)
        self.file = file
        self.rows = 0
        self.writer = tempfile.TemporaryFile(dir=Path(file.name).parent)  # noqa: SIM115  (closed by close)
        self._sizes: list[int] = []  # rows in each group

    def write(self, block: np.ndarray) -> None:
        self.rows += len(block)
        super().write(block)

    def write_group(self, group: np.ndarray) -> None:
        self.writer.write(np.ascontiguousarray(group).data)
        self._sizes.append(group.shape[1])

    def cells(self, index: int) -> tuple[np.dtype, Iterator[np.ndarray]]:
        """Returns the type of a column, and its cells in pieces.

        Texts are of a unicode type, `''` for −1; integers are int64 unless one is missing; the rest is float64.
        """
        column = self.columns[index]
        if column.labels:
            texts = np.array([*column.labels, ""])  # the last is for −1
            return texts.dtype, (texts[piece.astype(int)] for piece in self._values(index))
        is_whole = column.integer and not any(np.isnan(piece).any() for piece in self._values(index))
        kind = np.dtype("<i8" if is_whole else "<f8")
        return kind, (piece.astype(kind) for piece in self._values(index))

    def _values(self, index: int) -> Iterator[np.ndarray]:
        before = 0
        for size in self._sizes:
            self.writer.seek(8 * (len(self.columns) * before + index * size))
            yield np.frombuffer(self.writer.read(8 * size))
            before += size


class TableWriter(OutputWriter):
    """A writer that streams rows to a table; nothing is published until `publish`, except on standard output.

    Opening it checks that the output can be written.

    Args:
      output: a file, the URL of one, or None for standard output, which for a table may be a terminal.
      format: a name in `tables.FORMATS`.
      columns: one for each number of a row; no two have the same name.
      manifest: how the table was made; plain values, for JSON. Embedded where the format can hold it.
      units: where a CSV file states its units: `comment`, `metadata`, or None for nowhere. Other formats hold them.

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
        units: str | None = None,
    ) -> None:
        assert len({column.name for column in columns}) == len(columns) > 0
        super().__init__(StandardOutput(terminal=True) if output is None else destination_at(output))
        self.rows = 0
        self._width = len(columns)
        self._manifest = _json(manifest)
        with self.opening():
            self._file = self.open_file()
            known = tables.FORMATS[format]
            writer = known.commented if known.commented and units == COMMENT else known.writer
            self._rows: RowWriter = getattr(known.module, writer)(self._file, columns, self._manifest)
            self.resources.callback(self._rows.close)
            self._metadata: OutputWriter | None = None
            if known.commented and units == METADATA and output is not None:
                beside = written_file(metadata_path(Path(output)), metadata(Path(output), columns))
                self._metadata = self.resources.enter_context(beside)

    @property
    def together(self) -> Sequence[OutputWriter]:
        """This writer, and the writer of the metadata beside the table."""
        return [self, *([self._metadata] if self._metadata else [])]

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

    def finish(self) -> None:
        with self.writing():
            self._rows.finish(self._manifest)
            self._file.close()
        super().finish()
        if self._metadata:
            self._metadata.finish()

    def publish(self, manifest: Mapping[str, Any] | None = None) -> list[Path]:
        """Finishes the table, moves it to its final place, and returns its files.

        Args:
          manifest: replaces the one given at opening, except in feather.

        Raises:
          FileError: the output cannot be written.
          ClosedPipeError: the reader of standard output closed the pipe.
        """
        if manifest is not None:
            self._manifest = _json(manifest)
        return super().publish()


def _json(manifest: Mapping[str, Any] | None) -> str:
    return json.dumps(dict(manifest or {}), default=str)


def metadata_path(table: Path) -> Path:
    """Returns the path of the metadata of a table."""
    return table.with_name(f"{table.name}-metadata.json")


def metadata(table: Path, columns: Sequence[Column]) -> bytes:
    """Returns the metadata of a table with these columns."""
    described: list[dict[str, str]] = []
    for column in columns:
        facts = {UNIT: column.unit, MEANING: column.meaning}
        described.append({"titles": clean(column.name), **{key: text for key, text in facts.items() if text}})
    document = {"@context": CONTEXT, "url": table.name, "tableSchema": {"columns": described}}
    return f"{json.dumps(document, indent=2, ensure_ascii=False)}\n".encode()


def units_beside(table: Path) -> dict[str, str]:
    """Returns the units in the metadata of a table, by column; empty if they are missing or are not metadata."""
    path = metadata_path(table)
    if not is_file(path):
        return {}
    try:
        with opened(path, "metadata file", ()) as file:
            document = parse_manifest(file.read(MOST_METADATA))
    except FileError:
        return {}
    columns = _entry(_entry(document, "tableSchema"), "columns")
    known = [
        column for column in cast("list[Any]", columns if isinstance(columns, list) else []) if _entry(column, UNIT)
    ]
    return {title: column[UNIT] for column in known for title in _titles(column) if isinstance(column[UNIT], str)}


def _entry(node: object, key: str) -> object:
    """Returns an entry of an object in a document, which is untrusted; None if it is missing."""
    return cast("dict[str, object]", node).get(key) if isinstance(node, dict) else None


def _titles(column: dict[str, object]) -> Iterator[str]:
    titles = column.get("titles", column.get("name"))
    yield from (title for title in (titles if isinstance(titles, list) else [titles]) if isinstance(title, str))
