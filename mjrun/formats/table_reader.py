"""Tables, read back: the wanted columns of a table in any of mjrun's formats, whoever wrote it.

| format  | names of the columns                                 | a null or an empty cell |
|---------|------------------------------------------------------|-------------------------|
| csv     | in the header, less the spaces around them           | refused                 |
| jsonl   | the keys of the first row                            | refused                 |
| parquet | exact                                                | refused                 |
| feather | exact                                                | refused                 |
| npz     | exact                                                | –                       |
| mat     | in the cell `columns`, without it those of variables | –                       |

What mjrun wrote comes back as the same bits, but csv holds cleaned names, and jsonl null for what is not finite.
Tables come in pieces: besides the wanted columns, one of them at most is in memory once more.
A table is not trusted: nothing in it runs, and what is told of it is cleaned.
"""

import codecs
import contextlib
import csv
import importlib.util
import itertools
import json
import math
import zipfile
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, KeysView, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, AnyStr, BinaryIO

import numpy as np
import orjson

from mjrun.errors import FileError, MissingExtraError, UnknownNameError, clean, quoted
from mjrun.formats.input_file import cut, decoding, require_file
from mjrun.formats.mat_reader import KINDS, NUMERIC_KINDS, MatFile, Matrix
from mjrun.formats.table_writer import FORMATS, SUFFIXES

ROWS = 2**9  # of text, turned into numbers at a time while they are in the processor's cache
PIECE = 2**16  # values of an array read at a time
LINE = 2**24  # characters in a line of text, at most
NOT_COLUMNS = ("__units__", "__manifest__")  # what mjrun's npz has besides
NUMERIC = "biuf"  # kinds of NumPy's types that are read: booleans, integers, floats
SAID = {"U": "text", "S": "text", "O": "objects", "c": "complex values"}
HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}

Wanted = Callable[[str], bool]


def read_table(path: Path, wanted: Wanted) -> dict[str, np.ndarray]:
    """The columns of the table at `path` whose names are wanted, as float64 `(n,)`, in the table's order.

    Other columns may hold anything. Integers and booleans are numbers, and so are `nan` and `inf` in text; an empty
    cell, a null and a number in quotes in JSON are not. Lines count from 1, the header's; rows from 1.

    Raises:
      FileError: there is no such file, it is not whole, two wanted columns have one name or differ in length,
        or a wanted cell is not a number; the message says at which line or row.
      UnknownNameError: its suffix means no format; the message lists those that do.
      MissingExtraError: the format's library is not installed.
    """
    require_file(path, "table", SUFFIXES)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise UnknownNameError("table format", suffix, list(SUFFIXES), where=str(path))
    try:
        return READERS[SUFFIXES[suffix]](path, wanted)
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    except MemoryError:
        raise FileError(path, "its columns do not fit in memory") from None


def _chosen(path: Path, names: Sequence[str], wanted: Wanted) -> dict[str, int]:
    """The wanted names, each with its index."""
    chosen: dict[str, int] = {}
    for index, name in enumerate(names):
        if wanted(name):
            if name in chosen:
                raise FileError(path, f"two columns are called {_shown(name)}")
            chosen[name] = index
    return chosen


# --- text --------------------------------------------------------------------------------------------


def _csv(path: Path, wanted: Wanted) -> dict[str, np.ndarray]:
    # Bytes that are not UTF-8 may stand in other columns: an older spreadsheet writes its own code page.
    with path.open(encoding="utf-8-sig", errors="surrogateescape", newline="") as file:
        rows = _csv_rows(path, file)
        line, head = next(rows, (1, []))
        names = [name.strip(" \t") for name in head]
        _require_names(path, line, names)
        return _gathered(path, rows, _chosen(path, names, wanted), _floats_of_text)


def _csv_rows(path: Path, file: IO[str]) -> Iterator[tuple[int, list[str]]]:
    """The header and every row, as long as it, each with the line on which it begins; blank lines are no rows."""
    reader = csv.reader(_lines(path, file), skipinitialspace=True, strict=True)
    width = -1
    while True:
        line = reader.line_num + 1
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


def _require_names(path: Path, line: int, names: Sequence[str]) -> None:
    """Raises FileError if `names` cannot be a header."""
    place = f"{path}:{line}"
    if not names:
        raise FileError(path, "is empty: a table begins with the names of its columns")
    if any("\0" in name for name in names):
        raise FileError(place, "is not text in UTF-8")
    if len(names) == 1 and any(separator in names[0] for separator in ";\t"):
        raise FileError(place, f"{_shown(names[0])} is one column: columns are separated by commas")
    if all(_is_number(name, _floats_of_text) for name in names):
        raise FileError(place, "holds numbers: a table begins with the names of its columns")


def _jsonl(path: Path, wanted: Wanted) -> dict[str, np.ndarray]:
    with path.open("rb") as file:
        rows = _json_rows(path, file)
        first = next(rows, None)
        if first is None:
            raise FileError(path, "is empty: its first row has the names of the columns")
        names = first[1].keys()
        keys = {name: name for name in _chosen(path, list(names), wanted)}
        alike = _with_keys(path, rows, names, wanted)
        return _gathered(path, itertools.chain([first], alike), keys, _floats_of_json)


def _json_rows(path: Path, file: BinaryIO) -> Iterator[tuple[int, dict[str, Any]]]:
    """Every object, with its line; blank lines are no rows, and no two keys of the first row are alike."""
    first = True
    for number, text in enumerate(_lines(path, file), 1):
        line = text.removeprefix(codecs.BOM_UTF8) if number == 1 else text
        if not line.strip():
            continue
        place = f"{path}:{number}"
        try:
            row = orjson.loads(line)
        except orjson.JSONDecodeError as error:
            raise FileError(place, f"cannot be read as JSON: {clean(error.msg)}, character {error.pos + 1}") from None
        if not isinstance(row, dict):
            raise FileError(place, 'is not an object, as in {"time": 0.0}')
        if first:
            _require_unlike(place, line)
            first = False
        yield number, row


def _require_unlike(place: str, line: bytes) -> None:
    """Raises FileError if two keys of the object in `line` are alike, of which orjson keeps the last."""
    with contextlib.suppress(RecursionError):  # orjson goes deeper
        names = Counter(name for name, _ in json.loads(line, object_pairs_hook=list, parse_int=float))
        name, count = names.most_common(1)[0] if names else ("", 0)
        if count > 1:
            raise FileError(place, f"two columns are called {_shown(name)}")


def _with_keys(
    path: Path, rows: Iterable[tuple[int, dict[str, Any]]], names: KeysView[str], wanted: Wanted
) -> Iterator[tuple[int, dict[str, Any]]]:
    """`rows`, of which each has those keys in `names` that are wanted, and no other that is."""
    for line, row in rows:
        if row.keys() != names:
            for name in (*names, *row):
                if (name in names) != (name in row) and wanted(name):
                    reason = "is not in the first row" if name in row else "is missing"
                    raise FileError(f"{path}:{line}", f"column {_shown(name)} {reason}")
        yield line, row


def _lines(path: Path, file: IO[AnyStr]) -> Iterator[AnyStr]:
    for number in itertools.count(1):
        line = file.readline(LINE)
        if not line:
            return
        if len(line) == LINE:
            raise FileError(f"{path}:{number}", f"is a line of more than {LINE} characters")
        yield line


def _gathered(
    path: Path,
    rows: Iterator[tuple[int, Any]],
    keys: Mapping[str, Hashable],
    floats: Callable[[list[Any]], np.ndarray],
) -> dict[str, np.ndarray]:
    """The columns in `keys`, each by its name and by what it is called in a row."""
    pieces = {name: [np.empty(0)] for name in keys}
    while chunk := list(itertools.islice(rows, ROWS)):
        try:
            for name, key in keys.items():
                pieces[name].append(floats([row[key] for _, row in chunk]))
        except ValueError:
            cells = ((line, name, row[key]) for line, row in chunk for name, key in keys.items())
            line, name, cell = next(cell for cell in cells if not _is_number(cell[2], floats))
            raise FileError(f"{path}:{line}", f"column {_shown(name)}: {_said(cell)} is not a number") from None
    return {name: np.concatenate(pieces.pop(name)) for name in list(pieces)}


def _floats_of_text(cells: list[str]) -> np.ndarray:
    text = "".join(cells)
    if "_" in text or not text.isascii():  # Python's float takes 1_000 and the digits of any script
        raise ValueError
    return np.array(list(map(float, cells)))


def _floats_of_json(cells: list[Any]) -> np.ndarray:
    if not {int, float, bool}.issuperset(map(type, cells)):
        raise ValueError
    return np.array(cells, np.float64)


def _is_number(cell: Any, floats: Callable[[list[Any]], np.ndarray]) -> bool:
    try:
        floats([cell])
    except ValueError:
        return False
    return True


def _said(cell: Any) -> str:
    """A cell that is not a number, in words."""
    if isinstance(cell, str):
        return _shown(cell) if cell else "an empty cell"
    return "null" if cell is None else "a list" if isinstance(cell, list) else "an object"


# --- columnar ----------------------------------------------------------------------------------------


def _parquet(path: Path, wanted: Wanted) -> dict[str, np.ndarray]:
    _require_pyarrow(path)
    import pyarrow.parquet

    with path.open("rb") as file:
        with decoding(path, _unread(path)):
            found = pyarrow.parquet.ParquetFile(file)
            fields = _fields(found.schema_arrow)
        chosen = list(_arrow_columns(path, fields, wanted))
        with decoding(path, _unread(path)):
            batches = ([batch[name] for name in chosen] for batch in found.iter_batches(columns=chosen))
            return _joined(path, chosen, batches)


def _feather(path: Path, wanted: Wanted) -> dict[str, np.ndarray]:
    _require_pyarrow(path)
    from pyarrow import ipc

    with path.open("rb") as file:
        with decoding(path, _unread(path)):
            fields = _fields(ipc.open_file(file).schema)
        chosen = _arrow_columns(path, fields, wanted)
        if not chosen:  # no field included would mean all
            return {}
        with decoding(path, _unread(path)):
            options = ipc.IpcReadOptions(included_fields=list(chosen.values()))
            found = ipc.open_file(file, options=options)
            return _joined(path, list(chosen), map(_valid, map(found.get_batch, range(found.num_record_batches))))


def _require_pyarrow(path: Path) -> None:
    known = FORMATS["parquet"]
    if importlib.util.find_spec(known.library) is None:
        raise MissingExtraError(f"reading {path.suffix.lower()}", known.library, known.extra)


def _valid(batch: Any) -> list[Any]:
    """The columns of a batch whose offsets and indices have been checked: they are the file's own."""
    batch.validate(full=True)
    return batch.columns


def _fields(schema: Any) -> list[tuple[str, Any]]:
    return [(field.name, field.type) for field in schema]


def _arrow_columns(path: Path, fields: Sequence[tuple[str, Any]], wanted: Wanted) -> dict[str, int]:
    """The wanted columns, all of numbers, each with its index."""
    from pyarrow import types

    chosen = _chosen(path, [name for name, _ in fields], wanted)
    for name, index in chosen.items():
        kind = fields[index][1]
        inner = kind.value_type if types.is_dictionary(kind) else kind
        numeric = (types.is_floating, types.is_integer, types.is_boolean, types.is_decimal)
        if not any(is_kind(inner) for is_kind in numeric):
            raise FileError(path, f"column {_shown(name)} holds {clean(cut(str(inner)))}, not numbers")
    return chosen


def _joined(path: Path, names: Sequence[str], batches: Iterable[Sequence[Any]]) -> dict[str, np.ndarray]:
    """Batches of Arrow arrays, one for each name, as columns."""
    pieces = {name: [np.empty(0)] for name in names}
    before = 0
    for arrays in batches:
        for name, array in zip(names, arrays, strict=True):
            pieces[name].append(_floats_of_arrow(path, name, array, before))
        before += len(arrays[0]) if names else 0
    return {name: np.concatenate(pieces.pop(name)) for name in list(pieces)}


def _floats_of_arrow(path: Path, name: str, array: Any, before: int) -> np.ndarray:
    from pyarrow import types

    plain = array.dictionary_decode() if types.is_dictionary(array.type) else array
    if plain.null_count:
        row = before + int(plain.is_null().to_numpy(zero_copy_only=False).argmax()) + 1
        raise FileError(path, f"row {row}: column {_shown(name)}: null is not a number")
    return plain.to_numpy(zero_copy_only=False).astype(np.float64)


def _npz(path: Path, wanted: Wanted) -> dict[str, np.ndarray]:
    with path.open("rb") as file:
        with decoding(path, _unread(path)):
            archive = zipfile.ZipFile(file)
        arrays = [(info.filename.removesuffix(".npy"), info) for info in archive.infolist()]
        arrays = [(name, info) for name, info in arrays if name != info.filename and name not in NOT_COLUMNS]
        chosen = _chosen(path, [name for name, _ in arrays], wanted)
        found = {}
        for name, index in chosen.items():
            with decoding(path, _unread(path)), archive.open(arrays[index][1]) as member:
                found[name] = _floats_of_npy(path, name, member)
    return _even(path, found)


def _floats_of_npy(path: Path, name: str, member: IO[bytes]) -> np.ndarray:
    """The array in an archive's member; one of objects, which would have to be unpickled, is refused."""
    version = np.lib.format.read_magic(member)
    if version not in HEADERS:
        raise ValueError(f"an array is of the unknown version {version}")
    shape, _, dtype = HEADERS[version](member)
    _require_numeric(path, name, dtype)
    if not shape or shape[1:] not in ((), (1,)):
        raise FileError(path, f"column {_shown(name)} has the shape {shape}, not (n,)")
    values = np.empty(shape[0])
    for start in range(0, len(values), PIECE):
        piece = values[start : start + PIECE]
        piece[:] = np.frombuffer(member.read(piece.size * dtype.itemsize), dtype, piece.size)
    if member.read(1):  # at the end of a member its checksum is compared
        raise ValueError("an array is longer than its shape")
    return values


def _mat(path: Path, wanted: Wanted) -> dict[str, np.ndarray]:
    with path.open("rb") as file:
        with decoding(path, _unread(path)):
            found = MatFile(file)
            columns = found.columns()
        chosen = _chosen(path, [name for name, _ in columns], wanted)
        values = {}
        for name, index in chosen.items():
            with decoding(path, _unread(path)):
                values[name] = _floats_of_mat(path, name, found.read(columns[index][1]))
    return _even(path, values)


def _floats_of_mat(path: Path, name: str, matrix: Matrix) -> np.ndarray:
    if matrix.kind not in NUMERIC_KINDS or matrix.imaginary:
        said = "complex values" if matrix.imaginary else KINDS.get(matrix.kind, "objects")
        raise FileError(path, f"column {_shown(name)} holds {said}, not numbers")
    if len(matrix.shape) != 2 or 1 not in matrix.shape:
        raise FileError(path, f"column {_shown(name)} has the shape {matrix.shape}, not (n, 1) or (1, n)")
    _, values = next(matrix.parts)
    if values.size != math.prod(matrix.shape):
        raise ValueError("a matrix is not of the size that it says")
    return values.astype(np.float64)


def _require_numeric(path: Path, name: str, dtype: np.dtype) -> None:
    if dtype.kind not in NUMERIC:
        raise FileError(path, f"column {_shown(name)} holds {SAID.get(dtype.kind, dtype.name)}, not numbers")


def _even(path: Path, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """`columns`, if all are of one length."""
    sizes = {len(values): name for name, values in columns.items()}
    if len(sizes) > 1:
        said = " and ".join(f"{_shown(name)} {size}" for size, name in list(sizes.items())[:2])
        raise FileError(path, f"columns differ in rows: {said}")
    return columns


# --- messages ----------------------------------------------------------------------------------------


def _unread(path: Path) -> str:
    return f"cannot be read as {path.suffix.lower()}"


def _shown(text: str) -> str:
    return quoted(cut(text))


READERS = {"csv": _csv, "jsonl": _jsonl, "parquet": _parquet, "feather": _feather, "npz": _npz, "mat": _mat}
