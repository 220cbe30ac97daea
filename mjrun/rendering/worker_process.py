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
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from mjrun.errors import DrawError, MjrunError, clean

GRACE = 1.0  # [s] for a process to end by itself

Form = tuple[tuple[int, ...], np.dtype]  # shape and dtype of an array


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
    state: Form
    frame: Form

    @property
    def size(self) -> int:
        """Bytes of all slots."""
        return self.count * (_room(self.state) + _room(self.frame))

    def slots(self, memory: int) -> list[Slot]:
        """Arrays on the memory behind a descriptor; it stays mapped as long as one of them is held."""
        shared = mmap.mmap(memory, self.size)
        starts = itertools.accumulate(itertools.cycle((_room(self.state), _room(self.frame))), initial=0)
        return [
            Slot(*(np.ndarray(*form, buffer=shared, offset=next(starts)) for form in (self.state, self.frame)))
            for _ in range(self.count)
        ]


def _room(form: Form) -> int:
    """The bytes of an array, in whole pages."""
    shape, dtype = form
    return -(-math.prod(shape) * dtype.itemsize // mmap.PAGESIZE) * mmap.PAGESIZE


def anonymous() -> int:
    """The descriptor of an empty file without a name, in memory or, where the system has no such thing, on disk."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("mjrun")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


@dataclass(frozen=True)
class Failure:
    """An exception as it travels: unpickled, its class may want other arguments than it has."""

    kind: type[MjrunError] | None  # None for anything else: a bug
    message: str
    facts: dict[str, Any]
    trace: str

    @classmethod
    def of(cls, error: Exception) -> "Failure":
        trace = "".join(traceback.format_exception(error))
        if isinstance(error, MjrunError):
            return cls(type(error), str(error), vars(error), trace)
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        return cls(None, f"{type(error).__name__}: {clean(str(error))} ({place})", {}, trace)

    def error(self, during: str | None) -> MjrunError:
        """The exception to raise in the parent; it happened `during` something, or at the start when None."""
        if self.kind is not None:
            error = self.kind.__new__(self.kind, self.message)
            vars(error).update(self.facts)
        elif during is None:
            error = DrawError(f"a drawing process cannot start: {self.message}")
        else:
            error = MjrunError(f"a bug in mjrun, {during}: {self.message}")
        error.__cause__ = RuntimeError(f"in the drawing process:\n{self.trace}")
        return error


class Reply(NamedTuple):
    """What a drawing process tells its parent.

    Attributes:
      frame: the index of what was drawn; None when the painter was opened, or has answered.
      failure: why not, if so.
      heard: what MuJoCo warned of.
      answer: to what the painter was asked.
    """

    frame: int | None
    failure: Failure | None
    heard: Sequence[str]
    answer: Any = None


def work(connection: int, described: int, memory: int, module: str) -> None:
    """All that a drawing process does.

    It is told that its painter is described, then a layout, then frames, each with the number of its slot, or the
    name of a method of the painter to be called. It ends when the parent hangs up.

    Args:
      connection, described, memory: descriptors of its end of the pipe, the painter's pickle, and the slots.
      module: imported at once, since the painter will need it.
    """
    for number in (signal.SIGINT, signal.SIGTTOU):  # the parent's business, and no reason to stop
        signal.signal(number, signal.SIG_IGN)
    with contextlib.suppress(OSError):  # where there is no stderr, what drivers print is lost
        os.dup2(2, 1)
    threading.Thread(target=_end_with_parent, args=(connection,), daemon=True).start()
    with contextlib.suppress(EOFError, ConnectionError):
        _serve(Connection(connection), described, memory, module)
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


def _serve(connection: Connection, described: int, memory: int, module: str) -> None:
    with contextlib.suppress(ImportError):  # told when the painter cannot be loaded
        importlib.import_module(module)
    connection.recv()
    opened, painter = _loaded(described)
    connection.send(opened)
    if painter is None:
        return
    with contextlib.closing(painter):
        slots = connection.recv().slots(memory)
        while True:
            request = connection.recv()
            if isinstance(request, str):
                connection.send(_answer(painter, request))
            else:
                index, number = request
                connection.send(_painted(painter, index, slots[number]))


def _loaded(described: int) -> tuple[Reply, Painter | None]:
    """The painter, open, with what to tell of that; None if it cannot be."""
    heard: list[str] = []
    try:
        with mmap.mmap(described, 0, access=mmap.ACCESS_READ) as description:
            painter: Painter = pickle.loads(description)
        os.close(described)
        with _collected() as heard:
            painter.open()
    except Exception as error:
        return Reply(None, Failure.of(error), heard), None
    return Reply(None, None, heard), painter


def _painted(painter: Painter, index: int, slot: Slot) -> Reply:
    heard: list[str] = []
    try:
        with _collected() as heard:
            painter.paint(slot.state, index, slot.frame)
    except Exception as error:
        return Reply(index, Failure.of(error), heard)
    return Reply(index, None, heard)


def _answer(painter: Painter, question: str) -> Reply:
    heard: list[str] = []
    try:
        with _collected() as heard:
            return Reply(None, None, heard, getattr(painter, question)())
    except Exception as error:
        return Reply(None, Failure.of(error), heard)


def _collected() -> contextlib.AbstractContextManager[list[str]]:
    """What MuJoCo warns of; nothing for a painter that does not use it."""
    if "mujoco" not in sys.modules:
        return contextlib.nullcontext([])
    from mjrun.model.mujoco_globals import collected_warnings

    return collected_warnings()
