"""A live recording is that of the last run, and is what a reader of recordings expects."""

from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError, UsageError
from mjrun.formats.recording_reader import RecordingReader
from mjrun.viewer.session_recording import SessionRecording


def test_a_restart_drops_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with SessionRecording(str(path), 2, {"steps": 7, "by": "me"}) as recording:
        for step in range(5):
            recording.write(step, np.full(2, 10.0 + step))
        recording.restart()
        recording.restart()
        for step in range(3):
            recording.write(step, np.full(2, float(step)))
        recording.write(2, np.full(2, 9.0))  # the last one, once more
        assert recording.count == 3
        assert recording.publish() == [path]
    with RecordingReader(path) as reader:
        assert reader.steps.tolist() == [0, 1, 2]
        assert [reader.state(i).tolist() for i in range(3)] == [[0, 0], [1, 1], [2, 2]]
        assert (reader.facts["steps"], reader.facts["by"]) == (2, "me")


def test_without_states_or_publishing_the_old_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    path.write_bytes(b"old")
    with SessionRecording(str(path), 1, {}) as recording:
        assert recording.publish() == []
    with SessionRecording(str(path), 1, {}) as recording:
        recording.write(0, np.zeros(1))
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["run.npz"]


def test_what_cannot_be_written_is_said_at_once(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"\.npz"):
        SessionRecording(str(tmp_path / "run.csv"), 1, {})
    with pytest.raises(FileError):
        SessionRecording("/dev/null/run.npz", 1, {})
