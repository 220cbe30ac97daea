"""Child processes: how they are started, limited, listened to and ended.

A child has no standard input, inherits no descriptors but those named, and has a session of its own: the terminal's
signals, such as Ctrl-C's, are its parent's business, and killing it kills what it has started.
"""

import fcntl
import math
import os
import resource
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Literal

from mjrun.errors import FileError

STDOUT_LIMIT = 2**24  # bytes of captured output that are kept, from its beginning
STDERR_LIMIT = 2**16  # bytes of captured messages that are kept, from their end: the last line says why
POLL_INTERVAL = 0.05  # [s]
PIPE_GRACE = 1.0  # [s] for a pipe to end after its process
STATUS = Path("/proc/self/statm")
BOOT = (
    "import sys; end = 2 + int(sys.argv[1]); sys.path[:] = sys.argv[2:end]; "
    "from {module} import {function}; {function}(*sys.argv[end:])"
)

Cause = Literal["time", "memory", "ended"]
Stream = Literal["discard", "inherit", "capture"] | IO[bytes]


def python_call(function: str, *arguments: str, path: Sequence[str] | None = None) -> list[str]:
    """The command that calls a function in a new Python interpreter, which never imports `__main__`.

    Args:
      function: `package.module:name`.
      arguments: of the function, all strings.
      path: where it looks for modules; where this process does, when None.
    """
    module, _, name = function.partition(":")
    path = sys.path if path is None else path
    code = BOOT.format(module=module, function=name)
    return [sys.executable, "-P", "-c", code, str(len(path)), *path, *arguments]


@dataclass(frozen=True)
class ExitStatus:
    """How a process ended; as text, the end of a sentence about it.

    Attributes:
      code: its exit code, or minus the number of the signal that killed it.
      cause: why this process ended it: it exceeded its `time` or `memory`, or was `ended` as no longer needed;
        None if it ended by itself or was killed by somebody else.
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
        """Whether memory is the likely reason: when it runs out, the system kills processes with SIGKILL."""
        return self.cause == "memory" or (self.cause is None and self.code == -signal.SIGKILL)

    def __str__(self) -> str:
        if self.cause == "time":
            return "did not end in time"
        if self.cause == "memory":
            return "needed too much memory"
        return f"was killed by {self.signal}" if self.signal else f"ended with code {self.code}"


class ChildProcess:
    """A child process, which starts at once. Leaving its `with` block ends it, as does losing it or leaving Python.

    Args:
      command: the program and its arguments, such as `python_call` gives.
      environment: variables to change; None removes one.
      descriptors: that the child gets under new numbers, which are appended to the command.
      stdout, stderr: where they go. What is captured is read as it comes, so that a child never waits for it.

    Raises:
      FileError: the program may not be executed.
      OSError: the system refuses.
    """

    def __init__(
        self,
        command: Sequence[str],
        *,
        environment: Mapping[str, str | None] | None = None,
        descriptors: Sequence[int] = (),
        stdout: Stream = "discard",
        stderr: Stream = "inherit",
    ) -> None:
        self._cause: Cause | None = None
        variables = {**os.environ, **(environment or {})}
        with ExitStack() as stack:
            inherited: list[int] = []
            for descriptor in descriptors:
                # Above 2, which it may be when this process has no standard input: the child's 0 to 2 are taken.
                inherited.append(fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3))
                stack.callback(os.close, inherited[-1])
            try:
                self._popen = subprocess.Popen(
                    [*command, *map(str, inherited)],
                    stdin=subprocess.DEVNULL,
                    stdout=_target(stdout),
                    stderr=_target(stderr),
                    env={name: value for name, value in variables.items() if value is not None},
                    pass_fds=inherited,
                    start_new_session=True,
                )
            except PermissionError as error:
                reason = "cannot be started, which mjrun needs processes of its own for"
                raise FileError(command[0], f"{reason}: {error.strerror or error}") from None
        self._finalizer = weakref.finalize(self, _kill_and_reap, self._popen, os.getpid())
        self._stdout = _Capture(self._popen.stdout, STDOUT_LIMIT, keep="beginning")
        self._stderr = _Capture(self._popen.stderr, STDERR_LIMIT, keep="end")

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._popen.pid

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._popen.poll() is None

    @property
    def stdout(self) -> bytes:
        """What it has printed, if captured; complete after `wait` or `end`."""
        return bytes(self._stdout.content)

    @property
    def stderr(self) -> bytes:
        """What it has printed on standard error, if captured; complete after `wait` or `end`."""
        return bytes(self._stderr.content)

    @property
    def last_words(self) -> str:
        """The last line of `stderr`, where programs say why they end; empty if there is none."""
        return self.stderr.decode(errors="replace").strip().rpartition("\n")[2]

    def wait(self, seconds: float = math.inf, memory: float = math.inf) -> ExitStatus:
        """Waits until the process has ended, and kills it when it exceeds a limit.

        Args:
          seconds: from now on.
          memory: bytes that it fills (its resident set); not known on every system.
        """
        deadline = time.monotonic() + seconds
        try:
            while self.running:
                left = deadline - time.monotonic()
                if left <= 0:
                    self.kill("time")
                elif memory < math.inf and _resident(self.pid) > memory:
                    self.kill("memory")
                elif self._stdout.wait(min(left, POLL_INTERVAL)):
                    with suppress(subprocess.TimeoutExpired):
                        self._popen.wait(min(left, POLL_INTERVAL))
        except BaseException:
            self.kill()
            self._popen.wait()
            raise
        self._collect()
        return ExitStatus(self._popen.returncode, self._cause)

    def kill(self, cause: Cause = "ended") -> None:
        """Kills the process and what it has started, if it has not ended; from any thread."""
        if self.running:
            self._cause = self._cause or cause
            _kill(self._popen)

    def end(self, grace: float = 0) -> ExitStatus:
        """Ends the process: asks it to terminate, and kills it when it has not done so after `grace` [s]."""
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
        """Waits for the ends of the pipes. What the process has left behind may hold them, and is killed."""
        self._finalizer.detach()
        for capture in (self._stdout, self._stderr):
            if not capture.wait(PIPE_GRACE):
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(self.pid, signal.SIGKILL)
                capture.wait(PIPE_GRACE)


def limit_this_process(
    *, memory: float | None = None, cpu: float | None = None, file_size: float | None = None, core: float | None = None
) -> None:
    """Sets soft limits of the process that calls it, which it can lift by `math.inf`. A system may know fewer.

    Args:
      memory: bytes of addresses beyond those in use now; MemoryError tells of the limit.
      cpu: seconds of computing; SIGXCPU tells of the limit.
      file_size: bytes of a file that it writes; an OSError tells of the limit in Python, elsewhere SIGXFSZ.
      core: bytes of the memory image of a crash.
    """
    if memory is not None:
        pages = int(STATUS.read_text().split()[0]) if STATUS.exists() else 0
        memory += pages * resource.getpagesize()
    kinds = (resource.RLIMIT_AS, resource.RLIMIT_CPU, resource.RLIMIT_FSIZE, resource.RLIMIT_CORE)
    for kind, most in zip(kinds, (memory, cpu, file_size, core), strict=True):
        if most is None:
            continue
        with suppress(OSError, ValueError):
            hard = resource.getrlimit(kind)[1]
            soft = hard if most == math.inf else most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (int(soft), hard))


class _Capture:
    """Reads a pipe to its end in a thread, and keeps `limit` bytes of it; nothing without a pipe."""

    def __init__(self, pipe: IO[bytes] | None, limit: int, keep: Literal["beginning", "end"]) -> None:
        self.content = bytearray()
        self._limit, self._keep = limit, keep
        self._thread = threading.Thread(target=self._read, args=(pipe,), daemon=True) if pipe else None
        if self._thread:
            self._thread.start()

    def wait(self, seconds: float) -> bool:
        """Whether the pipe has ended, after `seconds` at most."""
        if self._thread is None:
            return True
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _read(self, pipe: IO[bytes]) -> None:
        with pipe:
            while chunk := os.read(pipe.fileno(), 2**16):
                if self._keep == "end":
                    self.content = (self.content + chunk)[-self._limit :]
                else:
                    self.content += chunk[: self._limit - len(self.content)]


def _target(stream: Stream) -> int | IO[bytes] | None:
    if not isinstance(stream, str):
        return stream
    return {"discard": subprocess.DEVNULL, "inherit": None, "capture": subprocess.PIPE}[stream]


def _kill(popen: subprocess.Popen[bytes]) -> None:
    """Kills a process that was not reaped, and its session with it."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(popen.pid, signal.SIGKILL)
    popen.kill()


def _kill_and_reap(popen: subprocess.Popen[bytes], parent: int) -> None:
    if os.getpid() == parent and popen.poll() is None:  # not in a fork of the parent
        _kill(popen)
        popen.wait()


def _resident(pid: int) -> int:
    """The memory that a process fills [bytes]; 0 where that is not known."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize()
    except (OSError, ValueError, IndexError):
        return 0
