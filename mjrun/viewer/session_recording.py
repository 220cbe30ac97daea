"""The recording of a live session."""

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

import numpy as np

from mjrun.formats.recording_writer import RecordingWriter


class SessionRecording:
    """A recording that can be begun anew; only the last one is ever published.

    Args:
      path: a .npz file, which is proven to be writable at once.
      size: numbers in a state.
      facts: what made it; `steps`, of the simulation, is added in the end.

    Raises:
      UsageError: the path has another suffix.
      FileError: the file cannot be written.
    """

    def __init__(self, path: str, size: int, facts: Mapping[str, object]) -> None:
        self.path = path
        self._size, self._facts = size, dict(facts)
        self._writer = RecordingWriter(path, size, self._facts)
        self._last = -1

    @property
    def count(self) -> int:
        """States that it holds."""
        return self._writer.count

    def write(self, step: int, state: np.ndarray) -> None:
        """Adds the state `(size,)` at `step`, unless it is there already: 0 at first, then ever greater."""
        if step > self._last:
            self._writer.write(step, state)
            self._last = step

    def restart(self) -> None:
        """Drops all states."""
        if self._last >= 0:
            self._writer.close()
            self._writer, self._last = RecordingWriter(self.path, self._size, self._facts), -1

    def publish(self) -> list[Path]:
        """Puts the recording where it belongs, if there is any state in it."""
        if self._last < 0:
            return []
        self._facts["steps"] = self._last
        return self._writer.publish()

    def __enter__(self) -> "SessionRecording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()
