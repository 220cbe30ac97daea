"""Replayable states, in memory while they are few and on disk when they are many."""

import tempfile
from types import TracebackType

import mujoco
import numpy as np

from mjrun.errors import FileError
from mjrun.model import state

SPILL = 2**20  # bytes that are kept in memory


class StateBuffer:
    """A list of integration states `(nstate,)` of one model, in the order they were appended."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._bytes = 8 * state.size(model)
        self._file = tempfile.SpooledTemporaryFile(max_size=SPILL)  # noqa: SIM115  (closed by close)
        self._count = 0

    def append(self, row: np.ndarray) -> None:
        """Adds one state at the end.

        Raises:
          FileError: the disk is full.
        """
        content = np.ascontiguousarray(row, np.float64).tobytes()
        if len(content) != self._bytes:
            raise ValueError(f"a state of this model has {self._bytes // 8} numbers, not {row.size}")
        try:
            self._file.seek(self._count * self._bytes)
            self._file.write(content)
        except OSError as error:
            where = tempfile.tempdir or "no folder"  # which was found when the states became many
            hint = "TMPDIR names another folder for it"
            raise FileError(where, f"cannot hold the recording: {error.strerror or error}", hint) from None
        self._count += 1

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> np.ndarray:
        if not 0 <= index < self._count:
            raise IndexError(index)
        self._file.seek(index * self._bytes)
        return np.frombuffer(self._file.read(self._bytes), np.float64)

    @property
    def size(self) -> int:
        """Numbers in a state."""
        return self._bytes // 8

    @property
    def steps(self) -> np.ndarray:
        """The step of each state `(n,)`, of a recording of every step."""
        return np.arange(self._count)

    def state(self, index: int) -> np.ndarray:
        """State number `index`, to be written on."""
        return self[index].copy()

    def close(self) -> None:
        """Frees the memory or the file."""
        self._file.close()

    def __enter__(self) -> "StateBuffer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
