"""Simulation of the points of a study; their metrics are measured while the rows stream by.

Points whose simulations are of one kind run side by side in one batch; every number is bit for bit that of the point
alone.
"""

import copy
import time
from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import mujoco
import numpy as np

from mjrun.errors import DeviceMemoryError, MjrunError, SimulationError, UsageError, option
from mjrun.experiment.design import ABSENT
from mjrun.experiment.results_table import metric_columns, parse_metrics
from mjrun.model import state
from mjrun.model.compiler_copied_fields import may_be_copied
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.model.override import Override
from mjrun.model.variants import BYTES, ModelVariant, SharedCompilation, VariantLoader, models_side_by_side
from mjrun.outputs.event_detection import EndCondition
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.physics.engine import AUTORESET, ENERGY, CEngine, Engine, joined
from mjrun.physics.initial_state import InitialState
from mjrun.physics.stepper import SLEEP
from mjrun.physics.warp_device import PerWorldFields, WarpDevice
from mjrun.physics.warp_engine import WarpEngine
from mjrun.probe.episode_columns import EpisodeColumns
from mjrun.probe.fields import RecordedFieldProbe, kinetic_sensors
from mjrun.probe.metric import BatchMetricEvaluator, Metric
from mjrun.simulation.simulation import Simulation
from mjrun.study.spec import PointResult, StudyPoint, StudySpec, is_path
from mjrun.timeline import Timeline, rational

if TYPE_CHECKING:
    from mjrun.study.episode_files import EpisodeFileMaker
    from mjrun.study.point_images import PointImageMaker

STARTS = [each.name for each in fields(InitialState)]  # options of simulations that their initial states depend on
WORLDS = 8192  # most points that Warp simulates at once
WORLD_BYTES = 2**31  # memory of their models
NOT_IN_WARP = (
    f"{option('engine')} warp: policies, controllers, replays, tables of controls, noise, pushes and sleep are not "
    "supported, nor are metrics that no recorded field contains\n"
    f"{option('engine')} local simulates them"
)
TIMESTEP = "opt.timestep"
ENOUGH = 512  # rows that are measured at once
SIDE_BY_SIDE = 1024  # most simulations in a batch
ROWS = 2**15  # that the simulations of a batch may have in memory, of at most `ENOUGH` each

_Expressions = tuple[Sequence[Metric], EndCondition | None]  # of one structure of models


class PointSimulator:
    """A simulator of points of one study."""

    def __init__(self, spec: StudySpec) -> None:
        self._spec = spec
        self._variants = VariantLoader(self._prepare)
        self._compiled = WeakKeyDictionary[SharedCompilation, _CompiledModel]()
        self._parsed = dict[tuple[object, ...], _Expressions]()  # by the structure of the model
        self._similar: _SimilarPoints | None = None
        self._start: tuple[_ReadyPoint, np.ndarray] | None = None  # of the last point that started in a compiled model
        self._files: PointImageMaker | EpisodeFileMaker | None = None
        self._engine: Engine
        self._world_fields: PerWorldFields | None = None
        self._most_worlds = WORLDS
        if spec.engine == "c":
            self._engine = CEngine(threads=1)
            self._most_bytes = BYTES
        else:
            device = WarpDevice(alternative="local")
            self._engine = WarpEngine(device)
            self._most_bytes = WORLD_BYTES
            self._world_fields = PerWorldFields(device)

    def run(self, points: Sequence[StudyPoint]) -> Iterator[Sequence[PointResult]]:
        """Yields the results of points in the order in which they end."""
        results = self._results(points)
        while True:
            with collected_warnings(), without_timers():  # but not while the caller uses them
                some = next(results, None)
            if some is None:
                return
            yield some

    def _results(self, points: Sequence[StudyPoint]) -> Iterator[Sequence[PointResult]]:
        batches = dict[object, list[_ReadyPoint]]()
        sizes = dict[int, int]()  # memory of their models, by id
        for point in points:
            start = time.perf_counter()
            if self._spec.product:
                yield [self._with_files(point)]
                continue
            try:
                ready = self._ready(point)
                ready.wall = time.perf_counter() - start
            except Exception as error:
                yield [self._failed(point, error, 0, time.perf_counter() - start)]
                continue
            if ready.kind is None:
                yield [self._alone(ready)]
                self._variants.reuse(ready.variant)
                continue
            batches.setdefault(ready.kind, []).append(ready)
            sizes |= _model_sizes([ready])
            if sum(map(len, batches.values())) >= self._most(ready) or sum(sizes.values()) > self._most_bytes:
                largest = max(batches, key=lambda kind: len(batches[kind]))
                yield [*self._side_by_side(batches.pop(largest))]
                sizes = _model_sizes([ready for batch in batches.values() for ready in batch])
        for batch in batches.values():
            yield [*self._side_by_side(batch)]

    def _most(self, ready: "_ReadyPoint") -> int:
        """Returns the number of simulations in a batch: few if they are long, since more only take memory."""
        if self._spec.engine == "warp":
            return self._most_worlds
        return min(SIDE_BY_SIDE, ROWS // min(ENOUGH, ready.timeline.steps + 1))

    def _ready(self, point: StudyPoint) -> "_ReadyPoint":
        if self._similar and (similar := self._similar.ready(point)):
            return similar
        simulation = self._spec.simulation(point.values)
        episode = simulation.episode
        if episode is None:
            variant = self._variants.load(simulation.source)
            compiled = self._compiled.get(variant.compilation)
            if compiled is None:
                compiled = self._compiled[variant.compilation] = self._measured(variant.compilation.model, simulation)
        else:  # which has a separate model and additional columns
            if self._spec.engine == "warp":
                raise UsageError(NOT_IN_WARP)
            model = copy.copy(episode.model())  # which other episodes share
            self._prepare(model)
            variant, compiled = ModelVariant(SharedCompilation(None, model)), self._measured(model, simulation)

        ready = _ReadyPoint(point, simulation, variant, compiled)
        if self._world_fields:
            if ready.kind is None:
                raise UsageError(NOT_IN_WARP)
            if variant.model is not variant.compiled:
                group = self._world_fields.group(variant.model)
            else:
                group = compiled.world_group = compiled.world_group or self._world_fields.group(variant.model)
            ready.kind = (*ready.kind, group)
        elif ready.may_have_similar(self._spec.names):
            self._similar = _SimilarPoints(ready, self._spec.names)
        return ready

    def _prepare(self, model: mujoco.MjModel) -> None:
        """Sets the flags that simulations need, so that the model does not have to be copied for them."""
        model.opt.disableflags |= AUTORESET
        texts = (*dict(self._spec.metrics).values(), self._spec.base.until or "")
        if any("energy" in text for text in texts) or kinetic_sensors(model):
            model.opt.enableflags |= ENERGY

    def _measured(self, model: mujoco.MjModel, simulation: Simulation) -> "_CompiledModel":
        """Parses expressions in the names of `model` and of an episode, unless models of one structure share them."""
        episode = simulation.episode.columns if simulation.episode else None
        key = (*structure(model), *(episode.names if episode else ()))
        if key not in self._parsed:
            end = EndCondition.of(simulation, model)
            self._parsed[key] = parse_metrics(self._spec.metrics, model, episode), end
        return _CompiledModel(model, key, *self._parsed[key], episode)

    def _alone(self, ready: "_ReadyPoint") -> PointResult:
        start = time.perf_counter()
        try:
            stepper = ready.simulation.stepper(ready.variant.model)
            measured = _MeasuredRows(ready, self._spec.every, 1)
            steps = ready.timeline.rows(every=measured.read_every)
            for block in ready.sampler.blocks(stepper, steps):
                table = block().values
                measured.feed(np.array(steps[: len(table)]), table[None], np.array([len(table)]))
                steps = steps[len(table) :]
                if not measured.running[0]:
                    break
        except Exception as error:
            steps = error.step if isinstance(error, SimulationError) else 0
            return self._failed(ready.point, error, steps, ready.wall + time.perf_counter() - start)
        return ready.result(measured.values()[0], int(measured.steps[0]), time.perf_counter() - start)

    def _with_files(self, point: StudyPoint) -> PointResult:
        """Simulates a point of a dataset, and makes its files."""
        assert self._spec.product
        start = time.perf_counter()
        try:
            self._files = self._files or self._spec.product.maker()
            steps, files = self._files.make(point.index, self._spec.values(point), self._spec.simulation(point.values))
        except Exception as error:
            steps = error.step if isinstance(error, SimulationError) else 0
            return self._failed(point, error, steps, time.perf_counter() - start)
        return PointResult(point.index, "ok", (), steps, wall=time.perf_counter() - start, files=files)

    def _side_by_side(self, batch: Sequence["_ReadyPoint"]) -> Iterator[PointResult]:
        begin = time.perf_counter()
        started = list[_ReadyPoint]()
        starts = list[np.ndarray]()
        data: mujoco.MjData | None = None
        known = {self._start[0].start_key: self._start[1]} if self._start else {}
        for ready in batch:
            try:
                key = ready.start_key
                start = known.get(key)
                if start is None:
                    model = ready.start_model
                    data = mujoco.MjData(model) if data is None else data  # all are of one size
                    ready.simulation.start.reset(model, data)
                    start = known[key] = state.save(model, data)
                starts.append(start)
                started.append(ready)
                if ready.start_model is ready.variant.compiled:  # which no later variant overwrites
                    self._start = ready, start
            except MjrunError as error:
                yield self._failed(ready.point, error, 0, ready.wall)
        if not started:
            return

        measured = _MeasuredRows(started[0], self._spec.every, len(started))
        try:
            failures = self._roll_out(started, np.array(starts), measured)
        except Exception as error:  # of all points, such as a model that the engine refuses
            if not isinstance(error, DeviceMemoryError) or len(started) == 1:
                yield from (self._failed(ready.point, error, 0, ready.wall) for ready in started)
                return
            failures = None
        if failures is None:  # not while the traceback of the error keeps the worlds in memory
            self._most_worlds = len(started) // 2
            for half in (started[: self._most_worlds], started[self._most_worlds :]):
                yield from self._side_by_side(half)
            return

        metrics = measured.values()
        wall = (time.perf_counter() - begin) / len(started)
        for index, ready in enumerate(started):
            if failure := failures.get(index):
                yield self._failed(ready.point, failure, failure.step, ready.wall + wall)
            else:
                yield ready.result(metrics[index], int(measured.steps[index]), wall)
        for ready in batch:
            self._variants.reuse(ready.variant)

    def _roll_out(
        self, points: Sequence["_ReadyPoint"], starts: np.ndarray, measured: "_MeasuredRows"
    ) -> dict[int, SimulationError]:
        """Measures the rows of every simulation; returns the errors of those that failed, by index."""
        first = points[0]
        models = models_side_by_side([ready.variant for ready in points])
        steps, running = first.timeline.steps, measured.running if first.compiled.end else None
        failures = dict[int, SimulationError]()
        blocks = self._engine.rollout(models, starts, None, steps, first.sampler.fields, measured.read_every, running)
        for block in blocks if first.compiled.end else joined(blocks, ENOUGH):
            tables = first.sampler.tables(block)
            for index, ready in enumerate(points):
                if ready.sampler.probes is not first.sampler.probes:
                    tables[index] = ready.sampler.tables(block, slice(index, index + 1))[0]
                elif ready.sampler is not first.sampler:
                    tables[index, :, 0] = ready.sampler.times(block.steps)
            measured.feed(block.steps, tables, block.counts)
            failures |= {index: error for index, error in block.failures.items() if not measured.has_ended[index]}
        return failures

    def _failed(self, point: StudyPoint, error: Exception, steps: int, wall: float) -> PointResult:
        spec = self._spec
        return PointResult.failed(point.index, error, len(spec.metrics), spec.base.snapshot, steps, wall)


class _CompiledModel:
    """Everything that the variants of a compiled model share.

    Attributes:
      structure: key of models whose simulations can run side by side; see `structure`.
      metrics: metrics in the names of this model.
      end: the condition that ends simulations, in the names of this model.
      reads_model: whether columns of metrics depend on numbers of each model, once there is a sampler.
      world_group: see `PerWorldFields.group`; empty until it is needed.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        structure: tuple[object, ...],
        metrics: Sequence[Metric],
        end: EndCondition | None,
        episode: EpisodeColumns | None,
    ) -> None:
        self.structure, self.metrics, self.end, self._episode = structure, metrics, end, episode
        self.world_group = ""
        self._model = model
        self._timeline: Timeline | None = None
        self._sampler: ProbeSampler | None = None
        self.reads_model = False

    def sampler(self, variant: ModelVariant, timeline: Timeline) -> ProbeSampler:
        """Returns the sampler of the columns of all metrics; variants share it if it does not read their numbers."""
        if self._sampler is None:
            self._timeline, self._sampler = timeline, self._new_sampler(self._model, timeline)
            probes = self._sampler.probes
            self.reads_model = any(isinstance(probe, RecordedFieldProbe) and probe.reads_model for probe in probes)
        elif self._timeline != timeline:
            self._timeline, self._sampler = timeline, self._sampler.with_timeline(timeline)
        return self._new_sampler(variant.model, timeline) if self.reads_model else self._sampler

    def _new_sampler(self, model: mujoco.MjModel, timeline: Timeline) -> ProbeSampler:
        names = dict.fromkeys([*metric_columns(self.metrics), *(self.end.columns if self.end else ())])
        return ProbeSampler(model, [*names], timeline, self._episode)


class _ReadyPoint:
    """A point that is ready to be simulated.

    Attributes:
      simulation: its simulation, or one with different numbers in the model.
      compiled: its compilation.
      timeline, sampler: its steps, and the columns of its metrics.
      kind: key of points that can run side by side; None for a point that can only run alone.
      wall: wall time until it was ready, including its compilation [s].
    """

    def __init__(
        self, point: StudyPoint, simulation: Simulation, variant: ModelVariant, compiled: _CompiledModel
    ) -> None:
        self.point, self.simulation, self.variant, self.compiled = point, simulation, variant, compiled
        self.wall = 0.0
        self._set_time()

    def _set_time(self) -> None:
        """Sets everything that depends on the timestep."""
        self.timeline = timeline_of(self.simulation, self.variant)
        self.sampler = self.compiled.sampler(self.variant, self.timeline)
        self.kind: tuple[object, ...] | None = None
        if self._can_share():
            self.kind = (self.compiled.structure, self.timeline.steps)

    def similar(self, point: StudyPoint, variant: ModelVariant) -> "_ReadyPoint":
        """Returns a point of the same simulation, whose model differs in copied fields only."""
        ready = copy.copy(self)
        ready.point, ready.variant, ready.wall = point, variant, 0.0
        if TIMESTEP in variant.arrays or TIMESTEP in self.variant.arrays:
            ready._set_time()
        return ready

    @property
    def start_key(self) -> tuple[int, ...]:
        """A key of points that start in the same state, as long as these points exist."""
        values = vars(self.simulation)
        return (id(self.start_model), *(id(values[name]) for name in STARTS))

    @property
    def start_model(self) -> mujoco.MjModel:
        """A model in which this point starts: copied fields do not change the start."""
        shares_start = self.variant.differs_as_copied and not self.variant.compiled.nplugin
        return self.variant.compiled if shares_start else self.variant.model

    def result(self, metrics: tuple[float, ...], steps: int, wall: float) -> PointResult:
        """Returns the result of a simulation that has reached its end, `wall` seconds after it was ready."""
        return PointResult(self.point.index, "ok", metrics, steps, wall=self.wall + wall)

    def may_have_similar(self, names: Sequence[str]) -> bool:
        """Returns whether points with other values of the parameters `names` may be `_SimilarPoints`."""
        has_paths = ABSENT not in self.point.values and all(map(is_path, names))
        is_shared = self.kind is not None and not self.compiled.reads_model
        return bool(names) and has_paths and is_shared and self.variant.differs_as_copied

    def _can_share(self) -> bool:
        simulation = self.simulation
        alone = (simulation.controller, simulation.replay, simulation.ctrl_from, simulation.policy)
        if any(each is not None for each in alone) or simulation.push or simulation.ctrl_noise:
            return False
        model = self.sampler.model
        return not model.opt.enableflags & SLEEP and self.sampler.reads_fields_only


class _SimilarPoints:
    """Points that differ from one only in copied fields of its model.

    Preparing them from that point is many times faster, as it takes no other simulation, source or model.

    Args:
      first: that point, whose model differs in copied fields only.
      names: names of the parameters, which are paths.
    """

    def __init__(self, first: _ReadyPoint, names: Sequence[str]) -> None:
        overrides = first.simulation.source.overrides
        own = [place for place, each in enumerate(overrides) if each.option == "set"][-len(names) :]
        self._first, self._names = first, names
        self._before = [each for each in overrides[: own[0]] if may_be_copied(each)]
        self._after = [each for each in overrides[own[-1] + 1 :] if may_be_copied(each)]

    def ready(self, point: StudyPoint) -> _ReadyPoint | None:
        """Returns a similar point that is ready; None if the point may not be similar."""
        own = [*map(Override, self._names, point.values)]
        if ABSENT in point.values or not all(map(may_be_copied, own)):
            return None
        variant = self._first.variant.compilation.with_values([*self._before, *own, *self._after])
        if variant is None:
            return None
        return self._first.similar(point, variant)


class _MeasuredRows:
    """The metrics of simulations of one kind, row by row, each up to its end.

    Args:
      first: the first of the points.
      every: steps between rows that metrics read; the end is such a row, too.
      count: number of simulations.

    Attributes:
      read_every: steps between rows to feed: a condition is evaluated at each step.
      running: `(n,)` bool; the engine clears those of failed simulations.
      has_ended: `(n,)` bool, true where the condition holds.
      steps: the last step of each simulation, `(n,)`.
    """

    def __init__(self, first: _ReadyPoint, every: int, count: int) -> None:
        self._end, self._names = first.compiled.end, first.sampler.names
        self._every, self._last = every, first.timeline.steps
        self._metrics = BatchMetricEvaluator(first.compiled.metrics, self._names, count)
        self.read_every = 1 if self._end else every
        self.running, self.has_ended = np.ones(count, bool), np.zeros(count, bool)
        self.steps = np.full(count, first.timeline.steps)

    def feed(self, steps: np.ndarray, tables: np.ndarray, counts: np.ndarray) -> None:
        """Adds the next rows `(n, rows, columns)` at `steps` `(rows,)`; `counts` `(n,)` of them are valid."""
        if self._end is None:
            self._metrics.feed(tables, counts)
            return
        ends = self._end.counts(self._names, tables, np.where(self.has_ended, 0, counts))
        counts = np.where(self.has_ended, 0, np.where(ends, ends, counts))
        is_new, last_row = ends > 0, np.maximum(ends - 1, 0)
        self.steps = np.where(is_new, steps[last_row], self.steps)
        self.has_ended |= is_new
        self.running &= ~is_new
        is_row = (steps % self._every == 0) | (steps == self._last)
        if is_row.any():
            self._metrics.feed(tables[:, is_row], np.concatenate([[0], np.cumsum(is_row)])[counts])
        if not is_row.all():
            ends_between = is_new & ~is_row[last_row]
            self._metrics.feed(tables[np.arange(len(tables)), last_row][:, None], ends_between.astype(int))

    def values(self) -> list[tuple[float, ...]]:
        """Returns the metrics of each simulation, after its last rows."""
        return self._metrics.values()


def timeline_of(simulation: Simulation, variant: ModelVariant) -> Timeline:
    """Returns the timeline of a simulation of a variant; makes no model for it if it differs in copied fields only."""
    if not variant.differs_as_copied or simulation.replay is not None:
        return simulation.timeline(variant.model)
    timestep = rational(variant.arrays[TIMESTEP].item()) if TIMESTEP in variant.arrays else None
    return simulation.timeline(variant.compiled, timestep)


def _model_sizes(points: Sequence[_ReadyPoint]) -> dict[int, int]:
    """Returns the memory of each model of these points [bytes], by its id."""
    sizes = dict[int, int]()
    for variant in (point.variant for point in points):
        sizes[id(variant.compiled)] = variant.compilation.size
        if variant.has_copy:
            sizes[id(variant.model)] = variant.compilation.size
    return sizes


def structure(model: mujoco.MjModel) -> tuple[object, ...]:
    """Returns a key that models share whose simulations have the same columns and can run side by side."""
    sizes = (model.nq, model.nv, model.nu, model.na, model.nbody, model.njnt, model.ngeom, model.nsite, model.ntendon)
    memory = (model.nsensordata, model.nM, model.nD, model.narena, model.nbuffer, model.nhistory)
    kinds = (model.jnt_type.tobytes(), model.sensor_type.tobytes(), model.sensor_dim.tobytes())
    delays = (model.actuator_history.tobytes(), model.sensor_history.tobytes())  # samples that are kept
    return (*sizes, *memory, *kinds, *delays, int(model.opt.integrator), model.names)
