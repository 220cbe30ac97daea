"""Rendering on all cores: the same frames in the same order, whether one process renders them or many.

The processes are copies of this one where that is safe, and otherwise new interpreters: a fork hangs once EGL is in
use. The compositor, the states and the frames lie in memory that only descriptors refer to: nothing can remain in
/dev/shm, and its size, 64 MB in many containers, is no limit.
"""

import contextlib
import importlib
import itertools
import math
import mmap
import os
import pickle
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from mjrun.child_process import ENVIRONMENT, IDLE, ExitStatus, memory_file
from mjrun.dataclass import dataclass
from mjrun.errors import DrawError, option
from mjrun.rendering.backend import may_draw_in_fork
from mjrun.worker import PicklableException, Worker, WorkerEndedError, replying

AHEAD = 2  # frames assigned to a process at a time: one to draw, and the next
SLOTS = 3  # frames in memory per process; the third waits for its turn

# Mesa reads this while loading: one thread each, since there is a process per core.
ONE_THREAD = {**ENVIRONMENT, "LP_NUM_THREADS": "1"}


class Compositor(Protocol):
    """A compositor of frames. Picklable until opened; opened, used and closed in one thread of one process."""

    def open(self) -> None:
        """Acquires the resources that rendering needs, such as an OpenGL context.

        Raises:
          MjrunError: a resource is not available.
        """
        ...

    def compose(self, state: np.ndarray, index: int, into: np.ndarray) -> None:
        """Fills `into` with frame `index`, which depends only on `state` and `index`."""
        ...

    def close(self) -> None:
        """Releases the resources."""
        ...


ArraySpec = tuple[tuple[int, ...], np.dtype]  # shape and dtype of an array
P = TypeVar("P", bound=Compositor)


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


class CompositorProcesses:
    """Processes that render for one pool after another. The constructor does not wait for them to start. To be closed.

    Args:
      count: number of processes.
      module: the module that compositors need, imported as the processes start.

    Raises:
      DrawError: processes cannot be started.
    """

    def __init__(self, count: int, module: str = "numpy") -> None:
        self._module = module
        self._workers: list[Worker] = []
        with contextlib.ExitStack() as stack, _system_errors():
            self._compositor = memory_file()
            stack.callback(os.close, self._compositor)
            self.memory = memory_file()
            stack.callback(os.close, self.memory)
            stack.callback(self._end_all)
            self.grow(count)
            self._resources = stack.pop_all()

    def grow(self, count: int) -> None:
        """Starts processes until there are `count`.

        Raises:
          DrawError: the processes cannot be started.
        """
        with _system_errors():
            while len(self._workers) < count:
                worker = Worker(
                    "mjrun.rendering.compositor_pool:CompositorServer",
                    environment=ONE_THREAD,
                    descriptors=[self._compositor, self.memory],
                    stderr="inherit",
                    is_fork=may_draw_in_fork(),
                )
                worker.send("prepare", partial(importlib.import_module, self._module))
                self._workers.append(worker)

    def assign(self, compositor: Compositor, count: int) -> list[Worker]:
        """Requests `count` processes to open `compositor` in place of their current one, and returns them."""
        for worker in [*self._workers]:
            try:
                while _awaits(worker, "open"):
                    worker.receive(idle=IDLE)
            except WorkerEndedError:
                self.discard(worker)
        self.grow(count)
        with _system_errors(), open(self._compositor, "wb", closefd=False) as file:
            file.seek(0)
            file.truncate()
            pickle.dump(compositor, file, pickle.HIGHEST_PROTOCOL)
        for worker in self._workers[:count]:
            worker.send("unpickle")  # which imports modules, so that warnings can be collected during open
            worker.send("open")
        return self._workers[:count]

    def prepare(self, preparation: Callable[[], object]) -> None:
        """Requests the processes to call a function in advance, such as one that loads a driver."""
        for worker in self._workers:
            worker.send("prepare", preparation)

    def discard(self, worker: Worker) -> None:
        """Kills a process that is no longer needed; `grow` starts another."""
        self._workers.remove(worker)
        worker.close()

    def close(self) -> None:
        """Ends the processes."""
        self._resources.close()

    def _end_all(self) -> None:
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.close()
        self._workers = []


class CompositorPool(Generic[P]):
    """A pool that renders frames in `jobs` processes. To be closed.

    The constructor requests the processes to open the compositor, without waiting for them.

    Args:
      shape, dtype: the shape and the type of a frame.
      jobs: number of processes.
      workers: the processes to use, whose next pool reuses the memory of frames; when None, the pool starts processes
        and ends them when it closes.

    Attributes:
      answer: the answer to the last question; None until it is known.

    Raises:
      DrawError: processes cannot be started.
    """

    answer: object = None

    def __init__(
        self,
        compositor: P,
        shape: tuple[int, ...],
        jobs: int,
        dtype: npt.DTypeLike = np.uint8,
        workers: CompositorProcesses | None = None,
    ) -> None:
        if jobs < 1:
            raise ValueError(f"jobs must be at least 1, not {jobs}")
        self._frame = shape, np.dtype(dtype)
        self._is_open = True
        self._resources = contextlib.ExitStack()
        self._slots: list[Slot] = []
        self._drawn: dict[int, PicklableException | None] = {}  # frames whose turn has not come
        self._warnings: set[str] = set()
        self._workers: list[Worker] = []
        self._group = workers or self._resources.enter_context(contextlib.closing(CompositorProcesses(jobs)))
        with contextlib.ExitStack() as stack:
            stack.callback(self.close)
            self._resources.callback(self._discard_busy)
            self._workers = self._group.assign(compositor, jobs)
            stack.pop_all()

    def frames(self, states: Iterable[np.ndarray], first: int = 0) -> Iterator[np.ndarray]:
        """Yields the frame of each of `states`, in order; an array is valid until the next one is requested.

        At most `SLOTS` states per process are read ahead. MuJoCo's warnings in other processes are repeated in this
        one, each text once. After an error, and when the iterator is closed early, the pool is closed.

        Args:
          states: states of one shape and dtype.
          first: the index of the first frame.

        Raises:
          DrawError: a process died, or hung and was killed; raised at once, with its frame and exit status.
          MjrunError: the compositor raised it; raised with the same class in the frame's turn. Any other exception in
              another process becomes an MjrunError that reports a bug.
        """
        try:
            self._check_open()
            for frame in self._drawn_frames(iter(states), first):
                yield frame
                self._check_open()
        except BaseException:
            self.close()
            raise

    def ask(self, question: Callable[[P], object]) -> None:
        """Calls `question`, a method of the compositor's class, on a compositor, after the frames assigned to it.

        The result becomes the pool's `answer`.
        """
        self.answer = None
        self._workers[0].send("ask", question)

    def close(self) -> None:
        """Releases the processes; busy ones are killed."""
        self._is_open = False
        self._resources.close()
        self._slots = []  # the memory remains as long as a frame is referenced

    def _discard_busy(self) -> None:
        for worker in self._workers:
            if _awaits(worker, "compose", "ask"):
                self._group.discard(worker)

    def _check_open(self) -> None:
        if not self._is_open:
            raise ValueError("the pool is closed")

    def _drawn_frames(self, states: Iterator[np.ndarray], first: int) -> Iterator[np.ndarray]:
        assigned = first
        for turn in itertools.count(first):
            assigned = self._assign(states, assigned, turn)
            while self._receive(wait=assigned > turn and turn not in self._drawn):
                assigned = self._assign(states, assigned, turn)
            if assigned == turn:
                break
            if failure := self._drawn.pop(turn):
                raise failure.error(f"a bug in mjrun, rendering frame {turn}")
            yield self._slots[turn % len(self._slots)].frame
        while _awaits(self._workers[0], "ask"):
            self._receive(wait=True)

    def _assign(self, states: Iterator[np.ndarray], assigned: int, turn: int) -> int:
        """Assigns frames to the least busy processes while slots are free; returns the first one not assigned."""
        while assigned < turn + SLOTS * len(self._workers):
            worker = min(self._workers, key=lambda worker: len(_drawing(worker)))
            if len(_drawing(worker)) == AHEAD or (state := next(states, None)) is None:
                break
            if not self._slots:
                self._lay_out(state)

            number = assigned % len(self._slots)
            slot = self._slots[number].state
            if (state.shape, state.dtype) != (slot.shape, slot.dtype):
                raise ValueError(f"a state must be {slot.dtype} {slot.shape}, not {state.dtype} {state.shape}")
            slot[...] = state

            worker.send("compose", assigned, number)
            assigned += 1
        return assigned

    def _lay_out(self, state: np.ndarray) -> None:
        layout = SharedMemoryLayout(SLOTS * len(self._workers), (state.shape, state.dtype), self._frame)
        with _system_errors():
            if os.fstat(self._group.memory).st_size < layout.size:  # never shrunk while a frame is referenced
                os.ftruncate(self._group.memory, layout.size)
            self._slots = layout.slots(self._group.memory)
        for worker in self._workers:
            worker.send("lay_out", layout)

    def _receive(self, *, wait: bool) -> bool:
        """Receives one reply from each process that has any, and returns whether there was one."""
        workers = replying(self._workers, IDLE, block=wait)
        for worker in workers:
            try:
                reply = worker.receive()
            except WorkerEndedError as death:
                raise _death(worker, death.ending) from None
            for text in reply.warnings:
                if text not in self._warnings:
                    self._warnings.add(text)
                    warnings.warn(text, stacklevel=4)  # at the line that requested the frame

            request, failure = reply.request, reply.failure
            if request.name == "compose":
                self._drawn[request.arguments[0]] = failure
            elif failure and request.name in ("unpickle", "open"):
                raise failure.error("a rendering process cannot start", DrawError)
            elif failure:
                raise failure.error("a bug in mjrun, in a rendering process")
            elif request.name == "ask":
                self.answer = reply.value
        return bool(workers)


class CompositorServer:
    """The compositor's server in a rendering process.

    Args:
      description: descriptor of the file with the pickled compositor.
      memory: descriptor of the memory of the slots.
    """

    def __init__(self, description: int, memory: int) -> None:
        self._description, self._memory = description, memory
        self._described: Compositor
        self._compositor: Compositor | None = None  # open, if any
        self._slots: list[Slot] = []

    def prepare(self, preparation: Callable[[], object]) -> None:
        """Calls a function without which opening a compositor takes longer."""
        with contextlib.suppress(Exception):  # reported when the compositor cannot be loaded or opened
            preparation()

    def unpickle(self) -> None:
        """Loads the described compositor in place of the current one."""
        if self._compositor is not None:
            self._compositor.close()
            self._compositor = None
        with mmap.mmap(self._description, 0, access=mmap.ACCESS_READ) as content:
            self._described = pickle.loads(content)

    def open(self) -> None:
        """Opens the compositor."""
        self._described.open()
        self._compositor = self._described

    def lay_out(self, layout: SharedMemoryLayout) -> None:
        """Maps the slots."""
        self._slots = layout.slots(self._memory)

    def compose(self, frame: int, slot: int) -> None:
        """Renders a frame in a slot."""
        assert self._compositor
        state, into = self._slots[slot]
        self._compositor.compose(state, frame, into)

    def ask(self, question: Callable[[Any], object]) -> object:
        """Calls a method of the compositor's class and returns its result."""
        return question(self._compositor)


def _drawing(worker: Worker) -> list[int]:
    """Returns the frames that are assigned to a process and not yet rendered, oldest first."""
    return [request.arguments[0] for request in worker.pending if request.name == "compose"]


def _awaits(worker: Worker, *names: str) -> bool:
    """Returns whether a process has not yet answered a request with one of these names."""
    return any(request.name in names for request in worker.pending)


def _death(worker: Worker, ending: ExitStatus) -> DrawError:
    """Creates the error about a process that has ended."""
    if _awaits(worker, "open"):
        which = "a rendering process, as it started,"
    else:
        frames = _drawing(worker)
        which = f"the process rendering frame {frames[0]}" if frames else "a rendering process"
    advice = ""
    if ending.out_of_memory:
        advice = f"\nthe system does that when memory runs out; fewer {option('jobs')} need less"
    elif ending.cause == "idle":
        jobs = f"{option('jobs')} 1, which needs no such process"
        advice = f"\nthe graphics driver may hang: try {jobs}, or another {option('gl')}"
    return DrawError(f"{which} {ending}{advice}")


@contextlib.contextmanager
def _system_errors() -> Iterator[None]:
    """Turns an OSError about a process, a descriptor or memory into a DrawError."""
    try:
        yield
    except OSError as error:
        alone = f"{option('jobs')} 1 needs only this one"
        raise DrawError(f"cannot render in several processes: {error}\n{alone}") from error
