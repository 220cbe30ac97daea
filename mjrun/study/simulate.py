"""Simulates points of a study, and measures their metrics while the rows stream by.

Points whose simulations are of one kind run side by side in one batch; every number is bit for bit that of the point
alone.
"""

import math
import time
from collections.abc import Iterator, Sequence
from weakref import WeakKeyDictionary

import mujoco
import numpy as np

from mjrun.errors import MjrunError, SimulationError, UnstableError, UsageError, concerning, flag, option
from mjrun.model import state
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.model.variants import BYTES, Compilation, ModelVariant, ModelVariants
from mjrun.outputs.trace_rows import ProbeSampler, RowBuffer
from mjrun.physics.c_engine import AUTORESET, ENERGY, SLEEP, CEngine
from mjrun.physics.engine import Engine, joined
from mjrun.physics.observe import Tap, observe
from mjrun.physics.stepper import PhysicsStepper
from mjrun.physics.warp_device import WarpDevice, WarpFields
from mjrun.physics.warp_engine import WarpEngine
from mjrun.probe.available import AvailableProbes
from mjrun.probe.episode import EpisodeColumns
from mjrun.probe.fields import FieldProbe
from mjrun.probe.metric import Metric, MetricEvaluation, parse_metric
from mjrun.simulation.episode import Episode
from mjrun.simulation.simulation import Simulation
from mjrun.study.spec import PointResult, Status, StudyPoint, StudySpec
from mjrun.timeline import Timeline

WORLDS = 8192  # the same of Warp
WORLD_BYTES = 2**31  # of their models
NOT_IN_WARP = (
    f"{option('engine')} warp: policies, controllers, replays, tables of controls, noise, pushes and sleep are not for "
    f"it, nor are metrics that no recorded field holds\n{option('engine')} local simulates them"
)
ENOUGH = 512  # rows that are worth measuring at once
SIDE_BY_SIDE = 64  # simulations of a batch, at most: more only take memory
BUG = 70


class PointSimulator:
    """Simulates points of one study."""

    def __init__(self, spec: StudySpec) -> None:
        self._spec = spec
        self._variants = ModelVariants(self._prepare)
        self._compiled = WeakKeyDictionary[Compilation, _CompiledModel]()
        self._metrics = dict[object, list[Metric]]()
        self._engine: Engine
        self._world_fields: WarpFields | None = None
        if spec.engine == "c":
            self._engine = CEngine(threads=1)
            self._most, self._most_bytes = SIDE_BY_SIDE, BYTES
        else:
            device = WarpDevice()
            self._engine = WarpEngine(device)
            self._most, self._most_bytes = WORLDS, WORLD_BYTES
            self._world_fields = WarpFields(device)

    def run(self, points: Sequence[StudyPoint]) -> Iterator[PointResult]:
        """The result of each point, not in their order, each as soon as it is known."""
        batches: dict[object, list[_Prepared]] = {}
        sizes: dict[int, int] = {}  # of their models, by id
        with collected_warnings(), without_timers():
            for point in points:
                start = time.perf_counter()
                try:
                    prepared = self._ready(point)
                    prepared.wall = time.perf_counter() - start
                except Exception as error:
                    yield self._failed(point, error, 0, time.perf_counter() - start)
                    continue
                if prepared.kind is None:
                    yield self._alone(prepared)
                    self._variants.reuse(prepared.variant)
                    continue
                batches.setdefault(prepared.kind, []).append(prepared)
                sizes |= _model_sizes([prepared])
                if sum(map(len, batches.values())) == self._most or sum(sizes.values()) > self._most_bytes:
                    largest = max(batches, key=lambda kind: len(batches[kind]))
                    yield from self._side_by_side(batches.pop(largest))
                    sizes = _model_sizes([prepared for batch in batches.values() for prepared in batch])
            for batch in batches.values():
                yield from self._side_by_side(batch)

    def _ready(self, point: StudyPoint) -> "_Prepared":
        simulation = self._spec.simulation(point.values)
        if simulation.episode is not None:
            return self._acting(point, simulation, simulation.episode)
        variant = self._variants.load(simulation.source)
        compiled = self._compiled.get(variant.compilation) or self._found_out(variant.compilation)
        timeline = simulation.timeline(variant.model)
        prepared = _Prepared(point, simulation, variant, timeline, compiled.sampler(timeline), compiled)
        if self._world_fields:
            if prepared.kind is None:
                raise UsageError(NOT_IN_WARP)
            prepared.kind = (*prepared.kind, self._world_group(self._world_fields, variant, compiled))
        return prepared

    def _world_group(self, fields: WarpFields, variant: ModelVariant, compiled: "_CompiledModel") -> str:
        """What points must have in common to be worlds of one group."""
        if variant.model is not variant.compiled:
            return fields.group(variant.model)
        compiled.world_group = compiled.world_group or fields.group(variant.model)
        return compiled.world_group

    def _acting(self, point: StudyPoint, simulation: Simulation, episode: Episode) -> "_Prepared":
        """A point at which a policy acts: its episode has a model and columns of its own."""
        if self._spec.engine == "warp":
            raise UsageError(NOT_IN_WARP)
        model = episode.model()
        timeline, key = simulation.timeline(model), (*structure(model), *episode.columns.names)
        compiled = _CompiledModel(model, key, self._metrics_of(model, key, episode.columns), episode.columns)
        return _Prepared(
            point,
            simulation,
            ModelVariant(model, Compilation(None, model)),
            timeline,
            compiled.sampler(timeline),
            compiled,
        )

    def _prepare(self, model: mujoco.MjModel) -> None:
        """Sets the flags that simulations need, so that nobody has to copy the model for them."""
        model.opt.disableflags |= AUTORESET
        if any("energy" in text for _, text in self._spec.metrics):
            model.opt.enableflags |= ENERGY

    def _found_out(self, compilation: Compilation) -> "_CompiledModel":
        """What is to be known of a compiled model, and remembered as long as it is."""
        model = compilation.model
        key = structure(model)
        compiled = self._compiled[compilation] = _CompiledModel(model, key, self._metrics_of(model, key))
        return compiled

    def _metrics_of(
        self, model: mujoco.MjModel, key: tuple[object, ...], episode: EpisodeColumns | None = None
    ) -> Sequence[Metric]:
        """The metrics in the names of `model` and of an episode, which all have in common that have this `key`."""
        if key not in self._metrics:
            available = AvailableProbes(model, episode.names if episode else ())
            self._metrics[key] = []
            for name, text in self._spec.metrics:
                with concerning("metric", name):
                    self._metrics[key].append(parse_metric(text, available, f"{option('metric')} {name}"))
        return self._metrics[key]

    def _alone(self, prepared: "_Prepared") -> PointResult:
        start = time.perf_counter()
        try:
            stepper = prepared.simulation.stepper(prepared.variant.model)
            rows = prepared.timeline.rows(every=self._spec.every)
            if isinstance(stepper, PhysicsStepper):
                for part in prepared.sampler.blocks(stepper, rows):
                    prepared.feed(part().values)
            else:
                buffer = RowBuffer(prepared.sampler, rows, lambda block: prepared.feed(block.values))
                observe(stepper, [Tap(rows, prepared.sampler.read, buffer.add)], rows[-1])
                buffer.flush()
            if isinstance(stepper, PhysicsStepper) and stepper.lacks_memory:
                raise out_of_memory(stepper.step, prepared.timeline)
        except Exception as error:
            steps = error.step if isinstance(error, SimulationError) else 0
            return self._failed(prepared.point, error, steps, prepared.wall + time.perf_counter() - start)
        return prepared.result(time.perf_counter() - start)

    def _side_by_side(self, batch: Sequence["_Prepared"]) -> Iterator[PointResult]:
        begin = time.perf_counter()
        ready: list[_Prepared] = []
        starts: list[np.ndarray] = []
        data = mujoco.MjData(batch[0].variant.model)  # they are all of one size
        for prepared in batch:
            try:
                model = prepared.variant.model
                prepared.simulation.start.reset(model, data)
                starts.append(state.save(model, data))
                ready.append(prepared)
            except MjrunError as error:
                yield self._failed(prepared.point, error, 0, prepared.wall)
        if not ready:
            return

        try:
            failures = self._roll_out(ready, np.array(starts))
        except Exception as error:  # of them all, such as a model that the engine refuses
            yield from (self._failed(prepared.point, error, 0, prepared.wall) for prepared in ready)
            return

        wall = (time.perf_counter() - begin) / len(ready)
        for index, prepared in enumerate(ready):
            if failure := failures.get(index):
                yield self._failed(prepared.point, failure, failure.step, prepared.wall + wall)
            else:
                yield prepared.result(wall)
        for prepared in batch:
            self._variants.reuse(prepared.variant)

    def _roll_out(self, ready: Sequence["_Prepared"], starts: np.ndarray) -> dict[int, SimulationError]:
        """Feeds every simulation its rows, and returns what became of those that failed, by index."""
        first = ready[0]
        models = [prepared.variant.model for prepared in ready]
        steps, every = first.timeline.steps, self._spec.every
        failures = dict[int, SimulationError]()
        for block in joined(self._engine.rollout(models, starts, None, steps, first.sampler.fields, every), ENOUGH):
            failures |= block.failures
            for index, step in block.shortages.items():
                failures.setdefault(index, out_of_memory(step, first.timeline))
            wanted = len(block.steps) - (block.steps[-1] % every != 0)  # the last step is no row of every N-th
            for index, prepared in enumerate(ready):
                count = min(int(block.counts[index]), wanted)
                if count > 0:
                    fields = {name: values[index, :count] for name, values in block.fields.items()}
                    initial = {name: values[index] for name, values in block.initial.items()}
                    prepared.feed(prepared.sampler.rows(block.steps[:count], fields, initial))
        return failures

    def _failed(self, point: StudyPoint, error: Exception, steps: int, wall: float) -> PointResult:
        status: Status = "unstable" if isinstance(error, UnstableError) else "failed"
        code = error.exit_code if isinstance(error, MjrunError) else BUG
        text = error.spelled(flag) if isinstance(error, MjrunError) else f"{type(error).__name__}: {error}"
        if self._spec.base.snapshot:
            text = self._spec.base.snapshot.with_original_names(text)
        metrics = (math.nan,) * len(self._spec.metrics)
        return PointResult(point.index, status, metrics, steps, code, text, wall)


class _CompiledModel:
    """What the variants of a compiled model have in common.

    Attributes:
      structure: see `structure`.
      metrics: in the names of this model.
      world_group: see `WarpFields.group`; empty as long as nobody has asked.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        structure: tuple[object, ...],
        metrics: Sequence[Metric],
        episode: EpisodeColumns | None = None,
    ) -> None:
        self.structure, self.metrics, self._episode = structure, metrics, episode
        self.world_group = ""
        self._model, self._sampler = model, dict[Timeline, ProbeSampler]()
        self._columns = [*dict.fromkeys(name for each in metrics for name in each.columns if name != "time")]

    def sampler(self, timeline: Timeline) -> ProbeSampler:
        """What measures the columns of all metrics, of whatever variant: nothing that variants differ in decides it."""
        if timeline not in self._sampler:
            self._sampler = {timeline: ProbeSampler(self._model, self._columns, timeline, self._episode)}
        return self._sampler[timeline]


class _Prepared:
    """A point that is ready to be simulated.

    Attributes:
      kind: points of one kind can run side by side; None for one that can only run alone.
      wall: wall time [s] until it was ready, which its compilation takes.
    """

    def __init__(
        self,
        point: StudyPoint,
        simulation: Simulation,
        variant: ModelVariant,
        timeline: Timeline,
        sampler: ProbeSampler,
        compiled: _CompiledModel,
    ) -> None:
        self.point, self.simulation, self.variant = point, simulation, variant
        self.timeline, self.sampler = timeline, sampler
        self.wall = 0.0
        names = [column.name for column in sampler.columns]
        self._metrics = MetricEvaluation(compiled.metrics, names)
        self.kind: tuple[object, ...] | None = None
        if self._can_share():
            self.kind = (compiled.structure, timeline.steps)

    def feed(self, block: np.ndarray) -> None:
        """Takes the next rows."""
        self._metrics.feed(block)

    def result(self, wall: float) -> PointResult:
        """The result of a simulation that has reached its end, within `wall` seconds after it was ready."""
        return PointResult(self.point.index, "ok", self._metrics.values(), self.timeline.steps, wall=self.wall + wall)

    def _can_share(self) -> bool:
        simulation = self.simulation
        alone = (simulation.controller, simulation.replay, simulation.ctrl_from, simulation.policy)
        if any(each is not None for each in alone) or simulation.push or simulation.ctrl_noise:
            return False
        model = self.sampler.model
        return not model.opt.enableflags & SLEEP and all(isinstance(p, FieldProbe) for p in self.sampler.probes)


def _model_sizes(points: Sequence[_Prepared]) -> dict[int, int]:
    """The memory of each model of these points [bytes], by its id."""
    models = {id(model): model for point in points for model in (point.variant.model, point.variant.compiled)}
    return {key: mujoco.mj_sizeModel(model) for key, model in models.items()}


def out_of_memory(step: int, timeline: Timeline) -> SimulationError:
    """Why a simulation fails in which MuJoCo has left out contacts; it goes on, but what follows is wrong."""
    text = f"MuJoCo left out contacts or constraints by step {step}: the model has too little memory for them"
    return SimulationError(step, float(timeline.time(step)), f'{text}; give it more as in <size memory="10M"/>')


def structure(model: mujoco.MjModel) -> tuple[object, ...]:
    """What models have in common whose simulations have the same columns, and can run side by side."""
    sizes = (model.nq, model.nv, model.nu, model.na, model.nbody, model.njnt, model.ngeom, model.nsite, model.ntendon)
    memory = (model.nsensordata, model.nM, model.nD, model.narena, model.nbuffer, model.nhistory)
    kinds = (model.jnt_type.tobytes(), model.sensor_type.tobytes(), model.sensor_dim.tobytes())
    delays = (model.actuator_history.tobytes(), model.sensor_history.tobytes())  # samples that are kept
    return (*sizes, *memory, *kinds, *delays, int(model.opt.integrator), model.names)
