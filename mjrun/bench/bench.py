"""A benchmark: wall time of steps and frames of a simulation on this machine, and its accuracy."""

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, field, replace
from fractions import Fraction
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import mujoco

from mjrun.bench import grid_timing, output_timing
from mjrun.bench.baseline import SCHEMA, check_same, compare, read_base, steps_of, workload_obstacle
from mjrun.bench.block_timing import Clock, ReferenceWorkloadInfo
from mjrun.bench.results import BenchResult, BenchSettings, EngineInfo, MachineInfo, ModelInfo, machine_info
from mjrun.bench.step_timing import LEFT_OUT, C, WarpSettings, check_engine
from mjrun.errors import UsageError, file_errors, option
from mjrun.experiment.design import SHORT_PATHS, value_list
from mjrun.formats.output_writer import StagedFile, require_own
from mjrun.model.mujoco_globals import collected_warnings, report_warnings
from mjrun.model.names import names
from mjrun.model.override import Override, overrides_of
from mjrun.model.source import ModelSource
from mjrun.model.sources import ModelLike, source_of
from mjrun.options.bench import BenchOptions
from mjrun.options.number_kinds import AUTO
from mjrun.options.option import is_given, options
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.output import RenderingResources
from mjrun.platform.cores import available_cores
from mjrun.rendering.backend import WorkingBackend
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.simulation.manifest import origin
from mjrun.simulation.simulation import Simulation

TEST = "test"  # keyframe from which testspeed starts
HORIZON = Fraction(1)  # [s] simulated time
WHOLE = Fraction(1)  # [s] simulated time of whole videos and traces


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
        setup = grid_timing.RolloutStart(key, self.noise_std, self.noise_rate)
        simulation = Simulation(self._source, key=setup.key, duration=WHOLE)
        header = self._header(simulation, model, load, machine, warp)
        overridden = [] if base is None else check_same(asdict(header), base, str(self.compare), self.force)
        grid, measurement = self._grid(model, base), self._measurement(warp)
        grid_timing.check_reference(measurement.reference, grid)
        backends = self._backends()

        rows = grid_timing.timed_grid(grid, setup, measurement, reporter, clock)
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
        notes += [*grid_timing.notes_on(rows, grid), *([LEFT_OUT] if warp else [])]
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

    def _grid(self, model: mujoco.MjModel, base: Mapping[str, Any] | None) -> list[grid_timing.GridPoint]:
        """Returns every point of the grid with its model; a baseline determines its steps unless they are specified."""
        grid = list[grid_timing.GridPoint]()
        for values in product(*self.grid.values()):
            point = dict(zip(self.grid, values, strict=True))
            compiled = model
            if point:
                overrides = [Override(SHORT_PATHS.get(path, path), value) for path, value in point.items()]
                compiled = replace(self._source, overrides=(*self._source.overrides, *overrides)).load()
            steps = steps_of(base, point) if base is not None and self.steps is None else self.steps
            grid.append(grid_timing.GridPoint(point, compiled, steps))
        return grid

    def _measurement(self, warp: WarpSettings | None) -> grid_timing.MeasurementSettings:
        usual = (1,) if self.scan else (1, AUTO)
        threads = [available_cores() if count == AUTO else int(count) for count in self.threads or usual]
        horizon = self.horizon or HORIZON
        return grid_timing.MeasurementSettings(
            budget=float(self.budget),
            repeats=self.repeats,
            threads=list(dict.fromkeys(threads)),
            horizon=horizon if self.accuracy else None,
            reference=self.reference,
            warp=warp,
        )

    def _frames(
        self, model: mujoco.MjModel, setup: grid_timing.RolloutStart, backends: Sequence[WorkingBackend], clock: Clock
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
