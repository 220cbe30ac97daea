"""Preview of a study: its points and steps, and their cost, measured on one of its points."""

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import closing

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.options.sweep import ExecutionOptions
from mjrun.platform.cores import available_cores
from mjrun.study.chunk_files import part_bytes
from mjrun.study.executors import INTERVAL, QUEUED, process_count
from mjrun.study.isolation import IsolatedSimulator
from mjrun.study.prepared import PreparedStudy
from mjrun.study.results import table_bytes
from mjrun.study.spec import PointResult, StudyPoint

SHOWN = 3  # points at each end of the study
PATIENCE = 60.0  # [s] for the point that is measured
START = 1.0  # [s] before processes simulate


@dataclass(frozen=True)
class StudyPreview:
    """The points and steps that a study would simulate, and their estimated cost.

    Attributes:
      path: folder of the study.
      points: number of points.
      known: number of points that have a result already.
      missing: number of points that would be simulated.
      chunks: approximate number of chunks, whose sizes are measured while they run.
      steps: steps of all missing simulations; where models vary, with the timestep of the base model.
      processes: number of processes that simulate; None where the engine has its own.
      point_wall: wall time of the measured point [s]; None if it failed.
      wall: estimated wall time of all points [s]; None if unknown.
      disk: estimated size of the study's files [bytes].
      names: parameters that vary.
      sample: first and last points.
      message: reason why the wall time is unknown; empty if it is known.
    """

    path: str
    points: int
    known: int
    missing: int
    chunks: int
    steps: int
    processes: int | None
    point_wall: float | None
    wall: float | None
    disk: int
    names: Sequence[str]
    sample: Sequence["PreviewPoint"]
    message: str = ""


@dataclass(frozen=True)
class PreviewPoint:
    """A point in a preview.

    Attributes:
      point: number of the point.
      values: values of the point, by parameter.
    """

    point: int
    values: Mapping[str, str]


def preview(prepared: PreparedStudy, options: ExecutionOptions) -> StudyPreview:
    """Previews the missing points of a study.

    Raises:
      UsageError: the engine is unknown.
    """
    missing = prepared.missing(options.retry_failed)
    steps = prepared.steps(missing)
    processes = process_count(options.engine, options.jobs, options.slurm)
    result, seconds = _measured(prepared, missing, options)
    of_step = seconds / result.steps if result and result.steps else 0.0
    sizes = _chunk_sizes(prepared, options, steps, processes or available_cores(), of_step)
    point_wall = wall = None
    if not missing:
        wall = 0.0
    elif result and result.steps:
        point_wall = seconds
        if processes:
            wall = START + seconds * int(steps.sum()) / result.steps / min(processes, len(sizes))

    count, design = len(prepared.points.points), prepared.points
    ends = sorted({*range(min(SHOWN, count)), *range(max(0, count - SHOWN), count)})
    parts = len(sizes) if wall is None else min(len(sizes), 1 + int(wall / INTERVAL))
    part = part_bytes([name for name, _ in prepared.spec.metrics], len(missing) // parts) if parts else 0
    return StudyPreview(
        path=prepared.folder.path(),
        points=count,
        known=count - len(missing),
        missing=len(missing),
        chunks=len(sizes),
        steps=int(steps.sum()),
        processes=processes,
        point_wall=point_wall,
        wall=wall,
        disk=prepared.files.size() + parts * part + table_bytes(design, len(prepared.spec.metrics)),
        names=design.names,
        sample=[PreviewPoint(index, design.values(index)) for index in ends],
        message=result.message if result and point_wall is None else "",
    )


def _chunk_sizes(
    prepared: PreparedStudy, options: ExecutionOptions, steps: np.ndarray, processes: int, of_step: float
) -> list[int]:
    """Returns the sizes of chunks if each step took `of_step` seconds."""
    ahead, start = processes * QUEUED, 0
    sizes, ends = prepared.chunk_sizes(options, ahead), list[int]()
    while start < len(steps):
        start += sizes.next(steps[start:])
        ends.append(start)
        if len(ends) > ahead:
            first, last = ([0, *ends][place - ahead] for place in (-2, -1))
            taken = int(steps[first:last].sum())
            sizes.add(last - first, taken, taken * of_step)
    return np.diff([0, *ends]).tolist()


def _measured(
    prepared: PreparedStudy, indices: Sequence[int], options: ExecutionOptions
) -> tuple[PointResult | None, float]:
    """Returns the result of the first of these points, and its wall time in a process that has started [s]."""
    if not indices:
        return None, math.nan
    point = StudyPoint(indices[0], prepared.points.points[indices[0]])
    limit = PATIENCE if options.time_limit is None else min(float(options.time_limit), PATIENCE)
    with closing(IsolatedSimulator(prepared.shipped)) as simulator:
        (result,) = simulator.run([point], limit)
        start = time.perf_counter()
        if result.status == "ok" and result.wall < PATIENCE / 10:  # now that the process is warm
            (result,) = simulator.run([point], limit)
            return result, time.perf_counter() - start
        return result, result.wall
