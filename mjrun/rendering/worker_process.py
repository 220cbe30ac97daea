"""The server in a rendering process, and the anonymous memory that it shares with its parent.

The painter, the states and the frames lie in memory that only descriptors refer to: nothing can remain in /dev/shm,
and its size, 64 MB in many containers, is no limit.
"""

import contextlib
import importlib
import itertools
import math
import mmap
import os
import pickle
import tempfile
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from mjrun.dataclass import dataclass

ArraySpec = tuple[tuple[int, ...], np.dtype]  # shape and dtype of an array


class Painter(Protocol):
    """A painter of frames. Picklable until opened; opened, used and closed in one thread of one process."""

    def open(self) -> None:
        """Acquires the resources that rendering needs, such as an OpenGL context.

        Raises:
          MjrunError: a resource is not available.
        """
        ...

    def paint(self, state: np.ndarray, index: int, into: np.ndarray) -> None:
        """Fills `into` with frame `index`, which depends only on `state` and `index`."""
        ...

    def close(self) -> None:
        """Releases the resources."""
        ...


class Slot(NamedTuple):
    """Memory for one state and the frame rendered from it."""

    state: np.ndarray
    frame: np.ndarray


@dataclass(frozen=True)
class SharedMemoryLayout:
    """The layout of `count` slots in shared memory, each array on separate pages."""

    count: int
    state: ArraySpec
    frame: ArraySpec

    @property
    def size(self) -> int:
        """The size of all slots [bytes]."""
        return self.count * (_page_bytes(self.state) + _page_bytes(self.frame))

    def slots(self, memory: int) -> list[Slot]:
        """Maps the slots in the memory behind a descriptor, for as long as one of their arrays is referenced."""
        shared = mmap.mmap(memory, self.size)
        starts = itertools.accumulate(itertools.cycle((_page_bytes(self.state), _page_bytes(self.frame))), initial=0)
        return [
            Slot(*(np.ndarray(*spec, buffer=shared, offset=next(starts)) for spec in (self.state, self.frame)))
            for _ in range(self.count)
        ]


def _page_bytes(spec: ArraySpec) -> int:
    """Returns the size of an array [bytes], rounded up to whole pages."""
    shape, dtype = spec
    return -(-math.prod(shape) * dtype.itemsize // mmap.PAGESIZE) * mmap.PAGESIZE


def memory_file() -> int:
    """Returns the descriptor of an empty nameless file, in memory or, if the system does not support that, on disk."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("mjrun")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


class PaintServer:
    """The painter's server in a rendering process.

    Args:
      description: descriptor of the file with the pickled painter.
      memory: descriptor of the memory of the slots.
    """

    def __init__(self, description: int, memory: int) -> None:
        self._description, self._memory = description, memory
        self._described: Painter
        self._painter: Painter | None = None  # open, if any
        self._slots: list[Slot] = []

    def load(self, module: str) -> None:
        """Imports a module that painters need."""
        with contextlib.suppress(ImportError):  # reported when the painter cannot be loaded
            importlib.import_module(module)

    def unpickle(self) -> None:
        """Loads the described painter in place of the current one."""
        if self._painter is not None:
            self._painter.close()
            self._painter = None
        with mmap.mmap(self._description, 0, access=mmap.ACCESS_READ) as content:
            self._described = pickle.loads(content)

    def open(self) -> None:
        """Opens the painter."""
        self._described.open()
        self._painter = self._described

    def lay_out(self, layout: SharedMemoryLayout) -> None:
        """Maps the slots."""
        self._slots = layout.slots(self._memory)

    def paint(self, frame: int, slot: int) -> None:
        """Renders a frame in a slot."""
        assert self._painter
        state, into = self._slots[slot]
        self._painter.paint(state, frame, into)

    def ask(self, question: Callable[[Any], object]) -> object:
        """Calls a method of the painter's class and returns its result."""
        return question(self._painter)
