"""Recordings on disk, beside NumPy: whole, or refused."""

import contextlib
import gc
import io
import itertools
import json
import os
import struct
import sys
import tracemalloc
import warnings
import zipfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mjrun.errors import FileError, UsageError
from mjrun.formats import recording
from mjrun.formats.recording import PIECE, RecordingReader, RecordingWriter
from mjrun.shared_status import interrupt

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
STATES = st.tuples(st.integers(1, 9), st.integers(1, 5)).flatmap(
    lambda shape: arrays(np.float64, shape, elements=NUMBERS)
)
hypothesis = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
FACTS = st.dictionaries(
    st.text().filter(lambda key: key != "stride"),
    st.none() | st.integers() | NUMBERS | st.text() | st.lists(st.text()),
    max_size=4,
)


def written(
    path: Path, states: np.ndarray, steps: Sequence[int] | None = None, /, stride: int = 1, **facts: object
) -> Path:
    """A recording of `states` `(n, size)`."""
    with RecordingWriter(str(path), states.shape[1], facts) as writer:
        for step, state in zip(steps or range(0, stride * len(states), stride), states, strict=True):
            writer.write(step, state)
        assert writer.count == len(states)
        assert writer.publish() == [path]
    return path


@given(states=STATES, strides=st.lists(st.integers(1, 2**40), min_size=8, max_size=8), facts=FACTS)
@hypothesis
def test_what_was_written_comes_back_bit_for_bit_in_any_order_and_by_numpy(
    tmp_path: Path, states: np.ndarray, strides: list[int], facts: dict[str, Any]
) -> None:
    steps = [0, *np.cumsum(strides).tolist()][: len(states)]
    path = written(tmp_path / "run.npz", states, steps, **facts)
    with np.load(path, allow_pickle=False) as arrays:
        assert sorted(arrays) == ["facts", "states", "steps"]
        assert (arrays["states"].dtype, arrays["steps"].dtype, arrays["facts"].shape) == (np.float64, np.int64, ())
        assert arrays["states"].shape == states.shape
        assert arrays["states"].tobytes() == states.tobytes()
        assert arrays["steps"].tolist() == steps
        assert json.loads(str(arrays["facts"])) == facts
    with RecordingReader(path) as recorded:
        assert (recorded.size, recorded.facts) == (states.shape[1], facts)
        assert (recorded.steps.dtype, recorded.steps.tolist()) == (np.int64, steps)
        for index in (*reversed(range(len(states))), 0, len(states) - 1):
            state = recorded.state(index)
            assert (state.tobytes(), state.shape) == (states[index].tobytes(), states[index].shape)
            state[:] = 7  # it is a copy


def interrupted_at(event: int, work: Callable[[], object]) -> bool:
    """Calls `work` with a signal at the given line that it executes in recording.py; returns whether there is one."""
    lines = iter(range(event + 1))

    def trace(frame: FrameType, kind: str, _: object) -> Any:
        if frame.f_code.co_filename != recording.__file__:
            return None
        if kind == "line" and next(lines, None) == event:
            interrupt(KeyboardInterrupt())
        return trace

    sys.settrace(trace)
    try:
        work()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(None)
    return False


def test_a_signal_at_any_line_of_write_leaves_what_can_be_published(tmp_path: Path) -> None:
    states = np.arange(6.0).reshape(3, 2)
    counts = list[int]()
    for event in itertools.count():
        with RecordingWriter(str(tmp_path / "run.npz"), 2, {}) as writer:
            writer.write(0, states[0])
            if not interrupted_at(event, partial(writer.write, 1, states[1])):
                break
            counts.append(writer.count)
            writer.write(writer.last + 1, states[2])
            writer.publish()
        with RecordingReader(tmp_path / "run.npz") as recorded:
            assert recorded.steps.tolist() == [*range(counts[-1] + 1)]
            assert recorded.state(0).tobytes() == states[0].tobytes()
            assert recorded.state(counts[-1]).tobytes() == states[2].tobytes()
    assert set(counts) == {1, 2}


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


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("run.csv", "recording run.csv: a recording is a .npz file, not '.csv'"),
        ("run", "recording run: a recording is a .npz file, and this has no suffix"),
        ("run.npz.\x1b", "recording run.npz.\\x1b: a recording is a .npz file, not '.\\x1b'"),
    ],
)
def test_what_cannot_be_a_recording_is_refused(path: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        RecordingWriter(path, 1, {})
    assert str(caught.value) == message


def test_a_state_that_is_not_finite_is_refused_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with RecordingWriter(str(path), 3, {}) as writer:
        writer.write(0, np.zeros(3))
        with pytest.raises(FileError) as caught:
            writer.write(12, np.array([0, 1, np.inf]))
    assert str(caught.value) == f"{path}: cannot hold step 12: number 2 of its state is inf"


@pytest.mark.parametrize(
    ("steps", "state", "message"),
    [
        ([0], np.zeros(2), r"a state must be float64 \(3,\)"),
        ([0], np.zeros((1, 3)), r"a state must be float64 \(3,\)"),
        ([0], np.zeros(3, np.float32), r"a state must be float64 \(3,\)"),
        ([1], np.zeros(3), "step 1 cannot come after"),
        ([-1], np.zeros(3), "step -1 cannot come after"),
        ([0, 0], np.zeros(3), "step 0 cannot come after"),
        ([0, 5, 4], np.zeros(3), "step 4 cannot come after"),
        ([], np.zeros(3), "at least one state"),
    ],
)
def test_states_and_steps_that_do_not_fit_are_a_bug(
    tmp_path: Path, steps: list[int], state: np.ndarray, message: str
) -> None:
    with RecordingWriter(str(tmp_path / "run.npz"), 3, {}) as writer, pytest.raises(ValueError, match=message):
        _ = [writer.write(step, state) for step in steps], writer.publish()
    assert list(tmp_path.iterdir()) == []


def test_any_memory_layout_is_written_and_may_be_changed_afterwards(tmp_path: Path) -> None:
    wide = np.arange(6.0).reshape(3, 2)
    with RecordingWriter(str(tmp_path / "run.npz"), 3, {}) as writer:
        writer.write(0, wide[:, 1])
        wide[:] = 0
        writer.publish()
    assert np.load(tmp_path / "run.npz")["states"].tolist() == [[1, 3, 5]]


GOOD: Mapping[str, np.ndarray] = {
    "states": np.arange(12.0).reshape(4, 3),
    "steps": np.array([0, 5, 10, 15]),
    "facts": np.array('{"model": "a"}'),
}
HINT = "\nrecording FILE.npz makes one"


def saved(path: Path, **changed: object) -> Path:
    """What NumPy makes of a good recording with some arrays changed, or left out when None."""
    arrays = {name: array for name, array in {**GOOD, **changed}.items() if array is not None}
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


def test_a_recording_that_numpy_wrote_is_one(tmp_path: Path) -> None:
    with RecordingReader(saved(tmp_path / "run.npz", more=np.array([object()]))) as found:
        assert (found.steps.tolist(), found.facts) == ([0, 5, 10, 15], {"model": "a"})
        assert [found.state(index).tolist() for index in range(4)] == GOOD["states"].tolist()
        for index in (4, 10**9, -1):
            with pytest.raises(IndexError):
                found.state(index)


def test_a_long_recording_stays_on_disk(tmp_path: Path) -> None:
    states = np.random.default_rng(4).standard_normal((20_000, 100))
    path = written(tmp_path / "run.npz", states)
    assert states.nbytes > 10 * PIECE
    tracemalloc.start()
    with RecordingReader(path) as found:
        assert np.array_equal(found.state(12_345), states[12_345])
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 5 * PIECE


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))  # noqa: PTH208


@pytest.mark.parametrize("changed", [{}, {"facts": None}, {"states": np.full((4, 3), np.nan)}])
def test_a_recording_is_closed_whether_it_is_refused_closed_or_forgotten(
    tmp_path: Path, changed: dict[str, object]
) -> None:
    path = saved(tmp_path / "run.npz", **changed)
    gc.collect()  # what other tests left open
    before = descriptors()
    with contextlib.suppress(FileError), RecordingReader(path) as recorded:
        assert descriptors() == before + 1
    assert descriptors() == before
    if not changed:
        with pytest.raises(ValueError, match="closed"):
            recorded.state(0)
        RecordingReader(path)
        gc.collect()
        assert descriptors() == before


def test_a_recording_that_is_replaced_while_it_is_read_is_read_on(tmp_path: Path) -> None:
    with RecordingReader(saved(tmp_path / "run.npz")) as found:
        written(tmp_path / "run.npz", np.zeros((1, 1)))
        assert found.state(3).tolist() == [9, 10, 11]


def test_a_recording_that_is_cut_while_it_is_read_says_so(tmp_path: Path) -> None:
    path = saved(tmp_path / "run.npz")
    with RecordingReader(path) as found:
        os.truncate(path, 100)
        with pytest.raises(FileError) as caught:
            found.state(2)
    assert str(caught.value) == f"{path}: has changed while it was read"


def test_a_recording_that_is_overwritten_while_it_is_read_says_so_even_with_its_size_and_time(tmp_path: Path) -> None:
    states = np.arange(12.0).reshape(4, 3)
    path, other = written(tmp_path / "run.npz", states), written(tmp_path / "other.npz", -states)
    times = path.stat()
    with RecordingReader(path) as found:
        assert found.state(1).tolist() == [3, 4, 5]
        with path.open("r+b") as file:
            file.write(other.read_bytes())
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        for read in (lambda: found.state(2), lambda: list(found.blocks())):
            with pytest.raises(FileError) as caught:
                read()
            assert str(caught.value) == f"{path}: has changed while it was read"


def test_a_recording_that_is_moved_or_touched_while_it_is_read_is_read_on(tmp_path: Path) -> None:
    path = saved(tmp_path / "run.npz")
    with RecordingReader(path) as found:
        os.utime(path)
        path.rename(tmp_path / "moved.npz")
        assert found.state(3).tolist() == [9, 10, 11]


BROKEN = [
    ({"states": None}, "it has no array 'states'"),
    ({"steps": None}, "it has no array 'steps'"),
    ({"facts": None}, "it has no array 'facts'"),
    ({"states": np.zeros((4, 3), np.float32)}, "'states' holds float32, not float64"),
    ({"states": np.zeros((4, 3), ">f8")}, "'states' holds >f8, not float64"),
    ({"states": np.array([[None] * 3] * 4)}, "'states' holds objects, not float64"),
    ({"states": np.zeros((4, 3), complex)}, "'states' holds complex values, not float64"),
    ({"states": np.zeros(4, "f8,f8")}, "'states' holds void128, not float64"),
    ({"states": np.zeros(4)}, "'states' has the shape (4,), not (n, size)"),
    ({"states": np.zeros((4, 0))}, "'states' has the shape (4, 0), not (n, size)"),
    ({"states": np.zeros((0, 3))}, "'states' has the shape (0, 3), not (n, size)"),
    ({"states": np.zeros((4, 3), order="F")}, "'states' is stored by column, not by row"),
    ({"states": np.zeros((5, 3))}, "it has 5 states and 4 steps"),
    ({"states": np.full((4, 3), np.nan)}, "state 0, at step 0: number 0 of its state is nan"),
    ({"states": np.array([[0.0] * 3] * 3 + [[0, -np.inf, 0]])}, "state 3, at step 15: number 1 of its state is -inf"),
    ({"steps": np.arange(4.0)}, "'steps' holds float64, not int64"),
    ({"steps": np.arange(4, dtype=np.int32)}, "'steps' holds int32, not int64"),
    ({"steps": np.array(list("abcd"))}, "'steps' holds text, not int64"),
    ({"steps": np.array(7)}, "'steps' has the shape (), not (n,)"),
    ({"steps": np.arange(1, 5)}, "its first step is 1, not 0"),
    ({"steps": np.array([0, 2, 2, 3])}, "its steps do not ascend: 2 comes after 2"),
    ({"steps": np.array([0, 2**62, -(2**62), 3])}, f"its steps do not ascend: {-(2**62)} comes after {2**62}"),
    ({"facts": np.array(["{}", "{}"])}, "'facts' has the shape (2,), not ()"),
    ({"facts": np.array(b"{}")}, "'facts' holds text, not unicode text"),
    ({"facts": np.array({})}, "'facts' holds objects, not unicode text"),
    ({"facts": np.array("[1]")}, "'facts' is not a JSON object"),
    ({"facts": np.array("{")}, "'facts' is not a JSON object"),
    ({"facts": np.array('{"a":' + "[" * 100_000)}, "'facts' is not a JSON object"),
]


def compressed(path: Path) -> None:
    np.savez_compressed(path, **GOOD)  # type: ignore[arg-type]


def twice(path: Path) -> None:
    with warnings.catch_warnings(), zipfile.ZipFile(saved(path), "a") as archive:
        warnings.simplefilter("ignore")
        archive.writestr("steps.npy", archive.read("steps.npy"))


def flipped(path: Path) -> None:
    content = saved(path).read_bytes()
    path.write_bytes(content.replace(struct.pack("<d", 7.0), struct.pack("<d", 7.5)))


def claiming(shape: tuple[int, ...], values: bytes = bytes(96), version: tuple[int, int] = (1, 0)) -> bytes:
    """An array's file that says it has `shape`."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return b"\x93NUMPY" + bytes(version) + head.getvalue()[8:] + values


def with_states(member: bytes) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        saved(path, states=None)
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("states.npy", member)

    return make


def vast(path: Path) -> None:
    """An archive whose directory says that a member of a few bytes has exabytes."""
    saved(path)
    with zipfile.ZipFile(path, "a") as archive:
        info = archive.getinfo("states.npy")
        info.compress_size = info.file_size = 2**60
        archive.writestr("more.npy", b"")


DAMAGED = [
    pytest.param(lambda path: path.write_bytes(b""), "File is not a zip file", id="empty"),
    pytest.param(lambda path: path.write_text("time,qpos\n0,1\n"), "File is not a zip file", id="text"),
    pytest.param(lambda path: os.truncate(saved(path), 700), "File is not a zip file", id="cut"),
    pytest.param(compressed, "'states' is compressed; np.savez stores arrays uncompressed", id="compressed"),
    pytest.param(twice, "it has two arrays 'steps'", id="twice"),
    pytest.param(flipped, "Bad CRC-32 for file 'states.npy'", id="flipped"),
    pytest.param(vast, "'states' ends early", id="vast"),
    pytest.param(
        with_states(claiming((10**9, 10**9))), f"'states' has the shape {(10**9, 10**9)}, but 96 bytes", id="claims"
    ),
    pytest.param(with_states(claiming((4, 3), bytes(95))), "'states' has the shape (4, 3), but 95 bytes", id="short"),
    pytest.param(with_states(claiming((-4, -3))), "'states' has the shape (-4, -3), not (n, size)", id="negative"),
    pytest.param(
        with_states(claiming((4, 3), version=(9, 0))), "an array has the unknown version (9, 0)", id="version"
    ),
    pytest.param(
        with_states(b"\x93NUMPY\x01\x00\xff\xff{"),
        "EOF: reading array header, expected 65535 bytes got 1",
        id="no header",
    ),
]


REFUSED = [pytest.param(partial(saved, **changed), message, id=message) for changed, message in BROKEN] + DAMAGED


@pytest.mark.parametrize(("make", "message"), REFUSED)
def test_a_recording_that_is_broken_or_damaged_is_refused(
    tmp_path: Path, make: Callable[[Path], object], message: str
) -> None:
    path = tmp_path / "run.npz"
    make(path)
    with pytest.raises(FileError) as caught:
        RecordingReader(path)
    assert str(caught.value) == f"{path}: is not a recording: {message}{HINT}"


def test_facts_of_any_length_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "FACTS", 10)
    path = saved(tmp_path / "run.npz")
    with pytest.raises(FileError, match="'facts' has 14 characters, not 1 to 10"):
        RecordingReader(path)


class Trap:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Callable[[str], object], tuple[str]]:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("name", GOOD)
def test_nothing_in_a_recording_runs(tmp_path: Path, name: str) -> None:
    trap = np.empty(4, object)
    trap[:] = Trap(tmp_path / "trapped")
    with pytest.raises(FileError, match="holds objects"):
        RecordingReader(saved(tmp_path / "run.npz", **{name: trap}))
    assert not (tmp_path / "trapped").exists()


@given(
    st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=6),
    st.floats(0.5, 1),
)
@example([], 0.9999)
@settings(hypothesis, max_examples=40)
def test_however_the_bytes_of_a_recording_are_changed_it_reads_as_finite_states_or_is_refused(
    tmp_path: Path, changes: list[tuple[float, int]], kept: float
) -> None:
    path = written(tmp_path / "run.npz", GOOD["states"], stride=5, model="a")
    content = bytearray(path.read_bytes())
    for place, value in changes:
        content[int(place * len(content))] = value
    path.write_bytes(content[: len(content) if kept > 0.9 else int(kept * len(content))])
    try:
        with RecordingReader(path) as found:
            states = np.stack([found.state(index) for index in range(len(found.steps))])
    except FileError as error:
        assert str(error).startswith(f"{path}: is not a recording: ")  # noqa: PT017  (it may read, too)
    else:
        assert states.tobytes() == GOOD["states"].tobytes()


def test_a_file_that_is_not_there_is_reported_with_those_like_it(tmp_path: Path) -> None:
    saved(tmp_path / "jump.npz")
    (tmp_path / "jumq.csv").write_text("")
    with pytest.raises(FileError) as caught:
        RecordingReader(tmp_path / "jumo.npz")
    assert str(caught.value) == f"{tmp_path}/jumo.npz: no such file (did you mean 'jump.npz'?){HINT}"


def test_a_folder_or_a_pipe_is_no_recording(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(FileError, match=r"pipe.npz: is not a regular file"):
        RecordingReader(tmp_path / "pipe.npz")
    with pytest.raises(FileError, match="is a folder, not a recording"):
        RecordingReader(tmp_path)


def test_what_a_file_says_of_itself_is_cleaned(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with_states(b"\x93NUMPY\x01\x00\x10\x00'\x1b[31m'          ")(path)
    with pytest.raises(FileError) as caught:
        RecordingReader(path)
    assert "\x1b" not in str(caught.value)
    assert "\\x1b[31m" in str(caught.value)


def test_all_states_come_in_blocks_with_their_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    states = np.random.default_rng(1).standard_normal((7, 3))
    with RecordingReader(written(tmp_path / "r.npz", states, stride=2)) as reader:
        monkeypatch.setattr(recording, "PIECE", 50)  # bytes: two states
        blocks = list(reader.blocks())
        assert [len(steps) for steps, _ in blocks] == [2, 2, 2, 1]
        assert np.array_equal(np.concatenate([block for _, block in blocks]), states)
        assert np.concatenate([steps for steps, _ in blocks]).tolist() == [0, 2, 4, 6, 8, 10, 12]
