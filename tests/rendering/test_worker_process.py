"""What drawing processes and their parent share: memory, failures, and messages over a pipe."""

import contextlib
import mmap
import os
import pickle
import sys
import threading
from collections.abc import Iterator
from multiprocessing.connection import Connection, Pipe
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.child_process import ChildProcess, python_call
from mjrun.errors import DrawError, MjrunError, NoRendererError, UnknownNameError, UnstableError
from mjrun.rendering.worker_process import (
    Answered,
    Draw,
    Drawn,
    Failure,
    Opened,
    OpenPainter,
    Query,
    SharedMemoryLayout,
    memory_file,
)

sys.path.append(str(Path(__file__).parent))  # drawing processes look where we look

from painters import Adding

from tests.processes import PATIENCE

SHAPES = st.lists(st.integers(1, 50), min_size=0, max_size=3).map(tuple)
SPECS = st.tuples(SHAPES, st.sampled_from(["f8", "f4", "i8", "u2", "u1"]).map(np.dtype))


@contextlib.contextmanager
def memory(size: int) -> Iterator[int]:
    descriptor = memory_file()
    try:
        os.ftruncate(descriptor, size)
        yield descriptor
    finally:
        os.close(descriptor)


# --- memory -----------------------------------------------------------------------------------------


@given(st.integers(1, 4), SPECS, SPECS)
def test_slots_are_apart_aligned_to_pages_and_the_same_in_every_mapping(count: int, state: tuple, frame: tuple) -> None:
    layout = SharedMemoryLayout(count, state, frame)
    with memory(layout.size) as descriptor:
        mine, theirs = layout.slots(descriptor), layout.slots(descriptor)
        arrays = [array for slot in mine for array in slot]
        assert len(mine) == count
        for number, array in enumerate(arrays):
            assert (array.shape, array.dtype) == (state, frame)[number % 2]
            assert array.ctypes.data % mmap.PAGESIZE == 0
            array[...] = number + 1
        for number, array in enumerate(array for slot in theirs for array in slot):
            assert (array == number + 1).all()
        needed = sum(-(-array.nbytes // mmap.PAGESIZE) for array in arrays)
        assert layout.size == needed * mmap.PAGESIZE


def test_memory_has_no_name_in_the_file_system() -> None:
    with memory(1) as descriptor:
        assert os.fstat(descriptor).st_nlink == 0
        assert not Path(f"/proc/self/fd/{descriptor}").readlink().exists()


def test_where_memory_has_no_descriptors_a_file_without_a_name_stands_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "memfd_create")
    layout = SharedMemoryLayout(1, ((3,), np.dtype(float)), ((2, 2), np.dtype(np.uint8)))
    with memory(layout.size) as descriptor:
        assert os.fstat(descriptor).st_nlink == 0
        layout.slots(descriptor)[0].state[:] = 1, 2, 3
        assert layout.slots(descriptor)[0].state.tolist() == [1, 2, 3]


# --- failures ---------------------------------------------------------------------------------------

ERRORS = [
    MjrunError("something"),
    DrawError("OpenGL refused"),
    UnstableError(7, 0.5, "qpos", "hinge", 0.002),
    NoRendererError({"egl": "is not there"}, "install it"),
    UnknownNameError("camera", "sdie", ["side", "top"]),
]


def raised(error: Exception) -> Exception:
    try:
        raise error
    except Exception as caught:
        return caught


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("during", [None, "drawing frame 3"])
def test_an_error_of_mjrun_arrives_as_it_was(error: MjrunError, during: str | None) -> None:
    arrived = pickle.loads(pickle.dumps(Failure.of(raised(error)))).error(during)
    assert type(arrived) is type(error)
    assert (str(arrived), arrived.args, arrived.exit_code) == (str(error), error.args, error.exit_code)
    assert vars(arrived) == vars(error)
    assert "in raised" in str(arrived.__cause__)


@pytest.mark.parametrize(
    ("during", "kind", "message"),
    [
        (None, DrawError, "a drawing process cannot start: ValueError: so ("),
        ("drawing frame 3", MjrunError, "a bug in mjrun, drawing frame 3: ValueError: so ("),
    ],
)
def test_anything_else_is_a_bug_with_its_place(during: str | None, kind: type[MjrunError], message: str) -> None:
    error = Failure.of(raised(ValueError("so"))).error(during)
    assert type(error) is kind
    assert str(error).startswith(message + "test_worker_process.py:")


def test_what_a_bug_says_cannot_write_to_a_terminal() -> None:
    assert "\x1b" not in str(Failure.of(raised(ValueError("\x1b[31mred"))).error("drawing frame 3"))


# --- messages ---------------------------------------------------------------------------------------

LAYOUT = SharedMemoryLayout(2, ((2,), np.dtype(float)), ((3,), np.dtype(np.int64)))


class Peer:
    """A drawing process, spoken to message by message."""

    def __init__(self, connection: Connection, description: int, slots: int) -> None:
        self.connection, self._description = connection, description
        self.slots = LAYOUT.slots(slots)

    def open(self, painter: object) -> Opened:
        os.truncate(self._description, 0)
        os.pwrite(self._description, pickle.dumps(painter), 0)
        self.connection.send(OpenPainter())
        return self.connection.recv()

    def draw(self, frame: int, slot: int) -> Drawn:
        self.connection.send(Draw(frame, slot))
        return self.connection.recv()


@pytest.fixture
def peer() -> Iterator[Peer]:
    with memory(0) as description, memory(LAYOUT.size) as slots:
        ours, theirs = Pipe()
        with theirs:
            command = python_call("mjrun.rendering.worker_process:work", "numpy")
            process = ChildProcess(command, descriptors=[theirs.fileno(), description, slots])
        yield Peer(ours, description, slots)
        ours.close()
        assert process.wait(PATIENCE).code == 0  # it ends by itself when its parent hangs up


def test_a_process_draws_from_the_slots_it_is_told(peer: Peer) -> None:
    assert peer.open(Adding()) == Opened(None, [])
    peer.connection.send(LAYOUT)
    for frame, slot in ((5, 1), (6, 0), (9, 1)):
        peer.slots[slot].state[:] = 10 * frame, 1
        assert peer.draw(frame, slot) == Drawn(frame, None, [])
        assert peer.slots[slot].frame.tolist() == [11 * frame + 1] * 3


def test_a_failed_frame_costs_no_other_frame(peer: Peer) -> None:
    peer.open(Adding({1: "is unstable", 2: "divides"}))
    peer.connection.send(LAYOUT)
    kinds = [failure and failure.kind for failure in (peer.draw(frame, 0).failure for frame in range(4))]
    assert [bool(peer.draw(frame, 0).failure) for frame in range(4)] == [False, True, True, False]
    assert kinds == [None, UnstableError, None, None]


def test_a_process_opens_one_painter_after_another(peer: Peer) -> None:
    failure = peer.open(Adding({-1: "has no renderer"})).failure
    assert failure is not None
    assert failure.kind is NoRendererError
    peer.connection.send(LAYOUT)
    peer.connection.send(Draw(0, 0))  # unanswered: there is no painter, as the parent knows
    assert peer.open(Adding()).failure is None
    assert peer.draw(0, 0).failure is None


def test_a_question_is_asked_of_the_painter(peer: Peer) -> None:
    peer.open(Adding())
    peer.connection.send(Query(Adding.process))
    reply = peer.connection.recv()
    assert isinstance(reply, Answered)
    assert reply.failure is None
    assert reply.answer not in (os.getpid(), threading.get_ident())
    assert Path(f"/proc/{reply.answer}").exists()
