"""A process that monitors the working process and reports its death: MuJoCo crashes on some models.

The system kills a process that crashes or exhausts memory before it can report anything. So the command forks at the
start, which takes a millisecond: the child works and records its activity in shared memory; the parent waits. The
caller sees only the parent, which forwards its signals, and kills the child if it does not respond.

A child that confines itself may come under an attacker's control, so it first promises which resources it will use.
From then on, the parent ignores further records and removes or kills only: the temporary folder of the promise,
unfinished files in the output folders, empty folders created in them or before, and its own descendants.
"""

import fcntl
import math
import os
import shlex
import signal
import sys
import time
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.platform.posix import PROMISE, SIGNALS, remove_folder
from mjrun.shared_status import ConfinementPromise, ProcessActivityMemory, ProcessStatus, record_status_in

if TYPE_CHECKING:
    from mjrun.errors import FailureReport

HANDLED = (signal.SIGCHLD, signal.SIGALRM, PROMISE)  # handled by the parent; `SIGNALS` are forwarded
GRACE = 0.5  # [s] for the child to respond to a signal before it is killed
LIMIT = 0.9  # [s] for it to end afterwards, unless it is completing an output
STARVED = 10.0  # [s] added to both, at most, while the child waits for a core of a busy machine
SHARE = 0.2  # [s] of CPU time after which it is not waiting for a core
COMPLETION = 30.0  # [s] for a confined process to complete an output
LINGER = 0.3  # [s] for a killed process to end
SUBREAPER = 36  # of prctl
PURSUIT = 10.0  # [s] after which processes that fork faster than they are killed are left alone
BUG, EXCEEDED = 70, 4
EXIT_CODES = {"reading": 3, "compiling": 3, "simulating": 4, "drawing": 5}

CRASHES: dict[int, str] = {
    signal.SIGSEGV: "it used memory that is not its own, as it does when something is nested too deeply",
    signal.SIGBUS: "it used memory that is not there",
    signal.SIGABRT: "it gave up",
    signal.SIGFPE: "it divided by zero",
    signal.SIGILL: "it came to an instruction that this processor does not have",
}
LIMITS: dict[int, tuple[str, str]] = {
    signal.SIGALRM: ("time", "it took longer than"),
    signal.SIGXCPU: ("time", "it computed for longer than"),
    signal.SIGXFSZ: ("file", "it wrote a larger file than"),
}
CHECK = "`mjrun check {model}` says what else is wrong with it"
ADVICE = {
    "reading": f"the file is damaged, or nests or attaches too much; {CHECK}",
    "compiling": f"a number in it is too large, or something in it is nested too deeply; {CHECK}",
    "simulating": f"a number in it is too large, or the file is damaged; {CHECK}",
    "drawing": "look for large numbers in its <visual>; another --gl or --renderer may draw it, "
    "and `mjrun doctor` shows which there are",
    "": "please report it; --debug shows where it was",
}

SHOW_CURSOR = "\r\x1b[K\x1b[?25h"  # and clears the line, as a progress bar does at its end


def continue_in_monitored_child() -> None:
    """Continues in a child process; the parent waits for its end, reports a crash, and exits with the same code.

    Signals of `SIGNALS` are blocked in the child until `system.release_signals` is called, unless they are ignored.
    """
    passed_on = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    memory, (theirs, ours) = ProcessActivityMemory(), os.pipe()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [*passed_on, *HANDLED])
    try:
        child = os.fork()
    except OSError:  # no more processes are allowed
        signal.pthread_sigmask(signal.SIG_SETMASK, [*before, *passed_on])
        return
    if child:
        os.close(theirs)
        os._exit(_Monitor(child, memory, passed_on).exit_code())

    os.close(ours)
    _end_with_parent(theirs)
    signal.pthread_sigmask(signal.SIG_SETMASK, [*before, *passed_on])
    record_status_in(memory)


def _end_with_parent(pipe: int) -> None:
    """Makes the system kill this process when the other end of the pipe is closed, if it can."""
    if sys.platform == "linux":
        fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)


class _Monitor:
    """A monitor that waits for a child process, passes signals on to it, and clears away what it leaves."""

    def __init__(self, child: int, memory: ProcessActivityMemory, passed_on: list[signal.Signals]) -> None:
        self._child, self._memory, self._passed_on = child, memory, passed_on
        self._promise: ConfinementPromise | None = None
        self._temporary: os.stat_result | None = None  # the folder of the promise
        self._made = list[str]()  # folders of outputs that were made before it
        self._ending: signal.Signals | None = None  # the first signal that was passed on
        self._patience = math.inf  # until when what it completes is waited for
        self._ended_at = 0.0, 0.0  # when that was, and how long the child had computed by then [s]
        self._is_late = False  # the child has heard it, and has not ended by itself
        self._has_expired = False  # the child has taken longer than it promised

    def exit_code(self) -> int:
        """Returns the exit code of the child once it has ended; reports an abnormal end."""
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # if it is ignored, no signal arrives
        while True:
            ended, wait_status = os.waitpid(self._child, os.WNOHANG)
            if ended:
                break
            self._handle_signal(signal.sigwait([*self._passed_on, *HANDLED]))

        code = os.waitstatus_to_exitcode(wait_status)
        if self._promise:
            kill_descendants()
        elif code >= 0 and self._ending is None and not self._memory.has_made_folders:
            return code  # without the import of json, which reads the status
        status = self._read_status()
        if code < 0 or (self._ending is not None and _has_left_something(status)):
            _clear_away(status)
        if self._promise:
            self._remove_temporary(self._promise)
        for folder in sorted(status.made, reverse=True):  # the innermost first
            with suppress(OSError):  # outputs were published in it
                Path(folder).rmdir()
        if code >= 0:
            return code
        failure = self._explain(code, status)
        _report(failure, is_answered=self._memory.answered)
        return failure.exit_code

    def _handle_signal(self, number: int) -> None:
        if number in self._passed_on:
            if self._ending is None:
                self._ending = signal.Signals(number)
                self._ended_at = time.monotonic(), _computed(self._child)
                signal.setitimer(signal.ITIMER_REAL, GRACE)
                if self._promise:
                    self._patience = time.monotonic() + COMPLETION
            os.kill(self._child, number)
        elif number == PROMISE:
            self._record_promise()
        elif number != signal.SIGALRM:
            return
        elif self._ending is None:
            self._has_expired = True
            os.kill(self._child, signal.SIGKILL)
        elif self._is_starved:
            signal.setitimer(signal.ITIMER_REAL, GRACE)
        elif not self._memory.heard or (self._is_late and not self._is_completing):
            for pid in self._read_status().children:
                _kill(pid)
            os.kill(self._child, signal.SIGKILL)
        else:
            self._is_late = True
            signal.setitimer(signal.ITIMER_REAL, LIMIT - GRACE)

    @property
    def _is_completing(self) -> bool:
        return self._memory.completing and time.monotonic() < self._patience

    @property
    def _is_starved(self) -> bool:
        """Returns whether the child could not respond to the signal yet because other processes occupy the cores."""
        since, computed = self._ended_at
        is_early = time.monotonic() < since + STARVED
        return is_early and _is_runnable(self._child) and _computed(self._child) < computed + SHARE

    def _record_promise(self) -> None:
        """Records the promise of the child, once."""
        status = self._memory.read()
        promise = status.promise
        if self._promise or promise is None:
            return
        self._promise, self._temporary, self._made = promise, os.lstat(promise.temporary), status.made
        adopt_descendants()
        if promise.seconds < math.inf and self._ending is None:
            signal.setitimer(signal.ITIMER_REAL, promise.seconds)
        self._memory.believed = True

    def _read_status(self) -> ProcessStatus:
        """Returns the status in shared memory, as far as trusted."""
        status = self._memory.read()
        if self._promise:
            written = {Path(folder) for folder in self._promise.written}
            status.folders = [str(place) for place in _inside(written, status.folders)]
            made = [str(place) for place in _inside(written, status.made) if place not in written]
            status.made = [*self._made, *made]
            status.children = []
        return status

    def _remove_temporary(self, promise: ConfinementPromise) -> None:
        """Removes the temporary folder, if it is still the one that was created."""
        with suppress(OSError):
            if self._temporary and os.path.samestat(self._temporary, os.lstat(promise.temporary)):
                remove_folder(Path(promise.temporary))

    def _explain(self, code: int, status: ProcessStatus) -> "FailureReport":
        """Explains why a child with this exit code was killed."""
        from mjrun.errors import FailureReport

        if self._ending == signal.SIGINT:
            return FailureReport("KeyboardInterrupt", "interrupted", 128 + signal.SIGINT)
        if self._ending is not None:
            return FailureReport("TerminatedError", f"ended by {self._ending.name}", 128 + self._ending)
        return _explain_death(signal.SIGALRM if self._has_expired else -code, status, limited=self._promise is not None)


def _status_fields(pid: int) -> list[str]:
    """Returns the fields of `/proc/PID/stat` from the state on; none where this system has no such file."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []


def _is_runnable(pid: int) -> bool:
    """Returns whether a process has a core or waits for one."""
    return _status_fields(pid)[:1] == ["R"]


def _computed(pid: int) -> float:
    """Returns how long a process has computed [s]."""
    fields = _status_fields(pid)
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK") if fields else math.inf


def _inside(folders: Collection[Path], paths: Sequence[str]) -> set[Path]:
    """Resolves `paths`, without those outside of `folders`."""
    places = {Path(os.path.realpath(path)) for path in paths}
    return {place for place in places if any(place.is_relative_to(folder) for folder in folders)}


def _explain_death(killer: int, status: ProcessStatus, *, limited: bool) -> "FailureReport":
    """Explains why a process was killed, other than by a requested end.

    Args:
      limited: the process had limits set by mjrun.
    """
    from mjrun.child_process import ExitStatus
    from mjrun.errors import LESS_MEMORY, FailureReport, OutOfMemoryError, clean, flag, option, spelled

    name = ExitStatus(-killer).signal
    during = f" while {status.activity} {clean(status.model)}" if status.activity else ""
    if killer == signal.SIGKILL:
        likely = f"the system does that when memory runs out; if so, {LESS_MEMORY}"
        return FailureReport("Killed", f"killed{during} ({name})\n{likely}", OutOfMemoryError.exit_code)
    if killer in LIMITS and limited:
        limit, reason = LIMITS[killer]
        message = f"ended{during}: {reason} its limit allows ({name})\n{option('limit')} {limit}=… allows more"
        return FailureReport("LimitExceeded", spelled(message, flag), EXIT_CODES.get(status.activity, EXCEEDED))
    if killer not in CRASHES:
        return FailureReport("TerminatedError", f"ended by {name}{during}", 128 + killer)

    who = "MuJoCo" if status.activity else "mjrun, or a library that it uses,"
    advice = ADVICE[status.activity].format(model=clean(shlex.quote(status.model)))
    message = f"{who} crashed{during}: {CRASHES[killer]} ({name})\n{advice}"
    return FailureReport("Crash", message, EXIT_CODES.get(status.activity, BUG))


def _has_left_something(status: ProcessStatus) -> bool:
    """Returns whether a process that ended by itself could not clean up completely."""
    from mjrun.formats.temporary_output import NAME

    with suppress(OSError):
        return bool(status.children) or any(
            NAME.fullmatch(path.name) for folder in status.folders for path in Path(folder).iterdir()
        )
    return False


def _clear_away(status: ProcessStatus) -> None:
    """Kills the children of a dead process, and removes its unfinished outputs."""
    from mjrun.formats.output_writer import remove_left_behind
    from mjrun.formats.temporary_output import NAME

    for pid in status.children:
        _kill(pid)
    for folder in map(Path, status.folders):
        deadline = time.monotonic() + LINGER
        with suppress(OSError):
            remove_left_behind(folder)
            while any(NAME.fullmatch(path.name) for path in folder.iterdir()) and time.monotonic() < deadline:
                time.sleep(0.02)  # another user's lock, or that of a process that was starting
                remove_left_behind(folder)


def _kill(pid: int) -> None:
    """Kills a process with its process group."""
    for kill in (os.killpg, os.kill):
        with suppress(ProcessLookupError, PermissionError):
            kill(pid, signal.SIGKILL)


def _report(failure: "FailureReport", *, is_answered: bool) -> None:
    from mjrun.cli.console import Console, document_form
    from mjrun.errors import EndRequestedError

    if sys.stderr.isatty():
        sys.stderr.write(SHOW_CURSOR)
    console = Console(document_form="" if is_answered else document_form(sys.argv[1:]))
    console.error(failure.message)
    console.report_failure(failure)
    with suppress(Exception, EndRequestedError):  # the reader is gone
        console.finish()


def adopt_descendants() -> bool:
    """Makes this process the parent of all descendants whose own parents end; returns whether that is supported."""
    import ctypes  # not before the command forks

    return sys.platform == "linux" and ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0) == 0


def kill_descendants() -> None:
    """Kills the children of this process, and the orphans that become its children."""
    deadline = time.monotonic() + PURSUIT
    while time.monotonic() < deadline:
        for pid in _children():
            with suppress(ProcessLookupError):  # it may belong to another user, or have been reaped
                os.kill(pid, signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:  # none are left
            return
        os.sched_yield()


def _children() -> list[int]:
    own = os.getpid()
    with suppress(OSError):
        return [int(pid) for pid in Path(f"/proc/{own}/task/{own}/children").read_text().split()]
    parents: dict[int, int] = {}  # of all processes, for kernels that do not list children
    for process in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            parents[int(process.parent.name)] = int(process.read_text(errors="replace").rpartition(")")[2].split()[1])
    return [pid for pid, parent in parents.items() if parent == own]
