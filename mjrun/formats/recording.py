"""Recordings: writes them, and reads any of their states from its place in the file.

A recording is untrusted: it is checked completely when it is opened, nothing in it is executed, and messages clean what
they quote from it.
"""

import io
import json
import math
import os
import shutil
import struct
import tempfile
import weakref
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np

from mjrun.confinement.confinement import is_readable
from mjrun.dataclass import dataclass
from mjrun.errors import FileError, UsageError, clean, file_errors, option, quoted
from mjrun.file_version import version_of
from mjrun.formats import npy_reader
from mjrun.formats.input_file import decoding, require_file
from mjrun.formats.output_writer import OutputWriter, StagedFile, closing_quietly
from mjrun.shared_status import uninterrupted

FACTS = 2**24  # characters of facts, at most
LOCAL = 26  # bytes in the header of an archive's member before the lengths of its name and extra field
TEXT = "unicode text"
ARRAYS: dict[str, tuple[str, tuple[str, ...]]] = {
    "states": ("float64", ("n", "size")),
    "steps": ("int64", ("n",)),
    "facts": (TEXT, ()),
}
HINT = f"{option('recording')} FILE.npz makes one"
SUFFIX = ".npz"
PIECE = 2**20  # bytes handled at a time


def is_recording(path: Path) -> bool:
    """Returns whether the file at `path` is a recording, even if incomplete; if it is not an archive, by its name."""
    if not is_readable(path):
        return False  # it is refused as a table
    try:
        with zipfile.ZipFile(path) as archive:
            return len({f"{name}.npy" for name in ARRAYS} & {*archive.namelist()}) > 1
    except (OSError, ValueError, zipfile.BadZipFile):
        return path.suffix.lower() == SUFFIX


class RecordingReader:
    """A reader of the states of a recording in any order; they stay on disk.

    Opening it checks it completely. A file that is replaced is read on; one that is written to is refused.

    Attributes:
      steps: steps of the states, `(n,)` int64, n ≥ 1, ascending from 0.
      size: length of a state.
      facts: facts about its making, according to the file.

    Raises:
      FileError: the file does not exist, or is not a complete recording; the message states why.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        require_file(self.path, "recording", [SUFFIX], HINT)
        try:
            with decoding(self.path, "is not a recording", HINT):
                self._read()
        except MemoryError:
            raise FileError(self.path, "does not fit in memory") from None

    def _read(self) -> None:
        with self.path.open("rb") as file, zipfile.ZipFile(file) as archive:
            self._version = version_of(os.fstat(file.fileno()))  # before anything is read
            states, steps, facts = (_array(archive, file, name) for name in ARRAYS)
            if states.shape[0] != steps.shape[0]:
                raise ValueError(f"it has {states.shape[0]} states and {steps.shape[0]} steps")
            self.steps, self.facts = _steps(archive, steps), _facts(archive, facts)
            _require_finite(archive, states, self.steps)
            self._states, self.size = states, states.shape[1]
            self._file = os.dup(file.fileno())
            self._closing = weakref.finalize(self, os.close, self._file)

    def state(self, index: int) -> np.ndarray:
        """Reads state number `index` as a new array `(size,)` float64.

        Raises:
          IndexError: the recording has fewer states.
          FileError: the file has changed since it was opened.
        """
        if not 0 <= index < len(self.steps):
            raise IndexError(index)
        return self._read_states(index, 1)[0]

    def blocks(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yields all states, a few at a time: their steps `(n,)` and the states `(n, size)` float64.

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
        with file_errors(self.path):
            content = os.pread(self._file, count * row, self._states.start + index * row)
            self._require_unchanged()
        return np.frombuffer(content, "<f8").reshape(count, self.size).astype(np.float64)

    def _require_unchanged(self) -> None:
        """Requires that all states are as they were when the file was opened.

        Renaming or replacing the file changes its version, too, so the states decide.
        """
        version = version_of(os.fstat(self._file))
        if version == self._version:
            return
        checksum, place = 0, self._states.start - self._states.head
        end = place + self._states.info.file_size
        while place < end and (content := os.pread(self._file, min(PIECE, end - place), place)):
            checksum, place = zlib.crc32(content, checksum), place + len(content)
        if checksum != self._states.info.CRC:
            raise FileError(self.path, "has changed while it was read")
        self._version = version

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file, which also happens when the reader is garbage-collected."""
        self._closing()


# The functions below raise ValueError for a fault of the recording; `decoding` adds the path.


@dataclass(frozen=True)
class _Array:
    """An array in an archive: its values begin `start` bytes into the file, `head` bytes into the member."""

    info: zipfile.ZipInfo
    head: int
    start: int
    shape: tuple[int, ...]
    dtype: np.dtype


def _array(archive: zipfile.ZipFile, file: BinaryIO, name: str) -> _Array:
    """Locates the array `name`, and checks that its header is that of a recording and agrees with its size."""
    infos = [info for info in archive.infolist() if info.filename == f"{name}.npy"]
    if len(infos) != 1:
        raise ValueError(f"it has {'two arrays' if infos else 'no array'} {name!r}")
    info = infos[0]
    if info.compress_type != zipfile.ZIP_STORED or info.compress_size != info.file_size:
        raise ValueError(f"{name!r} is compressed; np.savez stores arrays uncompressed")
    file.seek(max(0, info.header_offset) + LOCAL)
    begin = file.tell() + 4 + sum(struct.unpack("<HH", file.read(4)))
    if begin + info.file_size > os.fstat(file.fileno()).st_size:  # otherwise reading it would allocate much memory
        raise ValueError(f"{name!r} ends early")
    with archive.open(info) as member:
        shape, by_column, dtype = npy_reader.read_header(member)
        head = member.tell()
    _require_kind(name, shape, dtype)
    if by_column and len(shape) > 1:
        raise ValueError(f"{name!r} is stored by column, not by row")
    if math.prod(shape) * dtype.itemsize != info.file_size - head:
        raise ValueError(f"{name!r} has the shape {shape}, but {info.file_size - head} bytes")
    return _Array(info, head, begin + head, shape, dtype)


def _require_kind(name: str, shape: tuple[int, ...], dtype: np.dtype) -> None:
    kind, axes = ARRAYS[name]
    if dtype.kind != "U" if kind == TEXT else dtype != np.dtype(kind):
        raise ValueError(f"{name!r} holds {npy_reader.content_name(dtype)}, not {kind}")
    if len(shape) != len(axes) or any(length < 1 for length in shape):
        raise ValueError(f"{name!r} has the shape {shape}, not ({', '.join(axes)}{',' * (len(axes) == 1)})")
    if kind == TEXT and not 0 < dtype.itemsize <= 4 * FACTS:
        raise ValueError(f"{name!r} has {dtype.itemsize // 4} characters, not 1 to {FACTS}")


def _content(archive: zipfile.ZipFile, array: _Array) -> Iterator[bytes]:
    """Yields the values of `array` in pieces of whole rows, and compares its checksum at the end."""
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


class RecordingWriter(OutputWriter):
    """A writer that streams states to a recording; nothing is published until `publish`.

    Opening it checks that the output can be written. The same states and facts give the same bytes. A signal does not
    interrupt `write`, so the states written so far can always be published.

    Args:
      path: an .npz file.
      size: length of a state.
      facts: facts about its making; plain values, for JSON. They are written when the recording is finished.

    Attributes:
      count: number of states written so far.
      last: the step of the last state; -1 before the first.

    Raises:
      UsageError: the path has another suffix.
      FileError: the output cannot be written.
    """

    def __init__(self, path: str, size: int, facts: Mapping[str, Any]) -> None:
        _require_suffix(path)
        self.count = 0
        self._size = size
        self.last = -1
        self._facts = facts
        self._info = zipfile.ZipInfo("states.npy")  # dated 1980: same recording, same bytes
        super().__init__(StagedFile(Path(path)))
        with self.opening():
            folder = Path(self.destination.path).parent
            enter = self.resources.enter_context
            self._file = self.open_file()
            self._steps = enter(closing_quietly(tempfile.TemporaryFile(dir=folder)))  # noqa: SIM115
            self._archive = enter(closing_quietly(zipfile.ZipFile(self._file, "w")))
            self._member = enter(closing_quietly(_member(self._archive, self._info)))
            np.lib.format.write_array_header_1_0(self._member, self._head(0))

    def write(self, step: int, state: np.ndarray) -> None:
        """Adds the state `(size,)` float64 at `step`: 0 for the first, then ascending.

        Raises:
          FileError: the disk is full, or the state is not finite.
        """
        if state.shape != (self._size,) or state.dtype != np.float64:
            raise ValueError(f"a state must be float64 ({self._size},), not {state.dtype} {state.shape}")
        if step <= self.last or (self.last < 0 and step):
            raise ValueError(f"step {step} cannot come after {self.last if self.count else 'nothing'}")
        if not np.isfinite(state).all():
            raise FileError(self.destination.shown, f"cannot hold step {step}: {not_finite(state)}")
        with uninterrupted(), self.writing():
            self._member.write(state.astype("<f8").tobytes())
            self._steps.write(struct.pack("<q", step))
            self.count += 1
            self.last = step

    def finish(self) -> None:
        if not self.count:
            raise ValueError("a recording has at least one state")
        with self.writing():
            self._member.close()
            self._write_count()
            with _member(self._archive, zipfile.ZipInfo("steps.npy")) as member:
                np.lib.format.write_array_header_1_0(member, _head("<i8", (self.count,)))
                self._steps.seek(0)
                shutil.copyfileobj(self._steps, member, PIECE)
            with _member(self._archive, zipfile.ZipInfo("facts.npy")) as member:
                facts = json.dumps(dict(self._facts), default=str)
                np.lib.format.write_array(member, np.array(facts), allow_pickle=False)
            self._archive.close()
            self._file.close()
        super().finish()

    def _head(self, count: int) -> dict[str, Any]:
        return _head("<f8", (count, self._size))

    def _write_count(self) -> None:
        """Writes the number of states to the array's header, where NumPy leaves space, and corrects the checksum.

        With headers A and B of one length, crc(A + data) ^ crc(B + data) is crc(A + zeros) ^ crc(B + zeros), for as
        many zeros as data: a checksum is an affine function of the bits.
        """
        zeros = 8 * self._size * self.count
        heads = []
        for count in (0, self.count):
            head = io.BytesIO()
            np.lib.format.write_array_header_1_0(head, self._head(count))
            heads.append(head.getvalue())
            self._info.CRC ^= _followed_by_zeros(zlib.crc32(heads[-1]), zeros)
        assert len(heads[0]) == len(heads[1])
        self._file.seek(self._info.header_offset)
        self._file.write(self._info.FileHeader(zip64=True) + heads[1])


def _require_suffix(path: str) -> None:
    suffix = Path(path).suffix
    if suffix.lower() != SUFFIX:
        reason = f"not {quoted(suffix)}" if suffix else "and this has no suffix"
        raise UsageError(f"{option('recording')} {clean(path)}: a recording is a {SUFFIX} file, {reason}")


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Any:
    return archive.open(info, "w", force_zip64=True)


def _head(descr: str, shape: tuple[int, ...]) -> dict[str, Any]:
    return {"descr": descr, "fortran_order": False, "shape": shape}


def _followed_by_zeros(crc: int, count: int) -> int:
    """Returns the checksum of bytes with the checksum `crc`, followed by `count` zeros."""
    whole, rest = divmod(count, PIECE)
    zeros = bytes(PIECE if whole else 0)
    for _ in range(whole):
        crc = zlib.crc32(zeros, crc)
    return zlib.crc32(bytes(rest), crc)


def not_finite(state: np.ndarray) -> str:
    """Returns a description of the first number in `state` that is not finite."""
    index = int(np.isfinite(state).argmin())
    return f"number {index} of its state is {state[index]}"
