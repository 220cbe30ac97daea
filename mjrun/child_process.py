"""Child processes: their start, limits, output and end.

A child has no standard input unless it is fed, inherits only listed descriptors, and has a separate session: signals
of the terminal, such as Ctrl-C, reach only its parent, and killing it kills its descendants.
"""

import math
import mmap
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import IO, Literal, NoReturn

from mjrun.dataclass import dataclass
from mjrun.errors import FileError
from mjrun.platform import system
from mjrun.shared_status import note_child, note_end_of_child, record_status_in, uninterrupted

STDOUT_LIMIT = 2**24  # bytes of captured output that are kept, from its beginning
STDERR_LIMIT = 2**16  # bytes of captured messages that are kept, from their end: the last line gives the reason
POLL_INTERVAL = 0.05  # [s]
PIPE_GRACE = 1.0  # [s] for a pipe to end after its process
KILLED_GRACE = 0.1  # [s] for it to end after a process that was killed
IDLE = 60.0  # [s] without computing after which a process counts as hanging; a busy machine only slows it down
IDLE_INTERVAL = 1.0  # [s] between two checks for activity
# Modules are not garbage, and scanning them is slower than importing some of them.
BOOT = (
    "import gc, sys; gc.disable(); end = 2 + int(sys.argv[1]); sys.path[:] = sys.argv[2:end]; "
    "from {module} import {function}; gc.freeze(); gc.enable(); {function}(*sys.argv[end:])"
)
# Libraries read these when they are loaded: one thread each, as workers share the cores. MuJoCo reads MUJOCO_GL when it
# is imported, and would otherwise import GLFW, which starts a process to find its library.
ENVIRONMENT = {"MUJOCO_GL": "disable", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

Cause = Literal["time", "memory", "idle", "ended"]
Stream = Literal["discard", "inherit", "capture"] | IO[bytes] | int


def python_call(function: str, *arguments: str, path: Sequence[str] | None = None) -> list[str]:
    """Returns the command that calls a function in a new Python interpreter, which never imports `__main__`.

    Args:
      function: `package.module:name`.
      arguments: arguments of the function, all strings.
      path: the search path for modules; by default, that of this process.
    """
    module, _, name = function.partition(":")
    path = sys.path if path is None else path
    code = BOOT.format(module=module, function=name)
    return [sys.executable, "-P", "-c", code, str(len(path)), *path, *arguments]


@dataclass(frozen=True)
class ExitStatus:
    """The end of a process; as text, the end of a sentence about it.

    Attributes:
      code: its exit code, or minus the number of the signal that killed it.
      cause: why this process ended it: it exceeded its `time` or `memory`, was `idle`, or was `ended` as no longer
        needed; None if it ended by itself or was killed by another process.
    """

    code: int
    cause: Cause | None = None

    @property
    def signal(self) -> str:
        """The name of the signal that killed it; empty if none did."""
        if self.code >= 0:
            return ""
        return next((known.name for known in signal.Signals if known == -self.code), f"signal {-self.code}")

    @property
    def out_of_memory(self) -> bool:
        """True if memory is the likely reason: the system kills processes with SIGKILL when it runs out."""
        return self.cause == "memory" or (self.cause is None and self.signal == "SIGKILL")

    def __str__(self) -> str:
        if self.cause == "time":
            return "did not end in time"
        if self.cause == "memory":
            return "needed too much memory"
        if self.cause == "idle":
            return "did nothing any more"
        return f"was killed by {self.signal}" if self.signal else f"ended with code {self.code}"


class ChildProcess:
    """A child process, which starts at once. It ends with its `with` block, with its last reference, or with Python.

    Args:
      command: the program and its arguments, such as `python_call` gives.
      environment: variables to change; None removes one.
      descriptors: descriptors that the child gets under new numbers, which are appended to the command.
      inherited: descriptors that the child gets under the same numbers.
      fed: the child reads standard input from `feed`.
      stdout, stderr: their destinations, possibly descriptors. Captured output is read continuously, so that the child
        never waits for it.
      stdout_limit: bytes of captured output to keep.
      run_in_fork: function to call instead of the program, in a copy of this process without its other descriptors,
        signal handlers and status; its arguments are the new numbers of `descriptors`, and it must not return. See
        `may_fork`. Its output is read from the first `wait` or `capture`, since reading takes a thread, which no later
        copy could have.

    Raises:
      FileError: the program is not executable.
      OSError: the system refuses to start it.
    """

    def __init__(
        self,
        command: Sequence[str],
        *,
        environment: Mapping[str, str | None] | None = None,
        descriptors: Sequence[int] = (),
        inherited: Sequence[int] = (),
        fed: bool = False,
        stdout: Stream = "discard",
        stderr: Stream = "inherit",
        stdout_limit: float = STDOUT_LIMIT,
        run_in_fork: Callable[..., NoReturn] | None = None,
    ) -> None:
        self._cause: Cause | None = None
        self._output = stdout if isinstance(stdout, int) else None
        variables = {**os.environ, **(environment or {})}
        variables = {name: value for name, value in variables.items() if value is not None}
        with ExitStack() as stack, uninterrupted():  # so that no process is started and lost
            copies: list[int] = []
            for descriptor in descriptors:
                # Above 2, as the child uses 0 to 2; it may be lower if this process has no standard input.
                copies.append(system.duplicate(descriptor))
                stack.callback(os.close, copies[-1])
            try:
                self._popen = subprocess.Popen(
                    [*command, *map(str, copies)],
                    bufsize=0,
                    stdin=subprocess.PIPE if fed else subprocess.DEVNULL,
                    stdout=_target(stdout),
                    stderr=_target(stderr),
                    env=variables,
                    preexec_fn=partial(_continue_in_fork, run_in_fork, variables, copies) if run_in_fork else None,
                    **system.process_options([*copies, *inherited]),
                )
            except PermissionError as error:
                reason = "cannot be started; mjrun requires separate processes"
                raise FileError(command[0], f"{reason}: {error.strerror or error}") from None
            note_child(self._popen.pid)
            self._finalizer = weakref.finalize(self, _kill_and_reap, self._popen, os.getpid())
        if self._popen.stdin:
            system.make_nonblocking(self._popen.stdin.fileno())
        self._stdout = _Capture(self._popen.stdout, stdout_limit, keep="beginning")
        self._stderr = _Capture(self._popen.stderr, STDERR_LIMIT, keep="end")
        if run_in_fork is None:
            self.capture()

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._popen.pid

    @property
    def running(self) -> bool:
        """True until the process has ended."""
        return self._popen.poll() is None

    @property
    def stdout(self) -> bytes:
        """The captured output so far; complete after `wait` or `end`."""
        return bytes(self._stdout.content)

    def take_stdout(self) -> bytes:
        """Returns the output captured since the last call, which is then no longer kept in `stdout`."""
        return self._stdout.take()

    @property
    def stderr(self) -> bytes:
        """The captured standard error so far; complete after `wait` or `end`."""
        return bytes(self._stderr.content)

    @property
    def last_words(self) -> str:
        """The last line of `stderr`, where programs report why they end; possibly empty."""
        return self.stderr.decode(errors="replace").strip().rpartition("\n")[2]

    def capture(self) -> None:
        """Reads captured output from now on; needed only after `run_in_fork`."""
        self._stdout.start()
        self._stderr.start()

    def feed(self, content: memoryview, idle: float = math.inf) -> None:
        """Writes to the standard input of a process that is `fed`.

        Args:
          idle: seconds without reading or computing after which it is killed, unless the reader of its output waits.

        Raises:
          OSError: the process no longer reads.
        """
        assert self._popen.stdin
        if self._popen.stdin.closed:  # as after `wait`
            raise BrokenPipeError
        stdin = self._popen.stdin.fileno()
        left, idleness = content.cast("B"), Idleness(self.pid, idle)
        while left:
            try:
                left = left[os.write(stdin, left) :]
                idleness.end()
            except BlockingIOError:
                if system.wait_until_writable(stdin, IDLE_INTERVAL):
                    continue
                self._end_if_idle(idleness)

    def _end_if_idle(self, idleness: "Idleness") -> None:
        """Kills a process that has been idle for too long, unless it waits for the reader of its standard output."""
        if self._output is not None and system.is_full(self._output):
            idleness.end()
        elif idleness.exceeds(IDLE_INTERVAL):
            self.kill("idle")

    def end_feeding(self) -> None:
        """Closes its standard input."""
        assert self._popen.stdin
        self._popen.stdin.close()

    def wait(self, seconds: float = math.inf, memory: float = math.inf, idle: float = math.inf) -> ExitStatus:
        """Waits until the process has ended, and kills it if it exceeds a limit.

        Args:
          seconds: maximum time from now on.
          memory: maximum resident memory [bytes]; unknown on some systems.
          idle: maximum seconds without computing, as in `feed`.
        """
        deadline = time.monotonic() + seconds
        idleness, before = Idleness(self.pid, idle), time.monotonic()
        try:
            while self.running:
                left = deadline - time.monotonic()
                if left <= 0:
                    self.kill("time")
                elif memory < math.inf and resident_memory(self.pid) > memory:
                    self.kill("memory")
                elif idle < math.inf and time.monotonic() - before > IDLE_INTERVAL:
                    before = time.monotonic()
                    self._end_if_idle(idleness)
                elif all(capture.wait(min(left, POLL_INTERVAL)) for capture in (self._stdout, self._stderr)):
                    with suppress(subprocess.TimeoutExpired):
                        self._popen.wait(min(left, POLL_INTERVAL))
        except BaseException:
            self.kill()
            self._popen.wait()
            raise
        self._collect()
        return ExitStatus(self._popen.returncode, self._cause)

    def kill(self, cause: Cause = "ended") -> None:
        """Kills the process and its descendants if it is still running; callable from any thread."""
        if self.running:
            self._cause = self._cause or cause
            _kill(self._popen)

    def end(self, grace: float = 0) -> ExitStatus:
        """Ends the process: requests termination, and kills it after `grace` [s]."""
        if grace > 0 and self.running:
            self._cause = "ended"
            self._popen.terminate()
            self.wait(grace)
        self.kill()
        return self.wait()

    def __enter__(self) -> "ChildProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def _collect(self) -> None:
        """Waits for the pipes to close, and kills descendants that keep them open."""
        self._finalizer.detach()
        note_end_of_child(self.pid)
        if self._popen.stdin:
            self._popen.stdin.close()
        grace = KILLED_GRACE if self._cause else PIPE_GRACE
        for capture in (self._stdout, self._stderr):
            if not capture.wait(grace):
                system.kill_group(self.pid)
                capture.wait(grace)


def may_fork() -> bool:
    """Returns whether a copy of this process can continue by itself: it has no thread, not even of a library."""
    try:
        return system.CAN_FORK_LATE and len([*Path("/proc/self/task").iterdir()]) == 1
    except OSError:  # not on Linux, or confined
        return False


def _continue_in_fork(
    function: Callable[..., NoReturn], variables: Mapping[str, str], descriptors: Sequence[int]
) -> NoReturn:
    """Calls a function in a process that was just forked, with nothing of its parent but modules."""
    try:
        record_status_in(None)
        for number in system.SIGNALS:
            signal.signal(number, signal.SIG_DFL)
        for descriptor in [int(path.name) for path in Path("/proc/self/fd").iterdir()]:
            if descriptor > 2 and descriptor not in descriptors:
                with suppress(OSError):  # of the folder that was listed
                    os.close(descriptor)
        # The streams of the parent are never closed: their descriptors may be other files of this process by now.
        _streams_of_parent = sys.stdin, sys.stdout, sys.stderr
        sys.stdin, sys.stdout, sys.stderr = (os.fdopen(number, mode) for number, mode in enumerate("rww"))
        os.environ.clear()
        os.environ.update(variables)
        function(*map(str, descriptors))
    except BaseException:
        traceback.print_exc()
    os._exit(1)


def limit_this_process(
    *,
    memory: float | None = None,
    cpu: float | None = None,
    file_size: float | None = None,
    core: float | None = None,
    hard: bool = False,
) -> None:
    """Sets soft limits of this process; `math.inf` lifts them. Some systems support fewer limits.

    Args:
      memory: bytes of address space beyond the current use; exceeding it raises MemoryError.
      cpu: seconds of CPU time; exceeding it raises SIGXCPU.
      file_size: bytes of a written file; exceeding it raises OSError in Python, and SIGXFSZ elsewhere.
      core: bytes of a core dump.
      hard: make the limits permanent for this process and its descendants.
    """
    system.set_limits(memory=memory, cpu=cpu, file_size=file_size, core=core, hard=hard)


class _Capture:
    """A thread that reads a pipe to its end and keeps `limit` bytes; it does nothing without a pipe."""

    def __init__(self, pipe: IO[bytes] | None, limit: float, keep: Literal["beginning", "end"]) -> None:
        self.content = bytearray()
        self._limit, self._keep = limit, keep
        self._pipe, self._thread = pipe, None
        self._lock = threading.Lock()

    def start(self) -> None:
        """Starts the thread, unless it is running or has ended."""
        if self._pipe and self._thread is None:
            self._thread = threading.Thread(target=self._read, args=(self._pipe,), daemon=True)
            self._thread.start()

    def take(self) -> bytes:
        """Returns the content so far, and forgets it."""
        with self._lock:
            content, self.content = bytes(self.content), bytearray()
            return content

    def wait(self, seconds: float) -> bool:
        """Returns whether the pipe closes within `seconds`."""
        self.start()
        if self._thread is None:
            return True
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _read(self, pipe: IO[bytes]) -> None:
        with pipe:
            while chunk := os.read(pipe.fileno(), 2**16):
                with self._lock:
                    if self._keep == "end":
                        self.content = (self.content + chunk)[-int(self._limit) :]
                    elif len(self.content) < self._limit:
                        self.content += chunk[: int(min(self._limit - len(self.content), len(chunk)))]


class Idleness:
    """The time for which a process and its descendants have done nothing.

    Time is counted while waiting, not by a clock, so that a suspension of this process does not count.
    """

    def __init__(self, session: int, limit: float) -> None:
        self._session, self._limit = session, limit
        self._seconds, self._computed = 0.0, -1.0

    def end(self) -> None:
        """Resets the time after activity."""
        self._seconds = 0

    def exceeds(self, seconds: float) -> bool:
        """Adds `seconds`; returns whether the process has been idle for too long."""
        computed = _computing_time(self._session)
        self._seconds = self._seconds + seconds if computed == self._computed else 0
        self._computed = computed
        return self._seconds >= self._limit


def _target(stream: Stream) -> int | IO[bytes] | None:
    if not isinstance(stream, str):
        return stream
    return {"discard": subprocess.DEVNULL, "inherit": None, "capture": subprocess.PIPE}[stream]


def _kill(popen: subprocess.Popen[bytes]) -> None:
    """Kills a process that was not reaped, with its session."""
    system.kill_group(popen.pid)
    popen.kill()


def _kill_and_reap(popen: subprocess.Popen[bytes], parent: int) -> None:
    if os.getpid() == parent and popen.poll() is None:  # not in a fork of the parent
        _kill(popen)
        popen.wait()
        note_end_of_child(popen.pid)


def resident_memory(pid: int) -> int:
    """Returns the resident memory of a process [bytes]; 0 if unknown."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * mmap.PAGESIZE
    except (OSError, ValueError, IndexError):
        return 0


def _computing_time(session: int) -> float:
    """Returns the CPU time of all processes in a session [clock ticks]; 0 if unknown."""
    ticks = 0
    for process in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            fields = process.read_text(errors="replace").rpartition(")")[2].split()
            if int(fields[3]) == session:
                ticks += int(fields[11]) + int(fields[12])  # by itself, and in the system for it
    return ticks


def memory_file() -> int:
    """Returns the descriptor of an empty nameless file, in memory or, if the system does not support that, on disk."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("mjrun")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())
