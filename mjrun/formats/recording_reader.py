"""Reads recordings: any state, from its place in the file.

A recording is not trusted: all of it is checked when it is opened, nothing in it is run, and what messages quote
from it is cleaned.
"""

import json
import math
import os
import struct
import weakref
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from mjrun.closable import Closable
from mjrun.confinement.confinement import is_readable
from mjrun.errors import FileError, option
from mjrun.formats import npy_header
from mjrun.formats.input_file import decoding, require_file
from mjrun.formats.recording_writer import PIECE, SUFFIX, not_finite

FACTS = 2**24  # characters of facts, at most
LOCAL = 26  # bytes of a member's header in the archive before the lengths of its name and extra field
TEXT = "unicode text"
ARRAYS = {"states": ("float64", ("n", "size")), "steps": ("int64", ("n",)), "facts": (TEXT, ())}
HINT = f"{option('recording')} FILE.npz makes one"


def is_recording(path: Path) -> bool:
    """Whether the file at `path` is a recording, complete or not, or by its name alone if it is no archive."""
    if not is_readable(path):
        return False  # as a table it is refused
    try:
        with zipfile.ZipFile(path) as archive:
            return len({f"{name}.npy" for name in ARRAYS} & {*archive.namelist()}) > 1
    except (OSError, ValueError, zipfile.BadZipFile):
        return path.suffix.lower() == SUFFIX


class RecordingReader(Closable):
    """Reads the states of a recording in any order; they stay on disk.

    Opening it checks all of it.

    Attributes:
      steps: of the states, `(n,)` int64, n ≥ 1, ascending from 0.
      size: numbers in a state.
      facts: what made it, according to the file.

    Raises:
      FileError: there is no such file, or it is not a complete recording; the message says why.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        require_file(self.path, "recording", [SUFFIX], HINT)
        try:
            with decoding(self.path, "is not a recording", HINT):
                self._read()
        except OSError as error:
            raise FileError(self.path, f"cannot be read: {error.strerror or error}") from None
        except MemoryError:
            raise FileError(self.path, "does not fit in memory") from None

    def _read(self) -> None:
        with self.path.open("rb") as file, zipfile.ZipFile(file) as archive:
            states, steps, facts = (_array(archive, file, name) for name in ARRAYS)
            if states.shape[0] != steps.shape[0]:
                raise ValueError(f"it has {states.shape[0]} states and {steps.shape[0]} steps")
            self.steps, self.facts = _steps(archive, steps), _facts(archive, facts)
            _require_finite(archive, states, self.steps)
            self._start, self.size = states.start, states.shape[1]
            self._file = os.dup(file.fileno())
            self._closing = weakref.finalize(self, os.close, self._file)

    def state(self, index: int) -> np.ndarray:
        """State number `index` as a new array `(size,)` float64.

        Raises:
          IndexError: there is none.
          FileError: the file has changed since it was opened.
        """
        if not 0 <= index < len(self.steps):
            raise IndexError(index)
        return self._read_states(index, 1)[0]

    def blocks(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """All states, a few at a time: their steps `(n,)` and the states `(n, size)` float64.

        Raises:
          FileError: the file has changed since it was opened.
        """
        count = max(1, PIECE // (8 * self.size))
        for start in range(0, len(self.steps), count):
            steps = self.steps[start : start + count]
            yield steps, self._read_states(start, len(steps))

    def _read_states(self, index: int, count: int) -> np.ndarray:
        if not self._closing.alive:
            raise ValueError("the recording is closed")
        row = 8 * self.size
        try:
            content = os.pread(self._file, count * row, self._start + index * row)
        except OSError as error:
            raise FileError(self.path, f"cannot be read: {error.strerror or error}") from None
        if len(content) < count * row:
            raise FileError(self.path, f"has changed while it was read: state {index + len(content) // row} is gone")
        return np.frombuffer(content, "<f8").reshape(count, self.size).astype(np.float64)

    def close(self) -> None:
        """Closes the file, which also happens when the reader is garbage-collected."""
        self._closing()


# The functions below raise a ValueError for a fault of the recording; `decoding` adds the path.


@dataclass(frozen=True)
class _Array:
    """An array in an archive: its values begin `start` bytes into the file, `head` bytes into the member."""

    info: zipfile.ZipInfo
    head: int
    start: int
    shape: tuple[int, ...]
    dtype: np.dtype


def _array(archive: zipfile.ZipFile, file: BinaryIO, name: str) -> _Array:
    """The array `name`, whose header is that of a recording and agrees with its size."""
    infos = [info for info in archive.infolist() if info.filename == f"{name}.npy"]
    if len(infos) != 1:
        raise ValueError(f"it has {'two arrays' if infos else 'no array'} {name!r}")
    info = infos[0]
    if info.compress_type != zipfile.ZIP_STORED or info.compress_size != info.file_size:
        raise ValueError(f"{name!r} is compressed; np.savez keeps arrays as they are")
    file.seek(max(0, info.header_offset) + LOCAL)
    begin = file.tell() + 4 + sum(struct.unpack("<HH", file.read(4)))
    if begin + info.file_size > os.fstat(file.fileno()).st_size:  # or much would be allocated to read it
        raise ValueError(f"{name!r} ends early")
    with archive.open(info) as member:
        shape, by_column, dtype = npy_header.read_header(member)
        head = member.tell()
    _require_kind(name, shape, dtype)
    if by_column and len(shape) > 1:
        raise ValueError(f"{name!r} lies by the column, not by the row")
    if math.prod(shape) * dtype.itemsize != info.file_size - head:
        raise ValueError(f"{name!r} has the shape {shape}, but {info.file_size - head} bytes")
    return _Array(info, head, begin + head, shape, dtype)


def _require_kind(name: str, shape: tuple[int, ...], dtype: np.dtype) -> None:
    kind, axes = ARRAYS[name]
    if dtype.kind != "U" if kind == TEXT else dtype != np.dtype(kind):
        raise ValueError(f"{name!r} holds {npy_header.content_name(dtype)}, not {kind}")
    if len(shape) != len(axes) or any(length < 1 for length in shape):
        raise ValueError(f"{name!r} has the shape {shape}, not ({', '.join(axes)}{',' * (len(axes) == 1)})")
    if kind == TEXT and not 0 < dtype.itemsize <= 4 * FACTS:
        raise ValueError(f"{name!r} has {dtype.itemsize // 4} characters, not 1 to {FACTS}")


def _content(archive: zipfile.ZipFile, array: _Array) -> Iterator[bytes]:
    """The values of `array` in pieces of whole rows. At the end its checksum is compared."""
    row = array.dtype.itemsize * math.prod(array.shape[1:])
    with archive.open(array.info) as member:
        member.read(array.head)
        while content := member.read(row * max(1, PIECE // row)):
            yield content


def _steps(archive: zipfile.ZipFile, array: _Array) -> np.ndarray:
    steps = np.frombuffer(b"".join(_content(archive, array)), array.dtype).astype(np.int64)
    if steps[0]:
        raise ValueError(f"its first step is {steps[0]}, not 0")
    falls = steps[1:] <= steps[:-1]
    if falls.any():
        at = int(falls.argmax())
        raise ValueError(f"its steps do not ascend: {steps[at + 1]} comes after {steps[at]}")
    return steps


def _facts(archive: zipfile.ZipFile, array: _Array) -> dict[str, Any]:
    text = str(np.frombuffer(b"".join(_content(archive, array)), array.dtype)[0])
    try:
        facts = json.loads(text)
    except (ValueError, RecursionError):
        facts = None
    if not isinstance(facts, dict):
        raise ValueError("'facts' is not a JSON object")
    return facts


def _require_finite(archive: zipfile.ZipFile, states: _Array, steps: np.ndarray) -> None:
    first = 0
    for content in _content(archive, states):
        block = np.frombuffer(content, "<f8").reshape(-1, states.shape[1])
        good = np.isfinite(block).all(axis=1)
        if not good.all():
            row = int(good.argmin())
            raise ValueError(f"state {first + row}, at step {steps[first + row]}: {not_finite(block[row])}")
        first += len(block)
