"""Plans of studies: the missing points in chunks, for tasks that run independently of each other."""

import hashlib
import json
import time
from collections.abc import Mapping, Sequence

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean
from mjrun.experiment.design import Design
from mjrun.reporter import Reporter
from mjrun.study.executors import check_engine
from mjrun.study.point_files import PointKeeper
from mjrun.study.prepared import PreparedStudy
from mjrun.study.spec import StudyPoint
from mjrun.study.study import Study

SCHEMA = "mjrun-plan-1"
BLOCKS = 4  # blocks of points of each task, since slow points are often neighbours
VERSIONS = ("mjrun", "mujoco", "numpy")


@dataclass(frozen=True)
class StudyPlan:
    """The points of a study that remain to be simulated.

    Attributes:
      study: study as it will be collected.
      names: parameters that vary.
      identity: hashes of everything that determines the results, except the values of the points.
      chunks: all points, in lines of several.
    """

    study: Study
    names: Sequence[str]
    identity: Mapping[str, str]
    chunks: Sequence[Sequence[StudyPoint]]


@dataclass(frozen=True)
class TaskResult:
    """The result of a task.

    Attributes:
      path: folder of the study.
      task, tasks: number of the task, from 1, and number of tasks.
      points: number of points in its share.
      simulated: number of them that were simulated now; the others were known.
      statuses: number of simulated points by status.
      wall: wall time [s].
    """

    path: str
    task: int
    tasks: int
    points: int
    simulated: int
    statuses: Mapping[str, int]
    wall: float


def plan(study: Study) -> StudyPlan:
    """Plans the missing points of a study, and creates its folder, so that it can be collected.

    Raises:
      UsageError: a name is unknown, or a value is invalid.
      FileError: the folder cannot be created, or a file cannot be read.
    """
    prepared = PreparedStudy(study, study.spec)
    PointKeeper(study, prepared)  # which checks the options of kept files
    missing = prepared.missing(study.retry_failed)
    size = study.chunk or prepared.planned_size
    points = [StudyPoint(index, prepared.points.points[index]) for index in missing]
    chunks = [tuple(points[start : start + size]) for start in range(0, len(points), size)]
    prepared.files.create()
    return StudyPlan(study, prepared.points.names, _hashes(prepared.identity), chunks)


def run_task(plan: StudyPlan, task: int, tasks: int, reporter: Reporter) -> TaskResult:
    """Simulates the points of one of `tasks` equal parts of a plan, and publishes them in chunks.

    Raises:
      UsageError: something that determines the results has changed since the plan was made.
      FileError: results cannot be written.
    """
    start = time.perf_counter()
    study, points = plan.study, task_points(plan, task, tasks)
    statuses: Mapping[str, int] = {}
    if points:
        prepared = PreparedStudy(study, study.spec, Design(tuple(plan.names), [point.values for point in points]))
        _require_identity(prepared, plan.identity)
        check_engine(study.engine)
        prepared.files.create()
        prepared.warn_of_damaged(reporter)
        missing = prepared.missing(study.retry_failed)
        statuses = prepared.simulate(missing, study, reporter, [point.index for point in points])
    wall = time.perf_counter() - start
    return TaskResult(study.output, task, tasks, len(points), sum(statuses.values()), dict(statuses), wall)


def task_points(plan: StudyPlan, task: int, tasks: int) -> list[StudyPoint]:
    """Returns the share of a task, numbered from 1: blocks of neighbours, which share compilations, spread evenly."""
    points = [point for chunk in plan.chunks for point in chunk]
    size = -(-len(points) // (BLOCKS * tasks)) or 1
    starts = range((task - 1) * size, len(points), tasks * size)
    return [point for start in starts for point in points[start : start + size]]


def _require_identity(prepared: PreparedStudy, planned: Mapping[str, str]) -> None:
    """Raises UsageError if the results would not be those that were planned."""
    here = _hashes(prepared.identity)
    differing = [name for name in here if here[name] != planned.get(name)]
    if differing:
        other = {name: f"{name} {clean(planned.get(name, ''))}, here {here[name]}" for name in VERSIONS}
        facts = [other.get(name, name) for name in differing]
        raise UsageError(
            f"the plan was made with other {'; '.join(facts)}\n"
            "its results would not match the existing ones; make the plan again on this machine"
        )


def _hashes(identity: Mapping[str, object]) -> dict[str, str]:
    """Abbreviates each part of an identity."""
    texts = {name: json.dumps(value, sort_keys=True).encode() for name, value in identity.items()}
    hashes = {name: hashlib.sha256(text).hexdigest()[:32] for name, text in texts.items()}
    return hashes | {name: str(identity[name]) for name in VERSIONS}
