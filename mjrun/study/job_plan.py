"""Plans of studies: the ranges of missing points, for tasks that run independently of each other.

Each task computes the values of its points from their numbers, and opens only the results of these points.
"""

import time
from collections.abc import Mapping, Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean
from mjrun.reporter import Reporter
from mjrun.study.executors import check_engine
from mjrun.study.part_files import points_digest
from mjrun.study.point_files import PointFileMaker
from mjrun.study.prepared import PreparedStudy
from mjrun.study.spec import versions
from mjrun.study.study import Study

SCHEMA = "mjrun-plan-2"
BLOCKS = 4  # blocks of points of each task, since slow points are often neighbours
MOST_RANGES = 1000  # in a plan: closer ones are joined, and tasks skip the points that are known
DESIGN = "points"  # in the identity of a plan: the hash of the values of all points

Range = tuple[int, int]  # the first point, and that after the last


@dataclass(frozen=True)
class JobPlan:
    """The plan of a job array: the points of a study that remain to be simulated.

    Attributes:
      study: study as it will be collected.
      identity: hashes of everything that determines the results.
      ranges: ranges that contain all of these points, ascending.
    """

    study: Study
    identity: Mapping[str, str]
    ranges: Sequence[Range]

    @property
    def count(self) -> int:
        """The number of points in all ranges."""
        return sum(stop - first for first, stop in self.ranges)


@dataclass(frozen=True)
class JobTaskResult:
    """The result of one task of a job array.

    Attributes:
      path: folder of the study.
      task, tasks: number of the task, from 1, and number of tasks.
      points: number of points in its share.
      simulated: number of them that were simulated now; the others were known.
      statuses: number of simulated points by status.
      missing: number of points that have no result yet, as after the time budget.
      wall: wall time [s].
    """

    path: str
    task: int
    tasks: int
    points: int
    simulated: int
    statuses: Mapping[str, int]
    missing: int
    wall: float


def plan(study: Study) -> JobPlan:
    """Plans the missing points of a study, and creates its folder, so that it can be collected.

    Raises:
      UsageError: a name is unknown, or a value is invalid.
      FileError: the folder cannot be created, or a file cannot be read.
    """
    prepared = PreparedStudy(study, study.spec)
    PointFileMaker(study, prepared)  # which checks the options of kept files
    ranges = ranges_of(np.array(prepared.missing(study.retry_failed), np.int64))
    prepared.files.create()
    return JobPlan(study, _hashes(prepared), ranges)


def run_task(plan: JobPlan, task: int, tasks: int, reporter: Reporter) -> JobTaskResult:
    """Simulates the points of one of `tasks` equal parts of a plan, and publishes them in chunks.

    Raises:
      UsageError: something that determines the results has changed since the plan was made.
      FileError: results cannot be written.
    """
    start = time.perf_counter()
    study, points = plan.study, task_points(plan.ranges, task, tasks)
    statuses: Mapping[str, int] = {}
    missing = 0
    if len(points):
        prepared = PreparedStudy(study, study.spec)
        _require_identity(prepared, plan.identity)
        if points[-1] >= len(prepared.points.points):
            raise UsageError(f"the plan has a point {points[-1]}, but its study has {len(prepared.points.points)}")
        check_engine(study.engine, prepared.folder)
        prepared.numbers = points
        prepared.files.bounds = task_blocks(points)
        prepared.files.create()
        prepared.warn(reporter)
        statuses = prepared.simulate(prepared.missing(study.retry_failed), study, reporter)
        missing = int(prepared.known.is_missing.sum())
    wall, count = time.perf_counter() - start, sum(statuses.values())
    return JobTaskResult(study.output, task, tasks, len(points), count, dict(statuses), missing, wall)


def ranges_of(points: np.ndarray) -> list[Range]:
    """Returns at most `MOST_RANGES` ranges that contain ascending points `(n,)`: the widest gaps separate them."""
    if not len(points):
        return []
    gaps = np.flatnonzero(np.diff(points) > 1)
    widest = np.sort(gaps[np.argsort(-np.diff(points)[gaps], kind="stable")[: MOST_RANGES - 1]])
    first = [int(points[0]), *points[widest + 1].tolist()]
    last = [*points[widest].tolist(), int(points[-1])]
    return [(start, end + 1) for start, end in zip(first, last, strict=True)]


def task_points(ranges: Sequence[Range], task: int, tasks: int) -> np.ndarray:
    """Returns the share of a task, numbered from 1: blocks of neighbours, which share compilations, spread evenly."""
    if not ranges:
        return np.array([], np.int64)
    firsts = np.array([first for first, _ in ranges], np.int64)
    ends = np.cumsum([stop - first for first, stop in ranges], dtype=np.int64)
    count = int(ends[-1])
    size = -(-count // (BLOCKS * tasks))
    starts = range((task - 1) * size, count, tasks * size)
    blocks = [np.arange(start, min(start + size, count)) for start in starts]
    places = np.concatenate([np.array([], np.int64), *blocks])
    which = np.searchsorted(ends, places, "right")
    return places + (firsts - np.concatenate([[0], ends[:-1]]))[which]


def task_blocks(points: np.ndarray) -> np.ndarray:
    """Returns the first point of each block of neighbours, among the ascending points of a task `(n,)`."""
    return points[np.flatnonzero(np.diff(points, prepend=-2) > 1)]


def _require_identity(prepared: PreparedStudy, planned: Mapping[str, str]) -> None:
    """Raises UsageError if the results would not be those that were planned."""
    here = _hashes(prepared)
    differing = [name for name in here if here[name] != planned.get(name)]
    if differing:
        other = {
            name: f"{name} {clean(planned.get(name, ''))}, here {here[name]}"
            for name in versions(prepared.spec.packages)
        }
        facts = [other.get(name, name) for name in differing]
        raise UsageError(
            f"the plan was made with other {'; '.join(facts)}\n"
            "its results would not match the existing ones; make the plan again on this machine"
        )


def _hashes(prepared: PreparedStudy) -> dict[str, str]:
    """Returns the hashes of a study, and of its points."""
    return {**prepared.identity_hashes, DESIGN: points_digest(prepared.spec, prepared.points)}
