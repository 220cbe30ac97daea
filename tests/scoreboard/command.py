"""mjrun run many times, quickly: a process that has imported everything forks for each run.

A forked run has a session, folder, streams, limits and signals like a command started from a shell. Imports and the
start of the interpreter, which a fork does not show, are tried by `RealCommand`.
"""

import atexit
import ctypes
import gc
import json
import os
import pkgutil
import re
import resource
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any

from mjrun.confinement import landlock, seccomp
from tests.scoreboard.file_operations import Fault, Watcher, listener, watched

ROOT = Path(__file__).resolve().parents[2]
MIB = 2**20
VARIABLES = {"PYTHONPATH": str(ROOT), "COLUMNS": "120", "NO_COLOR": "1"}
# C0 and C1 controls except newline, tab and carriage return: they could move a terminal's cursor or change its state.
CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
MJRUN = "mjrun.cli.main:run"
EXIT_CODES = {0, 1, 2, 3, 4, 5, 6, 7, 8}
# Modules that the quick parts import again and again.
QUICK_IMPORTS = (
    *("yaml", "orjson", "mjrun.cli.commands.info", "mjrun.cli.commands.trace", "mjrun.cli.commands.run"),
    *("mjrun.outputs.perform", "mjrun.outputs.trace", "mjrun.formats.tables.csv", "mjrun.document.run"),
)


IDLE: dict[
    tuple[str, ...], list["subprocess.Popen[str]"]
] = {}  # processes of servers that have ended, by what they import


@dataclass(frozen=True)
class Ended:
    """The result of a run.

    Attributes:
      arguments: the command line after `mjrun`.
      code: its exit code, or minus the signal that killed it; None if it did not end in time.
      stdout, stderr: the bytes it printed.
      seconds: wall time.
      operations: on the files of a watched folder, in their order, each with the name of its file.
    """

    arguments: tuple[str, ...]
    code: int | None
    stdout: bytes
    stderr: bytes
    seconds: float
    operations: tuple[tuple[str, str], ...] = ()

    @property
    def message(self) -> str:
        """The text on standard error."""
        return self.stderr.decode("utf-8", "replace")

    @property
    def output(self) -> str:
        """The text on both streams."""
        return self.message + self.stdout.decode("utf-8", "replace")

    @property
    def faults(self) -> list[str]:
        """Faults that no run may have: a traceback, a bug, a signal, a hang, a silent failure, control bytes."""
        faults = []
        if self.code is None:
            faults.append(f"did not end in {self.seconds:.1f} s")
        elif self.code < 0:
            faults.append(f"killed by {signal.Signals(-self.code).name}")
        elif self.code not in EXIT_CODES:
            faults.append(f"exit code {self.code}")
        if self.code and not self.stderr.strip() and not self.stdout.strip():
            faults.append("failed without a word")
        if "Traceback (most recent call last)" in self.message:
            faults.append("a traceback")
        if CONTROL.search(self.message):
            faults.append("control bytes on standard error")
        return faults

    def faults_unless(self, codes: Collection[int]) -> list[str]:
        """Returns the faults, with one more if the exit code is none of these."""
        if self.code in codes:
            return self.faults
        return [*self.faults, f"exit code {self.code}, not {' or '.join(map(str, sorted(codes)))}"]

    def __str__(self) -> str:
        last = next((line for line in reversed(self.message.splitlines()) if line.strip()), "")
        return f"mjrun {' '.join(self.arguments)[:200]}: code {self.code}, {self.seconds:.1f} s: {last[:200]}"


def contents(folder: Path) -> dict[str, bytes]:
    """Returns all files below a folder, hidden ones too, by their path in it."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def modules_of_mjrun() -> list[str]:
    """Returns all modules of mjrun and of libraries that a run may import, except those that need OpenGL."""
    names = [module.name for module in pkgutil.walk_packages([str(ROOT / "mjrun")], "mjrun.")]
    left_out = ("__main__", "gym", "backend_trial", "worker")
    return ["yaml", "orjson", "PIL.Image", "rich.table", "pyarrow.parquet"] + [
        name for name in names if not any(part in name for part in left_out)
    ]


class CommandServer:
    """Runs command lines in processes forked from one that has already imported mjrun, MuJoCo and numpy.

    The process that is forked goes on to the next server with the same imports.

    Args:
      limit: seconds of wall time after which a run is killed and counts as hanging.
      memory: address space of a run in MiB; None for no limit.
      imports: modules to import once, for measures that run the same commands again and again.
      without_landlock: runs everything as on a kernel without Landlock.
    """

    def __init__(
        self,
        limit: float = 20.0,
        memory: int | None = None,
        imports: Sequence[str] = (),
        *,
        without_landlock: bool = False,
    ) -> None:
        self._limit, self._memory = limit, memory
        setting = ["--without-landlock"] * without_landlock
        self._idle = IDLE.setdefault((*setting, *imports), [])
        self._process = (
            self._idle.pop()
            if self._idle
            else subprocess.Popen(
                [sys.executable, "-m", "tests.scoreboard.command", *setting, *imports],
                cwd=ROOT,
                env={**os.environ, **VARIABLES},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        )

    def __enter__(self) -> "CommandServer":
        return self

    def __exit__(self, exception: object, *_: object) -> None:
        if exception is None:
            self._idle.append(self._process)
        else:
            self._process.communicate(timeout=60)

    def run(
        self,
        *arguments: str | Path,
        folder: Path,
        environment: Mapping[str, str] | None = None,
        limit: float | None = None,
        call: str = MJRUN,
        fault: Fault | None = None,
        kill_after: float | None = None,
        file_size: int | None = None,
        redirected: Mapping[int, str] | None = None,
    ) -> Ended:
        """Runs one command line in a folder.

        Args:
          arguments: after `mjrun`.
          folder: the working directory.
          environment: variables to set.
          limit: seconds, instead of the server's limit.
          call: `module:name` of the function that gets the arguments as a list and returns the exit code.
          fault: a fault of the file system; `number` 0 only lists the operations on its folder.
          kill_after: seconds after which the process gets SIGKILL.
          file_size: largest size of a file in bytes, as `ulimit -f` sets it.
          redirected: a file instead of a standard stream, by its number; an empty name closes the stream.

        Raises:
          OSError: the kernel cannot watch a process, which faults require.
        """
        line = tuple(map(str, arguments))
        with tempfile.TemporaryDirectory() as streams:
            request = {
                "arguments": line,
                "folder": str(folder),
                "streams": streams,
                "environment": dict(environment or {}),
                "limit": self._limit if limit is None else limit,
                "memory": self._memory,
                "call": call,
                "fault": fault and asdict(fault),
                "kill_after": kill_after,
                "file_size": file_size,
                "files": {str(number): path for number, path in (redirected or {}).items()},
            }
            for name in ("stdout", "stderr"):  # the run may be killed before it opens them
                Path(streams, name).touch()
            assert self._process.stdin
            assert self._process.stdout
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            answer = json.loads(self._process.stdout.readline())
            out, err = (Path(streams, name).read_bytes() for name in ("stdout", "stderr"))
        if answer["unwatched"]:
            raise OSError("this kernel does not let a process be watched")
        operations = tuple((operation, path) for operation, path in answer["operations"])
        return Ended(line, answer["code"], out, err, answer["seconds"], operations)


@atexit.register
def _end_idle() -> None:
    for process in chain.from_iterable(IDLE.values()):
        process.communicate(timeout=60)


def serve() -> None:
    """Answers requests, one line of JSON each, until standard input ends."""
    names = sys.argv[1:]
    if "--without-landlock" in names:
        names.remove("--without-landlock")
        _refuse_landlock()
    import mujoco  # noqa: F401
    import numpy as np  # noqa: F401

    import mjrun.cli.main  # noqa: F401

    for name in names:
        import_module(name)
    gc.freeze()  # no run looks through what it shares with this process, which would copy all of it
    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        request = json.loads(line)
        answers.write(json.dumps(_run(request)) + "\n")
        answers.flush()


def _refuse_landlock() -> None:
    """Makes the kernel answer this process and its children as one without Landlock does."""
    steps = [
        (seccomp.LOAD, 0, 0, seccomp.NUMBER),
        (seccomp.JUMP_IF_EQUAL, 0, 1, landlock.CREATE_RULESET),
        (seccomp.RETURN, 0, 0, seccomp.UNKNOWN),
        (seccomp.RETURN, 0, 0, seccomp.ALLOW),
    ]
    program = seccomp.BpfProgram(len(steps), b"".join(struct.pack("HBBI", *step) for step in steps))
    library = ctypes.CDLL(None, use_errno=True)
    library.prctl(landlock.NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    if library.prctl(seccomp.SET_SECCOMP, seccomp.FILTER, ctypes.byref(program), 0, 0):
        raise OSError(ctypes.get_errno(), "seccomp")


def _run(request: dict[str, Any]) -> dict[str, object]:
    """Runs mjrun as requested, and returns the answer."""
    began = time.monotonic()
    watching, watched_by = socket.socketpair() if request["fault"] else (None, None)
    child = os.fork()
    if not child:
        _become(request, watched_by)

    watcher = None
    if watching and watched_by:
        watched_by.close()
        descriptor = listener(watching)
        watching.close()
        if descriptor is not None:
            watcher = Watcher(descriptor, child, Fault(**request["fault"]))
    code = _wait(child, request["limit"], request["kill_after"], watcher)
    if watcher:
        os.close(watcher.listener)
    return {
        "code": code,
        "seconds": time.monotonic() - began,
        "operations": watcher.operations if watcher else [],
        "unwatched": bool(watching) and watcher is None,
    }


def _wait(child: int, limit: float, kill_after: float | None, watcher: Watcher | None) -> int | None:
    """Returns the exit code, None if it did not end in time. Kills the processes left in its session."""
    began = time.monotonic()
    pause = 0.002
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            code: int | None = os.waitstatus_to_exitcode(status)
            break
        passed = time.monotonic() - began
        if kill_after is not None and passed > kill_after:
            os.kill(child, signal.SIGKILL)
        if passed > limit:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            code = None
            break
        if watcher:
            watcher.answer(pause)
        else:
            time.sleep(pause)
        pause = min(2 * pause, 0.005 if kill_after or watcher else 0.05)
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    return code


def _become(request: dict[str, Any], watched_by: socket.socket | None) -> None:
    """Turns this process into a run of mjrun, and does not return."""
    code = 255
    try:
        os.setsid()
        os.chdir(str(request["folder"]))
        os.environ.update(request["environment"])
        for number, name, flags in (
            (0, "/dev/null", os.O_RDONLY),
            (1, f"{request['streams']}/stdout", os.O_WRONLY | os.O_CREAT),
            (2, f"{request['streams']}/stderr", os.O_WRONLY | os.O_CREAT),
        ):
            os.dup2(os.open(name, flags, 0o600), number)
        for name, path in request["files"].items():
            os.close(int(name))
            if path:
                os.dup2(os.open(path, os.O_RDWR), int(name))
        number = watched_by.fileno() if watched_by else 3
        os.closerange(3, number)
        os.closerange(number + 1, 256)
        if request["file_size"] is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (request["file_size"],) * 2)
        if request["memory"]:
            limit = int(request["memory"]) * MIB
            resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        from mjrun.cli import crash_monitor
        from mjrun.cli.standard_streams import open_standard_streams

        module, _, name = str(request["call"]).partition(":")
        call = getattr(import_module(module), name)
        open_standard_streams()
        if watched_by:
            watched(watched_by)
        arguments = list(request["arguments"])
        # A run that is killed, or fails, at a chosen moment has no process that watches it.
        alone = request["fault"] or request["kill_after"] is not None or request["call"] != MJRUN
        if not alone:
            crash_monitor.continue_in_monitored_child()
        code = call(arguments)
    except SystemExit as ending:
        code = ending.code if isinstance(ending.code, int) else 1
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        threading._shutdown()  # type: ignore[attr-defined]  # as at the end of an interpreter: it waits for threads
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    serve()
