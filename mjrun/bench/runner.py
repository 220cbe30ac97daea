"""The rows of a benchmark: every point of the grid, timed in turn, with what its steps consist of and are worth."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

import mujoco

from mjrun.bench.accuracy import arrive, distance
from mjrun.bench.control_noise import controls
from mjrun.bench.results import Accuracy, Counts, Row
from mjrun.bench.rollout_timing import Clock, Run
from mjrun.bench.step_timing import MOST_STEPS, Effort, Stepping
from mjrun.bench.warp_timing import WarpOptions, WarpStepping
from mjrun.errors import BadValueError, SimulationError
from mjrun.model.names import members
from mjrun.reporter import Reporter
from mjrun.sim.initial_state import Start
from mjrun.timeline import rational

FINER = 8  # times as many steps as the finest of the grid take the runs that distances are measured from


@dataclass(frozen=True)
class Case:
    """A point of the grid: its settings, its model, and the steps of a rollout, if they are fixed."""

    point: Mapping[str, str]
    model: mujoco.MjModel
    steps: int | None = None


@dataclass(frozen=True)
class Stimulus:
    """Where a rollout starts, and the noise on its controls, as `Bench` says it."""

    key: str | None
    std: float
    rate: float

    def run(self, model: mujoco.MjModel, steps: int) -> Run:
        """The rollout of `model`, with the controls of so many steps."""
        data = self.data(model)
        if not (self.std and model.nu):
            return Run.of(model, data)
        center = None if self.key is None else data.ctrl.copy()
        return Run.of(model, data, controls(model, steps, self.std, self.rate, center))

    def data(self, model: mujoco.MjModel) -> mujoco.MjData:
        """A new MjData at the start."""
        return Start(self.key).data(model)


@dataclass(frozen=True)
class Plan:
    """How much of each case is measured.

    Attributes:
      budget: wall time for all cases [s].
      repeats: of each rollout; the budget decides when None.
      threads: numbers of copies.
      horizon: simulated time after which accuracy is measured [s]; None without.
      reference: timestep that distances refer to [s]; an eighth of the finest when None.
      engine: steps many worlds at once; one is stepped by MuJoCo when None.
    """

    budget: float
    repeats: int | None
    threads: Sequence[int]
    horizon: Fraction | None
    reference: Fraction | None
    engine: WarpOptions | None = None

    def stepping(self, case: Case, stimulus: Stimulus, share: float, clock: Clock) -> Stepping:
        """The steps of a case, on a `share` of the budget."""
        make, effort = partial(stimulus.run, case.model), Effort(share * self.budget, case.steps, self.repeats)
        if self.engine is None:
            return Stepping(make, effort, clock)
        return WarpStepping(make, effort, clock, warp=self.engine)


def check_reference(reference: Fraction | None, cases: Sequence[Case]) -> None:
    """Refuses a reference that is no better than what is measured against it.

    Raises:
      BadValueError: it is not finer than every timestep.
    """
    finest = min(case.model.opt.timestep for case in cases)
    if reference is not None and reference >= rational(finest):
        expected = f"finer than every timestep that is measured, of which the finest is {finest:.6g} s"
        raise BadValueError("--reference", f"{float(reference):.6g}", expected)


def timed_rows(cases: Sequence[Case], stimulus: Stimulus, plan: Plan, reporter: Reporter, clock: Clock) -> list[Row]:
    """Measures every case. Their rollouts take turns, so that what disturbs one disturbs all.

    Raises:
      SimulationError: no case is stable.
    """
    steppings = [plan.stepping(case, stimulus, 1 / len(cases), clock) for case in cases]
    if plan.engine:
        reporter.note("warp compiles what it has not cached, which may take a minute")
    failures = [_failure(stepping.warm_up) for stepping in steppings]
    # As many steps for all, but where they are fixed: what a step costs changes with what happens.
    fewest = min((s.steps for s, failure in zip(steppings, failures, strict=True) if not failure), default=1)
    failures = [
        failure or _failure(partial(stepping.begin, case.steps or fewest))
        for case, stepping, failure in zip(cases, steppings, failures, strict=True)
    ]
    stable = [stepping for stepping, failure in zip(steppings, failures, strict=True) if not failure]
    if not stable:
        raise next(failure for failure in failures if failure)
    _take_turns(stable, reporter)
    reference = plan.reference or min(rational(case.model.opt.timestep) for case in cases) / FINER
    return [
        _row(case, failure or stepping, plan.threads, _accuracy(case.model, stimulus, plan.horizon, reference))
        for case, stepping, failure in zip(cases, steppings, failures, strict=True)
    ]


def _failure(action: Callable[[], None]) -> SimulationError | None:
    try:
        action()
    except SimulationError as error:
        return error
    return None


def _take_turns(steppings: Sequence[Stepping], reporter: Reporter) -> None:
    done, total = 0, sum(stepping.repeats for stepping in steppings)
    for turn in range(max(stepping.repeats for stepping in steppings)):
        for stepping in steppings:
            if turn < stepping.repeats:
                stepping.rollout()
                done += 1
                reporter.progress("rollouts", done, total)


def _row(case: Case, stepping: Stepping | SimulationError, threads: Sequence[int], accuracy: Accuracy | None) -> Row:
    option = case.model.opt
    same = {
        "point": dict(case.point),
        "integrator": _name(mujoco.mjtIntegrator, option.integrator),
        "timestep": float(option.timestep),
        "accuracy": accuracy,
    }
    if isinstance(stepping, SimulationError):
        failure = str(stepping).partition("\n")[0]
        nothing = dict.fromkeys(("step", "steps_per_second", "realtime_factor", "first_step", "counts", "phases"))
        return Row(**same, **nothing, steps=0, block=0, threads=[], overflows=[], failure=failure)
    step, profile = stepping.step, stepping.profile
    return Row(
        **same,
        steps=stepping.steps,
        block=stepping.block,
        step=step,
        steps_per_second=1 / step.median,
        realtime_factor=float(option.timestep) / step.median,
        first_step=stepping.first,
        counts=Counts(
            contacts=profile.contacts,
            constraints=profile.constraints,
            solver=_name(mujoco.mjtSolver, option.solver),
            iterations=profile.iterations,
            arena=profile.arena,
            arena_size=profile.arena_size,
        ),
        phases=profile.phases,
        threads=stepping.threads(threads),
        overflows=list(stepping.overflows),
        failure=None,
    )


def _name(enum: type, value: int) -> str:
    """How MJCF spells a member of one of MuJoCo's enums."""
    return next(name for name, number in members(enum).items() if number == value)


def _accuracy(
    model: mujoco.MjModel, stimulus: Stimulus, horizon: Fraction | None, reference: Fraction
) -> Accuracy | None:
    if horizon is None:
        return None
    drift = None
    try:
        arrival = arrive(model, stimulus.data(model), horizon)
        drift = arrival.drift
        apart = distance(model, stimulus.data(model), arrival, reference)
    except SimulationError as error:
        of = "" if drift is None else "the finer run: "
        failure = of + str(error).partition("\n")[0]
        return Accuracy(float(horizon), drift, float(reference), None, failure)
    return Accuracy(float(arrival.time), arrival.drift, float(reference), apart)


def remarks(rows: Sequence[Row], cases: Sequence[Case]) -> list[str]:
    """What is to be known of these rows."""
    found = []
    fewer = sorted({row.steps for row in rows if row.step and row.steps < MOST_STEPS})
    if fewer and all(case.steps is None for case in cases):
        shown = ", ".join(map(str, fewer))
        found.append(f"rollouts of {shown} steps instead of {MOST_STEPS}, to keep to the budget; --steps fixes them")
    if any(row.step and row.step.confidence is None for row in rows):
        found.append("there are too few repeats for an interval; 6 are the least")
    return found
