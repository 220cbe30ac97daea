"""Memory that grows with the work, and resources that many runs in a row leave behind.

The runs fail too, with every exit code, since a failed run must release its resources as well.
"""

import ctypes
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tests.scoreboard.command import QUICK_IMPORTS, ROOT, CommandServer
from tests.scoreboard.data import inputs_of
from tests.scoreboard.determinism import furnish
from tests.scoreboard.measure import Tally, measured

RUNS, QUICK_RUNS = 200, 12
LIMIT = 3600.0  # [s] for all runs in a row on a busy machine
GRACE = 5.0  # [s] after which all processes of a run must be gone
SUBREAPER = 36  # of prctl: makes orphans children of this process
SHARED = Path("/dev/shm")
PAUSE = 0.05  # [s] between two samples of memory
MOST = 10 * 2**20  # bytes of growth
MOST_MODELS = 64 * 2**20  # the same where each unit has a model: the memory that malloc keeps varies by a third of it

INPUTS = inputs_of(__name__)
# Command lines and the exit codes that they must have; heavy ones render or start processes.
LINES: tuple[tuple[str, int], ...] = INPUTS["LINES"]
HEAVY: tuple[tuple[str, int], ...] = INPUTS["HEAVY"]
MODEL = INPUTS["GROWING_MODEL"]
DRIVEN = MODEL.replace("</worldbody>", '</worldbody><actuator><motor name="motor" joint="up"/></actuator>')
# A small process starts the command, because the peak of a process includes that of the one it was before exec.
START = (
    "import resource, subprocess, sys; code = subprocess.call(sys.argv[2:]); "
    "open(sys.argv[1], 'w').write(str(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)); sys.exit(code)"
)


@measured(
    "200 runs in a row, in one process and in many",
    "no leaked descriptors, threads, processes, temporary files, shared memory; no `MUJOCO_LOG.TXT`",
    400,
)
def leaks(quick: bool) -> Tally:
    tally = Tally()
    with tempfile.TemporaryDirectory() as scratch, CommandServer(LIMIT, imports=QUICK_IMPORTS) as server:
        for how in ("one process",) if quick else ("one process", "many processes"):
            folder, temporary = furnish(Path(scratch, how)), Path(scratch, f"{how} temporary")
            temporary.mkdir()
            (folder / "wild.xml").write_text(INPUTS["WILD"])
            (folder / "broken.xml").write_text("<mujoco><worldbody>")
            count = QUICK_RUNS if quick else RUNS
            call = "tests.scoreboard.leaks:" + how.replace(" ", "_")
            ended = server.run(
                *(str(count), str(int(quick)), "report.json"),
                folder=folder,
                environment={"TMPDIR": str(temporary)},
                call=call,
            )
            report = folder / "report.json"
            tally.expect(ended.code == 0 and report.exists(), f"{how}: {ended}")
            for line, leaked in json.loads(report.read_text()) if report.exists() else ():
                tally.expect(not leaked, f"{how}: {line}: {leaked}")
    return tally


def one_process(arguments: Sequence[str]) -> int:
    """Runs the lines in turn in this process; the first run of each is a warm-up."""
    from mjrun.cli.main import run as run_mjrun

    return _in_a_row(arguments, run_mjrun, warms_up=True)


def many_processes(arguments: Sequence[str]) -> int:
    """Runs the lines in turn, each in a separate process."""
    from mjrun.cli.main import run as run_mjrun

    def run_in_child(line: Sequence[str]) -> int:
        child = os.fork()
        if not child:
            code = 255
            try:
                code = run_mjrun(line)
            finally:
                os._exit(code)
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

    return _in_a_row(arguments, run_in_child, warms_up=False)


def _in_a_row(arguments: Sequence[str], run_line: Callable[[Sequence[str]], int], *, warms_up: bool) -> int:
    count, quick, report = int(arguments[0]), bool(int(arguments[1])), arguments[2]
    ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0)
    tempfile.tempdir = None  # as TMPDIR says
    lines = LINES if quick else (*LINES, *HEAVY)
    if warms_up:
        for line, _ in lines:
            run_line(line.split(" "))
    known = {*_names("."), report}
    before, results = _state(), list[tuple[str, str]]()
    for index in range(count):
        line, expected = lines[index % len(lines)]
        code = run_line(line.split(" "))
        leaked = [] if code == expected else [f"exit code {code}, not {expected}"]
        leaked += _leaks(before)
        new = _names(".") - known
        if index >= len(lines):  # all lines have written their files by now
            leaked += [f"file {name}" for name in sorted(new)]
        known |= new
        before = _state()
        results.append((line, ", ".join(leaked)))
    Path(report).write_text(json.dumps(results))
    return 0


def _state() -> dict[str, set[str]]:
    """Returns the resources that this process, and the machine for it, holds."""
    return {
        "descriptors": {str(number) for number in range(len(_names("/proc/self/fd")))},
        "threads": {str(number) for number in range(threading.active_count())},  # libraries have their own pools
        "processes": _children(),
        "temporary files": _names(tempfile.gettempdir()),
        "shared memory": _ownerless(),
        "logs": {name for name in _names(".") if name.upper() == "MUJOCO_LOG.TXT"},
    }


def _names(folder: str | Path) -> set[str]:
    return {path.name for path in Path(folder).iterdir()}


def _leaks(before: dict[str, set[str]]) -> list[str]:
    """Returns the resources that are new and stay; shared memory of other programs comes and goes."""
    deadline = time.monotonic() + GRACE
    more = {kind: now - before[kind] for kind, now in _state().items()}
    while any(more.values()) and time.monotonic() < deadline:
        time.sleep(0.02)
        more = {kind: more[kind] & now for kind, now in _state().items()}
    return [f"{kind} {sorted(names)[:3]}" for kind, names in more.items() if names]


def _children() -> set[str]:
    """Returns the processes that have not ended, including orphans; zombies do not count."""
    found = set[str]()
    for task in _names("/proc/self/task"):
        with suppress(OSError):
            found |= {*Path(f"/proc/self/task/{task}/children").read_text().split()}
    alive = set[str]()
    for pid in found:
        with suppress(OSError):
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
                alive.add(pid)
    return alive


def _ownerless() -> set[str]:
    """Returns the names in shared memory that no process has mapped."""
    if not SHARED.is_dir() or not (names := _names(SHARED)):
        return set()
    for maps in Path("/proc").glob("[0-9]*/maps"):
        with suppress(OSError):
            text = maps.read_text()
            names -= {name for name in names if f"{SHARED}/{name}" in text}
    return names


@dataclass(frozen=True)
class Growing:
    """A command line whose work grows.

    Attributes:
      what: the unit of work.
      line: the command line after `mjrun`; `{n}` is the number of units, `{seconds}` as many thousandths of a second.
      warm: number of units after the warm-up, when buffers are full.
      whole: number of units in all.
    """

    what: str
    line: str
    warm: int
    whole: int

    @property
    def most(self) -> int:
        """Bytes of growth that are allowed."""
        return MOST_MODELS if self.what.startswith("models") else MOST

    def arguments(self, count: int) -> list[str]:
        """Returns the arguments after `mjrun` for a number of units."""
        seconds = f"{count // 1000}.{count % 1000:03}"
        return self.line.replace("{n}", str(count)).replace("{seconds}", seconds).split(" ")


@dataclass(frozen=True)
class Peak:
    """The memory of a command line.

    Attributes:
      largest: peak of the largest of its processes [bytes], by the kernel's count.
      together: largest sum of their private memory that was seen [bytes].
    """

    largest: int
    together: int


@measured(
    "memory: 10,000 frames, 1,000,000 rows, 10,000 points and episodes",
    "≤ 10 MiB more after the warm-up, ≤ 64 MiB where each point or episode has a model",
    60,
)
def memory(quick: bool) -> Tally:
    tally = Tally()
    for case in (Growing(*each) for each in INPUTS["QUICK" if quick else "CASES"]):
        peaks: list[Peak] = []
        for count in (case.warm, case.whole):
            with tempfile.TemporaryDirectory() as folder:
                code, peak = _peak(case.arguments(count), Path(folder))
            tally.expect(code == 0, f"{case.line}: {count:,} {case.what}: exit code {code}")
            peaks.append(peak)
        for name in ("largest", "together"):
            first, last = (getattr(peak, name) for peak in peaks)
            sizes = f"{first / 2**20:.1f} MiB for {case.warm:,}, {last / 2**20:.1f} MiB for {case.whole:,} {case.what}"
            tally.expect(last - first <= case.most, f"{case.line}: {sizes} ({name})")
    return tally


def _peak(arguments: list[str], folder: Path) -> tuple[int, Peak]:
    """Returns the exit code of a command line, and its memory."""
    (folder / "model.xml").write_text(DRIVEN)
    (folder / "task.yaml").write_text(INPUTS["TASK"])
    (folder / "large.xml").write_text(INPUTS["LARGE"])
    (folder / "varied.yaml").write_text(INPUTS["VARIED"])
    largest = folder / "largest"
    process = subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", START, str(largest), sys.executable, "-m", "mjrun", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    together, deadline = 0, time.monotonic() + LIMIT
    while process.poll() is None:
        together = max(together, sum(map(_private, _descendants(process.pid))))
        if time.monotonic() > deadline:
            os.killpg(process.pid, 9)
        time.sleep(PAUSE)
    return process.returncode, Peak(1024 * int(largest.read_text() or 0) if largest.exists() else 0, together)


def _descendants(pid: int) -> list[int]:
    """Returns the process and all that it has started."""
    found = [pid]
    for each in found:
        with suppress(OSError):
            for tasks in Path(f"/proc/{each}/task").iterdir():
                found += map(int, (tasks / "children").read_text().split())
    return found


def _private(pid: int) -> int:
    """Returns the anonymous memory of a process [bytes], its share where it is shared; 0 if it has ended."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss_Anon:"):
                return 1024 * int(line.split()[1])
    return 0
