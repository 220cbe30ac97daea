"""Worker processes: each has a server, an object whose methods answer the requests of its parent one after the other.

Workers are new interpreters that never import `__main__`, so that any script or notebook can start them; or copies of
a process that has imported their modules but none of the user's. A worker ends when its parent hangs up or dies,
however busy it is.
"""

import contextlib
import gc
import json
import math
import os
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from importlib import import_module
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection, Listener, Pipe, wait
from typing import Any, Literal, NamedTuple, NoReturn, cast

from mjrun.child_process import (
    ENVIRONMENT,
    IDLE_INTERVAL,
    ChildProcess,
    ExitStatus,
    Idleness,
    Stream,
    limit_this_process,
    python_call,
)
from mjrun.dataclass import dataclass
from mjrun.errors import MjrunError, exception_text, system_limit
from mjrun.platform import system

ACCEPT_INTERVAL = 0.05  # [s] between two looks at whether a process that is to connect has ended
STRANGER = (AuthenticationError, EOFError, OSError)  # what a connection of another process raises
GRACE = 1.0  # [s] from when the parent hangs up until a busy worker ends
DEATH_GRACE = 10.0  # [s] for a process to end after it has hung up
MESSAGE_LIMIT = 2**24  # bytes of a message in JSON
GARBAGE = 700  # objects between two searches for garbage, as Python's default; a copy of a command has more

Encoding = Literal["pickle", "json"]


@dataclass(frozen=True)
class PicklableException:
    """An exception in a form that can be pickled: not every class can be called with its instances' `args`.

    Attributes:
      kind: its class; None for a bug, which is anything but an MjrunError.
      args: the arguments of the exception; for a bug, its message alone.
      attributes: the other attributes of the exception.
      trace: the traceback as text.
    """

    kind: type[MjrunError] | None
    args: tuple[object, ...]
    attributes: dict[str, Any]
    trace: str

    @classmethod
    def of(cls, error: Exception) -> "PicklableException":
        """Returns the picklable form of an exception."""
        trace = "".join(traceback.format_exception(error))
        error = error if isinstance(error, MjrunError) else system_limit(error) or error
        if isinstance(error, MjrunError):
            return cls(type(error), error.args, dict(vars(error)), trace)
        return cls(None, (exception_text(error),), {}, trace)

    def error(self, beginning: str, bug: type[MjrunError] = MjrunError) -> MjrunError:
        """Returns the exception to raise in the parent: a bug is a `bug` whose message has this `beginning`."""
        if self.kind is None:
            error = bug(f"{beginning}: {self.args[0]}")
        else:
            error = self.kind.__new__(self.kind, *self.args)
            vars(error).update(self.attributes)
        error.__cause__ = RuntimeError(f"in another process:\n{self.trace}")
        return error


class WorkerEndedError(Exception):
    """A worker has ended, or was ended since it did not answer in time; as text, the end of a sentence about it.

    Attributes:
      ending: how it ended.
    """

    def __init__(self, ending: ExitStatus, last_words: str) -> None:
        self.ending = ending
        super().__init__(f"{ending}: {last_words}" if last_words and ending.cause is None else str(ending))


class Request(NamedTuple):
    """A request: a method of the server, by name, and its arguments."""

    name: str
    arguments: tuple[Any, ...]


class Reply(NamedTuple):
    """A reply to a request.

    Attributes:
      request: the request.
      value: what the method returned, or one of the items that it yields.
      failure: why the method failed.
      warnings: those of MuJoCo meanwhile.
      is_last: whether the request is answered; False for an item.
    """

    request: Request
    value: Any
    failure: PicklableException | None = None
    warnings: Sequence[str] = ()
    is_last: bool = True


class StreamingServer:
    """A server whose methods can send items of their reply at any time.

    Attributes:
      send_item: sends an item to the parent.
    """

    send_item: Callable[[object], None]


class Worker:
    """A worker process, as its parent sees it. To be closed.

    The constructor does not wait for it to start, except on systems where it cannot pass it a connection.

    Args:
      server: its class, `package.module:name`, which the process calls with the numbers of `descriptors`.
      environment: variables to change.
      descriptors: descriptors to pass to the process, which get new numbers.
      stderr: where its standard error goes, and its standard output with it.
      is_fork: whether it is a copy of this process, which starts at once; see `child_process.may_fork`.
      encoding: that of messages: `json` for a process that is not to be trusted, since unpickling runs code.
      path: the search path for modules; by default, that of this process.

    Attributes:
      connection: the connection to the process.
      process: the process.
      pending: the requests that are not answered, oldest first.

    Raises:
      FileError: the program may not be executed.
      OSError: the system refuses.
    """

    def __init__(
        self,
        server: str,
        *,
        environment: Mapping[str, str] = ENVIRONMENT,
        descriptors: Sequence[int] = (),
        stderr: Stream = "capture",
        is_fork: bool = False,
        encoding: Encoding = "pickle",
        path: Sequence[str] | None = None,
    ) -> None:
        self.pending = deque[Request]()
        self._encoding: Encoding = encoding
        if not system.PASSES_DESCRIPTORS:
            command = python_call("mjrun.worker:serve_by_address", server, encoding, path=path)
            self.process, self.connection = _called_back(command, environment, descriptors, stderr)
            return
        self.connection, theirs = Pipe()
        with contextlib.ExitStack() as stack, theirs:
            stack.callback(self.connection.close)
            self.process = ChildProcess(
                python_call("mjrun.worker:serve", server, encoding, path=path),
                environment=environment,
                descriptors=[theirs.fileno(), *descriptors],
                stderr=stderr,
                run_in_fork=partial(serve, server, encoding) if is_fork else None,
            )
            stack.pop_all()

    def send(self, name: str, *arguments: object) -> None:
        """Requests a method of the server, which `receive` returns the replies of."""
        self.pending.append(Request(name, arguments))
        with contextlib.suppress(OSError):  # it has ended; `receive` says how
            _send(self.connection, self._encoding, (name, arguments))

    def receive(self, seconds: float = math.inf, idle: float = math.inf) -> Reply:
        """Returns the next reply to the oldest of the pending requests.

        Args:
          seconds: the time without a message after which it is killed.
          idle: the time without a message or computing after which it is killed, as in `replying`.

        Raises:
          WorkerEndedError: the process has ended.
        """
        try:
            if idle < math.inf:
                replying([self], idle)
            if self.connection.poll(None if seconds == math.inf else seconds):
                reply = Reply(self.pending[0], *_receive(self.connection, self._encoding))
                if reply.is_last:
                    self.pending.popleft()
                return reply
            self.process.kill("time")
        except (EOFError, OSError, TypeError):  # the last from a reply of another form
            pass
        raise WorkerEndedError(self.process.wait(DEATH_GRACE), self.process.last_words)

    def ask(self, name: str, *arguments: object, seconds: float = math.inf) -> Any:
        """Returns what a method of the server answers, while no other request is pending.

        Raises:
          WorkerEndedError: as in `receive`.
          MjrunError: the method raises it; anything else that it raises is a bug.
        """
        self.send(name, *arguments)
        reply = self.receive(seconds)
        if reply.failure:
            raise reply.failure.error("a bug in mjrun")
        return reply.value

    def kill(self) -> None:
        """Ends the process, which `receive` reports; callable from any thread."""
        self.process.kill()

    def close(self) -> None:
        """Ends the process, even if it is busy."""
        self.process.end()
        self.connection.close()


def replying(workers: Sequence[Worker], idle: float, *, block: bool = True) -> list[Worker]:
    """Returns those of `workers` that have sent a reply or have ended, for `Worker.receive`.

    Args:
      idle: the time [s] without a reply and without computing after which a worker with pending requests is killed.
      block: wait for the first reply.
    """
    idleness = {worker: Idleness(worker.process.pid, idle) for worker in workers if worker.pending}
    by_connection = {worker.connection: worker for worker in workers}
    while True:
        ready = wait(list(by_connection), IDLE_INTERVAL if block else 0)
        if ready or not block:
            return [worker for connection, worker in by_connection.items() if connection in ready]
        for worker, seconds in idleness.items():
            if seconds.exceeds(IDLE_INTERVAL):
                worker.process.kill("idle")


def _send(connection: Connection, encoding: Encoding, message: object) -> None:
    if encoding == "json":
        connection.send_bytes(json.dumps(message).encode())
    else:
        connection.send(message)


def _receive(connection: Connection, encoding: Encoding) -> Sequence[Any]:
    """Returns the next message; anything but JSON ends an untrusted connection like a hang-up."""
    if encoding == "pickle":
        return connection.recv()
    try:
        return json.loads(connection.recv_bytes(MESSAGE_LIMIT))
    except (ValueError, RecursionError):
        raise EOFError from None


def _called_back(
    command: Sequence[str], environment: Mapping[str, str], descriptors: Sequence[int], stderr: Stream
) -> tuple[ChildProcess, Connection]:
    """Starts a worker that connects to this process: to an address, with a key, that its standard input tells it."""
    key = os.urandom(32)
    with contextlib.ExitStack() as stack, Listener(authkey=key) as listener:
        process = ChildProcess(
            command,
            environment=environment,
            descriptors=descriptors,
            fed=True,
            stderr=stderr,
        )
        stack.callback(process.end)
        with contextlib.suppress(OSError):  # it has ended; `receive` says how
            process.feed(memoryview(f"{json.dumps([listener.address, key.hex()])}\n".encode()))
        connection = _accepted(listener, key, process)
        stack.pop_all()
        return process, connection


def _accepted(listener: Listener, key: bytes, process: ChildProcess) -> Connection:
    """Returns the connection that a process makes; one whose other end is closed if the process ends instead."""
    has_accepted = threading.Event()

    def connect_in_its_place() -> None:
        while not has_accepted.wait(ACCEPT_INTERVAL):
            if not process.running:
                with contextlib.suppress(*STRANGER):
                    Client(listener.address, authkey=key).close()
                return

    threading.Thread(target=connect_in_its_place, daemon=True).start()
    try:
        while True:
            with contextlib.suppress(*STRANGER):
                return listener.accept()
    finally:
        has_accepted.set()


def serve(server: str, encoding: Encoding, connection: str, *descriptors: str) -> NoReturn:
    """Runs a worker: answers what the other end of the descriptor `connection` requests, until it hangs up."""
    parent = Connection(int(connection))
    _serve(server, encoding, parent, parent.fileno(), [*map(int, descriptors)])


def serve_by_address(server: str, encoding: Encoding) -> NoReturn:
    """Runs a worker that connects to the address on its standard input, which stays open while its parent lives."""
    address, key = json.loads(sys.stdin.readline())
    address = address if isinstance(address, str) else (address[0], address[1])  # JSON has no tuples
    _serve(server, encoding, Client(address, authkey=bytes.fromhex(key)), sys.stdin.fileno(), ())


def _serve(server: str, encoding: Encoding, parent: Connection, lifeline: int, descriptors: Sequence[int]) -> NoReturn:
    """Answers requests of the parent until it hangs up, which closes the other end of `lifeline` too."""
    with contextlib.suppress(OSError):  # without a stderr, what drivers and plugins print on stdout is lost
        os.dup2(2, 1)
    limit_this_process(core=0)
    threading.Thread(target=_end_with_parent, args=(lifeline,), daemon=True).start()
    gc.disable()  # modules are no garbage
    module, _, name = server.partition(":")
    methods = getattr(import_module(module), name)(*descriptors)
    send = partial(_send, parent, encoding)
    if isinstance(methods, StreamingServer):
        methods.send_item = lambda item: send((item, None, (), False))
    gc.freeze()
    gc.set_threshold(GARBAGE)
    gc.enable()
    with contextlib.suppress(EOFError, ConnectionError), parent:
        while True:
            _answer(send, methods, *_receive(parent, encoding))
    with contextlib.suppress(OSError):
        sys.stdout.flush()
    os._exit(0)  # nothing is left to do, and shutting down an interpreter takes time


def _end_with_parent(lifeline: int) -> None:
    """Ends this process, however busy, soon after the parent has hung up."""
    system.wait_for_hangup(lifeline)
    time.sleep(GRACE)
    os._exit(1)


def _answer(send: Callable[[object], None], methods: object, name: str, arguments: Sequence[Any]) -> None:
    value, failure, texts = None, None, list[str]()
    try:
        with _collected_warnings() as texts:
            method: Callable[..., object] = getattr(methods, name)
            value = method(*arguments)
            if isinstance(value, Iterator):
                for item in cast("Iterator[object]", value):
                    send((item, None, (), False))
                value = None
    except Exception as error:
        value, failure = None, PicklableException.of(error)
    send((value, failure, texts, True))


def _collected_warnings() -> contextlib.AbstractContextManager[list[str]]:
    """Collects the warnings of MuJoCo, where it is used."""
    if "mujoco" not in sys.modules:
        return contextlib.nullcontext([])
    from mjrun.model.mujoco_globals import collected_warnings

    return collected_warnings()
