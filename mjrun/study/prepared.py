"""A study that is ready to run: its points and their keys, the known results, and the missing chunks.

Points are identified without values that change nothing, since the simulation that they vary has them already: a study
keeps its points when it gains or loses a parameter with such a value.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import MjrunError, ModelError, UsageError, clean, listing, option
from mjrun.experiment.design import SHORT_PATHS, Design, design, numbers, texts_at
from mjrun.experiment.results_table import (
    Requirements,
    check_metric_names,
    column_units,
    metric_columns,
    metric_units,
    parse_metrics,
)
from mjrun.model import state
from mjrun.model.override import Override, changes_nothing, source_values
from mjrun.model.units import setting_unit
from mjrun.model.variants import VariantLoader, model_bytes
from mjrun.options.simulation import CONTROLS
from mjrun.options.sweep import ExecutionOptions, StudyOptions, VariationOptions
from mjrun.outputs.event_detection import EndCondition
from mjrun.probe.metric import Metric
from mjrun.python_code import edit_remarks, memory_warning
from mjrun.reporter import Reporter
from mjrun.simulation.simulation import Simulation
from mjrun.study import executors
from mjrun.study.dataset_specs import EpisodeSpec
from mjrun.study.part_files import point_keys, points_digest, study_digest, study_identity
from mjrun.study.prepared_points import JOB_SECONDS, LEAST_JOB, PreparedPoints
from mjrun.study.results import STATUSES, TABLE_COLUMNS, with_flags
from mjrun.study.simulate import WORLD_BYTES, timeline_of
from mjrun.study.spec import (
    BY_NAME,
    FILES,
    MODEL,
    ShippedStudy,
    StudySpec,
    is_path,
    require_values,
    simulation_at,
    versions,
    with_end,
)

IN_SECONDS = ("timestep", "duration", "ctrl_noise_time", "control_dt")  # options of simulations
LENGTH = ("timestep", "duration", "steps")  # parameters that determine the number of steps
CHUNK_STEPS = 50_000  # steps in a chunk whose time is not measured: usually seconds
CHUNK_POINTS = 500  # most points in such a chunk
LEAST_WORLDS, CHUNK_WORLDS = 256, 4096  # points in a chunk of Warp worlds; few do not pay for another process
NEUTRAL = {"scale": 1.0, "add": 0.0}  # relative values that change nothing
MOST = 64  # values, or points, that are tried one by one
# Kinds of elements, and settings, on which initial states do not depend.
NOT_IN_STARTS = ("geom", "site", "camera", "light", "material", "actuator", "sensor", "tendon", "pair", "opt", "vis")


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
            self._variants = VariantLoader()
            self._variants.add(base.source, self._source, self.model)
            self.points = checked_design(options, spec, self._source, self.model) if points is None else points
            varied = [*varied_files(spec.base, self.points)]
            others = [path for _, files in varied for path in files]
            snapshot = base.snapshot.with_files(others, of_models=[path for files, _ in varied for path in files])
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
        return {name: hashlib.sha256(text).hexdigest()[:32] for name, text in texts.items()} | versions(
            self.spec.packages
        )

    @property
    def identities(self) -> Mapping[str, object]:
        """Hashes for the manifest: of everything that determines all results, and of its parts."""
        return {"digest": self.files.study, "identity": self.identity_hashes}

    def keys_of(self, indices: Sequence[int] | np.ndarray) -> Sequence[str]:
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
        for text in [*edit_remarks(self.shipped.spec.modules), *self.first.remarks_on_end(self.model)]:
            reporter.warn(text)
        self._warn_of_replayed_states(reporter)
        if self.first.code and not self._acts_again_alike():
            code = option("policy" if self.first.controller is None else "controller")
            reporter.warn(memory_warning(code, f"{self.noun}s"))

    def _warn_of_replayed_states(self, reporter: Reporter) -> None:
        """Warns if parameters of the model vary under a replay, whose states they do not change."""
        base, names = self.spec.base, self.points.names
        varied = [name for name in names if is_path(SHORT_PATHS.get(name, name))]
        if base.replay is not None and base.replay_mode != CONTROLS and "replay_mode" not in names and varied:
            reporter.warn(
                f"all points replay the recorded states: {listing(varied)} only changes what is computed from them, "
                f"such as forces; {option('replay_mode')} controls simulates again"
            )

    def _acts_again_alike(self) -> bool:
        """Returns whether the user's code acts in the same way at the same start again, unless it fails there."""
        with suppress(MjrunError):
            model = self.first.load()
            first, again = (self.first.stepper(model).state() for _ in range(2))
            return np.array_equal(first, again)
        return True

    @cached_property
    def first(self) -> Simulation:
        """The simulation of the first point that can start."""
        return self._simulation(0)

    def _simulation(self, index: int) -> Simulation:
        """Returns the simulation of a point, in the base model: any other model might crash this process."""
        return replace(self.spec.simulation(self.points.points[index]), model=self.spec.base.model)

    def _start(self, simulation: Simulation) -> None:
        """Raises the errors of a simulation that are known before its first step."""
        is_episode = simulation.episode is not None
        model = simulation.load() if is_episode else self._variants.load(simulation.source).model
        simulation.timeline(model)
        simulation.stepper(model)

    def _starting(self) -> Simulation | None:
        """Returns the simulation of a point other than the first that can start, or None if none of those tried can."""
        count = len(self.points.points)
        for index in np.unique(np.linspace(0, count - 1, min(count, MOST)).astype(int))[1:]:
            with suppress(MjrunError):
                simulation = self._simulation(int(index))
                self._start(simulation)
                return simulation
        return None

    @cached_property
    def planned_size(self) -> int:
        """Points in a chunk whose time cannot be measured, from the length of the first simulation."""
        steps = max(1, self.first.timeline(self.model).steps)
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
        columns = [self.points.column(i) for i in deciding]

        def count(key: tuple[str, ...]) -> int:
            try:
                simulation = varying.simulation(key)
                return timeline_of(simulation, self._variants.load(simulation.source)).steps
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
            worlds = min(CHUNK_WORLDS, share, WORLD_BYTES // model_bytes(self.model))
            return executors.ChunkSizes(options.chunk or max(1, worlds), ahead)
        if options.engine == executors.SLURM:
            return executors.ChunkSizes(options.chunk, ahead, JOB_SECONDS, self.planned_size, LEAST_JOB)
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
            self._start(self.first)
        except ModelError:
            pass  # of this point alone, as the base model compiles: it fails wherever it is in the order
        except UsageError as error:
            if simulation := self._starting():  # the first point fails as it would anywhere else in the order
                self.first = simulation
                return metrics
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


def varied_files(base: Simulation, points: Design) -> Iterator[tuple[Sequence[Path], Sequence[Path]]]:
    """Yields the files that values of points name: those of the model, and others. An invalid value fails at its
    points.
    """
    for index, name in enumerate(points.names):
        if name in FILES or Override(name, "").file_attribute:
            for text in points.distinct(index):
                with suppress(MjrunError):
                    varied = simulation_at(base, (name,), (text,))
                    yield varied.source.files, [path for _, path in varied.tables]


def own_values(
    points: Design, spec: StudySpec, source: mujoco.MjSpec | None, model: mujoco.MjModel
) -> Mapping[int, frozenset[str]]:
    """Returns the values of parameters, by their places, that change nothing at any point.

    Args:
      source: specification of the base model; None for a compiled model.
      model: base model.
    """
    if spec.product:  # whose parameters include settings of cameras
        return {}
    names = [SHORT_PATHS.get(name, name) for name in points.names]
    found = dict[int, frozenset[str]]()
    for index, name in enumerate(names):
        others, distinct = [*names[:index], *names[index + 1 :]], points.distinct(index)
        if not is_path(name):
            found[index] = frozenset(_of_simulation(name, distinct, others, spec, model))
        elif source and MODEL not in others and not any(_share_a_field(name, other) for other in others):
            found[index] = frozenset(_of_model(name, distinct, source))
    return {index: texts for index, texts in found.items() if texts}


def _of_model(path: str, distinct: Sequence[str], source: mujoco.MjSpec) -> Iterator[str]:
    """Yields the values that change nothing in the source of the model."""
    operation = Override(path, "").operation
    try:
        present = np.array([NEUTRAL[operation]]) if operation else source_values(source, Override(path, ""))
    except MjrunError:  # texts, or several numbers
        present = None
    for text in _candidates(distinct, present):
        try:
            if changes_nothing(source, Override(path, text)):
                yield text
        except MjrunError:  # the point will fail with this error
            continue


def _of_simulation(
    name: str, distinct: Sequence[str], others: Sequence[str], spec: StudySpec, model: mujoco.MjModel
) -> Iterator[str]:
    """Yields the values that change no option, or neither the initial state nor the length."""
    base, group = spec.base, name.partition("/")[0]
    by_start = group == "key" or group in BY_NAME
    if group in BY_NAME and any(_share_an_entry(name, other) for other in others):
        return
    by_start &= base.replay is base.ctrl_from is base.policy is base.position_control is None
    by_start &= not any(other in (MODEL, "key") or _moves_starts(other) for other in others)
    by_length = group == "duration" and base.replay is base.policy is None and MODEL not in others
    value = getattr(base, group)
    is_number = isinstance(value, int | float) and not by_length
    for text in _candidates(distinct, np.array([value], float) if is_number else None):
        try:
            varied = simulation_at(base, (name,), (text,), dict(spec.controllers))
            is_same = getattr(varied, group) == value
            is_same |= by_start and _start(varied, model) == _start(base, model)
            is_same |= by_length and varied.timeline(model) == base.timeline(model)
        except MjrunError:  # the point will fail with this error
            continue
        if is_same:
            yield text


def _candidates(distinct: Sequence[str], present: np.ndarray | None) -> Sequence[str]:
    """Returns the values that may be among the present numbers; without these, all values unless they are many."""
    values = None if present is None else numbers(distinct)
    if present is None or values is None:
        return distinct if len(distinct) <= MOST else []
    return [distinct[int(place)] for place in np.flatnonzero(np.isin(values, present))[:MOST]]


def _start(simulation: Simulation, model: mujoco.MjModel) -> bytes:
    return state.save(model, simulation.initial_data(model)).tobytes()


def _moves_starts(name: str) -> bool:
    kind = Override(name, "").target.partition(".")[0].partition("/")[0]
    return is_path(name) and kind not in NOT_IN_STARTS


def _share_a_field(one: str, other: str) -> bool:
    """Returns whether two paths may change the same number."""
    paths = [Override(path, "") for path in (one, other)]
    (owner, _, field), (other_owner, _, other_field) = (path.target.rpartition(".") for path in paths)
    indices = [path.index for path in paths]
    if not is_path(other) or field != other_field or (None not in indices and indices[0] != indices[1]):
        return False
    return owner == other_owner or any(_is_open(each) for each in (owner, other_owner))


def _share_an_entry(one: str, other: str) -> bool:
    """Returns whether two parameters such as `qpos/root` and `qpos/root/z` may change the same number."""
    if one.partition("/")[0] != other.partition("/")[0]:
        return False
    return f"{one}/".startswith(f"{other}/") or f"{other}/".startswith(f"{one}/") or _is_open(one) or _is_open(other)


def _is_open(name: str) -> bool:
    """Returns whether a name may match several objects, or one by its index."""
    return bool(set(name) & set("*?[:")) or name.rpartition("/")[2].isdigit()
