"""Commands and worker processes as copies of interpreters that have already imported what such a process begins with.

Importing numpy and mujoco takes most of the time of a process in tests, which start hundreds. A copy runs the same code
with the same arguments, variables, folder and descriptors as a new interpreter would, and is a child of this process
too.
"""

import atexit
import contextlib
import ctypes
import fcntl
import functools
import gc
import inspect
import json
import os
import select
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, cast

from mjrun.child_process import python_call

# What each kind of process imports before it does anything: commands, and workers by their function or server.
COMMAND = "mjrun"
MODULES = {
    COMMAND: ("mjrun.cli.main", "mjrun.outputs.trace", "mjrun.outputs.video", "mjrun.rendering.compositor", "mujoco"),
    "mjrun.check.worker:CheckServer": ("mjrun.check.worker",),
    "mjrun.rendering.filament_worker:FilamentServer": ("mjrun.rendering.filament_worker",),
    "mjrun.rendering.compositor_pool:CompositorServer": ("mjrun.rendering.compositor_pool", "mujoco"),
    "mjrun.study.point_files:PointFileServer": ("mjrun.study.point_files", "mujoco"),
    "mjrun.study.point_server:PointSimulationServer": ("mjrun.study.point_server", "mjrun.study.simulate"),
}
OWNER = os.getpid()
EXECUTABLE, SEARCHED = sys.executable, [*sys.path]  # which tests change
# Variables that tests or libraries set, and that no module above reads while it is imported.
WITHOUT_EFFECT = ("PYTEST_CURRENT_TEST", "COLUMNS", "TERM", "NO_COLOR", "DISPLAY", "WAYLAND_DISPLAY", "MJRUN_CACHE")
WITHOUT_EFFECT += ("GITHUB_STEP_SUMMARY", "KMP_DUPLICATE_LIB_OK", "ORT_DISABLE_TELEMETRY")
MOST = 6  # interpreters at a time
REQUEST = 2**17  # bytes, at most
DESCRIPTORS = 64  # in a request, at most
COMM = Path("/proc/self/comm")
PROGRAM = Path(__file__).with_name("prepared_command.py")
SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER of prctl(2)


# --- in the process of the tests ------------------------------------------------------------------------


class PreparedInterpreter:
    """An interpreter with some modules, of which copies are made, for this process or for programs of shells.

    Attributes:
      is_usable: it could import them, and has no thread that a copy would lack.
    """

    def __init__(
        self, modules: Sequence[str], environment: Mapping[str, str], programs: socket.socket | None = None
    ) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            function = "serve_programs" if programs else "serve"
            numbers = [each.fileno() for each in (programs, theirs) if each]
            self._process = subprocess.Popen(
                python_call(f"tests.prepared_interpreters:{function}", *modules, *map(str, numbers), path=SEARCHED),
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=numbers,
                start_new_session=True,
            )
        self.is_usable = self._socket.recv(1) == b"1"

    def copy(self, request: Mapping[str, object], descriptors: Sequence[int]) -> int:
        """Starts a copy, as a child of this process, and returns its number."""
        libc = ctypes.CDLL(None)
        libc.prctl(SUBREAPER, 1)
        try:
            socket.send_fds(self._socket, [json.dumps(request).encode()], descriptors)
            pid = int(self._socket.recv(16))
            assert self._socket.recv(1)  # its parent has ended, so that it is ours
        finally:
            libc.prctl(SUBREAPER, 0)
        return pid

    def close(self) -> None:
        """Ends the interpreter, but not its copies."""
        self._socket.close()
        self._process.wait()


_interpreters = OrderedDict[object, PreparedInterpreter]()  # the last used at the end
_commands_seen = set[object]()  # the environments in which a command was started
_lock = threading.Lock()


class PreparedPopen(subprocess.Popen[Any]):
    """A command or worker process that is a copy of a prepared interpreter, where there is one that suits."""

    def _execute_child(self, *values: Any) -> None:
        start = super()._execute_child  # type: ignore[misc]
        arguments = inspect.signature(start).bind(*values).arguments
        with _lock if _may_be_a_copy(arguments) else contextlib.nullcontext() as is_locked:
            interpreter = _prepared(arguments) if is_locked else None
            if interpreter is None or not interpreter.is_usable:
                start(*values)
                return
            streams = (("p2cread", 0), ("c2pwrite", 1), ("errwrite", 2))
            numbers = [number if arguments[name] < 0 else arguments[name] for name, number in streams]
            names = ("args", "env", "pass_fds")
            folder = os.open(arguments["cwd"] or ".", os.O_PATH | os.O_CLOEXEC)
            try:
                descriptors = [folder, *numbers, *arguments["pass_fds"]]
                self.pid = interpreter.copy({name: arguments[name] for name in names}, descriptors)
            finally:
                os.close(folder)
        self._child_created = True
        ends = ("p2cread", "p2cwrite", "c2pread", "c2pwrite", "errread", "errwrite")
        cast("Any", self)._close_pipe_fds(*(arguments[name] for name in ends))


@functools.cache
def program() -> str:
    """Returns the words with which a shell starts mjrun as a copy of a prepared interpreter, where there is one."""
    if sys.platform == "linux":
        folder = tempfile.mkdtemp()
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as programs:
            programs.bind(f"{folder}/socket")
            programs.listen()
            interpreter = PreparedInterpreter(MODULES[COMMAND], os.environ, programs)
        atexit.register(shutil.rmtree, folder)
        atexit.register(interpreter.close)
        if interpreter.is_usable:
            return shlex.join([EXECUTABLE, "-I", "-S", str(PROGRAM), f"{folder}/socket"])
    return shlex.join([EXECUTABLE, "-m", "mjrun"])


def _may_be_a_copy(arguments: Mapping[str, Any]) -> bool:
    """Returns whether the process that runs the tests starts a command, or a worker in a separate session."""
    modules = _modules(arguments["args"])
    is_plain = arguments["start_new_session"] or modules == MODULES[COMMAND]
    return bool(modules and is_plain and arguments["preexec_fn"] is None and os.getpid() == OWNER)


def _prepared(arguments: Mapping[str, Any]) -> PreparedInterpreter | None:
    """Returns the interpreter for a process, with its modules and the variables that libraries read on import.

    For commands, it is made when an environment occurs again, since many tests have their own.
    """
    modules = _modules(arguments["args"])
    environment = {name: value for name, value in arguments["env"].items() if name not in WITHOUT_EFFECT}
    key = (modules, frozenset(environment.items()))
    if modules == MODULES[COMMAND] and key not in _commands_seen:
        _commands_seen.add(key)
        return None
    if key not in _interpreters:
        if len(_interpreters) == MOST:
            _interpreters.popitem(last=False)[1].close()
        _interpreters[key] = PreparedInterpreter(modules, environment)
    _interpreters.move_to_end(key)
    return _interpreters[key]


def _modules(command: Sequence[str]) -> tuple[str, ...]:
    """Returns the modules of the process that a command line starts; none if it starts something else."""
    if [*command[:3]] == [EXECUTABLE, "-m", "mjrun"]:
        return MODULES[COMMAND]
    if [*command[:3]] != [EXECUTABLE, "-P", "-c"] or not command[4].isdecimal():
        return ()
    server = command[5 + int(command[4]) :]
    return MODULES.get(server[0], ()) if command[3] == python_call("mjrun.worker:serve")[3] else ()


@atexit.register
def _end_all() -> None:
    while _interpreters:
        _interpreters.popitem()[1].close()


# --- in a prepared interpreter --------------------------------------------------------------------------


def serve(*arguments: str) -> None:
    """Imports modules, and makes a copy of this process for each request, until the other end hangs up."""
    *modules, connection = arguments
    parent = _prepare(modules, connection)
    while True:
        request, descriptors, _, _ = socket.recv_fds(parent, REQUEST, DESCRIPTORS)
        if not request:
            return
        if not (between := os.fork()):
            COMM.write_text("python")  # of the copy, too, before anybody can look at it
            if pid := os.fork():
                parent.send(str(pid).encode())
                os._exit(0)
            parent.detach()
            _run(json.loads(request), descriptors)
            return
        os.waitpid(between, 0)
        parent.send(b"1")
        for descriptor in descriptors:
            os.close(descriptor)


def serve_programs(*arguments: str) -> None:
    """Imports modules, and makes a copy of this process for each `prepared_command.py`, until its parent hangs up."""
    *modules, listening, connection = arguments
    parent = _prepare(modules, connection)
    programs = socket.socket(fileno=int(listening))
    while parent not in select.select([parent, programs], [], [])[0]:
        program, _ = programs.accept()
        if os.fork():
            program.close()
            with contextlib.suppress(ChildProcessError):
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
            continue
        request, descriptors, _, _ = socket.recv_fds(program, REQUEST, DESCRIPTORS)
        if not (pid := os.fork()):
            for each in (parent, programs, program):
                each.detach()
            COMM.write_text("python")
            _run(json.loads(request), descriptors)
            return
        program.send(str(pid).encode())
        program.send(str(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])).encode())
        os._exit(0)


def _prepare(modules: Sequence[str], connection: str) -> socket.socket:
    """Imports modules, and returns the socket of the parent, which is told whether this process can be copied."""
    parent = socket.socket(fileno=int(connection))
    gc.disable()
    for module in modules:
        import_module(module)
    gc.freeze()
    COMM.write_text("prepared")
    parent.send(b"1" if len([*Path("/proc/self/task").iterdir()]) == 1 else b"0")
    return parent


def _run(request: dict[str, Any], descriptors: Sequence[int]) -> None:
    """Does what a new interpreter would do."""
    folder, *streams = descriptors
    os.setsid()
    os.fchdir(folder)
    numbers = [0, 1, 2, *request["pass_fds"]]
    base = 1 + max([*numbers, *descriptors])
    copies = [fcntl.fcntl(descriptor, fcntl.F_DUPFD, base) for descriptor in streams]
    os.closerange(3, base)
    for copy, number in zip(copies, numbers, strict=True):
        os.dup2(copy, number)
        os.close(copy)
    os.environ.clear()
    os.environ.update(request["env"])
    gc.enable()
    _, option, code, *arguments = request["args"]
    if option == "-m":
        sys.argv[:] = [code, *arguments]
        sys.path[:0] = [str(Path.cwd()), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
        import_module(f"{code}.__main__").main()
    else:
        sys.argv[:] = ["-c", *arguments[1:]]
        exec(arguments[0], vars(sys.modules["__main__"]))
