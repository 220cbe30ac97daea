"""What runs in a drawing process, and what it shares with its parent: messages and anonymous memory.

The painter, the states and the frames lie in memory that only descriptors refer to: whatever happens, nothing is left
behind in /dev/shm, and its size, 64 MB in many containers, is no limit.
"""

import contextlib
import importlib
import itertools
import math
import mmap
import os
import pickle
import select
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from mjrun.errors import DrawError, MjrunError, clean

GRACE = 1.0  # [s] that a process gets to end by itself

T = TypeVar("T")

ArraySpec = tuple[tuple[int, ...], np.dtype]  # shape and dtype of an array


class Painter(Protocol):
    """Draws frames from states. Picklable until opened; opened, used and closed in one thread of one process."""

    def open(self) -> None:
        """Acquires what drawing needs, such as an OpenGL context.

        Raises:
          MjrunError: it is not available.
        """
        ...

    def paint(self, state: np.ndarray, index: int, into: np.ndarray) -> None:
        """Fills `into` with frame `index`, which depends on `state` and `index` alone."""
        ...

    def close(self) -> None:
        """Releases what `open` acquired."""
        ...


class Slot(NamedTuple):
    """Memory for one state and the frame that is drawn from it."""

    state: np.ndarray
    frame: np.ndarray


@dataclass(frozen=True)
class SharedMemoryLayout:
    """The layout of `count` slots in shared memory, each array on pages of its own."""

    count: int
    state: ArraySpec
    frame: ArraySpec

    @property
    def size(self) -> int:
        """Bytes of all slots."""
        return self.count * (_page_bytes(self.state) + _page_bytes(self.frame))

    def slots(self, memory: int) -> list[Slot]:
        """The slots in the memory behind a descriptor; it stays mapped as long as one of their arrays is referenced."""
        shared = mmap.mmap(memory, self.size)
        starts = itertools.accumulate(itertools.cycle((_page_bytes(self.state), _page_bytes(self.frame))), initial=0)
        return [
            Slot(*(np.ndarray(*spec, buffer=shared, offset=next(starts)) for spec in (self.state, self.frame)))
            for _ in range(self.count)
        ]


def _page_bytes(spec: ArraySpec) -> int:
    """The size of an array [bytes], rounded up to whole pages."""
    shape, dtype = spec
    return -(-math.prod(shape) * dtype.itemsize // mmap.PAGESIZE) * mmap.PAGESIZE


def memory_file() -> int:
    """The descriptor of an empty file without a name, in memory or, where the system does not offer that, on disk."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("mjrun")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


@dataclass(frozen=True)
class Failure:
    """An exception in a form that can be pickled: not every class can be called with its instances' `args`.

    Attributes:
      kind: its class; None for a bug, which is anything but an MjrunError.
      args: of the exception; for a bug, its message alone.
      attributes: the other attributes of the exception.
      trace: the traceback as text.
    """

    kind: type[MjrunError] | None
    args: tuple[object, ...]
    attributes: dict[str, Any]
    trace: str

    @classmethod
    def of(cls, error: Exception) -> "Failure":
        trace = "".join(traceback.format_exception(error))
        if isinstance(error, MjrunError):
            return cls(type(error), error.args, vars(error), trace)
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        return cls(None, (f"{type(error).__name__}: {clean(str(error))} ({place})",), {}, trace)

    def error(self, during: str | None) -> MjrunError:
        """The exception to raise in the parent; `during` is what it interrupted, None the start of the process."""
        if self.kind is not None:
            error = self.kind.__new__(self.kind, *self.args)
            vars(error).update(self.attributes)
        elif during is None:
            error = DrawError(f"a drawing process cannot start: {self.args[0]}")
        else:
            error = MjrunError(f"a bug in mjrun, {during}: {self.args[0]}")
        error.__cause__ = RuntimeError(f"in the drawing process:\n{self.trace}")
        return error


class OpenPainter(NamedTuple):
    """Tells a process to open the painter whose pickle is in the description file."""


class Draw(NamedTuple):
    """Tells a process to draw a frame in the slot with this number."""

    frame: int
    slot: int


class Query(NamedTuple):
    """Asks a process for the result of a method of the painter's class."""

    question: Callable[[Any], object]


class Opened(NamedTuple):
    """A painter was opened, or failed to; `warnings` are MuJoCo's."""

    failure: Failure | None
    warnings: Sequence[str]


class Drawn(NamedTuple):
    """A frame was drawn, or failed."""

    frame: int
    failure: Failure | None
    warnings: Sequence[str]


class Answered(NamedTuple):
    """A question was answered, or its method failed."""

    answer: object
    failure: Failure | None
    warnings: Sequence[str]


Reply = Opened | Drawn | Answered


def work(module: str, connection: str, description: str, memory: str) -> None:
    """The main function of a drawing process: does what its parent tells it until the parent hangs up.

    Args:
      module: imported at once, since painters will need it.
      connection, description, memory: descriptors of its end of the pipe, the painter's pickle, and the slots.
    """
    with contextlib.suppress(OSError):  # without a stderr, what drivers print on stdout is lost
        os.dup2(2, 1)
    threading.Thread(target=_end_with_parent, args=(int(connection),), daemon=True).start()
    with contextlib.suppress(EOFError, ConnectionError):
        _serve(Connection(int(connection)), int(description), int(memory), module)
    with contextlib.suppress(OSError):
        sys.stdout.flush()
    os._exit(0)  # nothing is left to do, and shutting down an interpreter takes time


def _end_with_parent(connection: int) -> None:
    """Ends this process, however busy, soon after the parent has hung up."""
    hung_up = select.poll()
    hung_up.register(connection, 0)
    hung_up.poll()
    time.sleep(GRACE)
    os._exit(1)


def _serve(connection: Connection, description: int, memory: int, module: str) -> None:
    with contextlib.suppress(ImportError):  # reported when the painter cannot be loaded
        importlib.import_module(module)
    painter: Painter | None = None
    slots: list[Slot] = []
    while True:
        message = connection.recv()
        if isinstance(message, OpenPainter):
            if painter is not None:
                painter.close()
            painter, failure, texts = _attempt(lambda: _load(description))
            if painter is not None:
                _, failure, texts = _attempt(painter.open)
                painter = painter if failure is None else None
            connection.send(Opened(failure, texts))
        elif isinstance(message, SharedMemoryLayout):
            slots = message.slots(memory)
        elif painter is None:
            continue  # the parent has been told why
        elif isinstance(message, Draw):
            slot = slots[message.slot]
            _, failure, texts = _attempt(partial(painter.paint, slot.state, message.frame, slot.frame))
            connection.send(Drawn(message.frame, failure, texts))
        elif isinstance(message, Query):
            answer, failure, texts = _attempt(partial(message.question, painter))
            connection.send(Answered(answer, failure, texts))


def _load(description: int) -> Painter:
    with mmap.mmap(description, 0, access=mmap.ACCESS_READ) as content:
        return pickle.loads(content)


def _attempt(function: Callable[[], T]) -> tuple[T | None, Failure | None, Sequence[str]]:
    """The result of `function`, or why it failed, and the warnings of MuJoCo meanwhile."""
    texts: list[str] = []
    try:
        with _collected_warnings() as texts:
            result = function()
    except Exception as error:
        return None, Failure.of(error), texts
    return result, None, texts


def _collected_warnings() -> contextlib.AbstractContextManager[list[str]]:
    """Collects the warnings of MuJoCo; none for a painter that does not use it."""
    if "mujoco" not in sys.modules:
        return contextlib.nullcontext([])
    from mjrun.model.mujoco_globals import collected_warnings

    return collected_warnings()
