"""How often the intervals of `mjrun fit` contain the truth, and the same problem solved by MuJoCo's own `mujoco.sysid`.

Logs are made by a bare loop of mj_step: a pendulum that swings, the arm of the gallery that follows targets, the car
that drives; with white noise, encoders of finite resolution, initial states that no log holds, and for the arm commands
that act late. Each is fitted for several seeds; the share of 95 % intervals that contain the truth is told for each
parameter, with the largest relative error of the estimates.

`mujoco.sysid` gets the swinging pendulum as its tutorial does it: one shot over the whole log from the measured initial
state. Its optimizers and `mjrun fit` run in turn, in one process; seconds, and how far each ends from the truth.

    python benchmarks/fit.py
    python benchmarks/fit.py --repetitions 10 --problems pendulum
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjrun.fit.fit import Fit
from mjrun.job.simulation import Simulation

ROOT = Path(__file__).resolve().parents[1]
NOISE, RESOLUTION = 1e-3, 2 * np.pi / 8192
PENDULUM = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0" damping="{0}" armature="{1}" frictionloss="{2}"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".02" mass="1"/>
    </body>
  </worldbody>
  <sensor><jointpos name="angle" joint="hinge"/></sensor>
</mujoco>"""
PATHS = ("joint/hinge.damping", "joint/hinge.armature", "joint/hinge.frictionloss")
TRUTH, NOMINAL = (0.05, 0.01, 0.02), (0.5, 0.2, 0.3)


@dataclass(frozen=True)
class Problem:
    """A log to make for each seed, what is looked for in it, and the truth."""

    model: Path
    free: Sequence[tuple[str, str]]
    truth: Sequence[float]
    log: Callable[[Path, int], None]


def write(path: Path, names: Sequence[str], rows: Sequence[Sequence[float]]) -> None:
    lines = [",".join(names), *(",".join(f"{value:.10g}" for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")


def measured(values: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """With noise, in counts of an encoder."""
    return np.round((values + generator.normal(0, NOISE, len(values))) / RESOLUTION) * RESOLUTION


def pendulum(folder: Path) -> Problem:
    """A pendulum that swings freely for five seconds."""
    path = folder / "pendulum.xml"
    path.write_text(PENDULUM.format(*NOMINAL))

    def log(file: Path, seed: int) -> None:
        generator = np.random.default_rng(seed)
        model = mujoco.MjModel.from_xml_string(PENDULUM.format(*TRUTH))
        data = mujoco.MjData(model)
        data.qpos[0] = 2.5
        rows: list[list[float]] = []
        for step in range(2500):
            if step % 5 == 0:
                rows.append([data.time, *measured(data.qpos, generator)])
            mujoco.mj_step(model, data)
        write(file, ["time", "qpos/hinge"], rows)

    return Problem(path, [(path_of, "log:1e-4..1") for path_of in PATHS], TRUTH, log)


def arm(folder: Path) -> Problem:
    """The arm, with armatures, dampings and friction of its own, a load at its flange, and commands that act late."""
    path = ROOT / "scenes/arm.xml"
    center, delay = (0.02, -0.01, 0.06), 0.008
    truth = (1.3, 0.7, 0.4, 2.0, *center, delay)
    free = [
        ("scale:joint/*.armature", "0.2..5"),
        ("scale:joint/*.damping", "0.1..5"),
        ("joint/*.frictionloss", "0..3"),
        ("geom/flange.mass", "0.05..5"),
        *((f"geom/flange.pos[{axis}]", "-0.1..0.1") for axis in range(3)),
        ("delay:ctrl/*", "0..0.03"),
    ]

    def log(file: Path, seed: int) -> None:
        generator = np.random.default_rng(seed)
        spec = mujoco.MjSpec.from_file(str(path))
        for joint in spec.joints:
            joint.armature *= truth[0]
            joint.damping = np.array(joint.damping) * truth[1]
            joint.frictionloss = truth[2]
        load = spec.geom("flange")
        load.mass, load.pos = truth[3], center
        model = spec.compile()
        data = mujoco.MjData(model)
        data.qpos[:] = generator.normal(0, 0.05, model.nq)  # which no log says
        frequencies = 0.3 + 0.15 * np.arange(model.nu)
        late = round(delay / model.opt.timestep)
        command = np.zeros(model.nu)
        told = [command] * late
        rows: list[list[float]] = []
        for step in range(3000):
            if step % 5 == 0:
                command = 0.5 * np.sin(2 * np.pi * frequencies * data.time)
                rows.append([data.time, *measured(data.qpos, generator), *command])
            told.append(command)
            data.ctrl[:] = told.pop(0)
            mujoco.mj_step(model, data)
        names = [f"qpos/{model.joint(i).name}" for i in range(model.njnt)]
        write(file, ["time", *names, *(f"ctrl/{model.actuator(i).name}" for i in range(model.nu))], rows)

    return Problem(path, free, truth, log)


def car(folder: Path) -> Problem:
    """The car, whose motors and wheels are others."""
    path = ROOT / "scenes/car.xml"
    truth = (0.05, 1.2)
    # Of `left` and `right`: the free joint, which `*` would name too, has no damping in the log.
    free = [("joint/*t.damping", "log:1e-3..1"), ("scale:actuator/*.gear[0]", "0.3..3")]

    def log(file: Path, seed: int) -> None:
        generator = np.random.default_rng(seed)
        spec = mujoco.MjSpec.from_file(str(path))
        for joint in spec.joints:
            if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
                joint.damping = np.array(joint.damping) * 0 + np.eye(len(np.ravel(joint.damping)))[0] * truth[0]
        for actuator in spec.actuators:
            actuator.gear = np.array(actuator.gear) * truth[1]
        model = spec.compile()
        data = mujoco.MjData(model)
        wheels = [i for i in range(model.njnt) if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE]
        rows: list[list[float]] = []
        for step in range(1500):
            if step % 5 == 0:
                data.ctrl[:] = 0.5 * np.sin(2 * np.pi * np.array([0.4, 0.7])[: model.nu] * data.time)
                angles = data.qpos[model.jnt_qposadr[wheels]]
                rows.append([data.time, *measured(angles, generator), *data.ctrl])
            mujoco.mj_step(model, data)
        names = [f"qpos/{model.joint(i).name}" for i in wheels]
        write(file, ["time", *names, *(f"ctrl/{model.actuator(i).name}" for i in range(model.nu))], rows)

    return Problem(path, free, truth, log)


PROBLEMS = {"pendulum": pendulum, "arm": arm, "car": car}


def coverage(name: str, repetitions: int, folder: Path) -> None:
    """Prints how often intervals contain the truth."""
    problem = PROBLEMS[name](folder)
    hits: list[list[bool]] = []
    errors: list[list[float]] = []
    start = time.perf_counter()
    for seed in range(repetitions):
        file = folder / f"{name}_{seed}.csv"
        problem.log(file, seed)
        simulation = Simulation(str(problem.model), seed=seed)
        result = Fit(simulation, data=[str(file)], free=problem.free, starts=1).run()
        hits.append([p.low <= t <= p.high for p, t in zip(result.parameters, problem.truth, strict=True)])
        errors.append([abs(p.value / t - 1) for p, t in zip(result.parameters, problem.truth, strict=True)])
    wall = (time.perf_counter() - start) / repetitions
    for (path, _), share, worst in zip(problem.free, np.mean(hits, axis=0), np.max(errors, axis=0), strict=True):
        error = f"worst error {100 * worst:.2f} %"
        print(f"{name:<10} {path:<28} in {100 * share:5.1f} % of {repetitions} intervals   {error}")
    print(f"{name:<10} {wall:.1f} s a fit")


def against_sysid(folder: Path) -> None:
    """Prints seconds and errors of `mujoco.sysid` and of `mjrun fit` on one log."""
    from mujoco import sysid

    problem = pendulum(folder)
    file = folder / "log.csv"
    problem.log(file, 0)
    times, angles = np.loadtxt(file, delimiter=",", skiprows=1).T

    start = time.perf_counter()
    result = Fit(Simulation(str(problem.model)), data=[str(file)], free=problem.free).run()
    report("mjrun fit", [p.value for p in result.parameters], time.perf_counter() - start, result.rollouts)

    for optimizer in ("mujoco", "scipy"):
        spec = mujoco.MjSpec.from_string(PENDULUM.format(*NOMINAL))
        model = spec.compile()
        parameters, calls = sysid.ParameterDict(), 0
        for index, path in enumerate(PATHS):
            field = path.rpartition(".")[2]

            def modify(changed: mujoco.MjSpec, parameter: object, field: str = field) -> None:
                joint = changed.joint("hinge")
                value = parameter.value[0]  # type: ignore[attr-defined]
                old = np.array(getattr(joint, field), float)
                setattr(joint, field, np.concatenate([[value], old[1:]]) if old.ndim else value)

            parameters.add(sysid.Parameter(field, NOMINAL[index], 1e-4, 1.0, modifier=modify))
        initial = sysid.create_initial_state(model, np.array([angles[0]]), np.zeros(1), np.zeros(0))
        sensors = sysid.TimeSeries.from_names(times, angles[:, None], model)
        controls = sysid.TimeSeries(np.arange(2500) * 0.002, np.zeros((2500, 0)))
        sequences = sysid.ModelSequences("pendulum", spec, "swing", initial, controls, sensors)
        residual = sysid.build_residual_fn(models_sequences=[sequences])

        def counted(x: np.ndarray, *arguments: object) -> object:
            nonlocal calls
            calls += x.shape[1] if x.ndim > 1 else 1
            return residual(x, *arguments)  # noqa: B023

        start = time.perf_counter()
        found, _ = sysid.optimize(initial_params=parameters, residual_fn=counted, optimizer=optimizer, verbose=False)
        values = [float(found[path.rpartition(".")[2]].value[0]) for path in PATHS]
        report(f"sysid, {optimizer}", values, time.perf_counter() - start, calls)


def report(name: str, values: Sequence[float], seconds: float, rollouts: int) -> None:
    errors = "   ".join(f"{100 * (value / truth - 1):+8.2f} %" for value, truth in zip(values, TRUTH, strict=True))
    print(f"{name:<14} {seconds:6.1f} s {rollouts:7d} rollouts   error of damping, armature, friction: {errors}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=50)
    parser.add_argument("--problems", nargs="*", choices=PROBLEMS, default=[*PROBLEMS])
    parser.add_argument("--no-sysid", action="store_true", help="leave out the comparison")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if not options.no_sysid:
            against_sysid(Path(folder))
        for name in options.problems:
            coverage(name, options.repetitions, Path(folder))


if __name__ == "__main__":
    main()
