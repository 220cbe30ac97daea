"""Whatever ends the process that works, its parent says what it was, with the right exit code."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

HEAD = """
import os, signal, sys, time
from mjrun.activity import completing, doing, note_child, note_heard
from mjrun.cli.watcher import listen, watched
def die(number):
    os.kill(os.getpid(), number)
def work():
"""
TAIL = """
signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
sys.exit(watched(work))
"""


def start(work: str, folder: Path) -> "subprocess.Popen[str]":
    """A process that watches a child in which the body of a function runs."""
    body = "".join(f"    {line}\n" for line in work.splitlines())
    pipe = subprocess.PIPE
    script = [sys.executable, "-c", HEAD + body + TAIL]
    return subprocess.Popen(script, cwd=folder, stdout=pipe, stderr=pipe, text=True, start_new_session=True)


def outcome(process: "subprocess.Popen[str]") -> tuple[int, str]:
    """Exit code and standard error."""
    _, errors = process.communicate(timeout=60)
    return process.returncode, errors


def assert_gone(pid: int) -> None:
    """A process ends soon; then it has no command line any more, even if nobody waits for it."""
    line, deadline = Path(f"/proc/{pid}/cmdline"), time.monotonic() + 60
    while line.exists() and line.read_bytes() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert time.monotonic() < deadline


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
        ("compiling", "SIGKILL", 3, "memory ran out: the process was killed while compiling robot.xml"),
        ("simulating", "SIGXCPU", 128 + signal.SIGXCPU, "ended by SIGXCPU while simulating robot.xml"),
    ],
)
def test_a_death_is_told_with_what_died_and_what_to_do(
    tmp_path: Path, activity: str, number: str, code: int, said: str
) -> None:
    ended, message = outcome(start(f"with doing({activity!r}, 'robot.xml'): die(signal.{number})", tmp_path))
    first, *rest = message.splitlines()
    assert ended == code
    assert first.startswith(f"mjrun: error: {said}")
    assert number in first or number == "SIGKILL"
    assert bool(rest) == (number != "SIGXCPU")


@pytest.mark.parametrize(
    ("activity", "number", "code", "said"),
    [
        ("reading", "SIGALRM", 3, "while reading robot.xml: it took longer than its limit allows"),
        ("", "SIGXCPU", 4, ": it computed for longer than its limit allows"),
    ],
)
def test_a_limit_of_a_confined_process_is_told_with_its_option_and_nothing_is_left(
    tmp_path: Path, activity: str, number: str, code: int, said: str
) -> None:
    own = tmp_path / "own"
    own.mkdir()
    (own / "file").write_text("")
    work = f"""
from mjrun.activity import note_temporary
note_temporary({str(own)!r})
with doing({activity!r}, "robot.xml"): die(signal.{number})"""
    ended, message = outcome(start(work, tmp_path))
    assert ended == code
    assert said in message
    assert "--limit time=" in message
    assert not own.exists()


def test_unfinished_outputs_and_processes_of_a_dead_one_are_removed(tmp_path: Path) -> None:
    work = """
from mjrun.child_process import ChildProcess
from mjrun.formats.destinations import StagedFile
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
listen()
print(flush=True)
time.sleep(1000)
"""
    process = start(work, tmp_path)
    assert process.stdout
    process.stdout.readline()
    process.terminate()
    printed, _ = process.communicate(timeout=60)
    assert (process.returncode, printed) == (143, "completed\n")


def test_a_child_that_heard_the_signal_and_does_not_end_is_killed(tmp_path: Path) -> None:
    work = """
from mjrun.formats.destinations import StagedFile
output = StagedFile(Path("table.csv"))
def end(number, frame):
    note_heard()
signal.signal(signal.SIGTERM, end)
listen()
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
from mjrun.formats.destinations import StagedFile
output = StagedFile(Path("table.csv"))
def end(number, frame):
    note_heard()
    os._exit(143)
signal.signal(signal.SIGTERM, end)
listen()
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
    process.communicate(timeout=60)  # once nobody holds its pipes any more
    assert_gone(child)
