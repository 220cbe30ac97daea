"""Tables: rows in by the block, one published table out, in the format that its suffix means.

| format  | suffix             | names           | labels, none  | units, manifest | memory            |
|---------|--------------------|-----------------|---------------|-----------------|-------------------|
| csv     | `.csv`             | cleaned         | cleaned, ``   | no              | flat              |
| jsonl   | `.jsonl`           | exact           | exact, null   | no              | flat              |
| parquet | `.parquet`         | exact           | exact, null   | yes             | flat              |
| feather | `.feather .arrow`  | exact           | exact, null   | as at opening   | flat              |
| npz     | `.npz`             | exact           | exact, `''`   | yes             | flat, disk twice  |
| mat     | `.mat`             | exact, in a cell| exact, `''`   | yes             | one column        |

Every number is the float64 that was measured: text is the shortest that reads back as the same bits.
A column with labels holds texts; its rows come as indices into them.
"""

import contextlib
import importlib.util
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Protocol

import numpy as np
import orjson

from mjrun.errors import ClosedPipeError, FileError, MissingExtraError, UnknownNameError, UsageError, clean
from mjrun.formats.columnar import FeatherSink, MatSink, NpzSink, ParquetSink
from mjrun.formats.publishing import Destination, StagedFile, StandardOutput
from mjrun.model.column import Column

PIECE = 2**16  # values turned into text at a time
FORMULA = ("=", "+", "-", "@")  # a spreadsheet takes a cell that starts so for a formula
# The same in full width, as in Japan, and after a semicolon, which parts cells where a comma is decimal.
LABEL_FORMULA = re.compile(r"(^|;)(?=\s*[=+\-@＝＋－＠])")


class Sink(Protocol):
    """One format of a table, into an open file. What its methods raise when that fails is an OSError."""

    def write(self, block: np.ndarray) -> None:
        """Adds rows `(n, columns)`, n ≥ 1."""
        ...

    def finish(self, manifest: str) -> None:
        """Completes the file; `manifest` is JSON, for a format that writes it last."""
        ...

    def close(self) -> None:
        """Frees what is held, after `finish` or instead of it."""
        ...


class CsvSink:
    """RFC 4180 in UTF-8, lines ending in a newline: the columns' names, then numbers and `nan`, `inf`, `-inf`.

    Names are cleaned of control characters and quoted where they need it. A name that a spreadsheet would take for
    a formula is quoted too, but not changed: in mjrun's own columns a group such as `qpos/` comes before every name
    from a model, so none can be one.

    A label may be any name from a model. It is cleaned and quoted in the same way; where a spreadsheet would take it
    for a formula, quoted or not, an apostrophe goes before that, as is the custom: `=1+1` is `'=1+1`. No text is an
    empty cell, an empty label `""`.
    """

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        self._file = file
        self._head = b",".join(_cell(column.name) for column in columns) + b"\n"
        self._texts = _texts(columns, _label_cell, b"")

    def write(self, block: np.ndarray) -> None:
        self._begin()
        for piece in _pieces(block):
            self._file.write(_mixed_lines(piece, self._texts) if self._texts else _lines(piece))

    def finish(self, manifest: str) -> None:
        self._begin()

    def close(self) -> None:
        pass

    def _begin(self) -> None:
        """Writes the header, which waits for the first row: what fails before it prints nothing."""
        self._file.write(self._head)
        self._head = b""


class JsonlSink:
    """One JSON object a line, `{"time":0.0,"qpos/knee":0.5}`; what is not finite, and no text, is null.

    A name or label that holds control characters is escaped, so that it reads back exactly and cannot steer a terminal.
    """

    def __init__(self, file: BinaryIO, columns: Sequence[Column], manifest: str) -> None:
        self._file = file
        first, *others = (_string(column.name) + b":" for column in columns)
        self._before = [b"}\n{" + first, *(b"," + key for key in others)]
        self._texts = _texts(columns, _string, b"null")

    def write(self, block: np.ndarray) -> None:
        for piece in _pieces(block):
            parts = [b""] * (2 * piece.size)
            parts[::2] = self._before * len(piece)
            parts[1::2] = _numbers(piece).replace(b"],[", b",").split(b",")
            for index, texts in self._texts.items():
                parts[2 * index + 1 :: 2 * piece.shape[1]] = texts[piece[:, index].astype(int)].tolist()
            parts[0] = parts[0].removeprefix(b"}\n")
            self._file.write(b"".join(parts) + b"}\n")

    def finish(self, manifest: str) -> None:
        pass

    def close(self) -> None:
        pass


@dataclass(frozen=True)
class Format:
    """A format of tables.

    Attributes:
      sink: opens one on a file, given the columns and the manifest as JSON.
      suffixes: those that mean it, the usual one first.
      pipe: whether it can be written to standard output.
      library, extra: what it needs beyond mjrun's own requirements, and the extra that installs it.
    """

    sink: Callable[[BinaryIO, Sequence[Column], str], Sink]
    suffixes: Sequence[str]
    pipe: bool = False
    library: str = ""
    extra: str = ""


FORMATS = {
    "csv": Format(CsvSink, (".csv",), pipe=True),
    "jsonl": Format(JsonlSink, (".jsonl",), pipe=True),
    "parquet": Format(ParquetSink, (".parquet",), library="pyarrow", extra="parquet"),
    "feather": Format(FeatherSink, (".feather", ".arrow"), library="pyarrow", extra="parquet"),
    "npz": Format(NpzSink, (".npz",)),
    "mat": Format(MatSink, (".mat",), library="scipy", extra="mat"),
}
SUFFIXES = {suffix: name for name, known in FORMATS.items() for suffix in known.suffixes}


def table_format(output: str | None, format: str | None = None) -> str:  # noqa: A002  (the word users know)
    """The name in `FORMATS` meant by an output's suffix, or by `format`; `output` None is standard output, csv.

    Raises:
      UnknownNameError: there is no such format or suffix; the message lists those there are.
      UsageError: the two disagree, or the format cannot be piped.
      MissingExtraError: the format's library is not installed.
    """
    name = _format(output, format)
    if output is None and not FORMATS[name].pipe:
        piped = " and ".join(n for n, f in FORMATS.items() if f.pipe)
        raise UsageError(f"--format {name} cannot be written to standard output\n{piped} can")
    library = FORMATS[name].library
    if library and importlib.util.find_spec(library) is None:
        raise MissingExtraError(f"writing {FORMATS[name].suffixes[0]}", library, FORMATS[name].extra)
    return name


class TableWriter:
    """Streams rows to a table as they come; nothing is published until `publish`.

    Opening it proves that the output can be written. Leave the context without `publish` and no trace
    of the table is left; on standard output, what is written is written.

    Args:
      output: a file, or None for standard output, which for a table may be a terminal.
      format: a name from `table_format`.
      columns: one for each number of a row; no two have the same name.
      manifest: what made the table, embedded where the format can hold it; plain values, for JSON.

    Attributes:
      rows: written so far.

    Raises:
      FileError: the output cannot be written.
    """

    def __init__(
        self,
        output: str | None,
        format: str,  # noqa: A002
        columns: Sequence[Column],
        manifest: Mapping[str, Any] | None = None,
    ) -> None:
        assert len({column.name for column in columns}) == len(columns) > 0
        self.rows, self._width = 0, len(columns)
        self._manifest = _document(manifest)
        with contextlib.ExitStack() as opened:
            self._target = StandardOutput(terminal=True) if output is None else StagedFile(Path(output))
            opened.callback(self._target.discard)
            with self._writing():
                self._file = opened.enter_context(_opened(self._target))
                self._sink = FORMATS[format].sink(self._file, columns, self._manifest)
            opened.callback(self._sink.close)
            self._opened = opened.pop_all()

    def write(self, block: np.ndarray) -> None:
        """Adds rows: `block` is `(n, columns)` float64 in any memory layout, and may be reused afterwards.

        Raises:
          FileError: the disk is full, or the format cannot hold more.
          ClosedPipeError: whoever read standard output is gone.
        """
        if block.ndim != 2 or block.shape[1] != self._width or block.dtype != np.float64:
            raise ValueError(f"rows must be float64 (n, {self._width}), not {block.dtype} {block.shape}")
        if not len(block):
            return
        with self._writing():
            self._sink.write(block)
            if self._target.stdout is not None:
                self._file.flush()
        self.rows += len(block)

    def publish(self, manifest: Mapping[str, Any] | None = None) -> list[Path]:
        """Completes the table, puts it in its place, and says which files that is.

        Args:
          manifest: takes the place of the one given at opening, in every format but feather.

        Raises:
          FileError: the table cannot be completed or put in its place.
          ClosedPipeError: whoever read standard output is gone.
        """
        final = self._manifest if manifest is None else _document(manifest)
        with self._writing():
            self._sink.finish(final)
            self._file.close()
        return self._target.publish()

    def close(self) -> None:
        """Ends the table, and removes what is not published."""
        self._opened.close()

    def __enter__(self) -> "TableWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Tells what the operating system refuses as mjrun tells it."""
        try:
            yield
        except BrokenPipeError:
            raise ClosedPipeError from None
        except OSError as error:
            raise FileError(self._target.shown, f"cannot be written: {error.strerror or error}") from None


@contextlib.contextmanager
def _opened(target: Destination) -> Iterator[BinaryIO]:
    """The file to write to, which is closed at the end, whether or not what it still holds can be written."""
    path = target.path if target.stdout is None else target.stdout
    file = open(path, "wb", closefd=target.stdout is None)  # noqa: SIM115
    try:
        yield file
    finally:
        with contextlib.suppress(OSError):
            file.close()


def _format(output: str | None, asked: str | None) -> str:
    if asked is not None and asked not in FORMATS:
        raise UnknownNameError("format", asked, list(FORMATS))
    if output is None:
        return asked or "csv"
    suffix = Path(output).suffix.lower()
    meant = SUFFIXES.get(suffix)
    if meant is None and asked is None:
        raise UnknownNameError("table format", suffix, list(SUFFIXES), where=output)
    if asked and meant and asked != meant:
        short = " (or --csv)" if asked == "csv" else ""
        raise UsageError(f"--format {asked}{short} and the suffix of {clean(output)} disagree")
    return asked or meant or ""


def _document(manifest: Mapping[str, Any] | None) -> str:
    return json.dumps(dict(manifest or {}), default=str)


def _cell(name: str) -> bytes:
    cell = clean(name)
    if not cell or cell.startswith(FORMULA) or any(c in cell for c in ',;"'):
        cell = '"' + cell.replace('"', '""') + '"'
    return cell.encode()


def _label_cell(label: str) -> bytes:
    return _cell(LABEL_FORMULA.sub(r"\1'", clean(label)))


def _string(text: str) -> bytes:
    return json.dumps(text, ensure_ascii=clean(text) != text).encode()


def _texts(columns: Sequence[Column], show: Callable[[str], bytes], none: bytes) -> dict[int, np.ndarray]:
    """What stands for the numbers of each column with labels, by its index; the last is for −1."""
    return {i: np.array([*map(show, c.labels), none], object) for i, c in enumerate(columns) if c.labels}


def _pieces(block: np.ndarray) -> Iterator[np.ndarray]:
    rows = max(1, PIECE // block.shape[1])
    for start in range(0, len(block), rows):
        yield np.ascontiguousarray(block[start : start + rows])


def _numbers(piece: np.ndarray) -> bytes:
    """`a,b],[c,d` for the rows `(a, b), (c, d)`; what is not finite is `null`."""
    return orjson.dumps(piece, option=orjson.OPT_SERIALIZE_NUMPY)[2:-2]


def _lines(piece: np.ndarray) -> bytes:
    text = _numbers(piece).replace(b"],[", b"\n") + b"\n"
    odd = piece[~np.isfinite(piece)]
    if not odd.size:
        return text
    words = np.array([b"inf", b"-inf", b"nan"])[np.where(np.isnan(odd), 2, odd < 0)]
    kept = text.split(b"null")
    parts = [b""] * (2 * len(kept) - 1)
    parts[::2], parts[1::2] = kept, words.tolist()
    return b"".join(parts)


def _mixed_lines(piece: np.ndarray, texts: Mapping[int, np.ndarray]) -> bytes:
    """The lines of a piece with columns of texts: the numbers between them are printed together."""
    cells = []
    for index, run in groupby(range(piece.shape[1]), key=lambda i: i if i in texts else -1):
        values = np.ascontiguousarray(piece[:, list(run)])
        cells.append(_lines(values).splitlines() if index < 0 else texts[index][values[:, 0].astype(int)].tolist())
    return b"\n".join(map(b",".join, zip(*cells, strict=True))) + b"\n"
