"""mjrun run many times, quickly: a process that has imported everything forks for each run.

A forked run has its own session, folder, streams, limits and signals, as a command started from a shell has; what a
fork cannot show, imports and the start of the interpreter, takes a command of its own.
"""

import json
import os
import pkgutil
import re
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any

from tests.scoreboard.file_operations import Fault, Watcher, listener, watched

ROOT = Path(__file__).resolve().parents[2]
MIB = 2**20
# C0 and C1 controls but newline, tab and carriage return: what could move a terminal's cursor or change its state.
CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
MJRUN = "mjrun.cli.main:run"
EXIT_CODES = {0, 1, 2, 3, 4, 5, 6, 7, 8}


@dataclass(frozen=True)
class Ended:
    """How a run ended.

    Attributes:
      code: its exit code, or minus the signal that killed it; None if it did not end in time.
      seconds: of wall time.
      operations: on the files of a folder that was watched, in their order, each with the name of its file.
    """

    arguments: tuple[str, ...]
    code: int | None
    stdout: bytes
    stderr: bytes
    seconds: float
    operations: tuple[tuple[str, str], ...] = ()

    @property
    def message(self) -> str:
        """What it said on standard error."""
        return self.stderr.decode("utf-8", "replace")

    @property
    def faults(self) -> list[str]:
        """What no run may show: a traceback, a bug, a signal, a hang, no word about a failure, control bytes."""
        found = []
        if self.code is None:
            found.append(f"did not end in {self.seconds:.1f} s")
        elif self.code < 0:
            found.append(f"killed by {signal.Signals(-self.code).name}")
        elif self.code not in EXIT_CODES:
            found.append(f"exit code {self.code}")
        if self.code and not self.stderr.strip() and not self.stdout.strip():
            found.append("failed without a word")
        if "Traceback (most recent call last)" in self.message:
            found.append("a traceback")
        if CONTROL.search(self.message):
            found.append("control bytes on standard error")
        return found

    def __str__(self) -> str:
        last = next((line for line in reversed(self.message.splitlines()) if line.strip()), "")
        return f"mjrun {' '.join(self.arguments)[:200]}: code {self.code}, {self.seconds:.1f} s: {last[:200]}"


def modules_of_mjrun() -> list[str]:
    """All that a run may import of mjrun, and what that imports in turn; not what OpenGL needs."""
    names = [module.name for module in pkgutil.walk_packages([str(ROOT / "mjrun")], "mjrun.")]
    left_out = ("__main__", "gym", "backend_trial", "worker")
    return ["yaml", "orjson", "PIL.Image", "rich.table", "pyarrow.parquet"] + [
        name for name in names if not any(part in name for part in left_out)
    ]


class CommandServer:
    """Runs command lines in processes forked from one that has imported mjrun, MuJoCo and numpy already.

    Args:
      limit: seconds of wall time that a run may take before it is killed and counts as hanging.
      memory: address space in MiB that a run may have; None for no limit.
      imports: modules to import once, for measures that run the same commands again and again.
      prefix: a command that runs the server, and all that it runs, in its way.
    """

    def __init__(
        self,
        limit: float = 20.0,
        memory: int | None = None,
        imports: Sequence[str] = (),
        prefix: Sequence[str] = (),
    ) -> None:
        self._limit, self._memory = limit, memory
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "120", "NO_COLOR": "1"}
        self._process = subprocess.Popen(
            [*prefix, sys.executable, "-m", "tests.scoreboard.command", *imports],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> "CommandServer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
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
          limit: seconds, in place of the server's.
          call: the function that gets the arguments as a list and returns the exit code, `module:name`: mjrun, or what
            it is compared with.
          fault: of the file system, with `number` 0 only to list what is done to its folder.
          kill_after: seconds after which the process gets SIGKILL.
          file_size: bytes that a file may have, as `ulimit -f` sets.
          redirected: a file in place of a standard stream, by its number; an empty name closes it.

        Raises:
          OSError: the kernel cannot watch, as a fault needs it.
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
            for name in ("stdout", "stderr"):  # it may be killed before it opens them
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


def serve() -> None:
    """Answers requests, one line of JSON each, until standard input ends."""
    import mujoco  # noqa: F401
    import numpy as np  # noqa: F401

    import mjrun.cli.main  # noqa: F401

    for name in sys.argv[1:]:
        import_module(name)
    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        request = json.loads(line)
        answers.write(json.dumps(_run(request)) + "\n")
        answers.flush()


def _run(request: dict[str, Any]) -> dict[str, object]:
    """Runs mjrun as a request says; returns the answer."""
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
    """Its exit code; None if it did not end in time. What it has left running in its session is killed."""
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
    """Turns this process into a run of mjrun; does not return."""
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
        # What is killed, or fails, at a moment of our choice has nobody else between itself and us.
        alone = request["fault"] or request["kill_after"] is not None or request["call"] != MJRUN
        code = call(arguments) if alone else crash_monitor.watched(lambda: call(arguments))
    except SystemExit as ending:
        code = ending.code if isinstance(ending.code, int) else 1
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    serve()
