"""Solve eight problems with known answers by `mjrun fit`, by scipy's least squares, and by `mujoco.sysid`.

Logs come from a bare loop of MuJoCo, with white noise and initial states that no log contains (`fit_problems.py`).
Three solvers fit each of several logs, in turn, in one process:

- `mjrun fit` of the whole log (`--holdout 0`);
- `scipy.optimize.least_squares` from three starts, over the parameters and the initial state, with rollouts in C
  (`mujoco.rollout`) of models that are compiled for each value; the best start counts;
- `mujoco.sysid` as in its tutorial: one shot from the measured initial state, over the parameters alone, once.

A line has the number of logs, the median and the largest relative error, the share of 95 % intervals that contain the
truth (`mjrun` and scipy, whose intervals are those of its Jacobian), rollouts, simulated time in lengths of the log
(some rollouts of `mjrun` are short stretches), and CPU seconds of a fit. The notes count fits that warn of a misfit and
logs that were refused. Motions that contacts make rough are expensive, so fewer of their logs are fitted
(`--rough-seeds`). `mujoco.sysid` needs `pip install 'mujoco[sysid]'`; without it, its lines say so.

    python benchmarks/fit.py
    python benchmarks/fit.py --seeds 5 --problems "pendulum friction" --no-sysid
"""

import argparse
import contextlib
import io
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
from fit_problems import PROBLEMS, Problem
from mujoco import rollout
from scipy import optimize, special

from mjrun.errors import MjrunError
from mjrun.fitting.fit import Fit
from mjrun.fitting.free_parameter import FreeParameter, free_parameters, overrides
from mjrun.fitting.prediction import ChunkRolloutInputs, Predictor
from mjrun.model import state
from mjrun.model.override import apply
from mjrun.simulation.simulation import Simulation

STARTS = 3
STATE_SCALE = 10.0


@dataclass
class Row:
    """Results of fits of one problem by one solver."""

    errors: list[list[float]] = field(default_factory=list[list[float]])
    hits: list[bool] = field(default_factory=list[bool])
    warned: int = 0
    refused: int = 0
    rollouts: list[int] = field(default_factory=list[int])
    lengths: list[float] = field(default_factory=list[float])
    seconds: list[float] = field(default_factory=list[float])
    failure: str = ""

    def line(self, problem: str, solver: str) -> str:
        """Returns the row of the table."""
        if not self.errors:
            return f"{problem:<22} {solver:<6} {self.refused:>5}   {self.failure or 'all refused'}"
        hits = f"{100 * np.mean(self.hits):5.0f} %" if self.hits else "      –"
        notes = [f"{self.warned} warned"] * bool(self.warned) + [f"{self.refused} refused"] * bool(self.refused)
        return (
            f"{problem:<22} {solver:<6} {len(self.errors) + self.refused:>5} "
            f"{100 * np.median(self.errors):7.3f} % {100 * np.max(self.errors):8.3f} % {hits} "
            f"{np.mean(self.rollouts):7.0f} {np.mean(self.lengths):7.0f} {np.mean(self.seconds):7.2f} s   "
            + ", ".join(notes)
        )


class Shot:
    """The whole log as a function of the parameters and the initial state."""

    def __init__(self, problem: Problem, model: Path, names: Sequence[str], rows: np.ndarray) -> None:
        simulation = Simulation(str(model))
        self.spec, compiled = simulation.source.compile()
        controls = [name for name in names if name.startswith("ctrl/")]
        measured = [name for name in names[1:] if name not in controls]
        self.parameters: list[FreeParameter] = free_parameters(problem.free, simulation.source, [*measured, *controls])
        self.problem, self.xml, self.compiled, self.rollouts = problem, problem.xml, compiled, 0
        nq, nv = compiled.nq, compiled.nv
        self.values, self.commands = rows[:, 1 : 1 + nq], rows[:, 1 + nq :]
        self.times, self.nv = rows[:, 0], nv
        data = mujoco.MjData(compiled)
        first = np.polynomial.polynomial.polyfit(self.times[:9], self._tangents(self.values[:9]), 2)
        data.qpos[:] = self.values[0]
        mujoco.mj_integratePos(compiled, data.qpos, first[0], 1.0)
        data.qvel[:] = first[1]
        self.start = data
        self.data = mujoco.MjData(compiled)

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Returns residuals in millimetres and milliradians, of coordinates from 0 to 1 and deviations of the start."""
        self.rollouts += 1
        values = [p.value(c) for p, c in zip(self.parameters, x, strict=False)]
        model, deviation = self.model(values), x[len(values) :]
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = self.start.qpos, self.start.qvel
        mujoco.mj_integratePos(model, data.qpos, np.array(deviation[: self.nv]), 1.0)
        data.qvel += deviation[self.nv :]
        every, steps = self.problem.every, self.problem.every * (len(self.times) - 1)
        delay = sum(v for p, v in zip(self.parameters, values, strict=True) if p.is_delay) / model.opt.timestep
        late = np.arange(steps) - delay
        held = np.clip(np.stack([np.floor(late), np.floor(late) + 1]) // every, 0, len(self.times) - 1).astype(int)
        share = (late - np.floor(late))[:, None]
        controls = self.commands[held[0]] * (1 - share) + self.commands[held[1]] * share
        initial = state.save(model, data, int(mujoco.mjtState.mjSTATE_FULLPHYSICS))
        states, _ = rollout.rollout(model, self.data, initial, control=controls[None])
        positions = np.concatenate([data.qpos[None], states[0, every - 1 :: every, 1 : 1 + model.nq]])
        return np.concatenate([1000 * self._tangents(positions, self.values).ravel(), deviation / STATE_SCALE])

    def model(self, values: Sequence[float]) -> mujoco.MjModel:
        """Returns the model with these values."""
        spec = mujoco.MjSpec.from_string(self.xml)
        for override in overrides(self.parameters, values):
            apply(spec, override)
        return spec.compile()

    def _tangents(self, positions: np.ndarray, origin: np.ndarray | None = None) -> np.ndarray:
        origin = np.broadcast_to(self.values[0] if origin is None else origin, positions.shape)
        differences = np.zeros((len(positions), self.nv))
        for row, one, other in zip(differences, origin, positions, strict=True):
            mujoco.mj_differentiatePos(self.compiled, row, 1.0, np.array(one), np.array(other))
        return differences


def by_mjrun(problem: Problem, model: Path, log: Path, seed: int, row: Row) -> None:
    begin, steps = time.process_time(), 0
    predict = Predictor.predict

    def counted(self: Predictor, rollouts: Sequence[ChunkRolloutInputs]) -> list[np.ndarray]:
        nonlocal steps
        steps += sum(each.chunk.steps for each in rollouts)
        return predict(self, rollouts)

    Predictor.predict = counted
    try:
        result = Fit(Simulation(str(model), seed=seed), data=[str(log)], free=problem.free, holdout=0).run()
    except MjrunError:
        row.refused += 1
        return
    finally:
        Predictor.predict = predict
    row.lengths.append(steps / round(problem.seconds / problem.model().opt.timestep))
    row.seconds.append(time.process_time() - begin)
    row.errors.append([abs(p.value / t - 1) for p, t in zip(result.parameters, problem.truth, strict=True)])
    row.hits += [p.low <= t <= p.high for p, t in zip(result.parameters, problem.truth, strict=True)]
    row.warned += any("lacks something" in each for each in result.remarks)
    row.rollouts.append(result.rollouts)


def by_scipy(problem: Problem, model: Path, log: Path, seed: int, row: Row) -> None:
    names, rows = problem.log(seed)
    begin = time.process_time()
    shot = Shot(problem, model, names, rows)
    count, generator = len(shot.parameters), np.random.default_rng(seed)
    starts = [np.array([p.first_coordinate for p in shot.parameters])]
    starts += [generator.uniform(0.1, 0.9, count) for _ in range(STARTS - 1)]
    free = np.full(2 * shot.nv, np.inf)
    bounds = (np.concatenate([np.zeros(count), -free]), np.concatenate([np.ones(count), free]))
    ends = [
        optimize.least_squares(
            shot.residuals, np.concatenate([start, np.zeros(2 * shot.nv)]), bounds=bounds, x_scale="jac", max_nfev=40
        )
        for start in starts
    ]
    best = min(ends, key=lambda end: end.cost)
    row.seconds.append(time.process_time() - begin)
    row.rollouts.append(shot.rollouts)
    row.lengths.append(shot.rollouts)
    freedom = len(best.fun) - len(best.x)
    errors = np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac)) * 2 * best.cost / freedom)[:count]
    reach = float(special.stdtrit(freedom, 0.975)) * errors
    for p, c, width, truth in zip(shot.parameters, best.x, reach, problem.truth, strict=False):
        row.hits.append(p.value(max(c - width, 0.0)) <= truth <= p.value(min(c + width, 1.0)))
    row.errors.append(
        [abs(p.value(c) / t - 1) for p, c, t in zip(shot.parameters, best.x, problem.truth, strict=False)]
    )


def by_sysid(problem: Problem, model: Path, log: Path, seed: int, row: Row) -> None:
    from mujoco import sysid

    if not hasattr(sysid, "optimize"):
        row.failure = "not installed"
        return
    names, rows = problem.log(seed)
    shot = Shot(problem, model, names, rows)
    if any(p.is_delay for p in shot.parameters):
        row.failure = "has no delays"
        return
    begin = time.process_time()
    parameters, calls = sysid.ParameterDict(), 0
    for index, each in enumerate(shot.parameters):

        def modify(spec: mujoco.MjSpec, parameter: object, each: FreeParameter = each) -> None:
            for override in overrides([each], [float(parameter.value[0])]):  # type: ignore[attr-defined]
                apply(spec, override)

        parameters.add(sysid.Parameter(f"p{index}", each.start, each.low, each.high, modifier=modify))
    spec = mujoco.MjSpec.from_string(problem.xml)
    columns: list[int] = []
    for joint in spec.joints:  # it compares sensors
        kind = mujoco.mjtSensor.mjSENS_JOINTPOS
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            kind = mujoco.mjtSensor.mjSENS_FRAMEPOS
            name = joint.parent.name or "free"
            joint.parent.name = name
            spec.add_sensor(name=f"at_{name}", type=kind, objtype=mujoco.mjtObj.mjOBJ_XBODY, objname=name)
            columns += [0, 1, 2]
            continue
        spec.add_sensor(name=f"at_{joint.name}", type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint.name)
    compiled = spec.compile()
    hinges = [i for j, i in enumerate(compiled.jnt_qposadr) if compiled.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE]
    measured = shot.values[:, [*columns, *hinges]]
    initial = sysid.create_initial_state(compiled, shot.start.qpos, shot.start.qvel, np.zeros(0))
    sensors = sysid.TimeSeries.from_names(shot.times, measured, compiled)
    steps = np.arange(problem.every * (len(shot.times) - 1) + 1)
    controls = sysid.TimeSeries(steps * compiled.opt.timestep, shot.commands[steps // problem.every])
    sequences = sysid.ModelSequences("log", spec, "log", initial, controls, sensors)
    residual = sysid.build_residual_fn(models_sequences=[sequences])

    def counted(x: np.ndarray, *arguments: object) -> object:
        nonlocal calls
        calls += x.shape[1] if x.ndim > 1 else 1
        return residual(x, *arguments)

    with contextlib.redirect_stdout(io.StringIO()):  # it reports every iteration
        best, _ = sysid.optimize(initial_params=parameters, residual_fn=counted, optimizer="mujoco", verbose=False)
    row.seconds.append(time.process_time() - begin)
    row.rollouts.append(calls)
    row.lengths.append(calls)
    row.errors.append([abs(float(best[f"p{i}"].value[0]) / t - 1) for i, t in enumerate(problem.truth)])


SOLVERS: dict[str, Callable[[Problem, Path, Path, int, Row], None]] = {
    "mjrun": by_mjrun,
    "scipy": by_scipy,
    "sysid": by_sysid,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="logs of each problem")
    parser.add_argument("--rough-seeds", type=int, default=5, help="logs of problems that contacts make rough")
    parser.add_argument("--problems", nargs="*", choices=PROBLEMS, default=[*PROBLEMS])
    parser.add_argument("--no-sysid", action="store_true", help="skip mujoco.sysid")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    solvers = [name for name in SOLVERS if not (options.no_sysid and name == "sysid")]
    heads = f"{'logs':>5} {'median':>9} {'largest':>10} {'covered':>7} {'rollouts':>7} {'lengths':>7} {'CPU':>7}"
    print(f"{'problem':<22} {'solver':<6} {heads}")
    for name in options.problems:
        problem, rows = PROBLEMS[name], {solver: Row() for solver in solvers}
        with tempfile.TemporaryDirectory() as folder:
            for seed in range(options.rough_seeds if problem.is_rough else options.seeds):
                model, log = problem.write(Path(folder), seed)
                for solver, row in rows.items():
                    try:
                        SOLVERS[solver](problem, model, log, seed, row)
                    except Exception as error:  # of a solver that is not ours
                        if solver == "mjrun":
                            raise
                        row.failure = f"{type(error).__name__}: {str(error).splitlines()[0]}"
        for solver, row in rows.items():
            print(row.line(name, solver), flush=True)


if __name__ == "__main__":
    main()
