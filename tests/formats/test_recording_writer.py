"""Recordings on disk: what NumPy finds in them is what went in, whole or not at all."""

import json
import resource
import tracemalloc
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mjrun.errors import FileError, UsageError
from mjrun.formats.recording_writer import PIECE, RecordingWriter

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
STATES = st.tuples(st.integers(1, 9), st.integers(1, 5)).flatmap(
    lambda shape: arrays(np.float64, shape, elements=NUMBERS)
)
FACTS = st.dictionaries(st.text(), st.none() | st.integers() | NUMBERS | st.text() | st.lists(st.text()), max_size=4)


def written(path: Path, states: np.ndarray, steps: list[int] | None = None, **facts: object) -> Path:
    """A recording of `states` `(n, size)`."""
    with RecordingWriter(str(path), states.shape[1], facts) as writer:
        for step, state in zip(range(len(states)) if steps is None else steps, states, strict=True):
            writer.write(step, state)
        assert writer.count == len(states)
        assert writer.publish() == [path]
    return path


@given(states=STATES, strides=st.lists(st.integers(1, 2**40), min_size=8, max_size=8), facts=FACTS)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_numpy_reads_what_was_written_bit_for_bit(
    tmp_path: Path, states: np.ndarray, strides: list[int], facts: dict[str, object]
) -> None:
    steps = [0, *np.cumsum(strides).tolist()][: len(states)]
    path = tmp_path / "run.npz"
    with RecordingWriter(str(path), states.shape[1], facts) as writer:
        for step, state in zip(steps, states, strict=True):
            writer.write(step, state)
        writer.publish()
    with np.load(path, allow_pickle=False) as found:
        assert sorted(found) == ["facts", "states", "steps"]
        assert (found["states"].dtype, found["steps"].dtype, found["facts"].shape) == (np.float64, np.int64, ())
        assert found["states"].shape == states.shape
        assert found["states"].tobytes() == states.tobytes()
        assert found["steps"].tolist() == steps
        assert json.loads(str(found["facts"])) == facts


@pytest.mark.parametrize("count", [1, 9, 10, 99_999])
def test_the_checksums_of_the_archive_are_right_and_nothing_is_compressed(tmp_path: Path, count: int) -> None:
    states = np.random.default_rng(3).standard_normal((count, 3))
    assert states.nbytes > 2 * PIECE or count < 11
    with zipfile.ZipFile(written(tmp_path / "run.npz", states)) as archive:
        assert archive.testzip() is None
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_STORED}
    assert np.array_equal(np.load(tmp_path / "run.npz")["states"], states)


def test_the_same_states_and_facts_make_the_same_bytes(tmp_path: Path) -> None:
    states = np.arange(12.0).reshape(4, 3)
    first, second = (written(tmp_path / name, states, model="a", seed=1).read_bytes() for name in ("a.npz", "b.npz"))
    assert first == second
    assert written(tmp_path / "c.npz", states, model="a", seed=2).read_bytes() != first


def test_any_memory_layout_is_written_as_it_reads_and_may_be_changed_afterwards(tmp_path: Path) -> None:
    wide = np.arange(6.0).reshape(3, 2)
    with RecordingWriter(str(tmp_path / "run.npz"), 3, {}) as writer:
        writer.write(0, wide[:, 1])
        wide[:] = 0
        writer.publish()
    assert np.load(tmp_path / "run.npz")["states"].tolist() == [[1, 3, 5]]


def peak(path: Path, count: int) -> int:
    """The most memory that a recording of `count` states takes [bytes]."""
    state = np.zeros(500)
    tracemalloc.start()
    with RecordingWriter(str(path), len(state), {}) as writer:
        for step in range(count):
            writer.write(step, state)
        writer.publish()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most


def test_memory_does_not_grow_with_the_recording(tmp_path: Path) -> None:
    peak(tmp_path / "warm.npz", 10)
    few, many = (peak(tmp_path / "run.npz", count) for count in (300, 3000))
    assert many - few < 2 * 2**20 < (3000 - 300) * 500 * 8 / 4


def test_a_recording_is_the_old_one_until_it_is_published(tmp_path: Path) -> None:
    target = tmp_path / "run.npz"
    target.write_text("old")
    with RecordingWriter(str(target), 1, {}) as writer:
        writer.write(0, np.zeros(1))
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_failure_leaves_no_trace(tmp_path: Path) -> None:
    writer = RecordingWriter(str(tmp_path / "run.npz"), 1, {})
    writer.write(0, np.zeros(1))
    writer.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("-", "recording: a recording cannot be written to standard output\ngive a file, as in run.npz"),
        ("run.csv", "recording run.csv: a recording is a .npz file, not '.csv'"),
        ("run", "recording run: a recording is a .npz file, and this has no suffix"),
        ("run.npz.\x1b", "recording run.npz.\\x1b: a recording is a .npz file, not '.\\x1b'"),
    ],
)
def test_what_cannot_be_a_recording_is_refused(path: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        RecordingWriter(path, 1, {})
    assert str(caught.value) == message


def test_a_bad_output_fails_when_it_is_opened() -> None:
    with pytest.raises(FileError, match="is not a folder"):
        RecordingWriter("/dev/null/run.npz", 1, {})


def test_a_state_that_is_not_finite_is_refused_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with RecordingWriter(str(path), 3, {}) as writer:
        writer.write(0, np.zeros(3))
        with pytest.raises(FileError) as caught:
            writer.write(12, np.array([0, 1, np.inf]))
    assert str(caught.value) == f"{path}: cannot hold step 12: number 2 of its state is inf"


@pytest.mark.parametrize("state", [np.zeros(2), np.zeros((1, 3)), np.zeros(3, np.float32)])
def test_a_state_of_another_shape_or_type_is_a_bug(tmp_path: Path, state: np.ndarray) -> None:
    with (
        RecordingWriter(str(tmp_path / "run.npz"), 3, {}) as writer,
        pytest.raises(ValueError, match=r"a state must be float64 \(3,\)"),
    ):
        writer.write(0, state)


@pytest.mark.parametrize("steps", [[1], [-1], [0, 0], [0, 5, 4]])
def test_steps_that_do_not_ascend_from_zero_are_a_bug(tmp_path: Path, steps: list[int]) -> None:
    with pytest.raises(ValueError, match=f"step {steps[-1]} cannot come after"):
        written(tmp_path / "run.npz", np.zeros((len(steps), 1)), steps)
    assert list(tmp_path.iterdir()) == []


def test_a_recording_of_nothing_is_a_bug(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least one state"):
        written(tmp_path / "run.npz", np.zeros((0, 1)))


@pytest.fixture
def small_disk() -> Iterator[None]:
    """No file can grow beyond 64 KiB: the operating system refuses as it does on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**16, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize(
    ("count", "size"),
    [
        pytest.param(100, 1000, id="while states come"),
        pytest.param(1, 2**13 - 1, id="with the last state"),
        pytest.param(4000, 2, id="with the steps"),
    ],
)
def test_a_full_disk_is_told_and_the_old_file_stays(tmp_path: Path, small_disk: None, count: int, size: int) -> None:
    target = tmp_path / "run.npz"
    target.write_text("old")
    with pytest.raises(FileError) as caught:
        written(target, np.zeros((count, size)))
    assert str(caught.value) == f"{target}: cannot be written: File too large"
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]
