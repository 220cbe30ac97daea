"""Recordings on disk: the replayable states of a simulation, in an ordinary .npz archive that `np.load` reads.

| array    | type and shape      | what                                                       |
|----------|---------------------|------------------------------------------------------------|
| `states` | float64 `(n, size)` | integration states, all finite                             |
| `steps`  | int64 `(n,)`        | the step of each, ascending from 0                         |
| `facts`  | text `()`           | what made it, as JSON: `json.loads(str(f["facts"]))`       |

The arrays are stored as they are, not compressed, so that a state can be read where it lies.
"""

import contextlib
import io
import json
import shutil
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mjrun.errors import FileError, UsageError, clean, option, quoted
from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.destinations import StagedFile

SUFFIX = ".npz"
PIECE = 2**20  # bytes handled at a time


class RecordingWriter(OutputWriter):
    """Streams states to a recording; nothing is published until `publish`.

    Opening it proves that the output can be written. The same states and facts make the same bytes.

    Args:
      path: a .npz file.
      size: numbers in a state.
      facts: what made the recording; plain values, for JSON. They are written when the recording is finished.

    Attributes:
      count: states written so far.

    Raises:
      UsageError: the path is standard output, or has another suffix.
      FileError: the output cannot be written.
    """

    def __init__(self, path: str, size: int, facts: Mapping[str, Any]) -> None:
        _require_suffix(path)
        self.count, self._size, self._last = 0, size, -1
        self._facts = facts
        self._info = zipfile.ZipInfo("states.npy")  # dated 1980: same recording, same bytes
        super().__init__(StagedFile(Path(path)))
        with self.opening():
            folder, enter = Path(self.destination.path).parent, self.resources.enter_context
            self._file = self.open_file()
            self._steps = enter(_closing(tempfile.TemporaryFile(dir=folder)))  # noqa: SIM115
            self._archive = enter(_closing(zipfile.ZipFile(self._file, "w")))
            self._member = enter(_closing(_member(self._archive, self._info)))
            np.lib.format.write_array_header_1_0(self._member, self._head(0))

    def write(self, step: int, state: np.ndarray) -> None:
        """Adds the state `(size,)` float64 at `step`: 0 at first, then ever greater.

        Raises:
          FileError: the disk is full, or the state is not finite.
        """
        if state.shape != (self._size,) or state.dtype != np.float64:
            raise ValueError(f"a state must be float64 ({self._size},), not {state.dtype} {state.shape}")
        if step <= self._last or (self._last < 0 and step):
            raise ValueError(f"step {step} cannot come after {self._last if self.count else 'nothing'}")
        if not np.isfinite(state).all():
            raise FileError(self.destination.shown, f"cannot hold step {step}: {not_finite(state)}")
        with self.writing():
            self._member.write(state.astype("<f8").tobytes())
            self._steps.write(struct.pack("<q", step))
        self.count, self._last = self.count + 1, step

    def complete(self) -> None:
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

    def _head(self, count: int) -> dict[str, Any]:
        return _head("<f8", (count, self._size))

    def _write_count(self) -> None:
        """Puts the number of states into the array's header, for which NumPy leaves room, and into the checksum.

        With heads A and B of one length, crc(A + data) ^ crc(B + data) is crc(A + zeros) ^ crc(B + zeros), for as
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
    if path == "-":
        raise UsageError(
            f"{option('recording')}: a recording cannot be written to standard output\ngive a file, as in run.npz"
        )
    suffix = Path(path).suffix
    if suffix.lower() != SUFFIX:
        reason = f"not {quoted(suffix)}" if suffix else "and this has no suffix"
        raise UsageError(f"{option('recording')} {clean(path)}: a recording is a {SUFFIX} file, {reason}")


@contextlib.contextmanager
def _closing(part: Any) -> Iterator[Any]:
    """`part`, closed at the end, whether or not what it still buffers can be written."""
    try:
        yield part
    finally:
        with contextlib.suppress(OSError, ValueError):
            part.close()


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Any:
    return archive.open(info, "w", force_zip64=True)


def _head(descr: str, shape: tuple[int, ...]) -> dict[str, Any]:
    return {"descr": descr, "fortran_order": False, "shape": shape}


def _followed_by_zeros(crc: int, count: int) -> int:
    """The checksum of bytes whose own is `crc`, and `count` zeros after them."""
    zeros = bytes(min(PIECE, count))
    while count:
        taken = min(PIECE, count)
        crc, count = zlib.crc32(memoryview(zeros)[:taken], crc), count - taken
    return crc


def not_finite(state: np.ndarray) -> str:
    """What is not finite in `state`."""
    index = int(np.isfinite(state).argmin())
    return f"number {index} of its state is {state[index]}"
