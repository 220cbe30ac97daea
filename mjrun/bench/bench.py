"""A benchmark: wall time of steps and frames of a simulation on this machine, and its accuracy.

The points of a grid of settings are timed in turn.
"""

import copy
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, field, replace
from fractions import Fraction
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjrun.bench import output_timing
from mjrun.bench.block_timing import Clock, ReferenceWorkloadInfo, ReferenceWorkloadTimer, RolloutInputs
from mjrun.bench.results import (
    SCHEMA,
    BenchResult,
    BenchSettings,
    EngineInfo,
    GridPointResult,
    IntegrationAccuracy,
    MachineInfo,
    ModelInfo,
    StepCounts,
    check_same,
    compare,
    machine_info,
    read_base,
    steps_of,
    workload_obstacle,
)
from mjrun.bench.step_timing import (
    LEFT_OUT,
    MOST_STEPS,
    C,
    StepTimer,
    TimingBudget,
    WarpSettings,
    WarpStepTimer,
    check_engine,
)
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, SimulationError, UsageError, file_errors, option, spelled
from mjrun.experiment.design import SHORT_PATHS, value_list
from mjrun.formats.output_writer import StagedFile, require_own
from mjrun.model.mujoco_globals import collected_warnings, report_warnings
from mjrun.model.names import enum_members, names
from mjrun.model.override import Override, overrides_of
from mjrun.model.source import ModelSource
from mjrun.model.sources import ModelLike, source_of
from mjrun.options.bench import BenchOptions
from mjrun.options.number_kinds import AUTO
from mjrun.options.option import is_given, options
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.output import RenderingResources
from mjrun.physics.initial_state import InitialState
from mjrun.physics.stepper import PhysicsStepper
from mjrun.physics.warp_device import COMPILES
from mjrun.platform.cores import available_cores
from mjrun.rendering.backend import WorkingBackend
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.simulation.origin import origin
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import nearest, rational

TEST = "test"  # keyframe from which testspeed starts
HORIZON = Fraction(1)  # [s] simulated time
WHOLE = Fraction(1)  # [s] simulated time of whole videos and traces
FINER = 8  # steps of the default finer run for each step of the finest point of the grid
NOISE_STD, NOISE_RATE = 0.01, 0.1  # as in testspeed


@dataclass(frozen=True)
class GridPoint:
    """A point of the grid: its settings, its model, and the steps in a rollout, if they are fixed."""

    point: Mapping[str, str]
    model: mujoco.MjModel
    steps: int | None = None


@dataclass(frozen=True)
class RolloutStart:
    """Start of a rollout, and the noise on its controls; see `Bench`."""

    key: str | None
    noise_std: float
    noise_rate: float

    def run(self, model: mujoco.MjModel, steps: int) -> RolloutInputs:
        """Returns a rollout of `model` with controls for `steps` steps."""
        data = self.data(model)
        if not (self.noise_std and model.nu):
            return RolloutInputs.of(model, data)
        center = None if self.key is None else data.ctrl.copy()
        return RolloutInputs.of(model, data, noisy_controls(model, steps, self.noise_std, self.noise_rate, center))

    def first_frames(self, model: mujoco.MjModel, fps: Fraction, count: int) -> list[np.ndarray]:
        """Returns the integration states at the first frames of a video."""
        spacing = 1 / (fps * rational(model.opt.timestep))
        steps = [nearest(frame * spacing) for frame in range(count)]
        return self.run(model, steps[-1]).states(steps)

    def data(self, model: mujoco.MjModel) -> mujoco.MjData:
        """Returns a new MjData at the start."""
        return InitialState(self.key).data(model)


@dataclass(frozen=True)
class MeasurementSettings:
    """Settings of the measurement of each point of the grid.

    Attributes:
      budget: wall time for all points [s].
      repeats: number of rollouts of each point; None lets the budget determine it.
      threads: numbers of copies.
      horizon: simulated time after which accuracy is measured [s]; None omits it.
      reference: timestep of the finer run [s]; None is an eighth of the finest of the grid.
      warp: options of MuJoCo Warp; None uses MuJoCo itself.
    """

    budget: float
    repeats: int | None
    threads: Sequence[int]
    horizon: Fraction | None
    reference: Fraction | None
    warp: WarpSettings | None = None

    def timer(self, point: GridPoint, setup: RolloutStart, share: float, clock: Clock) -> StepTimer:
        """Returns the timer of the steps of a point, with a `share` of the budget."""
        make = partial(setup.run, point.model)
        budget = TimingBudget(share * self.budget, point.steps, self.repeats)
        if self.warp is None:
            return StepTimer(make, budget, clock, ReferenceWorkloadTimer(clock))
        return WarpStepTimer(make, budget, clock, warp=self.warp)


def check_reference(reference: Fraction | None, grid: Sequence[GridPoint]) -> None:
    """Refuses a reference run that is not finer than all points.

    Raises:
      BadValueError: its timestep is not below all others.
    """
    finest = min(point.model.opt.timestep for point in grid)
    if reference is not None and reference >= rational(finest):
        expected = f"finer than every measured timestep, of which the finest is {finest:.6g} s"
        raise BadValueError(option("reference"), f"{float(reference):.6g}", expected)


def timed_grid(
    grid: Sequence[GridPoint], setup: RolloutStart, settings: MeasurementSettings, reporter: Reporter, clock: Clock
) -> list[GridPointResult]:
    """Measures every point. Their rollouts take turns, so that disturbances affect all of them.

    Raises:
      SimulationError: no point is stable.
    """
    timers = [settings.timer(point, setup, 1 / len(grid), clock) for point in grid]
    if settings.warp:
        reporter.note(COMPILES)

    failures = [_failure(timer.warm_up) for timer in timers]
    # All take equally many steps unless they are fixed, since the cost of a step changes during the motion.
    fewest = min((t.steps for t, failure in zip(timers, failures, strict=True) if not failure), default=1)
    failures = [
        failure or _failure(partial(timer.begin, point.steps or fewest))
        for point, timer, failure in zip(grid, timers, failures, strict=True)
    ]
    stable = [timer for timer, failure in zip(timers, failures, strict=True) if not failure]
    if not stable:
        raise next(failure for failure in failures if failure)

    _take_turns(stable, reporter)
    finer = settings.reference or min(rational(point.model.opt.timestep) for point in grid) / FINER
    results = [
        _result(point, failure or timer, settings.threads, _accuracy(point.model, setup, settings.horizon, finer))
        for point, timer, failure in zip(grid, timers, failures, strict=True)
    ]
    for overflow in dict.fromkeys(overflow for timer in stable for overflow in timer.overflows):
        reporter.warn(overflow)
    return results


def _failure(action: Callable[[], None]) -> SimulationError | None:
    try:
        action()
    except SimulationError as error:
        return error
    return None


def _take_turns(timers: Sequence[StepTimer], reporter: Reporter) -> None:
    done, total = 0, sum(timer.repeats for timer in timers)
    for turn in range(max(timer.repeats for timer in timers)):
        for timer in timers:
            if turn < timer.repeats:
                timer.rollout()
                done += 1
                reporter.progress("rollouts", done, total)


def _result(
    point: GridPoint, timer: StepTimer | SimulationError, threads: Sequence[int], accuracy: IntegrationAccuracy | None
) -> GridPointResult:
    opt = point.model.opt
    integrator, timestep = _name(mujoco.mjtIntegrator, opt.integrator), float(opt.timestep)
    if isinstance(timer, SimulationError):
        failure = _first_line(timer)
        return GridPointResult(dict(point.point), integrator, timestep, accuracy=accuracy, failure=failure)

    step, profile = timer.step, timer.profile
    counts = StepCounts(
        contacts=profile.contacts,
        constraints=profile.constraints,
        solver=_name(mujoco.mjtSolver, opt.solver),
        iterations=profile.iterations,
        arena=profile.arena,
        arena_size=profile.arena_size,
    )
    return GridPointResult(
        point=dict(point.point),
        integrator=integrator,
        timestep=timestep,
        steps=timer.steps,
        block=timer.block,
        step=step,
        reference_workload=timer.reference_workload,
        steps_per_second=1 / step.median,
        realtime_factor=timestep / step.median,
        first_step=timer.first,
        counts=counts,
        phases=profile.phases,
        threads=timer.threads(threads),
        overflows=[spelled(overflow) for overflow in timer.overflows],
        accuracy=accuracy,
    )


def _name(enum: type, value: int) -> str:
    """Returns the MJCF name of a member of one of MuJoCo's enums."""
    return next(name for name, number in enum_members(enum).items() if number == value)


def _accuracy(
    model: mujoco.MjModel, setup: RolloutStart, horizon: Fraction | None, finer: Fraction
) -> IntegrationAccuracy | None:
    if horizon is None:
        return None
    drift = None
    try:
        final = simulate_to(model, setup.data(model), horizon)
        drift = final.drift
        distance = distance_from_finer(model, setup.data(model), final, finer)
    except SimulationError as error:
        where = "" if drift is None else "the finer run: "
        return IntegrationAccuracy(float(horizon), drift, float(finer), None, where + _first_line(error))
    return IntegrationAccuracy(float(final.time), drift, float(finer), distance)


def _first_line(error: SimulationError) -> str:
    return str(error).partition("\n")[0]


def notes_on(results: Sequence[GridPointResult], grid: Sequence[GridPoint]) -> list[str]:
    """Returns remarks on these results."""
    notes = list[str]()
    fewer = sorted({result.steps for result in results if result.step and result.steps < MOST_STEPS})
    if fewer and all(point.steps is None for point in grid):
        shown = ", ".join(map(str, fewer))
        notes.append(
            f"rollouts of {shown} steps instead of {MOST_STEPS}, to keep to the budget; give the "
            "number of steps to fix it"
        )
    if any(result.step and result.step.confidence is None for result in results):
        notes.append("there are too few repeats for an interval, which takes at least 6")
    return notes


@dataclass(frozen=True)
class FinalState:
    """The final state of a simulation.

    Attributes:
      time: simulated time [s], exact.
      qpos, qvel: positions `(nq,)` and velocities `(nv,)`.
      drift: potential and kinetic energy, minus those at the start [J].
    """

    time: Fraction
    qpos: np.ndarray
    qvel: np.ndarray
    drift: float


def simulate_to(model: mujoco.MjModel, data: mujoco.MjData, horizon: Fraction) -> FinalState:
    """Simulates from the state in `data`, with constant controls, for the number of steps nearest to `horizon` [s].

    Raises:
      SimulationError: the simulation becomes unstable, or MuJoCo cannot complete a step.
    """
    timestep = rational(model.opt.timestep)
    return _advanced(_stepper(model, data), max(1, nearest(horizon / timestep)), timestep)


def distance_from_finer(model: mujoco.MjModel, data: mujoco.MjData, final: FinalState, timestep: Fraction) -> float:
    """Returns the distance of `final` from the end of a simulation with finer steps.

    Args:
      data: start of both simulations.
      timestep: timestep of the finer simulation [s].

    Returns:
      The root mean square, over all degrees of freedom, of the difference of the positions
      (`mj_differentiatePos`) [m and rad].

    Raises:
      SimulationError: the finer simulation becomes unstable, or MuJoCo cannot complete a step.
    """
    finer = copy.copy(model)
    finer.opt.timestep = float(timestep)
    steps = nearest(final.time / timestep)
    reference = _advanced(_stepper(finer, data), steps, timestep)
    # Its last step may miss that instant by up to half a step, which its velocity covers.
    qpos, rest = reference.qpos.copy(), float(final.time - reference.time)
    mujoco.mj_integratePos(model, qpos, reference.qvel, rest)
    return position_distance(model, qpos, final.qpos)


def position_distance(model: mujoco.MjModel, a: np.ndarray, b: np.ndarray) -> float:
    """Returns the root mean square over all degrees of freedom of the difference of positions `(nq,)` [m and rad]."""
    difference = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, difference, 1.0, a, b)
    return float(np.sqrt(np.mean(difference**2))) if model.nv else 0.0


def _stepper(model: mujoco.MjModel, data: mujoco.MjData) -> PhysicsStepper:
    measured = copy.copy(model)
    measured.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    return PhysicsStepper(measured, data)


def _advanced(stepper: PhysicsStepper, steps: int, timestep: Fraction) -> FinalState:
    before = float(stepper.instant().energy.sum())
    stepper.advance(steps)
    end = stepper.instant()
    return FinalState(steps * timestep, end.qpos.copy(), end.qvel.copy(), float(end.energy.sum()) - before)


def halton(index: np.ndarray, base: int) -> np.ndarray:
    """Returns the elements `index` `(n,)` of the Halton sequence of a base, in [0, 1), bit for bit as `mju_Halton`.

    They are the digits of the index, mirrored at the point: Halton 1960, Numerische Mathematik 2, 84-90.
    """
    rest, weight, elements = np.array(index), 1 / base, np.zeros(len(index))
    while rest.any():
        rest, digit = np.divmod(rest, base)
        elements += weight * digit
        weight /= base
    return elements


def noisy_controls(
    model: mujoco.MjModel,
    steps: int,
    std: float = NOISE_STD,
    rate: float = NOISE_RATE,
    center: np.ndarray | None = None,
) -> np.ndarray:
    """Returns the controls of every step, `(steps, nu)`, with the noise of MuJoCo 4.0's `sample/testspeed.cc`.

    Noise keeps a model from settling, where warm starts make steps unrealistically cheap.
    Each control returns to its centre exponentially, is pushed by an element of a Halton sequence, and stays in its
    range: an Ornstein-Uhlenbeck process, except that its noise is uniform instead of Gaussian.

    Args:
      std: scale of the noise in half ranges of the actuator, or in its units if it has no range.
      rate: time constant of the return [s]; 0 returns immediately.
      center: centre of each control `(nu,)`; None is the middle of its range, or 0 without one.
    """
    limited, (low, high) = model.actuator_ctrllimited.astype(bool), model.actuator_ctrlrange.T
    middle = np.where(limited, 0.5 * (high + low), 0.0) if center is None else np.asarray(center, float)
    keep = math.exp(-model.opt.timestep / rate) if rate else 0.0
    scale = std * math.sqrt(1 - keep * keep) * np.where(limited, 0.5 * (high - low), 1.0)
    pushes = [2 * halton(np.arange(steps), actuator + 2) - 1 for actuator in range(model.nu)]
    low, high = np.where(limited, low, -np.inf), np.where(limited, high, np.inf)
    noise = scale * np.column_stack(pushes) if model.nu else np.empty((steps, 0))
    last = middle
    for row in noise:
        row += keep * last + (1 - keep) * middle
        np.clip(row, low, high, out=row)
        last = row
    return noise


# --- the benchmark -----------------------------------------------------------------------------------


@options
class Bench(BenchOptions):
    """A benchmark of a model. Its options are keywords.

    Args:
      model: a file, another source such as `scene:dominos`, or a compiled model.
      command: command line.

    Rollouts have the length of those of testspeed by default: at most 10,000 steps, fewer if the budget requires it.
    All points of a `scan` are measured in turn, so that disturbances affect all of them.

    Raises:
      UsageError: a value is invalid, or would have no effect.
    """

    model: ModelLike = field(kw_only=False)
    command: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        needs = (("horizon", "accuracy"), ("reference", "accuracy"), ("fail_above", "compare"), ("force", "compare"))
        for name, other in needs:
            if is_given(self, name) and not is_given(self, other):
                raise UsageError(f"{option(name)} has no effect without {option(other)}")
        self._check_drawings()
        if self.scan and isinstance(self.model, mujoco.MjModel):
            raise UsageError(f"{option('scan')} changes a model before it is compiled; give its file")

        of_c = {"threads": bool(self.threads), "accuracy": self.accuracy, "render": self.render, "whole": self.whole}
        of_warp = {"worlds": self.worlds, "device": self.device, "nconmax": self.nconmax, "njmax": self.njmax}
        check_engine(self.engine, of_c, of_warp)

    @cached_property
    def drawings(self) -> list[ViewOptions]:
        """Every combination of size, view, quality and renderer; the first is that of a whole video."""
        usual = ViewOptions()
        return [
            ViewOptions(
                camera=self.camera or "free",
                size=size,
                view=view,
                quality=quality,
                renderer=renderer,
                gl=self.gl,
                require_gpu=self.require_gpu,
            )
            for renderer, size, quality, view in product(
                self.renderer or [usual.renderer],
                self.size or [usual.size],
                self.quality or [usual.quality],
                self.view or usual.view,
            )
        ]

    @cached_property
    def grid(self) -> dict[str, list[str]]:
        """Values of each setting in the scan."""
        grid = dict[str, list[str]]()
        for path, text in self.scan:
            if path in grid:
                raise UsageError(f"{option('scan')} {path} is given twice; give all its values at once")
            grid[path] = [*value_list(path, text, "scan")]
        return grid

    def _check_drawings(self) -> None:
        """Refuses drawing options if nothing is drawn, and several drawings of one video."""
        names = ("camera", "size", "view", "quality", "renderer", "gl", "require_gpu")
        drawing_options = [option(name) for name in names if is_given(self, name)]
        if drawing_options and not (self.render or self.whole):
            hint = f"add {option('render')} to time frames, or {option('whole')} to time a video"
            raise UsageError(f"{', '.join(drawing_options)}: nothing is drawn\n{hint}")
        if self.whole and not self.render and len(self.drawings) > 1:
            several = f"{option('render')} times several views"
            raise UsageError(f"{option('whole')} times one video, not {len(self.drawings)}; {several}")

    def run(self, reporter: Reporter | None = None, clock: Clock = time.perf_counter) -> BenchResult:
        """Runs the benchmark. Invalid options fail before the first step; an unstable point of a grid is a result.

        Args:
          clock: wall time [s].

        Raises:
          SimulationError: every point of the grid is unstable.
          MjrunError: the benchmark failed; nothing is saved.
        """
        reporter, begun = reporter or PythonApiReporter(), clock()
        with collected_warnings() as warnings, ExitStack() as stack:
            target = None
            if self.save is not None:
                require_own(Path(self.save), SCHEMA.rpartition("-")[0], "a baseline of mjrun bench")
                target = StagedFile(Path(self.save))
                stack.callback(target.cleanup)
            result = self._measured(reporter, clock)
            result = replace(result, wall=clock() - begun)
            if target:
                _publish(target, result)

        # Failures describe more precisely what MuJoCo warns of.
        if not any(row.failure or (row.accuracy and row.accuracy.failure) for row in result.rows):
            report_warnings(warnings, reporter)
        return result

    def _measured(self, reporter: Reporter, clock: Clock) -> BenchResult:
        base = None if self.compare is None else read_base(self.compare)
        machine = machine_info()
        warp = None if self.engine == C else WarpSettings(self.device, self.worlds, self.nconmax, self.njmax)
        is_compiled = isinstance(self.model, mujoco.MjModel)
        model, load = (self.model, None) if is_compiled else output_timing.timed_load(self._source, clock)
        key = TEST if self.key is None and TEST in names(model, "keyframe") else self.key
        setup = RolloutStart(key, self.noise_std, self.noise_rate)
        simulation = Simulation(self._source, key=setup.key, duration=WHOLE)
        header = self._header(simulation, model, load, machine, warp)
        overridden = [] if base is None else check_same(asdict(header), base, str(self.compare), self.force)
        grid, measurement = self._grid(model, base), self._measurement(warp)
        check_reference(measurement.reference, grid)
        backends = self._backends()

        rows = timed_grid(grid, setup, measurement, reporter, clock)
        frames = self._frames(model, setup, backends, clock)
        whole = (
            [
                output_timing.timed_trace(simulation, clock),
                output_timing.timed_video(simulation, self.drawings[0], clock),
            ]
            if self.whole
            else []
        )

        # Warp does not share MuJoCo's known bugs.
        notes = [*machine.disturbances, *(simulation.start if warp else simulation).remarks(model)]
        notes += [*notes_on(rows, grid), *([LEFT_OUT] if warp else [])]
        result = replace(header, rows=rows, frames=frames, whole=whole, load_after=machine_info().load, notes=notes)
        return result if base is None else self._compared(result, base, overridden)

    def _compared(self, result: BenchResult, base: Mapping[str, Any], overridden: Sequence[str]) -> BenchResult:
        now = asdict(result)
        comparison = compare(now, base, str(self.compare), self.fail_above or 0.0, overridden)
        if not (obstacle := workload_obstacle(now, base)):
            return replace(result, comparison=comparison)
        note = f"wall times are compared directly, regardless of other load of the machine: {obstacle}"
        return replace(result, comparison=comparison, notes=[*result.notes, note])

    def _backends(self) -> list[WorkingBackend]:
        """Detects the backend of each drawing before anything is timed."""
        drawings = self.drawings if self.render else self.drawings[:1] if self.whole else []
        with closing(RenderingResources()) as rendering:
            return [rendering.backend(drawing) for drawing in drawings]

    @property
    def _source(self) -> ModelSource:
        """Source of the model, with overrides."""
        source = source_of(self.model)
        return replace(source, overrides=(*source.overrides, *overrides_of(self)))

    def _grid(self, model: mujoco.MjModel, base: Mapping[str, Any] | None) -> list[GridPoint]:
        """Returns every point of the grid with its model; a baseline determines its steps unless they are specified."""
        grid = list[GridPoint]()
        for values in product(*self.grid.values()):
            point = dict(zip(self.grid, values, strict=True))
            compiled = model
            if point:
                overrides = [Override(SHORT_PATHS.get(path, path), value) for path, value in point.items()]
                compiled = replace(self._source, overrides=(*self._source.overrides, *overrides)).load()
            steps = steps_of(base, point) if base is not None and self.steps is None else self.steps
            grid.append(GridPoint(point, compiled, steps))
        return grid

    def _measurement(self, warp: WarpSettings | None) -> MeasurementSettings:
        usual = (1,) if self.scan else (1, AUTO)
        threads = [available_cores() if count == AUTO else int(count) for count in self.threads or usual]
        horizon = self.horizon or HORIZON
        return MeasurementSettings(
            budget=float(self.budget),
            repeats=self.repeats,
            threads=list(dict.fromkeys(threads)),
            horizon=horizon if self.accuracy else None,
            reference=self.reference,
            warp=warp,
        )

    def _frames(
        self, model: mujoco.MjModel, setup: RolloutStart, backends: Sequence[WorkingBackend], clock: Clock
    ) -> list[output_timing.FrameTiming]:
        """Times a frame of each drawing, over the first frames of a video."""
        states = setup.first_frames(model, output_timing.FPS, output_timing.LEAST) if self.render else []
        return [
            output_timing.timed_frames(drawing, model, backend, states, float(self.budget) / len(self.drawings), clock)
            for drawing, backend in (zip(self.drawings, backends, strict=True) if self.render else ())
        ]

    def _header(
        self,
        simulation: Simulation,
        model: mujoco.MjModel,
        load: output_timing.LoadTiming | None,
        machine: MachineInfo,
        warp: WarpSettings | None,
    ) -> BenchResult:
        """Returns the result without the measurements."""
        source = self._source
        options = BenchSettings(
            key=simulation.start.key,
            noise_std=float(self.noise_std),
            noise_rate=float(self.noise_rate),
            steps=self.steps,
            repeats=self.repeats,
            budget=float(self.budget),
            settings=[str(override) for override in source.overrides],
            scan=self.grid,
        )
        facts = origin(self, simulation, model, simulation.timeline(model))
        return BenchResult(
            mjrun=facts["mjrun"],
            mujoco=facts["mujoco"],
            numpy=facts["numpy"],
            python=facts["python"],
            command=self.command,
            machine=machine,
            load_after=None,
            engine=EngineInfo.of(warp, machine),
            model=ModelInfo.of(model, facts["model"]["path"], facts["model"]["sha256"], source.main_file),
            options=options,
            reference_workload=None if warp else ReferenceWorkloadInfo(),
            load=load,
        )


def _publish(target: StagedFile, result: BenchResult) -> None:
    with file_errors(target.shown, "written"):
        Path(target.path).write_text(json.dumps(asdict(result), indent=2) + "\n", "utf-8", newline="\n")
        target.sync()
    target.publish()
