"""The activity of this process, in shared memory that another process can read after this one has died.

Sections of the process that signals to end it must not interrupt are part of its activity.

Without such memory, as in programs that import mjrun, nothing is recorded. A process that is about to confine itself
makes a promise, which its parent records at once: later contents of the memory may come from an attacker.

The command imports this module before it forks, and everything that is imported then makes forking slower.
"""

import mmap
import os
import threading
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, cast, get_args

from mjrun.platform import system

SIZE = 2**19  # bytes of either copy of the status; the system provides only those that are used
MARKS = 8  # bytes before them
CURRENT, HEARD, COMPLETING, BELIEVED, ANSWERED, MADE = range(6)  # which copy is valid, and properties of the process
MODEL_LENGTH, MOST_FOLDERS = 400, 1000  # of a status that is read
PATIENCE = 60.0  # [s] to wait for that

Activity = Literal["", "reading", "compiling", "simulating", "drawing"]


class ConfinementPromise(SimpleNamespace):
    """The resources to which a process is about to confine itself.

    Attributes:
      temporary: the folder of its temporary files, which it created.
      written: the folders that it may write to, with links resolved.
      seconds: its maximum duration.
    """

    temporary: str
    written: list[str]
    seconds: float

    def __init__(self, temporary: str, written: list[str], seconds: float) -> None:
        super().__init__(temporary=temporary, written=written, seconds=seconds)


class ProcessStatus(SimpleNamespace):
    """The activity of a process.

    Attributes:
      activity: its current action on a model.
      model: the last model that it read or compiled.
      folders: the folders in which it writes outputs under temporary names.
      made: the output folders that it created.
      children: its running child processes.
      promise: its future confinement, if any.
    """

    activity: Activity
    model: str
    folders: list[str]
    made: list[str]
    children: list[int]
    promise: ConfinementPromise | None

    def __init__(
        self,
        activity: Activity = "",
        model: str = "",
        folders: Sequence[str] = (),
        made: Sequence[str] = (),
        children: Sequence[int] = (),
        promise: ConfinementPromise | None = None,
    ) -> None:
        lists = {"folders": [*folders], "made": [*made], "children": [*children]}
        super().__init__(activity=activity, model=model, promise=promise, **lists)

    def document(self) -> dict[str, object]:
        """Returns the status as a JSON object."""
        return {**vars(self), "promise": self.promise and vars(self.promise)}


class _Mark:
    """A property that is a byte of the shared memory."""

    def __init__(self, place: int) -> None:
        self._place = place

    def __get__(self, status: "ProcessActivityMemory", _: object = None) -> bool:
        return bool(status.memory[self._place])

    def __set__(self, status: "ProcessActivityMemory", value: bool) -> None:
        status.memory[self._place] = value


class ProcessActivityMemory:
    """The status of one process in memory shared with its parent and its children.

    Attributes:
      memory: two copies of the status, and marks before them.
      reader: the process that created it.
      heard: the process has received the signal to end and is cleaning up.
      completing: the process is doing work that must be completed even if it is to end.
      believed: the promise was recorded.
      answered: the process has printed its JSON document, or begun to.
      has_made_folders: the process has created output folders.
    """

    heard, completing, believed = _Mark(HEARD), _Mark(COMPLETING), _Mark(BELIEVED)
    answered, has_made_folders = _Mark(ANSWERED), _Mark(MADE)

    def __init__(self) -> None:
        self.memory = mmap.mmap(-1, MARKS + 2 * SIZE)
        self.reader = os.getpid()

    def write(self, status: ProcessStatus) -> None:
        """Replaces the status; if the process dies meanwhile, either the old or the new status remains."""
        import json

        text = json.dumps(status.document()).encode()
        if len(text) >= SIZE:
            return
        other = 1 - self.memory[CURRENT]
        begin = MARKS + other * SIZE
        self.memory[begin : begin + len(text) + 1] = text + b"\0"
        self.memory[CURRENT] = other

    def read(self) -> ProcessStatus:
        """Returns the status; an empty one if the memory contains none."""
        begin = MARKS + (self.memory[CURRENT] & 1) * SIZE
        text = self.memory[begin : max(begin, self.memory.find(b"\0", begin))]
        import json

        with suppress(ValueError, TypeError, KeyError, OverflowError, RecursionError):
            return _parsed(json.loads(text))
        return ProcessStatus()


_memory: ProcessActivityMemory | None = None
_status, _lock = ProcessStatus(), threading.Lock()


def record_status_in(memory: ProcessActivityMemory | None) -> None:
    """Makes this process write its status to `memory` from now on."""
    global _memory, _status
    _memory, _status = memory, ProcessStatus()


@contextmanager
def doing(activity: Activity, model: Path | str = "") -> Generator[None]:
    """Records an action on a model, by default the last one, for the `with` block."""
    before = _status.activity
    with _changed_status() as status:
        status.activity, status.model = activity, str(model) or status.model
    try:
        yield
    finally:
        with _changed_status() as status:
            status.activity = before


def note_folder(folder: Path) -> None:
    """Records that outputs are written in `folder` under temporary names."""
    path = os.path.abspath(folder)  # noqa: PTH100 – links are not followed
    if path not in _status.folders:
        with _changed_status() as status:
            status.folders.append(path)


def note_made_folder(folder: Path) -> None:
    """Records that `folder` was created for outputs, to be removed if it stays empty."""
    path = str(folder)
    if path not in _status.made:
        with _changed_status() as status:
            status.made.append(path)
        if _memory:
            _memory.has_made_folders = True


def note_child(pid: int) -> None:
    """Records that a process was started."""
    with _changed_status() as status:
        status.children.append(pid)


def note_end_of_child(pid: int) -> None:
    """Records that a process has ended."""
    with _changed_status() as status:
        if pid in status.children:
            status.children.remove(pid)


def make_promise(promise: ConfinementPromise) -> None:
    """Records the future confinement of this process, and waits until its reader has recorded it.

    Raises:
      OSError: the reader does not respond.
    """
    assert _memory
    with _changed_status() as status:
        status.promise = promise
    deadline = time.monotonic() + PATIENCE
    if os.getppid() == _memory.reader:
        system.send_promise(_memory.reader)
    while not _memory.believed:
        if os.getppid() != _memory.reader or time.monotonic() > deadline:
            raise OSError("the monitoring process does not respond")
        time.sleep(0.0005)


def is_monitored() -> bool:
    """Returns whether another process reads the status of this one after its death."""
    return _memory is not None


def note_heard() -> None:
    """Records that this process has received a signal to end."""
    if _memory:
        _memory.heard = True


def note_answered() -> None:
    """Records that this process prints its JSON document."""
    if _memory:
        _memory.answered = True


@contextmanager
def completing() -> Generator[None]:
    """Records that the `with` block must be completed even if the process is to end; blocks may be nested."""
    if _memory is None:
        yield
        return
    before, _memory.completing = _memory.completing, True
    try:
        yield
    finally:
        _memory.completing = before


def _parsed(values: dict[str, Any]) -> ProcessStatus:
    """Parses the status from a document with any content."""
    activity = str(values["activity"])
    promise = values["promise"]
    return ProcessStatus(
        cast("Activity", activity) if activity in get_args(Activity) else "",
        str(values["model"])[:MODEL_LENGTH],
        [str(folder) for folder in values["folders"]][:MOST_FOLDERS],
        [str(folder) for folder in values["made"]][:MOST_FOLDERS],
        [int(pid) for pid in values["children"]],
        promise and ConfinementPromise(**promise),
    )


@contextmanager
def _changed_status() -> Generator[ProcessStatus]:
    with _lock:
        yield _status
        if _memory:
            _memory.write(_status)


_depth = 0
_waiting: BaseException | None = None


@contextmanager
def uninterrupted() -> Generator[None]:
    """Delays errors from `interrupt` to the end of the `with` block, which should be short."""
    global _depth, _waiting
    if threading.current_thread() is not threading.main_thread():  # handlers of signals run in the main thread
        yield
        return
    _depth += 1
    try:
        yield
    finally:
        _depth -= 1
        if not _depth and _waiting is not None:
            error, _waiting = _waiting, None
            raise error


def interrupt(error: BaseException) -> None:
    """Raises `error` as soon as the main thread may be interrupted; for signal handlers."""
    global _waiting
    if not _depth:
        raise error
    _waiting = error
