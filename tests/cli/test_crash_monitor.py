"""Whatever ends the process that works, its parent says what it was, with the right exit code."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
import zlib
from pathlib import Path

import pytest

from mjrun.cli import crash_monitor
from mjrun.shared_status import ProcessActivityMemory
from tests.processes import PATIENCE, command_line_of, wait_until

HEAD = """
import os, signal, sys, time
from mjrun import shared_status
from mjrun.shared_status import ConfinementPromise, ProcessStatus
from mjrun.shared_status import completing, doing, make_promise, note_child, note_heard
from mjrun.cli.crash_monitor import continue_in_monitored_child
from mjrun.platform import system
def die(number):
    os.kill(os.getpid(), number)
def work():
"""
TAIL = """
signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
continue_in_monitored_child()
sys.exit(work())
"""


def start(work: str, folder: Path, *arguments: str) -> "subprocess.Popen[str]":
    """A process, of a command line with `arguments`, that watches a child in which the body of a function runs."""
    body = "".join(f"    {line}\n" for line in work.splitlines())
    pipe = subprocess.PIPE
    script = [sys.executable, "-c", HEAD + body + TAIL, *arguments]
    return subprocess.Popen(script, cwd=folder, stdout=pipe, stderr=pipe, text=True, start_new_session=True)


def outcome(process: "subprocess.Popen[str]") -> tuple[int, str]:
    """Exit code and standard error."""
    _, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, errors


def assert_gone(pid: int) -> None:
    """A process ends; then it has no command line any more, even if nobody waits for it."""
    wait_until(lambda: not command_line_of(pid))


@pytest.mark.parametrize("code", [0, 1, 70])
def test_the_exit_code_of_the_child_is_that_of_the_command(tmp_path: Path, code: int) -> None:
    assert outcome(start(f"return {code}", tmp_path)) == (code, "")


@pytest.mark.parametrize(
    ("activity", "number", "code", "said"),
    [
        ("reading", "SIGSEGV", 3, "MuJoCo crashed while reading robot.xml"),
        ("compiling", "SIGABRT", 3, "MuJoCo crashed while compiling robot.xml"),
        ("simulating", "SIGBUS", 4, "MuJoCo crashed while simulating robot.xml"),
        ("drawing", "SIGFPE", 5, "MuJoCo crashed while drawing robot.xml"),
        ("", "SIGSEGV", 70, "mjrun, or a library that it uses, crashed: "),
        ("compiling", "SIGKILL", 3, "killed while compiling robot.xml"),
        ("simulating", "SIGXCPU", 128 + signal.SIGXCPU, "ended by SIGXCPU while simulating robot.xml"),
    ],
)
def test_a_death_is_reported_with_what_died_and_what_to_do(
    tmp_path: Path, activity: str, number: str, code: int, said: str
) -> None:
    ended, message = outcome(start(f"with doing({activity!r}, 'robot.xml'): die(signal.{number})", tmp_path))
    first, *rest = message.splitlines()
    assert ended == code
    assert first.startswith(f"mjrun: error: {said}")
    assert number in first
    assert bool(rest) == (number != "SIGXCPU")


@pytest.mark.parametrize(
    ("work", "code", "kind"),
    [
        ("with doing('reading', 'robot.xml'): die(signal.SIGSEGV)", 3, "Crash"),
        ("die(signal.SIGKILL)", 3, "Killed"),
        ("die(signal.SIGXCPU)", 128 + signal.SIGXCPU, "TerminatedError"),
    ],
)
def test_json_reports_a_death_unless_it_was_printed_before(tmp_path: Path, work: str, code: int, kind: str) -> None:
    out, errors = start(work, tmp_path, "info", "--json").communicate(timeout=PATIENCE)
    failure = json.loads(out)["error"]
    assert (failure["exit_code"], failure["kind"]) == (code, kind)
    assert failure["message"].splitlines()[0] in errors

    answer = "from mjrun.cli.console import Console\nconsole = Console()\nconsole.document({'a': 1})\nconsole.finish()"
    out, _ = start(f"{answer}\n{work}", tmp_path, "info", "--json").communicate(timeout=PATIENCE)
    assert json.loads(out) == {"a": 1}
    assert start(work, tmp_path, "info").communicate(timeout=PATIENCE)[0] == ""


@pytest.mark.parametrize(
    ("activity", "number", "code", "said"),
    [
        ("reading", "SIGALRM", 3, "while reading robot.xml: it took longer than its limit allows"),
        ("", "SIGXCPU", 4, ": it computed for longer than its limit allows"),
    ],
)
def test_a_limit_of_a_confined_process_is_reported_with_its_option_and_nothing_is_left(
    tmp_path: Path, activity: str, number: str, code: int, said: str
) -> None:
    own = tmp_path / "own"
    own.mkdir()
    (own / "file").write_text("")
    work = f"""
make_promise(ConfinementPromise({str(own)!r}, [], 1000))
with doing({activity!r}, "robot.xml"): die(signal.{number})"""
    ended, message = outcome(start(work, tmp_path))
    assert ended == code
    assert said in message
    assert "--limit time=" in message
    assert not own.exists()


def test_a_child_that_confined_itself_ends_in_time_whatever_it_ignores(tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    work = f"""
make_promise(ConfinementPromise({str(tmp_path / "own")!r}, [], 0.2))
signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
while True: time.sleep(1000)"""
    code, message = outcome(start(work, tmp_path))
    assert code == 4
    assert "it took longer than its limit allows" in message


# What code of an attacker may write on the board, each as the statements that do.
LIES = {
    "folders": "board.write(ProcessStatus(folders=[OUTSIDE]))",
    "made folders": "board.write(ProcessStatus(made=[OUTSIDE + '/empty', 'out/../outside/empty', 'out']))",
    "children": "board.write(ProcessStatus(children=[VICTIM, -VICTIM]))",
    "promise": "board.write(ProcessStatus(promise=ConfinementPromise(OUTSIDE, [OUTSIDE], 1)))",
    "another promise": (
        "board.write(ProcessStatus(promise=ConfinementPromise(OUTSIDE, [OUTSIDE], 1)))\n"
        "os.kill(os.getppid(), signal.SIGUSR1)\ntime.sleep(0.1)"
    ),
    "link": (
        "os.symlink(OUTSIDE, 'out/link')\nboard.write(ProcessStatus(folders=['out/link', OUTSIDE + '/../outside']))"
    ),
    "escape sequences": "board.write(ProcessStatus('drawing', 'a\\x1b]0;title\\x07\\x9b' * 9999))",
    "activity": "board.write(ProcessStatus('\\x1b[2J'))",
    "garbage": "board.memory[8:] = b'\\xff' * (len(board.memory) - 8)",
    "which": "board.memory[0] = 255",
    "depth": "board.memory[8:] = b'[' * (len(board.memory) - 8)",
    "numbers": "board.memory[8:200] = b'9' * 191 + b'\\0'",
    "kinds": (
        'board.memory[8:89] = b\'{"activity":[],"model":{},"folders":7,"made":7,"children":1e999}\'.ljust(81, b\'\\0\')'
    ),
    "temporary": "os.rename('own', 'mine')\nos.symlink(OUTSIDE, 'own')",
    "another temporary": "os.rename('own', 'mine')\nos.rename('outside', 'own')\nos.symlink('own', 'outside')",
}


@pytest.mark.parametrize("lie", LIES)
def test_nothing_that_a_confined_child_writes_decides_what_is_removed_killed_or_printed(
    tmp_path: Path, lie: str
) -> None:
    outside = tmp_path / "outside"
    for folder in (outside, outside / "empty", tmp_path / "out", tmp_path / "own"):
        folder.mkdir()
    unfinished = f".x.mjrun-{zlib.crc32(os.uname().nodename.encode()):08x}00000000.part"
    for place in (outside, tmp_path / "out"):
        (place / unfinished).write_text("")
    with subprocess.Popen(["sleep", "1000"], start_new_session=True) as victim:
        work = f"""
OUTSIDE, VICTIM, board = {str(outside)!r}, {victim.pid}, shared_status._memory
make_promise(ConfinementPromise({str(tmp_path / "own")!r}, [{str(tmp_path / "out")!r}], 1000))
board.write(ProcessStatus(folders=[{str(tmp_path / "out")!r}]))
{LIES[lie]}
die(signal.SIGSEGV)"""
        code, message = outcome(start(work, tmp_path))
        alive = victim.poll() is None
        victim.kill()
    assert alive
    assert code in (70, 5)
    assert "crashed" in message
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f]", message)
    assert len(message) < 4000
    elsewhere = tmp_path / "own" if lie == "another temporary" else outside  # where it was moved
    assert (elsewhere / unfinished).exists()
    assert (elsewhere / "empty").is_dir()
    assert (tmp_path / "out").is_dir()
    assert (tmp_path / "own").exists() == ("temporary" in lie)
    for path in tmp_path.rglob(unfinished):
        path.unlink()


def test_a_confined_child_gets_its_unfinished_outputs_and_empty_folders_removed(tmp_path: Path) -> None:
    for name in ("own", "out", "out/inner", "made"):
        (tmp_path / name).mkdir()
    work = f"""
from mjrun.formats.output_writer import StagedFile
from pathlib import Path
from mjrun.shared_status import note_made_folder
note_made_folder(Path({str(tmp_path / "made")!r}))
make_promise(ConfinementPromise({str(tmp_path / "own")!r}, [{str(tmp_path / "out")!r}], 1000))
Path("own/file").write_text("")
outputs = [StagedFile(Path("out/a.csv")), StagedFile(Path("out/inner/b.csv"))]
die(signal.SIGSEGV)"""
    assert outcome(start(work, tmp_path))[0] == 70
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")) == ["out", "out/inner"]


def test_folders_made_for_outputs_of_a_dead_process_are_removed_if_they_are_empty(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    work = """
from mjrun.formats.output_writer import StagedFile
from pathlib import Path
outputs = [StagedFile(Path(path)) for path in ("a/b/x.csv", "there/c/x.csv", "made/d/x.csv", "made/x.csv")]
outputs[-1].publish()
die(signal.SIGSEGV)"""
    assert outcome(start(work, tmp_path))[0] == 70
    left = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*"))
    assert left == ["made", "made/x.csv", "there"]


def test_folders_made_for_outputs_of_a_process_that_ends_by_itself_are_removed_if_they_are_empty(
    tmp_path: Path,
) -> None:
    work = """
from pathlib import Path
from mjrun.shared_status import note_made_folder
for name in ("empty", "full"):
    Path(name).mkdir()
    note_made_folder(Path(name))
Path("full/x.csv").write_text("")
os._exit(7)"""
    assert outcome(start(work, tmp_path))[0] == 7
    assert [path.name for path in tmp_path.iterdir()] == ["full"]


def test_a_confined_child_that_dies_leaves_no_empty_folder_in_its_outputs(tmp_path: Path) -> None:
    for name in ("own", "out"):
        (tmp_path / name).mkdir()
    work = f"""
from mjrun.formats.output_writer import StagedFile
from pathlib import Path
make_promise(ConfinementPromise({str(tmp_path / "own")!r}, [{str(tmp_path / "out")!r}], 1000))
output = StagedFile(Path("out/a/b/x.csv"))
die(signal.SIGSEGV)"""
    assert outcome(start(work, tmp_path))[0] == 70
    assert [path.name for path in tmp_path.rglob("*")] == ["out"]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives orphans to an ancestor")
@pytest.mark.parametrize("ending", ["os._exit(0)", "die(signal.SIGSEGV)"])
def test_whatever_a_confined_child_has_started_ends_with_it(tmp_path: Path, ending: str) -> None:
    (tmp_path / "own").mkdir()
    work = f"""
make_promise(ConfinementPromise({str(tmp_path / "own")!r}, [], 1000))
into, out = os.pipe()
for _ in range(3):
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
            os.write(1, f"{{os.getpid()}} ".encode())
            os.write(out, b"x")
            time.sleep(1000)
        os._exit(0)
for _ in range(3): os.wait()
for _ in range(3): os.read(into, 1)
{ending}"""
    process = start(work, tmp_path)
    printed, _ = process.communicate(timeout=PATIENCE)
    pids = [int(pid) for pid in printed.split()]
    assert len(pids) == 3
    for pid in pids:
        assert_gone(int(pid))


def test_unfinished_outputs_and_processes_of_a_dead_one_are_removed(tmp_path: Path) -> None:
    work = """
from mjrun.child_process import ChildProcess
from mjrun.formats.output_writer import StagedFile
from pathlib import Path
output = StagedFile(Path("table.csv"))
child = ChildProcess(["sleep", "1000"])
print(child.pid, os.listdir("."), flush=True)
die(signal.SIGSEGV)
"""
    process = start(work, tmp_path)
    assert process.stdout
    printed = process.stdout.readline()
    assert outcome(process)[0] == 70
    assert ".part" in printed
    assert [*tmp_path.iterdir()] == []
    assert_gone(int(printed.split()[0]))


def test_temporary_files_of_a_dead_process_are_removed(tmp_path: Path) -> None:
    work = """
import tempfile
from mjrun.formats.temporary_output import scratch_folder
tempfile.tempdir = os.getcwd()
with scratch_folder() as folder:
    (folder / "copy.xml").touch()
    print(os.listdir("."), flush=True)
    die(signal.SIGSEGV)
"""
    process = start(work, tmp_path)
    assert process.stdout
    assert ".part" in process.stdout.readline()
    assert outcome(process)[0] == 70
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_child_that_hears_no_signal_is_killed(tmp_path: Path, number: signal.Signals) -> None:
    process = start("print(flush=True)\ntime.sleep(1000)", tmp_path)
    assert process.stdout
    process.stdout.readline()
    process.send_signal(number)
    said = "interrupted" if number == signal.SIGINT else f"ended by {number.name}"
    assert outcome(process) == (128 + number, f"mjrun: error: {said}\n")


def test_a_child_that_heard_the_signal_has_time_for_what_it_completes(tmp_path: Path) -> None:
    work = """
def end(number, frame):
    with completing():
        note_heard()
        time.sleep(1.5)
        print("completed", flush=True)
        os._exit(143)
signal.signal(signal.SIGTERM, end)
system.release_signals()
print(flush=True)
time.sleep(1000)
"""
    process = start(work, tmp_path)
    assert process.stdout
    process.stdout.readline()
    process.terminate()
    printed, _ = process.communicate(timeout=PATIENCE)
    assert (process.returncode, printed) == (143, "completed\n")


def test_a_child_that_heard_the_signal_and_does_not_end_is_killed(tmp_path: Path) -> None:
    work = """
from mjrun.formats.output_writer import StagedFile
output = StagedFile(Path("table.csv"))
def end(number, frame):
    note_heard()
signal.signal(signal.SIGTERM, end)
system.release_signals()
print(flush=True)
while True:
    time.sleep(1000)
"""
    process = start("from pathlib import Path" + work, tmp_path)
    assert process.stdout
    process.stdout.readline()
    process.terminate()
    assert outcome(process) == (143, "mjrun: error: ended by SIGTERM\n")
    assert [*tmp_path.iterdir()] == []


def test_what_a_child_could_not_clear_away_is_cleared_away(tmp_path: Path) -> None:
    work = """
from mjrun.formats.output_writer import StagedFile
output = StagedFile(Path("table.csv"))
def end(number, frame):
    note_heard()
    os._exit(143)
signal.signal(signal.SIGTERM, end)
system.release_signals()
print(flush=True)
time.sleep(1000)
"""
    process = start("from pathlib import Path" + work, tmp_path)
    assert process.stdout
    process.stdout.readline()
    process.terminate()
    assert outcome(process) == (143, "")
    assert [*tmp_path.iterdir()] == []


def test_the_child_dies_with_its_parent(tmp_path: Path) -> None:
    process = start("print(os.getpid(), flush=True)\ntime.sleep(1000)", tmp_path)
    assert process.stdout
    child = int(process.stdout.readline())
    process.kill()
    process.communicate(timeout=PATIENCE)  # once nobody holds its pipes any more
    assert_gone(child)


def test_a_child_is_starved_while_it_waits_for_a_core_and_has_hardly_computed() -> None:
    """A busy process is, until it has had its share; one that sleeps, or does not exist, is not."""
    busy, asleep = (
        subprocess.Popen([sys.executable, "-c", code]) for code in ("while True: pass", "import time; time.sleep(7200)")
    )
    try:
        monitor = crash_monitor._Monitor(busy.pid, ProcessActivityMemory(), [])
        now = time.monotonic()
        wait_until(lambda: crash_monitor._computed(busy.pid) > 1)
        monitor._ended_at = now + PATIENCE, crash_monitor._computed(busy.pid) + PATIENCE
        assert monitor._is_starved
        monitor._ended_at = now + PATIENCE, 0.0  # it has computed for longer than its share
        assert not monitor._is_starved
        monitor._ended_at = now - crash_monitor.STARVED, crash_monitor._computed(busy.pid) + PATIENCE
        assert not monitor._is_starved
        wait_until(lambda: not crash_monitor._is_runnable(asleep.pid))
    finally:
        for process in (busy, asleep):
            process.kill()
            process.wait()
    assert not crash_monitor._is_runnable(busy.pid)
    assert crash_monitor._computed(busy.pid) == math.inf
