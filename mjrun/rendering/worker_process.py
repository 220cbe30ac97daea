"""What runs in a drawing process, and what it shares with its parent: messages, and memory without a name.

A painter, its states and its frames lie in memory that only descriptors refer to. Whatever happens, nothing
can be left in /dev/shm, and its size, 64 MB in many containers, is no limit.
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

GRACE = 1.0  # [s] for a process to end by itself

T = TypeVar("T")

ArraySpec = tuple[tuple[int, ...], np.dtype]  # shape and dtype of an array


class Painter(Protocol):
    """Draws frames from states. Picklable until opened; opened, used and closed in one thread of one process."""

    def open(self) -> None:
        """Gets what drawing needs, such as an OpenGL context.

        Raises:
          MjrunError: it cannot be had.
        """
        ...

    def paint(self, state: np.ndarray, index: int, into: np.ndarray) -> None:
        """Fills all of `into` with frame `index`, which depends on nothing but `state` and `index`."""
        ...

    def close(self) -> None:
        """Frees what `open` got."""
        ...


class Slot(NamedTuple):
    """Room for one state and the frame that is drawn from it."""

    state: np.ndarray
    frame: np.ndarray


@dataclass(frozen=True)
class Layout:
    """How `count` slots lie in shared memory."""

    count: int
    state: ArraySpec
    frame: ArraySpec

    @property
    def size(self) -> int:
        """Bytes of all slots."""
        return self.count * (_page_bytes(self.state) + _page_bytes(self.frame))

    def slots(self, memory: int) -> list[Slot]:
        """Arrays on the memory behind a descriptor; it stays mapped as long as one of them is held."""
        shared = mmap.mmap(memory, self.size)
        starts = itertools.accumulate(itertools.cycle((_page_bytes(self.state), _page_bytes(self.frame))), initial=0)
        return [
            Slot(*(np.ndarray(*spec, buffer=shared, offset=next(starts)) for spec in (self.state, self.frame)))
            for _ in range(self.count)
        ]


def _page_bytes(spec: ArraySpec) -> int:
    """The bytes of an array, in whole pages."""
    shape, dtype = spec
    return -(-math.prod(shape) * dtype.itemsize // mmap.PAGESIZE) * mmap.PAGESIZE


def memory_file() -> int:
    """The descriptor of an empty file without a name, in memory or, where the system has no such thing, on disk."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("mjrun")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


@dataclass(frozen=True)
class Failure:
    """An exception on its way to another process, where its class could not be called with the same arguments.

    Attributes:
      kind: its class; None for anything else than an MjrunError: a bug.
      args: the exception's; of a bug, its message alone.
      attributes: everything else of the exception.
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
        """The exception to raise in the parent; `during` says what it interrupted; None: the start."""
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
    """Asks a process to open the painter that is described by now."""


class Draw(NamedTuple):
    """Asks a process to draw a frame in the slot with this number."""

    frame: int
    slot: int


class Ask(NamedTuple):
    """Asks a process for the result of a method of the painter's class."""

    question: Callable[[Any], object]


class Opened(NamedTuple):
    """A painter was opened, or could not be; `warnings` are MuJoCo's."""

    failure: Failure | None
    warnings: Sequence[str]


class Drawn(NamedTuple):
    """A frame was drawn, or could not be."""

    frame: int
    failure: Failure | None
    warnings: Sequence[str]


class Answered(NamedTuple):
    """A question was answered, or could not be."""

    answer: object
    failure: Failure | None
    warnings: Sequence[str]


Reply = Opened | Drawn | Answered


def work(module: str, connection: str, description: str, memory: str) -> None:
    """All that a drawing process does: what its parent asks, until that hangs up.

    Args:
      module: imported at once, since painters will need it.
      connection, description, memory: descriptors of its end of the pipe, the painter's pickle, and the slots.
    """
    with contextlib.suppress(OSError):  # where there is no stderr, what drivers print is lost
        os.dup2(2, 1)
    threading.Thread(target=_end_with_parent, args=(int(connection),), daemon=True).start()
    with contextlib.suppress(EOFError, ConnectionError):
        _serve(Connection(int(connection)), int(description), int(memory), module)
    with contextlib.suppress(OSError):
        sys.stdout.flush()
    os._exit(0)  # nothing is left to do, and taking an interpreter down takes its time


def _end_with_parent(connection: int) -> None:
    """Ends this process, whatever keeps it busy, soon after the parent has hung up."""
    hung_up = select.poll()
    hung_up.register(connection, 0)
    hung_up.poll()
    time.sleep(GRACE)
    os._exit(1)


def _serve(connection: Connection, description: int, memory: int, module: str) -> None:
    with contextlib.suppress(ImportError):  # told when the painter cannot be loaded
        importlib.import_module(module)
    painter: Painter | None = None
    slots: list[Slot] = []
    while True:
        message = connection.recv()
        if isinstance(message, OpenPainter):
            if painter is not None:
                painter.close()
            painter, failure, texts = _tried(lambda: _loaded(description))
            if painter is not None:
                _, failure, texts = _tried(painter.open)
                painter = painter if failure is None else None
            connection.send(Opened(failure, texts))
        elif isinstance(message, Layout):
            slots = message.slots(memory)
        elif painter is None:
            continue  # the parent knows why
        elif isinstance(message, Draw):
            slot = slots[message.slot]
            _, failure, texts = _tried(partial(painter.paint, slot.state, message.frame, slot.frame))
            connection.send(Drawn(message.frame, failure, texts))
        elif isinstance(message, Ask):
            answer, failure, texts = _tried(partial(message.question, painter))
            connection.send(Answered(answer, failure, texts))


def _loaded(description: int) -> Painter:
    with mmap.mmap(description, 0, access=mmap.ACCESS_READ) as content:
        return pickle.loads(content)


def _tried(function: Callable[[], T]) -> tuple[T | None, Failure | None, Sequence[str]]:
    """What `function` returns, or why it failed, and what MuJoCo warns of meanwhile."""
    texts: list[str] = []
    try:
        with _collected_warnings() as texts:
            result = function()
    except Exception as error:
        return None, Failure.of(error), texts
    return result, None, texts


def _collected_warnings() -> contextlib.AbstractContextManager[list[str]]:
    """What MuJoCo warns of; nothing for a painter that does not use it."""
    if "mujoco" not in sys.modules:
        return contextlib.nullcontext([])
    from mjrun.model.mujoco_globals import collected_warnings

    return collected_warnings()
