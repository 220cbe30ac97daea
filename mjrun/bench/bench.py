"""A benchmark: what steps and frames of a simulation cost on this machine, and how accurate it is."""

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, field, replace
from fractions import Fraction
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import mujoco

from mjrun.bench.baseline import check_same, compare, read_base, steps_of, workload_obstacle
from mjrun.bench.frame_timing import FPS, LEAST, FrameTiming, timed_frames
from mjrun.bench.machine_info import MachineInfo, machine_info
from mjrun.bench.output_timing import LoadTiming, timed_load, timed_trace, timed_video
from mjrun.bench.reference_workload import WorkloadInfo
from mjrun.bench.results import BenchResult, BenchSettings, EngineInfo, ModelInfo
from mjrun.bench.rollout_timing import Clock
from mjrun.bench.settings_grid import (
    GridPoint,
    MeasurementSettings,
    RolloutStart,
    check_reference,
    notes_on,
    timed_grid,
)
from mjrun.bench.warp_timing import LEFT_OUT, C, WarpOptions, check_engine
from mjrun.errors import FileError, UsageError, option
from mjrun.formats.destinations import StagedFile
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.names import names
from mjrun.model.override import overrides_of
from mjrun.model.source import Source
from mjrun.model.sources import ModelLike, source_of
from mjrun.options.bench import BenchOptions
from mjrun.options.number_kinds import AUTO
from mjrun.options.option import is_given, options
from mjrun.options.view import ViewOptions
from mjrun.outputs.output import RendererRequest, SharedRendering
from mjrun.physics.parameter_grid import points, scan_values, settings
from mjrun.platform.cores import available_cores
from mjrun.rendering.backend import Backend
from mjrun.reporter import Reporter, WarningReporter, pass_on
from mjrun.simulation.manifest import origin
from mjrun.simulation.simulation import Simulation

TEST = "test"  # the keyframe that testspeed starts from
HORIZON = Fraction(1)  # [s] simulated
WHOLE = Fraction(1)  # [s] simulated, of whole videos and traces


@options
class Bench(BenchOptions):
    """What to measure: its options are keywords.

    Args:
      model: a file, another source such as `scene:dominos`, or a compiled model.
      command: the command line.

    Steps are those of testspeed by default: at most 10,000, fewer if the budget is too small for them. All points of a
    `scan` are measured in turn, so that what disturbs one disturbs all.

    Raises:
      UsageError: a value makes no sense, or would have no effect.
    """

    model: ModelLike = field(kw_only=False)
    command: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_effects()
        self._check_drawings()
        if self.scan and isinstance(self.model, mujoco.MjModel):
            raise UsageError(f"{option('scan')} changes a model before it is compiled; give its file")

        of_c = {"threads": bool(self.threads), "accuracy": self.accuracy, "render": self.render, "whole": self.whole}
        of_warp = {"worlds": self.worlds, "device": self.device, "nconmax": self.nconmax, "njmax": self.njmax}
        check_engine(self.engine, of_c, of_warp)

    @cached_property
    def drawings(self) -> list[ViewOptions]:
        """Every combination of size, view, quality and renderer; the first is what a whole video shows."""
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
        """The values of each setting in the scan."""
        grid: dict[str, list[str]] = {}
        for path, text in self.scan:
            if path in grid:
                raise UsageError(f"{option('scan')} {path} is given twice; give all its values at once")
            grid[path] = scan_values(path, text)
        return grid

    def _check_effects(self) -> None:
        """Refuses options that would be ignored."""
        needs = (("horizon", "accuracy"), ("reference", "accuracy"), ("fail_above", "compare"), ("force", "compare"))
        for name, other in needs:
            if is_given(self, name) and not is_given(self, other):
                raise UsageError(f"{option(name)} has no effect without {option(other)}")

    def _check_drawings(self) -> None:
        """Refuses options of drawing where nothing is drawn, and several drawings for one video."""
        names = ("camera", "size", "view", "quality", "renderer", "gl", "require_gpu")
        given_names = [option(name) for name in names if is_given(self, name)]
        if given_names and not (self.render or self.whole):
            hint = f"add {option('render')} to time frames, or {option('whole')} to time a video"
            raise UsageError(f"{', '.join(given_names)}: nothing is drawn\n{hint}")
        if self.whole and not self.render and len(self.drawings) > 1:
            several = f"{option('render')} times several views"
            raise UsageError(f"{option('whole')} times one video, not {len(self.drawings)}; {several}")

    def run(self, reporter: Reporter | None = None, clock: Clock = time.perf_counter) -> BenchResult:
        """Measures. What can fail early fails before the first step; an unstable point of a grid is a result.

        Args:
          clock: wall time [s].

        Raises:
          MjrunError: nothing was saved.
          SimulationError: every point of the grid is unstable.
        """
        reporter, begun = reporter or WarningReporter(), clock()
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
        setup = RolloutStart(self._key(model), self.noise_std, self.noise_rate)
        simulation = Simulation(self._source, key=setup.key, duration=WHOLE)
        header = self._header(simulation, model, load, machine, warp)
        overridden = [] if base is None else check_same(asdict(header), base, str(self.compare), self.force)
        grid, measurement = self._grid(model, base), self._measurement(warp)
        check_reference(measurement.reference, grid)
        backends = self._backends()

        rows = timed_grid(grid, setup, measurement, reporter, clock)
        frames = self._frames(model, setup, backends, clock)
        whole = [timed_trace(simulation, clock), timed_video(simulation, self.drawings[0], clock)] if self.whole else []

        # MuJoCo's known bugs are not those of Warp.
        notes = [*machine.disturbances, *(simulation.start if warp else simulation).remarks(model)]
        notes += [*notes_on(rows, grid), *([LEFT_OUT] if warp else [])]
        result = replace(header, rows=rows, frames=frames, whole=whole, load_after=machine_info().load, notes=notes)
        return result if base is None else self._compared(result, base, overridden)

    def _compared(self, result: BenchResult, base: Mapping[str, Any], overridden: Sequence[str]) -> BenchResult:
        now = asdict(result)
        comparison = compare(now, base, str(self.compare), self.fail_above or 0.0, overridden)
        if not (obstacle := workload_obstacle(now, base)):
            return replace(result, comparison=comparison)
        note = f"wall times are compared as they are, whatever else the machine was doing: {obstacle}"
        return replace(result, comparison=comparison, notes=[*result.notes, note])

    def _backends(self) -> list[Backend]:
        """What draws each of the drawings, found before anything is timed."""
        drawings = self.drawings if self.render else self.drawings[:1] if self.whole else []
        with SharedRendering() as rendering:
            return [rendering.backend(RendererRequest.of(drawing)) for drawing in drawings]

    @property
    def _source(self) -> Source:
        """Where the model comes from."""
        source = source_of(self.model)
        return replace(source, overrides=(*source.overrides, *overrides_of(self)))

    def _loaded(self, clock: Clock) -> tuple[mujoco.MjModel, LoadTiming | None]:
        if isinstance(self.model, mujoco.MjModel):
            return self.model, None
        return timed_load(self._source, clock)

    def _key(self, model: mujoco.MjModel) -> str | None:
        if self.key is not None:
            return self.key
        return TEST if TEST in names(model, "keyframe") else None

    def _grid(self, model: mujoco.MjModel, base: Mapping[str, Any] | None) -> list[GridPoint]:
        """Every point of the grid, with its model; a baseline decides on its steps, if they are not given."""
        grid = []
        for point in points(self.grid):
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
        self, model: mujoco.MjModel, setup: RolloutStart, backends: Sequence[Backend], clock: Clock
    ) -> list[FrameTiming]:
        """The cost of a frame of each drawing, over the first frames of a video."""
        states = setup.first_frames(model, FPS, LEAST) if self.render else []
        return [
            timed_frames(drawing, model, backend, states, float(self.budget) / len(self.drawings), clock)
            for drawing, backend in (zip(self.drawings, backends, strict=True) if self.render else ())
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
            reference_workload=None if warp else WorkloadInfo(),
            load=load,
        )


def _publish(target: StagedFile, result: BenchResult) -> None:
    try:
        Path(target.path).write_text(json.dumps(asdict(result), indent=2) + "\n", "utf-8")
        target.sync()
    except OSError as error:
        raise FileError(target.shown, f"cannot be written: {error.strerror or error}") from None
    target.publish()
