"""The plan of a study: its missing points in chunks, for tasks that know nothing of each other."""

import hashlib
import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mjrun.errors import UsageError, clean
from mjrun.experiment.design import Design
from mjrun.reporter import Reporter
from mjrun.study.executors import check_engine
from mjrun.study.keep import PointKeeper
from mjrun.study.prepared import PreparedStudy
from mjrun.study.results import FailureNotes
from mjrun.study.spec import StudyPoint
from mjrun.study.study import Study

SCHEMA = "mjrun-plan-1"
BLOCKS = 4  # of points that each task simulates: what is slow is seldom in one place
VERSIONS = ("mjrun", "mujoco", "numpy")


@dataclass(frozen=True)
class StudyPlan:
    """What is to be simulated of a study.

    Attributes:
      study: as it is to be collected.
      names: what varies.
      identity: hashes of all that decides the results, but for the values of the points.
      chunks: all points, so many on a line.
    """

    study: Study
    names: Sequence[str]
    identity: Mapping[str, str]
    chunks: Sequence[Sequence[StudyPoint]]


@dataclass(frozen=True)
class TaskResult:
    """What a task has done.

    Attributes:
      path: the folder of the study.
      task, tasks: its number, from 1, of how many.
      points: that were its share.
      simulated: how many of them were simulated now; the others were known.
      statuses: how many of these ended in which way.
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
    """The plan of what is missing of a study; its folder is made, so that it can be collected.

    Raises:
      UsageError: a name that nothing has, or a value that cannot be.
      FileError: the folder cannot be made, or a file cannot be read.
    """
    prepared = PreparedStudy.of(study, study.spec)
    PointKeeper(study, prepared)  # checks what is to be kept of which points
    missing = prepared.missing(study.retry_failed)
    size = study.chunk or prepared.planned_size
    points = [StudyPoint(index, prepared.points.points[index]) for index in missing]
    chunks = [tuple(points[start : start + size]) for start in range(0, len(points), size)]
    prepared.files.create()
    return StudyPlan(study, prepared.points.names, _hashes(prepared.identity), chunks)


def run_task(plan: StudyPlan, task: int, tasks: int, reporter: Reporter) -> TaskResult:
    """Simulates the points of one of `tasks` equal parts of a plan, and publishes them as they are done.

    Raises:
      UsageError: what decides the results is not as it was when the plan was made.
      FileError: results cannot be written.
    """
    start = time.perf_counter()
    study, points = plan.study, task_points(plan, task, tasks)
    statuses = Counter[str]()
    if points:
        prepared = _prepared(plan, [point.values for point in points])
        check_engine(study.engine)
        prepared.files.create()
        prepared.warn_of_damaged(reporter)
        missing = prepared.missing(study.retry_failed)
        notes = FailureNotes(prepared.points, reporter, [point.index for point in points])
        for results in prepared.simulate(missing, study, reporter):
            notes.add(results)
            statuses.update(result.status for result in results)
            reporter.progress("points", statuses.total(), len(missing))
    wall = time.perf_counter() - start
    return TaskResult(study.output, task, tasks, len(points), statuses.total(), dict(statuses), wall)


def task_points(plan: StudyPlan, task: int, tasks: int) -> list[StudyPoint]:
    """The share of a task, numbered from 1: blocks of neighbours, which share compilations, from all over the plan."""
    points = [point for chunk in plan.chunks for point in chunk]
    size = -(-len(points) // (BLOCKS * tasks)) or 1
    starts = range((task - 1) * size, len(points), tasks * size)
    return [point for start in starts for point in points[start : start + size]]


def _prepared(plan: StudyPlan, points: Sequence[tuple[str, ...]]) -> PreparedStudy:
    """These points of the study, if their results are those that the plan is about."""
    study, names = plan.study, tuple(plan.names)
    prepared = PreparedStudy.of(study, study.spec, Design(names, points))
    here, there = _hashes(prepared.identity), plan.identity
    differing = [name for name in here if here[name] != there.get(name)]
    if differing:
        other = {name: f"{name} {clean(there.get(name, ''))}, here {here[name]}" for name in VERSIONS}
        facts = [other.get(name, name) for name in differing]
        raise UsageError(
            f"the plan was made with other {'; '.join(facts)}\n"
            "its results would not belong to those that are there; make the plan again, here"
        )
    return prepared


def _hashes(identity: Mapping[str, object]) -> dict[str, str]:
    """Each part of an identity in few characters."""
    texts = {name: json.dumps(value, sort_keys=True).encode() for name, value in identity.items()}
    hashes = {name: hashlib.sha256(text).hexdigest()[:32] for name, text in texts.items()}
    return hashes | {name: str(identity[name]) for name in VERSIONS}
