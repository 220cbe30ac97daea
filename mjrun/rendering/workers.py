"""Drawing on all cores: the same frames in the same order, whether by one process or by many.

The processes are new interpreters, never forks, which hang once EGL is in use; and they never import
`__main__`, so that any script or notebook may draw.
"""

import contextlib
import fcntl
import itertools
import os
import pickle
import selectors
import signal
import subprocess
import sys
import warnings
from collections import deque
from collections.abc import Iterable, Iterator
from multiprocessing.connection import Pipe
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from mjrun.errors import DrawError
from mjrun.rendering.worker_process import GRACE, Failure, Layout, Painter, Reply, Slot, anonymous

AHEAD = 2  # frames a process has been given: one to draw, one to go on with
SLOTS = 3  # frames in memory per process; the third waits for its turn

# Read when Mesa and OpenBLAS are loaded: one thread each, since there is a process per core.
# And by MuJoCo as it is imported, which else imports GLFW, and that starts a process to look for its library.
ENVIRONMENT = {"LP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MUJOCO_GL": "disable"}
BOOT = (
    "import sys; sys.path[:] = sys.argv[5:]; from mjrun.rendering.worker_process import work; "
    "work(*map(int, sys.argv[1:4]), sys.argv[4])"
)


class Workers:
    """Processes that will draw, started without waiting for them, maybe before it is known what. To be closed.

    Args:
      jobs: how many.
      module: that the painter needs, imported as they start.

    Raises:
      DrawError: processes cannot be started.
    """

    def __init__(self, jobs: int, module: str = "numpy") -> None:
        self.workers: list[_Worker] = []
        with contextlib.ExitStack() as stack, _refusals():
            self._described = anonymous()
            stack.callback(os.close, self._described)
            self.memory = anonymous()
            stack.callback(os.close, self.memory)
            stack.callback(self._dismiss)
            for _ in range(jobs):
                self.workers.append(_Worker(self._described, self.memory, module))
            self._all = stack.pop_all()

    def brief(self, painter: Painter) -> None:
        """Tells them what to draw with."""
        with _refusals(), open(self._described, "wb", closefd=False) as file:
            pickle.dump(painter, file, pickle.HIGHEST_PROTOCOL)
        for worker in self.workers:
            worker.send("")

    def close(self) -> None:
        """Ends the processes, those that are busy at once."""
        self._all.close()

    def _dismiss(self) -> None:
        for worker in self.workers:
            worker.dismiss()
        for worker in self.workers:
            worker.end()


class Pool:
    """Draws frames in `jobs` processes, or in this one if that is 1. To be closed.

    Making it opens the painter, or starts the processes without waiting for them.

    Args:
      shape, dtype: of the array that is one frame.
      jobs: how many, or those that were started already; they end with the pool.

    Attributes:
      answer: to the last question, when it is known.

    Raises:
      DrawError: processes cannot be started.
      MjrunError: the painter cannot be opened here.
    """

    answer: Any = None

    def __init__(
        self, painter: Painter, shape: tuple[int, ...], jobs: int | Workers, dtype: npt.DTypeLike = np.uint8
    ) -> None:
        if jobs != 1 and isinstance(jobs, int):
            if jobs < 1:
                raise ValueError(f"jobs must be at least 1, not {jobs}")
            jobs = Workers(jobs)
        self._painter, self._crew = painter, jobs if isinstance(jobs, Workers) else None
        self._frame = (shape, np.dtype(dtype))
        self._open = True
        self._slots: list[Slot] = []
        self._drawn: dict[int, Failure | None] = {}  # whose turn has not come
        self._told: set[str] = set()
        self._asked = False
        if self._crew is None:
            painter.open()
            return
        self._workers = self._crew.workers
        self._selector = selectors.DefaultSelector()
        try:
            for worker in self._workers:
                self._selector.register(worker.connection, selectors.EVENT_READ, worker)
            self._crew.brief(painter)
        except BaseException:
            self.close()
            raise

    def frames(self, states: Iterable[np.ndarray], first: int = 0) -> Iterator[np.ndarray]:
        """The frame of each of `states`, in order; an array is valid until the next one is asked for.

        At most `SLOTS` states per process are taken ahead. What MuJoCo warns of in another process is warned
        of in this one, each text once. After an error, or when left before the end, the pool is closed.

        Args:
          states: all of one shape and dtype.
          first: the index of the first frame.

        Raises:
          DrawError: a process died, at once; the message names its frame and how it ended.
          MjrunError: what the painter raised, of the same class, in the frame's turn. Anything else that it
            raises in another process arrives as a bug, an MjrunError.
        """
        try:
            self._check_open()
            for frame in self._together(iter(states), first) if self._crew else self._alone(states, first):
                yield frame
                self._check_open()
        except BaseException:
            self.close()
            raise

    def ask(self, question: str) -> None:
        """Has the method `question` of a painter called, after the frames that its process was given, for `answer`."""
        if self._crew is None:
            self.answer = getattr(self._painter, question)()
            return
        self.answer, self._asked = None, True
        self._workers[0].send(question)

    def close(self) -> None:
        """Ends the processes, those that are busy at once."""
        if not self._open:
            return
        self._open = False
        if self._crew is None:
            self._painter.close()
            return
        self._crew.close()
        self._selector.close()
        self._slots = []  # the memory lasts while somebody holds a frame

    def __enter__(self) -> "Pool":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check_open(self) -> None:
        if not self._open:
            raise ValueError("the pool is closed")

    def _alone(self, states: Iterable[np.ndarray], first: int) -> Iterator[np.ndarray]:
        frame = np.empty(*self._frame)
        for index, state in enumerate(states, first):
            self._painter.paint(state, index, frame)
            yield frame

    def _together(self, states: Iterator[np.ndarray], first: int) -> Iterator[np.ndarray]:
        given = first
        for turn in itertools.count(first):
            given = self._hand_out(states, given, turn)
            while self._hear(wait=given > turn and turn not in self._drawn):
                given = self._hand_out(states, given, turn)
            if given == turn:
                break
            if failure := self._drawn.pop(turn):
                raise failure.error(f"drawing frame {turn}")
            yield self._slots[turn % len(self._slots)].frame
        while self._asked:
            self._hear(wait=True)

    def _hand_out(self, states: Iterator[np.ndarray], given: int, turn: int) -> int:
        """Gives frames to processes that have room, while slots are free; returns how many are given by now."""
        while given < turn + SLOTS * len(self._workers):
            worker = min(self._workers, key=lambda each: len(each.drawing))
            if len(worker.drawing) == AHEAD or (state := next(states, None)) is None:
                break
            if not self._slots:
                self._lay_out(state)
            number = given % len(self._slots)
            room = self._slots[number].state
            if (state.shape, state.dtype) != (room.shape, room.dtype):
                raise ValueError(f"a state must be {room.dtype} {room.shape}, not {state.dtype} {state.shape}")
            room[...] = state
            worker.drawing.append(given)
            worker.send((given, number))
            given += 1
        return given

    def _lay_out(self, state: np.ndarray) -> None:
        assert self._crew
        layout = Layout(SLOTS * len(self._workers), (state.shape, state.dtype), self._frame)
        with _refusals():
            os.ftruncate(self._crew.memory, layout.size)
            self._slots = layout.slots(self._crew.memory)
        for worker in self._workers:
            worker.send(layout)

    def _hear(self, *, wait: bool) -> bool:
        """Takes one reply of each process that has any, and returns whether there was one."""
        events = self._selector.select(None if wait else 0)
        for key, _ in events:
            opened = key.data.ready
            index, failure, heard, answer = key.data.receive()
            for text in heard:
                if text not in self._told:
                    self._told.add(text)
                    warnings.warn(text, stacklevel=4)  # where the frame was asked for
            if index is not None:
                self._drawn[index] = failure
            elif failure:
                raise failure.error("in a drawing process" if opened else None)
            elif answer is not None:
                self.answer, self._asked = answer, False
        return bool(events)


class _Worker:
    """A drawing process, as its parent sees it.

    Attributes:
      drawing: the frames that it was given and has not drawn, oldest first.
      ready: whether its painter is open.
    """

    def __init__(self, described: int, memory: int, module: str) -> None:
        self.drawing: deque[int] = deque()
        self.ready = False
        self.connection, theirs = Pipe()
        with contextlib.ExitStack() as stack:
            stack.callback(theirs.close)
            inherited = []
            for descriptor in (theirs.fileno(), described, memory):
                # Above 2, which it may be when this process has no stdin: the child's 0 to 2 are taken.
                inherited.append(fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3))
                stack.callback(os.close, inherited[-1])
            self._child = subprocess.Popen(
                [sys.executable, "-P", "-c", BOOT, *map(str, inherited), module, *map(str, sys.path)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                env={**os.environ, **ENVIRONMENT},
                pass_fds=inherited,
                process_group=0,  # Ctrl-C is ours
            )

    def send(self, message: object) -> None:
        with contextlib.suppress(OSError):  # it is gone, and its last reply, unread as yet, may say why
            self.connection.send(message)

    def receive(self) -> Reply:
        try:
            reply: Reply = self.connection.recv()
        except (EOFError, OSError):
            raise self._lost() from None
        if reply.frame is None:
            self.ready = True
        else:
            self.drawing.remove(reply.frame)
        return reply

    def dismiss(self) -> None:
        """Lets the process end; kills it if it is busy."""
        if self.drawing or not self.ready:
            self._child.kill()
        self.connection.close()

    def end(self) -> int:
        """Waits until the process is gone, killing it if that takes long, and returns its code."""
        try:
            return self._child.wait(2 * GRACE)
        except subprocess.TimeoutExpired:
            self._child.kill()
            return self._child.wait()

    def _lost(self) -> DrawError:
        doing = f"the process drawing frame {self.drawing[0]}" if self.drawing else "a drawing process"
        which = doing if self.ready else "a drawing process, as it started,"
        code = self.end()
        if code >= 0:
            return DrawError(f"{which} ended with code {code}")
        name = next((known.name for known in signal.Signals if known == -code), f"signal {-code}")
        memory = "\nthe system does that when memory runs out; fewer --jobs need less" if name == "SIGKILL" else ""
        return DrawError(f"{which} was killed by {name}{memory}")


@contextlib.contextmanager
def _refusals() -> Iterator[None]:
    """Says what the system refuses: a process, a descriptor, memory."""
    try:
        yield
    except OSError as error:
        raise DrawError(f"cannot draw in several processes: {error}\n--jobs 1 needs only this one") from error
