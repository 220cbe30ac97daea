"""Code of an exploited parser inside `--untrusted`: nothing outside is changed, read or reached."""

import ctypes
import fcntl
import json
import os
import resource
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import termios
import tty
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from mjrun.confinement import landlock, seccomp
from tests.scoreboard import attacks
from tests.scoreboard.attacks import CHILD, LANDLOCK, LISTEN, LOADER, MAIN, OPERATIONS, SECRET, SIGNALS, Target
from tests.scoreboard.command import CONTROL, QUICK_IMPORTS, CommandServer, Ended
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Tally, measured
from tests.scoreboard.outside_files import LIMIT, MODEL, TASK

ATTACKED = "tests.scoreboard.attacks:attacked"
TRACE = ("trace", "model.xml", "--steps", "2", "-o", "../out/t.csv")
INPUTS = inputs_of(__name__)
SWEEP = INPUTS["SWEEP"]
# Kinds of processes in which the code runs: the place, and the command.
PLACES: dict[str, tuple[str, tuple[str, ...]]] = {
    "the process": (MAIN, TRACE),
    "the thread that loads": (LOADER, TRACE),
    "the process that draws": (
        CHILD,
        ("video", "model.xml", "--size", "16x16", "--duration", "1", "--jobs", "2", "-o", "../out/v.mp4"),
    ),
    "the process that simulates": (CHILD, (*SWEEP, "-o", "../out")),
    "the process that plays": (
        CHILD,
        ("eval", "task.yaml", "--policy", "zero", "--episodes", "4", "--jobs", "2", "-o", "../out"),
    ),
    "the process that serves a page": (MAIN, ("view", "model.xml", "--browser", "--recording", "../out/r.npz")),
}
QUICK = (MAIN, LOADER)


@dataclass
class World:
    """The files, processes, servers and terminal outside, during a run.

    Attributes:
      folder: the folder of all files.
      targets: the target of each operation.
      victims: the process of each operation that must not be reached.
      servers: sockets that must not be reached.
      terminal: the terminal that is standard input.
    """

    folder: Path
    targets: dict[str, Target]
    victims: dict[str, "subprocess.Popen[bytes]"]
    servers: list[socket.socket]
    terminal: int

    def state(self, name: str) -> object:
        """Returns the state of everything that an operation could change outside."""
        at, victim = self.targets[name], self.victims[name]
        files = [
            _described(path) for top in (at.folder, at.beside) for path in (Path(top), *sorted(Path(top).rglob("*")))
        ]
        files += [_described(Path(path)) for path in (at.readable, f"{at.readable}.new", at.memory)]
        process: object = "dead"
        if victim.poll() is None:
            limits = resource.prlimit(victim.pid, resource.RLIMIT_NOFILE)
            scheduled = (os.sched_getscheduler(victim.pid), sorted(os.sched_getaffinity(victim.pid)))
            process = (limits, scheduled, os.getpriority(os.PRIO_PROCESS, victim.pid))
        return files, process

    @property
    def typed(self) -> int:
        """Number of bytes that wait in the terminal."""
        return struct.unpack("i", fcntl.ioctl(self.terminal, termios.FIONREAD, bytes(4)))[0]

    @property
    def reached(self) -> list[str]:
        """The servers that received something."""
        names = []
        for server in self.servers:
            with suppress(BlockingIOError):
                kind = server.type
                server.recv(100) if kind == socket.SOCK_DGRAM else server.accept()[0].close()
                names.append(f"{server.family.name} {kind.name}")
        return names


def _described(path: Path) -> object:
    try:
        kind = os.lstat(path)
    except OSError as error:
        return str(path), error.errno
    content = path.read_bytes() if path.is_file() and not path.is_symlink() else b""
    attributes = {name: os.getxattr(path, name) for name in os.listxattr(path)} if content else {}
    return (
        str(path),
        kind.st_mode,
        kind.st_uid,
        kind.st_gid,
        kind.st_size,
        kind.st_mtime_ns,
        content,
        attributes,
        _flags(path),
    )


def _flags(path: Path) -> bytes:
    """Returns the flags of a file (FS_IOC_GETFLAGS), where its file system supports them."""
    if not path.is_file():
        return b""
    with path.open("rb") as file, suppress(OSError):
        return fcntl.ioctl(file, 0x80086601, bytes(8))
    return b""


@contextmanager
def world(names: list[str]) -> Iterator[World]:
    """Makes a model's folder, and the world outside it, in a new temporary folder."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        memory = Path(stack.enter_context(tempfile.TemporaryDirectory(dir="/dev/shm")))
        for name in ("model", "out", "temporary"):
            (folder / name).mkdir()
        (folder / "model/model.xml").write_text(MODEL)
        (folder / "model/task.yaml").write_text(TASK.format(model="model.xml"))

        servers, addresses = [], []
        for family, kind, address in (
            (socket.AF_UNIX, socket.SOCK_STREAM, f"{folder}/stream"),
            (socket.AF_UNIX, socket.SOCK_STREAM, f"\0mjrun-{os.getpid()}-{os.urandom(4).hex()}"),
            (socket.AF_UNIX, socket.SOCK_DGRAM, f"{folder}/datagrams"),
            (socket.AF_INET, socket.SOCK_STREAM, ("127.0.0.1", 0)),
            (socket.AF_INET, socket.SOCK_DGRAM, ("127.0.0.1", 0)),
        ):
            server = stack.enter_context(socket.socket(family, kind))
            server.bind(address)
            server.setblocking(False)
            if kind == socket.SOCK_STREAM:
                server.listen(100)
            servers.append(server)
            addresses.append(server.getsockname()[1] if family == socket.AF_INET else address)

        master, terminal = os.openpty()
        tty.setraw(terminal)  # in which each byte counts, and not only whole lines
        stack.callback(os.close, master)
        stack.callback(os.close, terminal)
        key = int.from_bytes(os.urandom(3), "little") + 1
        library = ctypes.CDLL(None)
        segment = library.shmget(key, 4096, 0o1600)
        stack.callback(library.shmctl, segment, 0, None)

        made = World(folder, {}, {}, servers, terminal)
        for number, name in enumerate(names):
            outside = folder / f"outside/{number}"
            (outside / "empty").mkdir(parents=True)
            (outside / "secret").write_text(SECRET)
            with suppress(OSError):  # of a file system without attributes
                os.setxattr(outside / "secret", "user.secret", SECRET.encode())
            for each in (folder / f"model/{number}.txt", memory / str(number)):
                each.write_text(SECRET)
            beside = folder / f"temporary/{number}"
            beside.mkdir()
            victim = subprocess.Popen(
                ["sleep", "1000"], cwd=outside, env={"NAME": SECRET}, stdin=subprocess.DEVNULL, start_new_session=True
            )
            stack.callback(_end, victim)
            places = (str(outside), str(folder / f"model/{number}.txt"), str(beside), str(memory / str(number)))
            made.targets[name] = Target(*places, victim.pid, tuple(addresses), key)
            made.victims[name] = victim
        yield made


def _end(victim: "subprocess.Popen[bytes]") -> None:
    victim.kill()
    victim.wait()


@measured(
    "code that runs inside --untrusted",
    "0 files, processes, sockets or terminals outside read, changed or reached, nothing left running; by an exploited "
    "parser in each kind of process, and by the filter of system calls alone",
    400,
)
def inside_sandbox(quick: bool) -> Tally:
    tally = Tally()
    if sys.platform != "linux" or not seccomp.is_known():
        tally.leave_out("all of it: there is no filter of system calls for this machine")
        return tally
    known = [name for name, each in OPERATIONS.items() if landlock.version() >= (6 if each.by == SIGNALS else 1)]
    by_filter = [name for name, each in OPERATIONS.items() if each.by not in (LANDLOCK, SIGNALS)]
    tally.left_out += [f"{name}: this kernel's Landlock is too old" for name in OPERATIONS if name not in known]
    with ExitStack() as stack:
        server = stack.enter_context(CommandServer(LIMIT, imports=QUICK_IMPORTS if quick else ()))
        if not quick:
            _try_free(tally, server)
        if landlock.version():
            for where, (place, command) in PLACES.items():
                if not quick or (place in QUICK and command == TRACE):
                    _try_confined(tally, server, where, place, command, known)
            for lie in attacks.LIES:
                if not quick or lie == "folders":
                    _try_lie(tally, server, lie)
        if not quick or not landlock.version():
            without = stack.enter_context(CommandServer(LIMIT, without_landlock=True))
            _try_confined(tally, without, "the process, without Landlock", MAIN, TRACE, by_filter)
    return tally


def _run(
    server: CommandServer, made: World, place: str, command: tuple[str, ...], *, untrusted: bool = True, lie: str = ""
) -> tuple[Ended, dict[str, list[dict[str, object]]]]:
    """Runs a command; returns the run, and the results of each operation, one from each attacked process."""
    results = made.folder / "out/attempts"
    targets = {name: asdict(target) for name, target in made.targets.items()}
    environment = {
        attacks.PLACE: place,
        attacks.RESULTS: str(results),
        attacks.TARGETS: json.dumps(targets),
        attacks.LIE: lie,
        "TMPDIR": str(made.folder / "temporary"),
    }
    line = [*command, *(["--untrusted"] if untrusted else [])]
    terminal = {0: os.ttyname(made.terminal)}
    folder = made.folder / "model"
    run = server.run(*line, folder=folder, environment=environment, call=ATTACKED, redirected=terminal)
    lines = results.read_text().splitlines() if results.exists() else []
    attempts: dict[str, list[dict[str, object]]] = {}
    for values in map(json.loads, lines):
        attempts.setdefault(str(values.pop("name")), []).append(values)
    return run, attempts


def _try_free(tally: Tally, server: CommandServer) -> None:
    """Tries each operation without `--untrusted`: it must do harm, or its refusal shows nothing."""
    names = [name for name, each in OPERATIONS.items() if each.free]
    with world(names) as made:
        before = {name: made.state(name) for name in names}
        run, attempts = _run(server, made, MAIN, TRACE, untrusted=False)
        for name in names:
            attempt = attempts.get(name, [])
            works = any(each.get("got") is not None for each in attempt) or made.state(name) != before[name]
            if "type into" in name:
                works = made.typed > 0
            if not works:
                why = attempt[0].get("refused", "nothing changes") if attempt else "it did not run"
                tally.leave_out(f"{name}, to see that it works without --untrusted: {why}")
        tally.expect(len(attempts) > len(names), f"without --untrusted: {len(attempts)} operations were tried: {run}")
        for daemon in attempts.get("a daemon", []):
            os.kill(int(str(daemon["pid"])), signal.SIGKILL)


def _try_confined(
    tally: Tally, server: CommandServer, where: str, place: str, command: tuple[str, ...], operations: list[str]
) -> None:
    names = [name for name in operations if name != LISTEN or command[0] != "view"]
    with world(names) as made:
        before = {name: made.state(name) for name in names}
        run, attempts = _run(server, made, place, command)
        for name in names:
            attempt, same = attempts.get(name, []), made.state(name) == before[name]
            refused = bool(attempt) and all(each.get("got") is None for each in attempt)
            changed = "" if same else ", and something has changed"
            tally.expect(refused and same, f"{where}: {name}: {attempt}{changed}: {run}")
        daemons = [daemon["pid"] for daemon in attempts.get("a daemon", [])]
        alive = [pid for pid in daemons if Path(f"/proc/{pid}").exists()]
        tally.expect(bool(daemons) and not alive, f"{where}: processes are left: {alive} of {daemons}: {run}")
        left = [path.name for path in (made.folder / "temporary").iterdir() if not path.name.isdigit()]
        tally.expect(not left, f"{where}: {left} are left beside temporary files")
        tally.expect(not made.typed, f"{where}: {made.typed} bytes were typed into the terminal")
        tally.expect(not (reached := made.reached), f"{where}: reached {reached}")
        tally.expect(run.code == 0, f"{where}: {run}")


def _try_lie(tally: Tally, server: CommandServer, lie: str) -> None:
    """Tries false entries on the status board of a process that dies: they must do no harm."""
    name = "kill a process"
    with world([name]) as made:
        before = made.state(name)
        run, _ = _run(server, made, MAIN, TRACE, lie=lie)
        tally.expect(made.state(name) == before, f"a lie, {lie}: something has changed: {run}")
        reported = run.code in (5, 70) and "crashed" in run.message and not CONTROL.search(run.message)
        tally.expect(reported, f"a lie, {lie}: {run}")
        shutil.rmtree(made.folder / "out", ignore_errors=True)
