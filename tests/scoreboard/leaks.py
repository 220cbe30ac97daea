"""Many runs in a row, in one process and in many, leave nothing behind: no descriptor, process, thread, file or memory.

The runs fail too, in every way that is told by an exit code: what fails is cleared away as well.
"""

import ctypes
import json
import os
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from tests.scoreboard.command import CommandServer
from tests.scoreboard.data import inputs_of
from tests.scoreboard.makings import furnish
from tests.scoreboard.measure import Measure, Tally

RUNS, QUICK_RUNS = 200, 12
LIMIT = 3600.0  # seconds, for all runs in a row on a machine that does much else
GRACE = 5.0  # seconds in which what a run has started has to be gone
SUBREAPER = 36  # of prctl: orphans come to us
SHARED = Path("/dev/shm")

DRAWN = "--size 64x48 --camera side --quality draft"
# Command lines and the exit codes that they must have, by turns; those that draw or start processes come last.
INPUTS = inputs_of(__name__)
LINES: tuple[tuple[str, int], ...] = INPUTS["LINES"]
HEAVY: tuple[tuple[str, int], ...] = INPUTS["HEAVY"]
WILD = INPUTS["WILD"]


def run(quick: bool) -> Tally:
    tally = Tally()
    with tempfile.TemporaryDirectory() as scratch, CommandServer(LIMIT) as server:
        for how in ("one process",) if quick else ("one process", "many processes"):
            folder, temporary = furnish(Path(scratch, how)), Path(scratch, f"{how} temporary")
            temporary.mkdir()
            (folder / "wild.xml").write_text(WILD)
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
            for line, leaks in json.loads(report.read_text()) if report.exists() else ():
                tally.expect(not leaks, f"{how}: {line}: {leaks}")
    return tally


def one_process(arguments: Sequence[str]) -> int:
    """Runs the lines by turns in this process; the first time of each is a warm-up."""
    from mjrun.cli.main import run as run_mjrun

    return _in_a_row(arguments, run_mjrun, warms_up=True)


def many_processes(arguments: Sequence[str]) -> int:
    """Runs the lines by turns, each in a process of its own."""
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
        leaks = [] if code == expected else [f"exit code {code}, not {expected}"]
        leaks += _leaks(before)
        new = _names(".") - known
        if index >= len(lines):  # what each line makes is there by now
            leaks += [f"file {name}" for name in sorted(new)]
        known |= new
        before = _state()
        results.append((line, ", ".join(leaks)))
    Path(report).write_text(json.dumps(results))
    return 0


def _state() -> dict[str, set[str]]:
    """What this process, and the machine for it, holds."""
    return {
        "descriptors": {str(number) for number in range(len(_names("/proc/self/fd")))},
        "threads": {str(number) for number in range(threading.active_count())},  # libraries keep pools of their own
        "processes": _children(),
        "temporary files": _names(tempfile.gettempdir()),
        "shared memory": _ownerless(),
        "logs": {name for name in _names(".") if name.upper() == "MUJOCO_LOG.TXT"},
    }


def _names(folder: str | Path) -> set[str]:
    return {path.name for path in Path(folder).iterdir()}


def _leaks(before: dict[str, set[str]]) -> list[str]:
    """What there is more than before, and stays: others, whose memory is shared too, come and go."""
    deadline = time.monotonic() + GRACE
    more = {kind: now - before[kind] for kind, now in _state().items()}
    while any(more.values()) and time.monotonic() < deadline:
        time.sleep(0.02)
        more = {kind: more[kind] & now for kind, now in _state().items()}
    return [f"{kind} {sorted(names)[:3]}" for kind, names in more.items() if names]


def _children() -> set[str]:
    """The processes that have not ended, orphans of others among them; those that have are reaped."""
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
    """What lies in shared memory and no process has mapped."""
    if not SHARED.is_dir() or not (names := _names(SHARED)):
        return set()
    for maps in Path("/proc").glob("[0-9]*/maps"):
        with suppress(OSError):
            text = maps.read_text()
            names -= {name for name in names if f"{SHARED}/{name}" in text}
    return names


MEASURE = Measure(
    "200 runs in a row, in one process and in many",
    "no leaked descriptors, threads, processes, temporary files, shared memory; no `MUJOCO_LOG.TXT`",
    400,
    run,
)
