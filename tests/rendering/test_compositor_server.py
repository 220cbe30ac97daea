"""The memory that drawing processes share with their parent, and what they are asked to draw in it."""

import contextlib
import mmap
import os
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import NoRendererError, UnstableError
from mjrun.rendering.compositor_pool import CompositorServer, SharedMemoryLayout, memory_file

sys.path.append(str(Path(__file__).parent))  # where drawing processes look

from compositors import Adding

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


# --- drawing ----------------------------------------------------------------------------------------


class Peer(CompositorServer):
    """What draws in a drawing process, and its parent's side of the memory."""

    def __init__(self, description: int, memory: int) -> None:
        super().__init__(description, memory)
        layout = SharedMemoryLayout(2, ((2,), np.dtype(float)), ((3,), np.dtype(np.int64)))
        os.ftruncate(memory, layout.size)
        self.slots = layout.slots(memory)
        self.lay_out(layout)

    def open_described(self, compositor: object) -> None:
        os.truncate(self._description, 0)
        os.pwrite(self._description, pickle.dumps(compositor), 0)
        self.unpickle()
        self.open()


@pytest.fixture
def peer() -> Iterator[Peer]:
    with memory(0) as description, memory(0) as slots:
        yield Peer(description, slots)


def test_frames_are_drawn_from_the_slots_that_are_named(peer: Peer) -> None:
    peer.open_described(Adding())
    for frame, slot in ((5, 1), (6, 0), (9, 1)):
        peer.slots[slot].state[:] = 10 * frame, 1
        peer.compose(frame, slot)
        assert peer.slots[slot].frame.tolist() == [11 * frame + 1] * 3


def test_a_failed_frame_costs_no_other_frame(peer: Peer) -> None:
    peer.open_described(Adding({1: "is unstable"}))
    peer.compose(0, 0)
    with pytest.raises(UnstableError):
        peer.compose(1, 0)
    peer.compose(2, 0)


def test_one_compositor_is_opened_after_another(peer: Peer) -> None:
    with pytest.raises(NoRendererError):
        peer.open_described(Adding({-1: "has no renderer"}))
    peer.open_described(Adding())
    peer.compose(0, 0)
    assert peer.ask(Adding.process) == os.getpid()
