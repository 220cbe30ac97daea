"""A study that is ready to run: its points and their keys, the known results, and the missing chunks."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import MjrunError, UsageError, clean, option
from mjrun.experiment.design import Design, design
from mjrun.experiment.design_points import texts_at
from mjrun.experiment.results_table import (
    Requirements,
    check_metric_names,
    column_units,
    metric_columns,
    metric_units,
    parse_metrics,
)
from mjrun.model.override import Override
from mjrun.model.units import setting_unit
from mjrun.model.variants import VariantLoader
from mjrun.options.sweep import ExecutionOptions, StudyOptions, VariationOptions
from mjrun.outputs.event_detection import EndCondition
from mjrun.probe.metric import Metric
from mjrun.python_code import memory_warning
from mjrun.reporter import Reporter
from mjrun.simulation.simulation import Simulation
from mjrun.study import executors
from mjrun.study.chunk_files import point_keys, points_digest, study_digest, study_identity
from mjrun.study.episode_spec import EpisodeSpec
from mjrun.study.ineffective_values import own_values
from mjrun.study.prepared_points import JOB_SECONDS, PreparedPoints
from mjrun.study.results import STATUSES, TABLE_COLUMNS, with_flags
from mjrun.study.simulate import WORLD_BYTES
from mjrun.study.spec import FILES, MODEL, ShippedStudy, StudySpec, require_values, simulation_at, versions, with_end

IN_SECONDS = ("timestep", "duration", "ctrl_noise_time", "control_dt")  # options of simulations
LENGTH = ("timestep", "duration", "steps")  # parameters that determine the number of steps
CHUNK_STEPS = 50_000  # steps in a chunk whose time is not measured: usually seconds
CHUNK_POINTS = 500  # most points in such a chunk
LEAST_WORLDS, CHUNK_WORLDS = 256, 4096  # points in a chunk of Warp worlds; few do not pay for another process


class PreparedStudy(PreparedPoints):
    """A study whose names and numbers are all checked. Nothing is written yet, and only copies of its files are read.

    Args:
      spec: specification, without the names of parameters.
      points: the points, if the options do not describe them.

    Attributes:
      spec: specification of the points.
      points: parameters and the values of each point.
      model: base model.
      shipped: the study as processes receive it.
      folder: folder of the study.
      columns: columns that the metrics read in the base model, except the time.
      units: units of parameters and metrics in the base model; empty where unknown.

    Raises:
      UsageError: a name is unknown, or a value is invalid.
      FileError: a file cannot be read.
    """

    def __init__(self, options: StudyOptions, spec: StudySpec, points: Design | None = None) -> None:
        if not isinstance(spec.product, EpisodeSpec):
            executors.require_extra("sweep")
        base = spec.base.with_snapshot()
        assert base.snapshot
        with base.snapshot.original_names_in_errors():
            self._source, self.model = base.compile()
            self.points = checked_design(options, spec, self._source, self.model) if points is None else points
            snapshot = base.snapshot.with_files(varied_files(spec.base, self.points))
            self.spec = replace(spec, names=self.points.names, base=replace(base, snapshot=snapshot))
            self.shipped = ShippedStudy.of(self.spec)
            written = with_end(options.metric, base) if self.spec.metrics else ()
            metrics = self._check(options, written)
            self.columns, self.units = metric_columns(metrics), self._units(written, metrics)
            names = [name for name, _ in spec.metrics]
            super().__init__(self.spec, self.points, self.shipped, options.output, names)

    @cached_property
    def identity(self) -> Mapping[str, object]:
        """Everything that determines the results, except the values of the points."""
        return study_identity(self.spec, self.model, self.shipped.spec.modules)

    @cached_property
    def identity_hashes(self) -> Mapping[str, str]:
        """A hash of each part of the identity, or its version."""
        texts = {name: json.dumps(value, sort_keys=True).encode() for name, value in self.identity.items()}
        return {name: hashlib.sha256(text).hexdigest()[:32] for name, text in texts.items()} | versions()

    @property
    def identities(self) -> Mapping[str, object]:
        """Hashes for the manifest: of everything that determines all results, and of its parts."""
        return {"digest": self.files.study, "identity": self.identity_hashes}

    def _keys(self, indices: Sequence[int] | np.ndarray) -> Sequence[str]:
        return point_keys(self.identity, self.spec, self.points.at(indices), self._own_values)

    @cached_property
    def _own_values(self) -> Mapping[int, frozenset[str]]:
        return own_values(self.points, self.spec, self._source, self.model)

    def _digest(self) -> str:
        return study_digest(self.identity, points_digest(self.spec, self.points))

    @property
    def noun(self) -> str:
        return "episode" if isinstance(self.spec.product, EpisodeSpec) else "point"

    def warn(self, reporter: Reporter) -> None:
        super().warn(reporter)
        if self.first.code and not self._acts_again_alike():
            code = option("policy" if self.first.controller is None else "controller")
            reporter.warn(memory_warning(code, f"{self.noun}s"))

    def _acts_again_alike(self) -> bool:
        """Returns whether the user's code acts in the same way at the same start again, unless it fails there."""
        with suppress(MjrunError):
            model = self.first.load()
            first, again = (self.first.stepper(model).state() for _ in range(2))
            return np.array_equal(first, again)
        return True

    @cached_property
    def first(self) -> Simulation:
        """The simulation of the first point, in the base model: any other model might crash this process."""
        return replace(self.spec.simulation(self.points.points[0]), model=self.spec.base.model)

    @cached_property
    def planned_size(self) -> int:
        """Points in a chunk whose time cannot be measured, from the length of the first simulation."""
        steps = max(1, self.first.timeline(self.first.load()).steps)
        return max(1, min(CHUNK_STEPS // steps, CHUNK_POINTS))

    def steps(self, indices: Sequence[int] | np.ndarray) -> np.ndarray:
        """Returns the number of steps of points `(n,)`; 0 for a point whose simulation cannot be made, and for episodes
        of a dataset, whose lengths only their simulation shows.
        """
        if isinstance(self.spec.product, EpisodeSpec):
            return np.zeros(len(indices), np.int64)
        names = self.points.names
        deciding = [i for i, name in enumerate(names) if name.rpartition(".")[2].rpartition(":")[2] in LENGTH]
        varying = replace(self.spec, names=tuple(names[i] for i in deciding))
        variants, columns = VariantLoader(), [self.points.column(i) for i in deciding]

        def count(key: tuple[str, ...]) -> int:
            try:
                simulation = varying.simulation(key)
                return simulation.timeline(variants.load(simulation.source).model).steps
            except MjrunError:
                return 0

        if not columns:
            return np.broadcast_to(np.int64(count(())), len(indices))
        places = np.stack([column.places[np.asarray(indices, np.intp)] for column in columns])
        different, which = np.unique(places, axis=1, return_inverse=True)
        keys = [tuple(texts_at(column.texts, key[[i]])[0] for i, column in enumerate(columns)) for key in different.T]
        return np.array([count(key) for key in keys], np.int64)[which.ravel()]

    def chunk_sizes(self, options: ExecutionOptions, ahead: int) -> executors.ChunkSizes:
        """Returns the sizes of chunks, of which `ahead` are in flight."""
        if self.spec.engine == "warp":
            processes = executors.process_count(options.engine, options.jobs) or 1
            share = max(LEAST_WORLDS, -(-len(self.points.points) // processes))
            worlds = min(CHUNK_WORLDS, share, WORLD_BYTES // mujoco.mj_sizeModel(self.model))
            return executors.ChunkSizes(options.chunk or max(1, worlds), ahead)
        if options.engine == executors.SLURM:
            return executors.ChunkSizes(options.chunk, ahead, JOB_SECONDS, self.planned_size)
        return executors.ChunkSizes(options.chunk, ahead)

    def _check(self, options: StudyOptions, written: Sequence[tuple[str, str]]) -> Sequence[Metric]:
        """Raises errors that concern all points before the first is simulated; returns the metrics."""
        episode = self.first.episode
        EndCondition.of(self.first, self.model)  # whose errors name the option
        check_metric_names(written, (*self.points.names, *STATUSES, *TABLE_COLUMNS))
        metrics = parse_metrics(written, self.model, episode.columns if episode else None)
        numbers = [*self.points.names, *(name for name, _ in self.spec.metrics)]
        Requirements(options.require, numbers, STATUSES, with_flags)
        if isinstance(self.spec.product, EpisodeSpec):  # whose simulation would take as long as the whole point
            return metrics
        try:
            model = self.first.load()
            self.first.timeline(model)
            self.first.stepper(model)
        except UsageError as error:
            match error.path:
                case ("set", name, *rest) if name in self.points.names:
                    error.path = ("vary", name, *rest)
                case _:
                    pass
            raise
        return metrics

    def _units(self, written: Sequence[tuple[str, str]], metrics: Sequence[Metric]) -> Mapping[str, str]:
        episode = self.first.episode
        names = (*self.points.names, *metric_columns(metrics))
        columns = column_units(self.model, names, episode.columns if episode else None)
        return parameter_units(self.points.names, columns, self.model) | metric_units(written, metrics, columns)


def parameter_units(names: Sequence[str], columns: Mapping[str, str], model: mujoco.MjModel) -> dict[str, str]:
    """Returns the units of parameters; empty where unknown.

    Args:
      columns: the units of the columns of a trace.
    """
    return {
        name: columns.get(name) or (name in IN_SECONDS and "s") or setting_unit(model, name) or "" for name in names
    }


def checked_design(
    options: VariationOptions, spec: StudySpec, source: mujoco.MjSpec | None, model: mujoco.MjModel
) -> Design:
    """Returns the points that `options` describe, with their names and values checked.

    Args:
      source: the specification of the base model, or None if it is compiled already.
      model: the base model.

    Raises:
      UsageError: a name is unknown, or a value is invalid.
    """
    points = design(options, model, spec.base.seed)
    try:
        shared, has_cameras = None if MODEL in points.names else source, spec.product is not None
        require_values(points, dict(spec.controllers), shared, has_cameras=has_cameras)
    except UsageError as error:
        if options.points is not None:
            error.add_note(f"the columns of {clean(options.points)} are parameters, too")
        raise
    return points


def varied_files(base: Simulation, points: Design) -> Iterator[Path]:
    """Yields the files that values of points name. A value that names no valid model fails at its points."""
    for index, name in enumerate(points.names):
        if name in FILES or Override(name, "").file_attribute:
            for text in points.distinct(index):
                with suppress(MjrunError):
                    yield from (path for _, path in simulation_at(base, (name,), (text,)).inputs)
