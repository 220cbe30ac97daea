"""What a study would do: its points, its steps, and what they cost, measured on one of its points."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.errors import MjrunError
from mjrun.model.variants import ModelVariants
from mjrun.options.sweep import ExecutionOptions
from mjrun.study.executors import process_count
from mjrun.study.isolation import IsolatedSimulator
from mjrun.study.parts import part_bytes
from mjrun.study.prepared import PreparedStudy
from mjrun.study.results import table_bytes
from mjrun.study.simulate import PointResult

SHOWN = 3  # points at each end of the study
PATIENCE = 60.0  # [s] for the point that is measured
START = 1.0  # [s] until processes simulate
LENGTH = ("timestep", "duration", "steps")  # decide how many steps a simulation takes


@dataclass(frozen=True)
class StudyPreview:
    """What a study would do.

    Attributes:
      path: its folder.
      points: how many there are.
      known: of them, how many have a result already.
      missing: how many would be simulated.
      chunks: tasks that these points make.
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
    sizes = [len(chunk.points) for chunk in prepared.chunks(missing, options)]
    steps = _steps(prepared, missing)
    processes = process_count(options.engine, options.jobs)
    result, seconds = _measured(prepared, missing, options)
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


def _steps(prepared: PreparedStudy, indices: Sequence[int]) -> np.ndarray:
    """How many steps these points take `(n,)`; those whose simulation cannot be made take none."""
    names = prepared.points.names
    deciding = [i for i, name in enumerate(names) if name.rpartition(".")[2].rpartition(":")[2] in LENGTH]
    variants, known = ModelVariants(), dict[tuple[str, ...], int]()
    counts: list[int] = []
    for index in indices:
        values = prepared.points.points[index]
        key = tuple(values[i] for i in deciding)
        if key not in known:
            try:
                simulation = prepared.spec.varying(tuple(names[i] for i in deciding)).simulation(key)
                known[key] = simulation.timeline(variants.load(simulation.source).model).steps
            except MjrunError:
                known[key] = 0
        counts.append(known[key])
    return np.array(counts, np.int64)


def _measured(
    prepared: PreparedStudy, indices: Sequence[int], options: ExecutionOptions
) -> tuple[PointResult | None, float]:
    """The result of the first of these points, and the wall time of it [s], in a process that has started."""
    chunk = next(prepared.chunks(indices[:1], options), None)
    if chunk is None:
        return None, math.nan
    simulator = IsolatedSimulator(prepared.spec)
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
