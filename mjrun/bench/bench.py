"""A benchmark: what the steps, the pictures and the accuracy of a simulation cost on this machine."""

import hashlib
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

from mjrun.bench.baseline import check_same, compare, read_base, steps_of
from mjrun.bench.control_noise import RATE, STD
from mjrun.bench.frame_timing import FEW, FPS, Frame, timed_frames
from mjrun.bench.load_timing import Load, timed_load
from mjrun.bench.machine import Machine, machine
from mjrun.bench.output_timing import whole_film, whole_trace
from mjrun.bench.results import BenchResult, Engine, ModelFacts, Options
from mjrun.bench.rollout_timing import Clock
from mjrun.bench.runner import Case, Plan, Stimulus, check_reference, remarks, timed_rows
from mjrun.bench.warp_timing import LEFT_OUT, WARP, C, WarpOptions, check_engine
from mjrun.errors import BadValueError, FileError, UsageError
from mjrun.formats.publishing import StagedFile
from mjrun.job.manifest import origin
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
from mjrun.timeline import nearest, rational

TEST = "test"  # the keyframe that testspeed starts from
WHOLE = Fraction(1)  # [s] simulated, of whole films and traces
SIZES = ("nq", "nv", "nu", "nbody", "ngeom")


@dataclass(frozen=True)
class Bench:
    """What to measure.

    Args:
      model: a compiled model, or the path of one.
      key: keyframe to start from, by name or index; `test`, if there is one, when None, as testspeed has it.
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
      horizon: simulated time after which that is done [s].
      reference: timestep of the finer run, finer than every one in the grid [s]; an eighth of the finest when None.
      drawings: pictures to time, of one camera and one view each.
      whole: also time a whole trace and a whole film.
      engine: `c`, MuJoCo itself, or `warp`, MuJoCo Warp, which times steps alone.
      worlds, device, nconmax, njmax: of `warp`, as `WarpOptions` has them.
      save: a file for the result, to be compared with later.
      compare: a file so saved.
      fail_above: by how much a figure may be slower: 0.1 is a tenth.
      force: compare whatever differs.
      command: the command line.
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
    horizon: float | str | Fraction = 1
    reference: float | str | Fraction | None = None
    drawings: Sequence[Drawing] = ()
    whole: bool = False
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
        for flag, count in (("--steps", self.steps), ("--repeats", self.repeats)):
            if count is not None and not (isinstance(count, int) and count > 0):
                raise BadValueError(flag, count, "a positive whole number")
        for flag, value in (("--noise-rate", self.noise_rate), ("--fail-above", self.fail_above)):
            if not 0 <= value < math.inf:
                raise BadValueError(flag, value, "a number from 0 on")
        if not 0 <= self.noise_std <= 1:
            raise BadValueError("--noise-std", self.noise_std, "a number from 0 to 1")
        for count in self.threads or ():
            if count != AUTO and not (isinstance(count, int) and count > 0):
                raise BadValueError("--threads", count, f"a number from 1 on, or {AUTO}")
        for flag, value in (("--budget", self.budget), ("--horizon", self.horizon), ("--reference", self.reference)):
            if value is not None:
                positive(flag, value)
        if any(len(drawing.panels) != 1 for drawing in self.drawings):
            raise UsageError("each drawing that is timed must be of one camera and one view")
        if self.scan and isinstance(self.model, mujoco.MjModel):
            raise UsageError("a scan changes a model before it is compiled; give its file")
        of_c = {"threads": self.threads is not None, "accuracy": self.accuracy}
        of_c |= {"render": bool(self.drawings), "whole": self.whole}
        names_of_warp = ("worlds", "device", "nconmax", "njmax")
        check_engine(self.engine, of_c, {name: getattr(self, name) for name in names_of_warp})

    def run(self, reporter: Reporter | None = None, clock: Clock = time.perf_counter) -> BenchResult:
        """Measures. What can fail early fails before the first step; an unstable point of a grid is a result.

        Args:
          clock: wall time [s].

        Raises:
          MjrunError: nothing was saved.
          SimulationError: every point of the grid is unstable.
        """
        reporter, begun = reporter or QuietReporter(), clock()
        with collected_warnings() as heard, ExitStack() as stack:
            target = None if self.save is None else StagedFile(Path(self.save))
            if target:
                stack.callback(target.discard)
            result = self._measured(reporter, clock)
            result = replace(result, wall=clock() - begun)
            if target:
                _publish(target, result)
        if not any(
            row.failure or (row.accuracy and row.accuracy.failure) for row in result.rows
        ):  # which say it better
            pass_on(heard, reporter)
        return result

    def _measured(self, reporter: Reporter, clock: Clock) -> BenchResult:
        base = None if self.compare is None else read_base(self.compare)
        here, warp = machine(), self._warp()
        model, load = self._loaded(clock)
        key = self._key(model)
        simulation = Simulation(self.model, key=key, duration=WHOLE)
        facts = self._facts(simulation, model, load, here, warp)
        overridden = [] if base is None else check_same(asdict(facts), base, str(self.compare), self.force)
        stimulus, cases, plan = (
            Stimulus(key, self.noise_std, self.noise_rate),
            self._cases(model, base),
            self._plan(warp),
        )
        check_reference(plan.reference, cases)
        # Before the first step.
        drawn = [*self.drawings, *([Drawing()] if self.whole and not self.drawings else [])]
        backends = [drawing.search().result(drawing.require_gpu) for drawing in drawn]
        rows = timed_rows(cases, stimulus, plan, reporter, clock)
        for overflow in dict.fromkeys(overflow for row in rows for overflow in row.overflows):
            reporter.warn(overflow)
        frames = [self._frame(model, stimulus, *pair, clock) for pair in zip(self.drawings, backends, strict=False)]
        whole = []
        if self.whole:
            whole = [whole_trace(simulation, clock)]
            whole += [whole_film(simulation, drawing, clock) for drawing in self.drawings[:1] or (None,)]
        found = replace(
            facts,
            rows=rows,
            frames=frames,
            whole=whole,
            load_after=machine().load,
            # What is known to be wrong with MuJoCo is not so of Warp.
            notes=[
                *here.remarks,
                *(simulation.start if warp else simulation).remarks(model),
                *remarks(rows, cases),
                *([LEFT_OUT] if warp else []),
            ],
        )
        if base is None:
            return found
        return replace(found, comparison=compare(asdict(found), base, str(self.compare), self.fail_above, overridden))

    @property
    def _source(self) -> Source:
        """Where the model comes from."""
        return source_of(self.model)

    def _loaded(self, clock: Clock) -> tuple[mujoco.MjModel, Load | None]:
        if isinstance(self.model, mujoco.MjModel):
            return self.model, None
        return timed_load(self._source, clock)

    def _key(self, model: mujoco.MjModel) -> str | None:
        if self.key is not None:
            return str(self.key)
        return TEST if TEST in names(model, "keyframe") else None

    def _cases(self, model: mujoco.MjModel, base: Mapping[str, Any] | None) -> list[Case]:
        """Every point of the grid, with its model; a base decides how many steps it takes, if nobody else does."""
        found = []
        for point in points(self.scan):
            compiled = model
            if point:
                compiled = replace(self._source, settings=(*self._source.settings, *settings(point))).load()
            fixed = steps_of(base, point) if base is not None and self.steps is None else self.steps
            found.append(Case(point, compiled, fixed))
        return found

    def _warp(self) -> WarpOptions | None:
        if self.engine == C:
            return None
        return WarpOptions(self.device, self.worlds, self.nconmax, self.njmax)

    def _plan(self, warp: WarpOptions | None) -> Plan:
        usual = (1,) if self.scan else (1, AUTO)
        asked = [available_cores() if count == AUTO else int(count) for count in self.threads or usual]
        return Plan(
            budget=float(self.budget),
            repeats=self.repeats,
            threads=list(dict.fromkeys(asked)),
            horizon=rational(self.horizon) if self.accuracy else None,
            reference=None if self.reference is None else rational(self.reference),
            engine=warp,
        )

    def _frame(
        self, model: mujoco.MjModel, stimulus: Stimulus, drawing: Drawing, backend: Backend, clock: Clock
    ) -> Frame:
        """What a picture costs: of the first instants of a film."""
        spacing = 1 / (FPS * rational(model.opt.timestep))
        steps = [nearest(k * spacing) for k in range(FEW)]
        states = stimulus.run(model, steps[-1]).states(steps)
        return timed_frames(drawing, model, backend, states, float(self.budget) / len(self.drawings), clock)

    def _facts(
        self,
        simulation: Simulation,
        model: mujoco.MjModel,
        load: Load | None,
        here: Machine,
        warp: WarpOptions | None,
    ) -> BenchResult:
        """What is known before a step is taken."""
        known = origin(self, simulation, model, simulation.timeline(model))
        source = self._source
        return BenchResult(
            **{name: known[name] for name in ("mjrun", "mujoco", "numpy", "python")},
            command=self.command,
            machine=here,
            load_after=None,
            engine=Engine(C, None, "cpu", here.cpu, 1, None, None) if warp is None else _engine(warp, here),
            model=ModelFacts(
                path=known["model"]["path"],
                sha256=known["model"]["sha256"],
                file_sha256=source.main_file and hashlib.sha256(source.main_file.read_bytes()).hexdigest(),
                **{size: int(getattr(model, size)) for size in SIZES},
            ),
            options=Options(
                key=self._key(model),
                noise_std=float(self.noise_std),
                noise_rate=float(self.noise_rate),
                steps=self.steps,
                repeats=self.repeats,
                budget=float(self.budget),
                settings=[str(setting) for setting in source.settings],
                scan={path: list(values) for path, values in self.scan.items()},
            ),
            load=load,
            rows=[],
            frames=[],
            whole=[],
            comparison=None,
            notes=[],
            wall=0.0,
        )


def _engine(warp: WarpOptions, here: Machine) -> Engine:
    name = here.cpu if warp.device == "cpu" else warp.device_name  # Warp says no more than CPU
    return Engine(WARP, warp.version, warp.device, name, warp.worlds, warp.nconmax, warp.njmax)


def _publish(target: StagedFile, result: BenchResult) -> None:
    try:
        Path(target.path).write_text(json.dumps(asdict(result), indent=2) + "\n", "utf-8")
    except OSError as error:
        raise FileError(target.shown, f"cannot be written: {error.strerror or error}") from None
    target.publish()
