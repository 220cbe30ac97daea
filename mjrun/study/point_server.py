"""The process that simulates points of a study: it may crash, hang or run out of memory, and costs nothing else.

It may start before its study is known, in a process that has not imported mujoco yet.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, cast

from mjrun.worker import Worker

if TYPE_CHECKING:
    from mjrun.python_code import Sealed
    from mjrun.study.spec import PointResult, Proof, StudyPoint, StudySpec

_waiting = deque[tuple[Path, Worker]]()  # for a study, and the folder from which they see relative paths


class PointServer:
    """Simulates points of one study."""

    def __init__(self) -> None:
        import_module("mjrun.study.simulate")  # while the study is prepared

    def open(self, sealed: "Sealed", root: Path) -> None:
        """Takes the study, whose files are in the folder `root`."""
        from mjrun.study.simulate import PointSimulator

        self._spec = cast("StudySpec", sealed.open()).with_files_in(root)
        self._simulator = PointSimulator(self._spec)

    def simulate(self, points: "Sequence[StudyPoint]") -> "Iterator[PointResult | Proof]":
        """Yields the result of each point, not in their order, and then what they were simulated with."""
        from mjrun.study.spec import Proof

        yield from self._simulator.run(points)
        yield Proof.here(self._spec.models(point.values for point in points))


def start_early() -> None:
    """Starts a worker that the next `new_worker` returns; until then it imports what simulations need."""
    _waiting.append((Path.cwd(), _started()))


def new_worker() -> Worker:
    """Returns a worker that waits for a study."""
    while _waiting:
        folder, worker = _waiting.popleft()
        if folder == Path.cwd() and worker.process.running:
            return worker
        worker.close()
    return _started()


def _started() -> Worker:
    return Worker("mjrun.study.point_server:PointServer")
