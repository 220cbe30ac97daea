"""A benchmark: what steps and frames of a simulation cost on this machine, and how accurate it is."""

import json
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import KW_ONLY, asdict, dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import mujoco

from mjrun.bench.baseline import check_same, compare, read_base, steps_of, workload_obstacle
from mjrun.bench.control_noise import RATE, STD
from mjrun.bench.frame_timing import FPS, LEAST, FrameTiming, timed_frames
from mjrun.bench.grid_timing import (
    GridPoint,
    MeasurementSettings,
    RolloutSetup,
    check_reference,
    notes_on,
    timed_grid,
)
from mjrun.bench.load_timing import LoadTiming, timed_load
from mjrun.bench.machine_info import MachineInfo, machine_info
from mjrun.bench.output_timing import timed_trace, timed_video
from mjrun.bench.reference_workload import ReferenceInfo
from mjrun.bench.results import BenchOptions, BenchResult, EngineInfo, ModelInfo
from mjrun.bench.rollout_timing import Clock
from mjrun.bench.warp_timing import LEFT_OUT, C, WarpOptions, check_engine
from mjrun.errors import BadValueError, FileError, UsageError, option
from mjrun.formats.publishing import StagedFile
from mjrun.job.manifest import origin
from mjrun.job.panels import panels_of
from mjrun.job.shared_rendering import RendererChoice, SharedRendering
from mjrun.job.simulation import Simulation, positive
from mjrun.job.view import Drawing
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.names import names
from mjrun.model.source import Source
from mjrun.model.sources import ModelLike, source_of
from mjrun.rendering.backend import Backend
from mjrun.rendering.process_count import AUTO, available_cores
from mjrun.reporter import QuietReporter, Reporter, pass_on
from mjrun.sim.parameter_grid import points, settings
from mjrun.timeline import rational

TEST = "test"  # the keyframe that testspeed starts from
HORIZON = Fraction(1)  # [s] simulated
WHOLE = Fraction(1)  # [s] simulated, of whole videos and traces


@dataclass(frozen=True)
class Bench:
    """What to measure.

    Args:
      model: a compiled model, or the path of one.
      key: keyframe to start from, by name or index; `test`, if there is one, when None, as in testspeed.
      noise_std: scale of the noise on the controls, in half ranges; testspeed's own. With 0 the controls stay those
        of the start, as in a bare loop.
      noise_rate: time in which controls return to the keyframe's, or to the middle of their ranges [s].
      steps: of one rollout; at most testspeed's 10,000, fewer if the budget is too small for them, when None.
      repeats: of the rollout; as many as the budget allows, at least 7, when None.
      budget: wall time for steps, and again for drawing, more or less [s].
      threads: how many copies to run side by side, numbers or `auto`, as many as there are cores; 1 and `auto`, but
        1 alone with a `scan`, when None.
      scan: settings, `integrator`, `timestep` or any path, to the values that they take; all combinations are
        measured in turn, so that what disturbs one disturbs all.
      accuracy: also measure energy drift, and distance from a run with finer steps.
      horizon: simulated time after which that is done [s]; 1 when None.
      reference: timestep of the finer run, finer than every one in the grid [s]; an eighth of the finest when None.
      drawings: frames to time, of one camera and one view each.
      whole: also time a whole trace and a whole video.
      video: what that video shows; the first of `drawings`, or else what a video shows by default, when None.
      engine: `c`, MuJoCo itself, or `warp`, MuJoCo Warp, which times steps alone.
      worlds, device, nconmax, njmax: of `warp`, as `WarpOptions` has them.
      save: a file for the result, to be compared with later.
      compare: a file so saved.
      fail_above: by how much a figure may be slower: 0.1 is a tenth.
      force: compare in spite of differences.
      command: the command line.

    Raises:
      UsageError: a value makes no sense, or would have no effect.
    """

    model: ModelLike
    _: KW_ONLY
    key: str | int | None = None
    noise_std: float = STD
    noise_rate: float = RATE
    steps: int | None = None
    repeats: int | None = None
    budget: float = 3.0
    threads: Sequence[int | str] | None = None
    scan: Mapping[str, Sequence[str]] = field(default_factory=dict)
    accuracy: bool = False
    horizon: float | str | Fraction | None = None
    reference: float | str | Fraction | None = None
    drawings: Sequence[Drawing] = ()
    whole: bool = False
    video: Drawing | None = None
    engine: str = C
    worlds: int | None = None
    device: str | None = None
    nconmax: int | None = None
    njmax: int | None = None
    save: str | None = None
    compare: str | None = None
    fail_above: float = 0.0
    force: bool = False
    command: str = ""

    def __post_init__(self) -> None:
        self._check_numbers()
        self._check_effects()
        if any(len(panels_of(drawing)) != 1 for drawing in self.drawings):
            raise UsageError("each drawing that is timed must be of one camera and one view")
        if self.scan and isinstance(self.model, mujoco.MjModel):
            raise UsageError(f"{option('scan')} changes a model before it is compiled; give its file")

        of_c = {"threads": self.threads is not None, "accuracy": self.accuracy}
        of_c |= {"render": bool(self.drawings), "whole": self.whole}
        of_warp = {"worlds": self.worlds, "device": self.device, "nconmax": self.nconmax, "njmax": self.njmax}
        check_engine(self.engine, of_c, of_warp)

    def _check_numbers(self) -> None:
        for name, count in (("steps", self.steps), ("repeats", self.repeats)):
            if count is not None and not (isinstance(count, int) and count > 0):
                raise BadValueError(option(name), count, "a positive whole number")
        for name, value in (("noise_rate", self.noise_rate), ("fail_above", self.fail_above)):
            if not 0 <= value < math.inf:
                raise BadValueError(option(name), value, "a number from 0 on")
        if not 0 <= self.noise_std <= 1:
            raise BadValueError(option("noise_std"), self.noise_std, "a number from 0 to 1")
        for count in self.threads or ():
            if count != AUTO and not (isinstance(count, int) and count > 0):
                raise BadValueError(option("threads"), count, f"a number from 1 on, or {AUTO}")
        for name, duration in (("budget", self.budget), ("horizon", self.horizon), ("reference", self.reference)):
            if duration is not None:
                positive(option(name), duration)

    def _check_effects(self) -> None:
        """Refuses options that would be ignored."""
        needs = (
            ("horizon", self.horizon is not None, "accuracy", self.accuracy),
            ("reference", self.reference is not None, "accuracy", self.accuracy),
            ("video", self.video is not None, "whole", self.whole),
            ("fail_above", self.fail_above > 0, "compare", self.compare is not None),
            ("force", self.force, "compare", self.compare is not None),
        )
        for name, is_given, other, has_effect in needs:
            if is_given and not has_effect:
                raise UsageError(f"{option(name)} has no effect without {option(other)}")

    def run(self, reporter: Reporter | None = None, clock: Clock = time.perf_counter) -> BenchResult:
        """Measures. What can fail early fails before the first step; an unstable point of a grid is a result.

        Args:
          clock: wall time [s].

        Raises:
          MjrunError: nothing was saved.
          SimulationError: every point of the grid is unstable.
        """
        reporter, begun = reporter or QuietReporter(), clock()
        with collected_warnings() as warnings, ExitStack() as stack:
            target = None if self.save is None else StagedFile(Path(self.save))
            if target:
                stack.callback(target.discard)
            result = self._measured(reporter, clock)
            result = replace(result, wall=clock() - begun)
            if target:
                _publish(target, result)

        # The failures say better what MuJoCo warns of.
        if not any(row.failure or (row.accuracy and row.accuracy.failure) for row in result.rows):
            pass_on(warnings, reporter)
        return result

    def _measured(self, reporter: Reporter, clock: Clock) -> BenchResult:
        base = None if self.compare is None else read_base(self.compare)
        machine, warp = machine_info(), self._warp()
        model, load = self._loaded(clock)
        setup = RolloutSetup(self._key(model), self.noise_std, self.noise_rate)
        simulation = Simulation(self.model, key=setup.key, duration=WHOLE)
        header = self._header(simulation, model, load, machine, warp)
        overridden = [] if base is None else check_same(asdict(header), base, str(self.compare), self.force)
        grid, measurement = self._grid(model, base), self._measurement(warp)
        check_reference(measurement.reference, grid)
        video = self.video or next(iter(self.drawings), Drawing())
        backends = self._backends(video)

        rows = timed_grid(grid, setup, measurement, reporter, clock)
        frames = self._frames(model, setup, backends, clock)
        whole = [timed_trace(simulation, clock), timed_video(simulation, video, clock)] if self.whole else []

        # MuJoCo's known bugs are not those of Warp.
        notes = [*machine.disturbances, *(simulation.start if warp else simulation).remarks(model)]
        notes += [*notes_on(rows, grid), *([LEFT_OUT] if warp else [])]
        result = replace(header, rows=rows, frames=frames, whole=whole, load_after=machine_info().load, notes=notes)
        return result if base is None else self._compared(result, base, overridden)

    def _compared(self, result: BenchResult, base: Mapping[str, Any], overridden: Sequence[str]) -> BenchResult:
        now = asdict(result)
        comparison = compare(now, base, str(self.compare), self.fail_above, overridden)
        if not (obstacle := workload_obstacle(now, base)):
            return replace(result, comparison=comparison)
        note = f"wall times are compared as they are, whatever else the machine was doing: {obstacle}"
        return replace(result, comparison=comparison, notes=[*result.notes, note])

    def _backends(self, video: Drawing) -> list[Backend]:
        """What draws each of the drawings, found before anything is timed; that of the video is only tried."""
        drawings = [*self.drawings, *([video] if self.whole and video not in self.drawings else [])]
        with SharedRendering() as rendering:
            return [rendering.backend(RendererChoice.of(drawing)) for drawing in drawings]

    @property
    def _source(self) -> Source:
        """Where the model comes from."""
        return source_of(self.model)

    def _loaded(self, clock: Clock) -> tuple[mujoco.MjModel, LoadTiming | None]:
        if isinstance(self.model, mujoco.MjModel):
            return self.model, None
        return timed_load(self._source, clock)

    def _key(self, model: mujoco.MjModel) -> str | None:
        if self.key is not None:
            return str(self.key)
        return TEST if TEST in names(model, "keyframe") else None

    def _grid(self, model: mujoco.MjModel, base: Mapping[str, Any] | None) -> list[GridPoint]:
        """Every point of the grid, with its model; a baseline decides on its steps, if they are not given."""
        grid = []
        for point in points(self.scan):
            compiled = model
            if point:
                compiled = replace(self._source, overrides=(*self._source.overrides, *settings(point))).load()
            steps = steps_of(base, point) if base is not None and self.steps is None else self.steps
            grid.append(GridPoint(point, compiled, steps))
        return grid

    def _warp(self) -> WarpOptions | None:
        if self.engine == C:
            return None
        return WarpOptions(self.device, self.worlds, self.nconmax, self.njmax)

    def _measurement(self, warp: WarpOptions | None) -> MeasurementSettings:
        usual = (1,) if self.scan else (1, AUTO)
        threads = [available_cores() if count == AUTO else int(count) for count in self.threads or usual]
        horizon = HORIZON if self.horizon is None else rational(self.horizon)
        return MeasurementSettings(
            budget=float(self.budget),
            repeats=self.repeats,
            threads=list(dict.fromkeys(threads)),
            horizon=horizon if self.accuracy else None,
            reference=None if self.reference is None else rational(self.reference),
            warp=warp,
        )

    def _frames(
        self, model: mujoco.MjModel, setup: RolloutSetup, backends: Sequence[Backend], clock: Clock
    ) -> list[FrameTiming]:
        """The cost of a frame of each drawing, over the first frames of a video."""
        states = setup.first_frames(model, FPS, LEAST) if self.drawings else []
        return [
            timed_frames(drawing, model, backend, states, float(self.budget) / len(self.drawings), clock)
            for drawing, backend in zip(self.drawings, backends, strict=False)
        ]

    def _header(
        self,
        simulation: Simulation,
        model: mujoco.MjModel,
        load: LoadTiming | None,
        machine: MachineInfo,
        warp: WarpOptions | None,
    ) -> BenchResult:
        """The result as far as it is known before a step is taken."""
        source = self._source
        options = BenchOptions(
            key=simulation.start.key,
            noise_std=float(self.noise_std),
            noise_rate=float(self.noise_rate),
            steps=self.steps,
            repeats=self.repeats,
            budget=float(self.budget),
            settings=[str(override) for override in source.overrides],
            scan={path: list(values) for path, values in self.scan.items()},
        )
        facts = origin(self, simulation, model, simulation.timeline(model))
        return BenchResult(
            **{name: facts[name] for name in ("mjrun", "mujoco", "numpy", "python")},
            command=self.command,
            machine=machine,
            load_after=None,
            engine=EngineInfo.of(warp, machine),
            model=ModelInfo.of(model, facts["model"]["path"], facts["model"]["sha256"], source.main_file),
            options=options,
            reference_workload=None if warp else ReferenceInfo(),
            load=load,
        )


def _publish(target: StagedFile, result: BenchResult) -> None:
    try:
        Path(target.path).write_text(json.dumps(asdict(result), indent=2) + "\n", "utf-8")
    except OSError as error:
        raise FileError(target.shown, f"cannot be written: {error.strerror or error}") from None
    target.publish()
