"""Points of studies and evaluations in the process of the test: a separate one shows nothing more, and costs more."""

import threading
from collections import deque
from collections.abc import Iterator
from typing import Any

import pytest

from mjrun.study import isolation
from mjrun.study.point_server import PointSimulationServer
from mjrun.worker import PicklableException, Reply, Request

_alone = threading.Lock()  # the threads of an engine share MuJoCo's handler of warnings
_servers = list[PointSimulationServer]()  # of which another thread, where garbage is collected, must free no OpenGL


class WorkerHere:
    """A worker whose server is in this process, and answers when it is asked for replies."""

    def __init__(self) -> None:
        self.pending = deque[Request]()
        self._server = PointSimulationServer()
        _servers.append(self._server)
        self._values = deque[Any]()

    def send(self, name: str, *arguments: object) -> None:
        """Requests a method of the server."""
        self.pending.append(Request(name, arguments))

    def receive(self, seconds: float) -> Reply:
        """Returns the next reply to the oldest of the pending requests; nothing ends it after some `seconds`."""
        request = self.pending[0]
        if not self._values:
            try:
                with _alone:
                    value = getattr(self._server, request.name)(*request.arguments)
                    self._values.extend(value if isinstance(value, Iterator) else [value])
            except Exception as error:
                return Reply(self.pending.popleft(), None, PicklableException.of(error))
        value = self._values.popleft()
        if not self._values:
            self.pending.popleft()
        return Reply(request, value)

    def kill(self) -> None:
        """Does nothing: the test would end with it."""

    def close(self) -> None:
        """Forgets what was requested."""
        self.pending.clear()


def simulate_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets engines that are threads of this process simulate points in it."""
    monkeypatch.setattr(isolation, "new_worker", WorkerHere)
