"""What this process is doing, in shared memory that another process can still read when this one has died.

Nothing is noted without such memory, as in programs that import mjrun. A process that is about to confine itself makes
a promise, which the other one takes down at once: what the memory holds later may have been written by an attacker.
"""

import json
import mmap
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, cast, get_args

SIZE = 2**19  # bytes of either copy of the notice; the system provides only those that are used
MARKS = 8  # bytes before them
CURRENT, HEARD, COMPLETING, BELIEVED, ANSWERED = range(5)  # which copy is valid, and properties of the process
MODEL_LENGTH, MOST_FOLDERS = 400, 1000  # of a notice that is read
PROMISE = signal.SIGUSR1  # by which a process calls for the one that reads its promise
PATIENCE = 60.0  # [s] to wait for that

Activity = Literal["", "reading", "compiling", "simulating", "drawing"]


@dataclass
class Promise:
    """What a process is going to be confined to.

    Attributes:
      temporary: the folder of its temporary files, which it has made.
      written: the folders that it may write in, as links lead to them.
      seconds: how long it may last.
    """

    temporary: str
    written: list[str]
    seconds: float


@dataclass
class ProcessStatus:
    """What a process is doing.

    Attributes:
      activity: what it does with a model at the moment.
      model: which, the last that it has read or compiled.
      folders: where it has written outputs under temporary names.
      made: the folders of outputs that it has made.
      children: the processes that it has started and that have not ended.
      promise: what it will be confined to, if it will be.
    """

    activity: Activity = ""
    model: str = ""
    folders: list[str] = field(default_factory=list[str])
    made: list[str] = field(default_factory=list[str])
    children: list[int] = field(default_factory=list[int])
    promise: Promise | None = None


class _Mark:
    """A property that is a byte of the shared memory."""

    def __init__(self, place: int) -> None:
        self._place = place

    def __get__(self, status: "SharedStatus", _: object = None) -> bool:
        return bool(status.memory[self._place])

    def __set__(self, status: "SharedStatus", value: bool) -> None:
        status.memory[self._place] = value


class SharedStatus:
    """Holds the status of one process in memory that it shares with those that it is forked from or into.

    Attributes:
      memory: two copies of the status, and marks before them.
      reader: the process that has made it.
      heard: whether the process has heard that it is to end, and clears away.
      completing: whether the process does what it should be given the time for, though it is to end.
      believed: whether the promise was taken down.
      answered: whether the process has printed its JSON document, or begun to.
    """

    heard, completing, believed, answered = (_Mark(place) for place in (HEARD, COMPLETING, BELIEVED, ANSWERED))

    def __init__(self) -> None:
        self.memory = mmap.mmap(-1, MARKS + 2 * SIZE)
        self.reader = os.getpid()

    def write(self, notice: ProcessStatus) -> None:
        """Replaces the status; whenever the process dies, there is the old one or the new one."""
        text = json.dumps(asdict(notice)).encode()
        if len(text) >= SIZE:
            return
        other = 1 - self.memory[CURRENT]
        begin = MARKS + other * SIZE
        self.memory[begin : begin + len(text) + 1] = text + b"\0"
        self.memory[CURRENT] = other

    def read(self) -> ProcessStatus:
        """The status; an empty one if the memory holds none."""
        begin = MARKS + (self.memory[CURRENT] & 1) * SIZE
        text = self.memory[begin : max(begin, self.memory.find(b"\0", begin))]
        with suppress(ValueError, TypeError, KeyError, OverflowError, RecursionError):
            return _parsed(json.loads(text))
        return ProcessStatus()


_board: SharedStatus | None = None
_notice, _lock = ProcessStatus(), threading.Lock()


def write_on(board: SharedStatus | None) -> None:
    """Lets this process write its status to `board` from now on."""
    global _board, _notice
    _board, _notice = board, ProcessStatus()


@contextmanager
def doing(activity: Activity, model: Path | str = "") -> Iterator[None]:
    """Notes what is done with a model, with the last one if none is given, within the `with` block."""
    before = _notice.activity
    with _noting() as notice:
        notice.activity, notice.model = activity, str(model) or notice.model
    try:
        yield
    finally:
        with _noting() as notice:
            notice.activity = before


def note_folder(folder: Path) -> None:
    """Notes that outputs are written in `folder` under temporary names."""
    path = os.path.abspath(folder)  # noqa: PTH100 – as it is, without following links
    if path not in _notice.folders:
        with _noting() as notice:
            notice.folders.append(path)


def note_made_folder(folder: Path) -> None:
    """Notes that `folder` was made for outputs, to be removed if it stays empty."""
    path = str(folder)
    if path not in _notice.made:
        with _noting() as notice:
            notice.made.append(path)


def note_child(pid: int) -> None:
    """Notes that a process was started."""
    with _noting() as notice:
        notice.children.append(pid)


def note_end_of_child(pid: int) -> None:
    """Notes that a process has ended."""
    with _noting() as notice:
        if pid in notice.children:
            notice.children.remove(pid)


def make_promise(promise: Promise) -> None:
    """Notes what this process is going to be confined to, and waits until the process that reads it knows.

    Raises:
      OSError: that process does not answer.
    """
    assert _board
    with _noting() as notice:
        notice.promise = promise
    deadline = time.monotonic() + PATIENCE
    if os.getppid() == _board.reader:
        os.kill(_board.reader, PROMISE)
    while not _board.believed:
        if os.getppid() != _board.reader or time.monotonic() > deadline:
            raise OSError("the process that stands guard does not answer")
        time.sleep(0.0005)


def is_watched() -> bool:
    """Whether another process reads the notice of this one when it has died."""
    return _board is not None


def note_heard() -> None:
    """Notes that this process has heard that it is to end."""
    if _board:
        _board.heard = True


def note_answered() -> None:
    """Notes that this process prints its JSON document."""
    if _board:
        _board.answered = True


@contextmanager
def completing() -> Iterator[None]:
    """Notes that what is done within the `with` block must come to its end, also when the process is to end."""
    if _board:
        _board.completing = True
    try:
        yield
    finally:
        if _board:
            _board.completing = False


def _parsed(values: dict[str, Any]) -> ProcessStatus:
    """The status in a document of any content."""
    activity = str(values["activity"])
    promise = values["promise"]
    return ProcessStatus(
        cast("Activity", activity) if activity in get_args(Activity) else "",
        str(values["model"])[:MODEL_LENGTH],
        [str(folder) for folder in values["folders"]][:MOST_FOLDERS],
        [str(folder) for folder in values["made"]][:MOST_FOLDERS],
        [int(pid) for pid in values["children"]],
        promise and Promise(**promise),
    )


@contextmanager
def _noting() -> Iterator[ProcessStatus]:
    with _lock:
        yield _notice
        if _board:
            _board.write(_notice)
