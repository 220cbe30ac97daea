"""Workers: requests and replies, limits, and what comes back of a process that fails or dies."""

import gc
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from mjrun.errors import DrawError, InvalidActionError, MjrunError, NoRendererError, UnknownNameError, UnstableError
from mjrun.worker import PicklableException, Request, StreamingServer, Worker, WorkerEndedError
from tests.prepared_interpreters import COMMAND, MODULES
from tests.processes import PATIENCE, wait_until

ROOT = Path(__file__).parents[1]
ERRORS = [
    MjrunError("something"),
    DrawError("OpenGL refused"),
    UnstableError(7, 0.5, "qpos", "hinge", 0.002),
    NoRendererError({"egl": "is not there"}, "install it"),
    UnknownNameError("camera", "sdie", ["side", "top"]),
    InvalidActionError(3, 0.5, "p.onnx", {"knee": float("nan")}),
]


class Server:
    """The requests that the workers of these tests answer."""

    def echo(self, *values: object) -> tuple[object, ...]:
        return values

    def count(self, number: int, last: str = "") -> Iterator[int]:
        yield from range(number)
        if last:
            getattr(self, last)()

    def process(self) -> tuple[int, str | None]:
        return os.getpid(), os.environ.get("OPENBLAS_NUM_THREADS")

    def refuse(self) -> None:
        error = UnstableError(7, 0.5, "qpos", "hinge", 0.002)
        error.add_note("in the third")
        raise error

    def divide(self) -> float:
        return 1 / 0

    def load(self) -> None:
        import mujoco  # noqa: F401

    def warn(self) -> None:
        import mujoco

        model = mujoco.MjModel.from_xml_string(
            '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
        )
        data = mujoco.MjData(model)
        data.qpos[:] = float("nan")
        mujoco.mj_step(model, data)

    def hang(self) -> None:
        time.sleep(PATIENCE)

    def crash(self) -> None:
        print("printed", flush=True)  # noqa: T201
        print("out of luck", file=sys.stderr, flush=True)  # noqa: T201
        os.abort()


class HostileServer(StreamingServer):
    """A server whose process a model has taken over."""

    def send(self, item: object) -> str:
        self.send_item(item)
        return "sent"

    def write(self, message: str) -> None:
        os.write(int(sys.argv[-1]), bytes.fromhex(message))
        os._exit(3)


class Touch:
    """Creates a file when it is unpickled."""

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (Path("run"),)


@pytest.fixture(params=["new", "prepared"])
def worker(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Worker]:
    """A new interpreter, and a copy of a prepared one, which behaves alike."""
    if request.param == "prepared":
        monkeypatch.setitem(MODULES, "tests.test_worker:Server", ("tests.test_worker",))
    with closing(Worker("tests.test_worker:Server")) as made:
        yield made


def raised(error: Exception) -> Exception:
    try:
        raise error
    except Exception as caught:
        return caught


# --- requests ---------------------------------------------------------------------------------------


def test_requests_are_answered_in_their_order_by_a_process_with_one_thread(worker: Worker) -> None:
    worker.send("echo", 1, "two")
    worker.send("process")
    assert [*worker.pending] == [Request("echo", (1, "two")), Request("process", ())]
    assert worker.receive().value == (1, "two")
    reply = worker.receive()
    assert reply.value == (worker.process.pid, "1")
    assert (reply.failure, reply.warnings, reply.is_last) == (None, [], True)
    assert not worker.pending
    assert worker.ask("echo") == ()


def test_items_arrive_one_by_one_before_the_answer(worker: Worker) -> None:
    worker.send("count", 2)
    worker.send("echo")
    replies = [worker.receive() for _ in range(4)]
    assert [(reply.request.name, reply.value, reply.is_last) for reply in replies] == [
        ("count", 0, False),
        ("count", 1, False),
        ("count", None, True),
        ("echo", (), True),
    ]


def test_what_a_method_raises_is_raised_here_and_the_next_request_is_answered(worker: Worker) -> None:
    with pytest.raises(UnstableError) as caught:
        worker.ask("refuse")
    assert (caught.value.step, caught.value.__notes__) == (7, ["in the third"])
    for name in ("divide", "no_such_method"):
        with pytest.raises(MjrunError, match=f"^a bug in mjrun: .*{name[:3]}"):
            worker.ask(name)
    worker.send("count", 1, "divide")
    assert worker.receive().value == 0
    assert worker.receive().failure is not None
    assert worker.ask("echo") == ()


def test_warnings_of_mujoco_come_with_the_reply(worker: Worker) -> None:
    worker.ask("load")
    worker.send("warn")
    (text,) = worker.receive().warnings
    assert "Nan, Inf or huge value in QPOS" in text


@pytest.mark.parametrize(
    "message",
    [pickle.dumps((Touch(), None, (), True)), b"not JSON", b"5", b"[1, 2, 3, 4, 5]", b"[" * 10**5, b""],
)
def test_what_an_untrusted_worker_sends_is_json_and_runs_nothing(message: bytes) -> None:
    content = len(message).to_bytes(4, "big") + message if message else bytes([127, 255, 255, 255])
    with closing(Worker("tests.test_worker:HostileServer", encoding="json")) as worker:
        worker.send("send", {"a": [1]})
        assert [worker.receive()[1:] for _ in range(2)] == [({"a": [1]}, None, [], False), ("sent", None, [], True)]
        worker.send("write", content.hex())
        with pytest.raises(WorkerEndedError, match=r"^ended with code 3$"):
            worker.receive()
    assert not Path("run").exists()


@pytest.mark.usefixtures("new_interpreters")
@pytest.mark.parametrize("server", sorted({*MODULES} - {COMMAND}))
def test_servers_that_other_tests_ask_in_prepared_interpreters_answer_in_new_ones(server: str) -> None:
    descriptors = os.pipe() if server.endswith("CompositorServer") else ()
    with closing(Worker(server, descriptors=descriptors)) as worker:
        with pytest.raises(MjrunError, match="has no attribute 'no_such_method'"):
            worker.ask("no_such_method")
        command = Path(f"/proc/{worker.process.pid}/cmdline")
        assert not command.exists() or server.encode() in command.read_bytes()
    for descriptor in descriptors:
        os.close(descriptor)


# --- death ------------------------------------------------------------------------------------------


def test_a_worker_that_dies_is_told_with_its_last_words(worker: Worker) -> None:
    worker.send("crash")
    worker.send("echo")
    with pytest.raises(WorkerEndedError, match=r"^was killed by SIGABRT: out of luck$") as caught:
        worker.receive()
    assert caught.value.ending.code == -signal.SIGABRT
    with pytest.raises(WorkerEndedError):
        worker.ask("echo")


def test_a_worker_that_is_silent_for_too_long_is_killed(worker: Worker) -> None:
    assert worker.ask("echo", seconds=PATIENCE) == ()
    with pytest.raises(WorkerEndedError, match=r"^did not end in time$"):
        worker.ask("hang", seconds=0.1)


def test_a_server_that_cannot_be_made_says_why() -> None:
    with closing(Worker("tests.nowhere:Server")) as worker, pytest.raises(WorkerEndedError, match="No module named"):
        worker.ask("echo")


@pytest.mark.parametrize(("name", "code"), [("echo", 0), ("hang", 1)])
def test_a_worker_ends_when_its_parent_hangs_up_however_busy_it_is(worker: Worker, name: str, code: int) -> None:
    worker.ask("echo")
    worker.send(name)
    worker.connection.close()
    assert worker.process.wait(PATIENCE).code == code


def test_a_worker_ends_at_once_when_it_is_closed(worker: Worker) -> None:
    worker.send("hang")
    worker.close()
    assert not worker.process.running
    worker.close()


def test_a_system_that_refuses_leaves_nothing_open(monkeypatch: pytest.MonkeyPatch) -> None:
    gc.collect()  # what other tests left open
    before = len([*Path("/proc/self/fd").iterdir()])
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(FileNotFoundError):
        Worker("tests.test_worker:Server")
    wait_until(lambda: len([*Path("/proc/self/fd").iterdir()]) == before)


# --- failures ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_an_error_of_mjrun_arrives_as_it_was(error: MjrunError) -> None:
    error.add_note("somewhere")
    arrived = pickle.loads(pickle.dumps(PicklableException.of(raised(error)))).error("a bug", DrawError)
    assert type(arrived) is type(error)
    assert (str(arrived), arrived.args, arrived.exit_code) == (str(error), error.args, error.exit_code)
    assert (vars(arrived), arrived.spelled(str)) == (vars(error), error.spelled(str))
    assert "in raised" in str(arrived.__cause__)


@pytest.mark.parametrize("kind", [MjrunError, DrawError])
def test_anything_else_is_a_bug_with_its_place(kind: type[MjrunError]) -> None:
    error = PicklableException.of(raised(ValueError("so"))).error("a bug, drawing", kind)
    assert type(error) is kind
    assert str(error).startswith("a bug, drawing: ValueError: so (test_worker.py:")


def test_what_a_bug_says_cannot_write_to_a_terminal() -> None:
    assert "\x1b" not in str(PicklableException.of(raised(ValueError("\x1b[31mred"))).error("a bug"))


FORKS = """
import os, signal, sys, threading
from tests.test_worker import ForkServer
from mjrun.child_process import may_fork
from mjrun.worker import Worker, WorkerEndedError

signal.signal(signal.SIGTERM, lambda *_: None)
print("unwritten", end="")
inherited = os.open("/dev/null", os.O_RDONLY)
ForkServer.imported = "by the parent"
assert may_fork()
first, second = (Worker("tests.test_worker:ForkServer", environment={"MJRUN_NEW": "2"}, is_fork=True) for _ in range(2))
assert may_fork()  # still: nothing reads their output yet
for worker in (first, second):
    assert worker.ask("facts", inherited) == ("by the parent", os.getpid(), "2", False, True)
os.kill(second.process.pid, signal.SIGTERM)  # which this process ignores
try:
    second.ask("facts", inherited)
except WorkerEndedError as error:
    assert error.ending.signal == "SIGTERM"
try:
    first.ask("stumble")
except WorkerEndedError as error:
    assert str(error) == "ended with code 3: last words", error
threading.Thread(target=threading.Event().wait, daemon=True).start()
assert not may_fork()
"""


class ForkServer:
    """The requests that copies of a process answer."""

    imported = "anew"

    def facts(self, descriptor: int) -> tuple[str, int, str | None, bool, bool]:
        """Returns facts about this process, of which each would differ in a new interpreter or in an unchanged copy."""
        try:
            os.fstat(descriptor)
            is_open = True
        except OSError:
            is_open = False
        is_default = signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
        return self.imported, os.getppid(), os.environ.get("MJRUN_NEW"), is_open, is_default

    def stumble(self) -> None:
        sys.stderr.write("last words")
        sys.stderr.flush()
        os._exit(3)


@pytest.mark.skipif(sys.platform != "linux", reason="workers are copies on Linux only")
def test_copies_of_a_process_share_its_modules_and_nothing_else() -> None:
    done = subprocess.run([sys.executable, "-c", FORKS], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "unwritten"
