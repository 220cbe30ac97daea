"""Server of the process that simulates points of a study; a crash, hang or lack of memory ends that process alone.

The process may start before its study is known, from a parent that has not imported mujoco.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, cast

from mjrun.worker import Worker

if TYPE_CHECKING:
    from mjrun.python_code import Sealed
    from mjrun.study.spec import PointResult, StudyPoint, StudySpec, WorkerVersions

_waiting = deque[tuple[Path, Worker]]()  # workers without a study, and the folder of their relative paths


class PointServer:
    """A server that simulates points of one study."""

    def __init__(self) -> None:
        import_module("mjrun.study.simulate")  # while the parent prepares the study

    def open(self, sealed: "Sealed", root: Path) -> None:
        """Opens the study, whose files are in the folder `root`."""
        from mjrun.study.simulate import PointSimulator

        spec = cast("StudySpec", sealed.open())
        snapshot = spec.base.snapshot and replace(spec.base.snapshot, root=root)
        self._spec = replace(spec, base=replace(spec.base, snapshot=snapshot))
        self._simulator = PointSimulator(self._spec)

    def simulate(self, points: "Sequence[StudyPoint]") -> "Iterator[PointResult | WorkerVersions]":
        """Yields the result of each point in any order, and finally the versions that they were simulated with."""
        from mjrun.study.spec import WorkerVersions

        yield from self._simulator.run(points)
        yield WorkerVersions.here(self._spec.models(point.values for point in points))


def start_early() -> None:
    """Starts a worker for the next `new_worker` to return; it imports what simulations need in the meantime."""
    _waiting.append((Path.cwd(), _started()))


def new_worker() -> Worker:
    """Returns a worker without a study."""
    while _waiting:
        folder, worker = _waiting.popleft()
        if folder == Path.cwd() and worker.process.running:
            return worker
        worker.close()
    return _started()


def _started() -> Worker:
    return Worker("mjrun.study.point_server:PointServer")
