"""Server of the process that simulates points of a study; a crash, hang or lack of memory ends that process alone.

The process may start before its study is known, from a parent that has not imported mujoco.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, cast

from mjrun.child_process import may_fork
from mjrun.worker import Worker

if TYPE_CHECKING:
    from mjrun.python_code import PickledWithCode
    from mjrun.study.spec import PointResult, SimulatorSpec, StudyPoint, WorkerVersions

SIMULATION = "mjrun.study.simulate"  # which imports mujoco
FORKS = 8  # most copies of this process: more take longer than a study of few points

_waiting = deque[tuple[Path, Worker]]()  # workers without a study, and the folder of their relative paths


class PointSimulationServer:
    """A server that simulates points of one study."""

    def __init__(self) -> None:
        import_module(SIMULATION)  # while the parent prepares the study

    def open(self, pickled: "PickledWithCode", root: Path) -> None:
        """Opens the study, whose files are in the folder `root`."""
        self._spec = cast("SimulatorSpec", pickled.open()).stored_at(root)
        self._simulator = self._spec.simulator()

    def simulate(self, points: "Sequence[StudyPoint]") -> "Iterator[Sequence[PointResult] | WorkerVersions]":
        """Yields the results of points in any order, and finally the versions that they were simulated with."""
        from mjrun.study.spec import WorkerVersions

        yield from self._simulator.run(points)
        yield WorkerVersions.here(self._spec.models(point.values for point in points), self._spec.packages)


def start_early(count: int) -> None:
    """Starts workers for the next calls of `new_worker`.

    Copies of this process, which has to import what they need in any case, take milliseconds each. Where it must not
    be copied, a single new interpreter imports it meanwhile.
    """
    if may_fork():
        import_module(SIMULATION)
        import_module("mujoco.introspect.structs")  # which metrics need
    if may_fork():
        _waiting.extend((Path.cwd(), _started(is_fork=True)) for _ in range(min(count, FORKS)))
    else:
        _waiting.append((Path.cwd(), _started()))


def new_worker() -> Worker:
    """Returns a worker without a study."""
    while True:
        try:
            folder, worker = _waiting.popleft()
        except IndexError:
            return _started()
        if folder == Path.cwd() and worker.process.running:
            worker.process.capture()
            return worker
        worker.close()


def _started(*, is_fork: bool = False) -> Worker:
    return Worker("mjrun.study.point_server:PointSimulationServer", is_fork=is_fork)
