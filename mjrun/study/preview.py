"""What a study would do: its points, its steps, and what they cost, measured on one of its points."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.options.sweep import ExecutionOptions
from mjrun.platform.cores import available_cores
from mjrun.study.chunk_files import part_bytes
from mjrun.study.executors import QUEUED, ChunkSizes, process_count
from mjrun.study.isolation import IsolatedSimulator
from mjrun.study.prepared import PreparedStudy
from mjrun.study.results import table_bytes
from mjrun.study.spec import PointResult

SHOWN = 3  # points at each end of the study
PATIENCE = 60.0  # [s] for the point that is measured
START = 1.0  # [s] until processes simulate


@dataclass(frozen=True)
class StudyPreview:
    """What a study would do.

    Attributes:
      path: its folder.
      points: how many there are.
      known: of them, how many have a result already.
      missing: how many would be simulated.
      chunks: tasks that these points make, about, as chunks are measured while they run.
      steps: of all simulations that are missing; where models vary, as if they had the timestep of the base model.
      processes: that simulate; None where the engine has its own.
      point_wall: wall time of the point that was measured [s]; None if it failed.
      wall: estimated wall time of all [s]; None if it is not known.
      disk: estimated size of the study's files [bytes].
      names: what varies.
      sample: the first points and the last.
      message: why the wall time is not known; empty if it is.
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
    sample: Sequence["PointValues"]
    message: str = ""


@dataclass(frozen=True)
class PointValues:
    """A point.

    Attributes:
      point: its number.
      values: by what varies.
    """

    point: int
    values: Mapping[str, str]


def preview(prepared: PreparedStudy, options: ExecutionOptions) -> StudyPreview:
    """What is left to do of a study.

    Raises:
      UsageError: there is no such engine.
    """
    missing = prepared.missing(options.retry_failed)
    steps = prepared.steps(missing)
    processes = process_count(options.engine, options.jobs)
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

    count, design = len(prepared.keys), prepared.points
    ends = sorted({*range(min(SHOWN, count)), *range(max(0, count - SHOWN), count)})
    part = part_bytes([name for name, _ in prepared.spec.metrics], sizes[0]) * len(sizes) if sizes else 0
    return StudyPreview(
        path=str(prepared.folder),
        points=count,
        known=count - len(missing),
        missing=len(missing),
        chunks=len(sizes),
        steps=int(steps.sum()),
        processes=processes,
        point_wall=point_wall,
        wall=wall,
        disk=prepared.files.size() + part + table_bytes(design, len(prepared.spec.metrics)),
        names=design.names,
        sample=[PointValues(i, dict(zip(design.names, design.points[i], strict=True))) for i in ends],
        message=result.message if result and point_wall is None else "",
    )


def _chunk_sizes(
    prepared: PreparedStudy, options: ExecutionOptions, steps: np.ndarray, processes: int, of_step: float
) -> list[int]:
    """How many points chunks would have, if each step took so many seconds."""
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
    """The result of the first of these points, and the wall time of it [s], in a process that has started."""
    if not indices:
        return None, math.nan
    (chunk,) = prepared.chunks(indices[:1], options, ChunkSizes(1, 1))
    simulator = IsolatedSimulator(prepared.shipped)
    limit = min(chunk.time_limit, PATIENCE)
    try:
        (result,) = simulator.run(chunk.points, limit)
        start = time.perf_counter()
        if result.status == "ok" and result.wall < PATIENCE / 10:  # now that the process is warm
            (result,) = simulator.run(chunk.points, limit)
            return result, time.perf_counter() - start
        return result, result.wall
    finally:
        simulator.close()
