"""Child processes, against real ones that misbehave."""

import contextlib
import gc
import math
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from mjrun.child_process import STDERR_LIMIT, STDOUT_LIMIT, ChildProcess, ExitStatus, limit_this_process, python_call
from mjrun.errors import FileError
from tests.cases import cases
from tests.processes import PATIENCE

MIB = 2**20
FOREVER = "import time; time.sleep(7200)"
READY = f"print('ready', flush=True); {FOREVER}"
PARENT = f"import subprocess, sys; print(subprocess.Popen([sys.executable, '-c', {FOREVER!r}]).pid, flush=True)"


def python(code: str, **how: object) -> ChildProcess:
    return ChildProcess([sys.executable, "-c", code], **how)  # type: ignore[arg-type]


def gone(pid: int) -> bool:
    """Tells whether a process has ended; zombies count as ended."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    return True


def eventually(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return condition()


# --- start ----------------------------------------------------------------------------------------


def test_a_python_call_has_the_parent_s_path_and_its_arguments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "stranger.py").write_text("def greet(*names):\n    import sys\n    print(*names, sys.path)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    child = ChildProcess(python_call("stranger:greet", "a b", "2"), stdout="capture")
    assert child.wait() == ExitStatus(0)
    assert child.stdout.decode() == f"a b 2 {sys.path}\n"


def test_a_python_call_can_have_a_path_of_its_own() -> None:
    child = ChildProcess(python_call("json:loads", "{}", path=["/nowhere"]), stderr="capture")
    assert child.wait().code == 1
    assert "No module named 'json'" in child.last_words


def test_the_environment_is_changed_and_variables_are_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MJRUN_OLD", "1")
    code = "import os; print(os.environ.get('MJRUN_OLD'), os.environ.get('MJRUN_NEW'), 'PATH' in os.environ)"
    child = python(code, environment={"MJRUN_OLD": None, "MJRUN_NEW": "2"}, stdout="capture")
    child.wait()
    assert child.stdout == b"None 2 True\n"


def test_only_named_descriptors_are_inherited_under_the_numbers_appended() -> None:
    ours, theirs = os.pipe()
    os.set_inheritable(ours, True)
    code = f"""
import os, sys
number = int(sys.argv[1])
os.write(number, b"hello")
try:
    os.fstat({ours})
except OSError:
    os.write(number, b", nothing else")
"""
    with python(code, descriptors=[theirs]) as child:
        os.close(theirs)
        assert child.wait() == ExitStatus(0)
    with os.fdopen(ours, "rb") as pipe:
        assert pipe.read() == b"hello, nothing else"


def test_standard_input_is_empty_and_the_session_is_its_own() -> None:
    child = python("import os, sys; print(repr(sys.stdin.read()), os.getsid(0) == os.getpid())", stdout="capture")
    child.wait()
    assert child.stdout == b"'' True\n"


def test_a_program_that_is_not_there_is_refused_by_the_system() -> None:
    with pytest.raises(FileNotFoundError):
        ChildProcess(["/nowhere/nothing"])


# --- death ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "text", "out_of_memory"),
    [
        ("", "ended with code 0", False),
        ("raise SystemExit(3)", "ended with code 3", False),
        ("import os; os.abort()", "was killed by SIGABRT", False),
        ("import os; os.kill(os.getpid(), 11)", "was killed by SIGSEGV", False),
        ("import os; os.kill(os.getpid(), 9)", "was killed by SIGKILL", True),
        (
            f"import os; os.kill(os.getpid(), {signal.SIGRTMIN + 1})",
            f"was killed by signal {signal.SIGRTMIN + 1}",
            False,
        ),
    ],
)
def test_how_a_process_ended_in_words(code: str, text: str, out_of_memory: bool) -> None:
    ending = python(code).wait()
    assert str(ending) == text
    assert ending.out_of_memory is out_of_memory


def test_the_last_line_on_standard_error_are_its_last_words() -> None:
    child = python("import sys; print('noise', file=sys.stderr); sys.exit('no device')", stderr="capture")
    assert child.wait().code == 1
    assert child.last_words == "no device"
    assert child.stdout == b""


# --- limits ---------------------------------------------------------------------------------------


def test_a_process_that_hangs_is_killed_when_its_time_is_up() -> None:
    child = python(FOREVER, stdout="capture")
    ending = child.wait(0.2)
    assert (ending.code, ending.cause, str(ending)) == (-signal.SIGKILL, "time", "did not end in time")
    assert not ending.out_of_memory
    assert gone(child.pid)


def test_a_process_that_fills_too_much_memory_is_killed() -> None:
    ending = python(f"memory = b'x' * {200 * MIB}; {FOREVER}").wait(PATIENCE, memory=100 * MIB)
    assert (ending.cause, ending.out_of_memory, str(ending)) == ("memory", True, "needed too much memory")


@cases("limits, code, text")
def test_a_process_can_limit_itself(limits: str, code: str, text: str, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(f"import math, os\nfrom mjrun.child_process import *\nos.chdir({str(tmp_path)!r})\n")
    with script.open("a") as file:
        file.write(f"limit_this_process(core=0)\nlimit_this_process({limits})\n{code}\n")
    child = ChildProcess(
        [sys.executable, str(script)], stderr="capture", environment={"PYTHONPATH": os.pathsep.join(sys.path)}
    )
    ending = child.wait(PATIENCE)
    assert text in f"{child.last_words} {ending}"


def test_limits_that_are_not_named_stay() -> None:
    before = [resource.getrlimit(kind) for kind in range(8)]
    limit_this_process()
    assert [resource.getrlimit(kind) for kind in range(8)] == before


# --- output ---------------------------------------------------------------------------------------


def test_a_flood_on_both_streams_is_taken_and_bounded() -> None:
    code = """
import sys
for i in range(3 * 2**8):
    sys.stdout.write("%08d" % i * 2**13)
    sys.stderr.write("%08d" % i * 2**13)
sys.stderr.write("last")
"""
    child = python(code, stdout="capture", stderr="capture")
    assert child.wait(PATIENCE) == ExitStatus(0)
    assert child.stdout == b"".join(b"%08d" % i * 2**13 for i in range(2**8))
    assert len(child.stdout) == STDOUT_LIMIT
    assert len(child.stderr) == STDERR_LIMIT
    assert child.stderr.endswith(b"0" * 5 + b"767last")


def test_captured_output_can_be_taken_piece_by_piece() -> None:
    code = "import sys; [sys.stdout.write(f'{i} ' * 100) for i in range(2000)]"
    with ChildProcess([sys.executable, "-c", code], stdout="capture", stdout_limit=math.inf) as child:
        pieces = [child.take_stdout()]
        while child.running:
            pieces.append(child.take_stdout())
        child.wait()
        pieces.append(child.take_stdout())
    assert b"".join(pieces) == "".join(f"{i} " * 100 for i in range(2000)).encode()
    assert child.take_stdout() == child.stdout == b""


def test_a_process_may_close_its_streams_early() -> None:
    child = python(
        "import os; os.close(1); os.close(2); import time; time.sleep(.2); os._exit(5)",
        stdout="capture",
        stderr="capture",
    )
    assert child.wait() == ExitStatus(5)


def test_output_can_go_to_a_file(tmp_path: Path) -> None:
    with (tmp_path / "log").open("w+b") as file:
        python("import os; print('out', flush=True); os.system('echo err >&2')", stdout=file, stderr=file).wait()
        file.seek(0)
        assert file.read() == b"out\nerr\n"


def test_a_grandchild_that_holds_the_pipe_is_killed_with_the_session() -> None:
    child = python(PARENT, stdout="capture")
    assert child.wait() == ExitStatus(0)
    assert eventually(lambda: gone(int(child.stdout)))


# --- end ------------------------------------------------------------------------------------------


def test_a_process_is_asked_to_end_before_it_is_killed() -> None:
    code = f"import signal, sys; signal.signal(signal.SIGTERM, lambda *_: sys.exit(7)); {READY}"
    child = python(code, stdout="capture")
    assert eventually(lambda: child.stdout == b"ready\n")
    assert child.end(grace=30) == ExitStatus(7, "ended")
    assert child.end() == ExitStatus(7, "ended")


def test_a_process_that_does_not_end_is_killed() -> None:
    child = python(f"import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); {READY}", stdout="capture")
    assert eventually(lambda: child.stdout == b"ready\n")
    assert child.end(grace=0.1) == ExitStatus(-signal.SIGKILL, "ended")
    assert gone(child.pid)


def test_ending_kills_what_the_process_has_started() -> None:
    with python(f"{PARENT}; {FOREVER}", stdout="capture") as child:
        assert eventually(lambda: child.stdout.endswith(b"\n"))
    assert gone(child.pid)
    assert eventually(lambda: gone(int(child.stdout)))


def test_another_thread_may_kill_what_is_waited_for() -> None:
    child = python(FOREVER)
    threading.Timer(0.2, child.kill).start()
    assert child.wait() == ExitStatus(-signal.SIGKILL, "ended")


def test_an_interrupt_leaves_no_process() -> None:
    child = python(FOREVER)
    threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        child.wait()
    assert gone(child.pid)


def test_a_process_that_nobody_holds_is_ended() -> None:
    child = python(FOREVER)
    pid = child.pid
    del child
    gc.collect()
    assert gone(pid)


def test_no_process_outlives_the_interpreter() -> None:
    start = f"child = ChildProcess([sys.executable, '-c', {FOREVER!r}])"
    code = f"import sys; from mjrun.child_process import ChildProcess; {start}; print(child.pid)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    assert out.stderr == ""
    assert gone(int(out.stdout))


def test_waiting_forever_costs_nothing_that_is_infinite() -> None:
    assert python("").wait(math.inf, math.inf) == ExitStatus(0)


def test_a_program_that_may_not_be_executed_is_named(tmp_path: Path) -> None:
    program = tmp_path / "python"
    program.touch(0o600)
    with pytest.raises(FileError, match=r"python: cannot be started; .*: Permission denied"):
        ChildProcess([str(program)])


# --- fed and idle ---------------------------------------------------------------------------------


def test_what_is_fed_arrives_whole(tmp_path: Path) -> None:
    content = os.urandom(2**20)
    with (tmp_path / "copy").open("wb") as copy:
        child = ChildProcess(["cat"], fed=True, stdout=copy)
        child.feed(memoryview(content)[:1000])
        child.feed(memoryview(content)[1000:])
        child.end_feeding()
        assert child.wait() == ExitStatus(0)
    assert (tmp_path / "copy").read_bytes() == content


def test_feeding_who_takes_nothing_any_more_fails() -> None:
    with python("pass", fed=True) as child:
        child.wait()
        with pytest.raises(BrokenPipeError):
            child.feed(memoryview(b"1"))


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjrun.child_process.IDLE_INTERVAL", 0.1)


@pytest.mark.usefixtures("impatient")
def test_who_takes_nothing_and_computes_nothing_is_killed() -> None:
    with python(FOREVER, fed=True) as child:
        with pytest.raises(BrokenPipeError):
            child.feed(memoryview(bytes(2**20)), idle=0.5)
        status = child.wait()
    assert status == ExitStatus(-signal.SIGKILL, "idle")
    assert str(status) == "did nothing any more"


@pytest.mark.usefixtures("impatient")
def test_who_ends_neither_nor_computes_is_killed() -> None:
    assert python(FOREVER).wait(idle=0.5).cause == "idle"


@pytest.mark.usefixtures("impatient")
def test_who_computes_or_waits_for_somebody_else_is_not_idle() -> None:
    busy = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'while True: pass'])"  # a child of it
    assert python(busy).wait(3, idle=2).cause == "time"
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with pytest.raises(BlockingIOError):  # noqa: PT012
        while True:
            os.write(writing, bytes(2**16))
    assert python(FOREVER, stdout=writing).wait(1, idle=0.2).cause == "time"
    os.close(reading)
    os.close(writing)


def test_an_end_does_not_wait_for_a_stranger_that_holds_a_pipe() -> None:
    stranger = "import os, time; os.setsid(); print(os.getpid(), flush=True); time.sleep(7200)"
    code = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {stranger!r}]); {FOREVER}"
    child = python(code, stdout="capture", stderr="capture")
    assert eventually(lambda: bool(child.stdout))
    pid = int(child.stdout)
    try:
        began = time.monotonic()
        child.end()
        assert time.monotonic() - began < PATIENCE
        assert not gone(pid)
    finally:
        os.kill(pid, signal.SIGKILL)
