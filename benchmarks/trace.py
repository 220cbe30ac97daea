"""Microseconds per row of `mjrun trace`, compared with a bare `mj_step` loop in C.

Every step is a row with all default columns, energy and exact CSV; `mjrun trace` is timed as a whole process, and its
start-up, measured with a few rows, is subtracted. The loop is a script with the arguments MODEL NSTEP [KEYFRAME] that
prints one line of JSON with `us_per_step`, specified by --baseline. Ratios below 1 are better.
More expensive outputs and inputs are timed, too, by the lowest CPU time of alternate runs: the contact table, columns
that are read instant by instant, a table of controls, noise, and a controller called at every step, beside the loop
that a user would write for it: `mj_step1`, controller, `mj_step2`, with qpos and qvel appended to lists. They have so
many rows that plain ones take as long as start-up. The traces have more columns, energy and exact CSV; "alike" has the
columns of the loop, in npz. Of the other two controllers one passes its data on to a function, and one keeps it, so
that it must get a copy. An episode of the standing humanoid is compared with the same loop around the same policy, a
network in ONNX and a function in Python, on the same observations; the loop has neither rewards nor terminations. A
long run of the last model shows that memory stays constant.

    python benchmarks/trace.py
    python benchmarks/trace.py --long 5000000 --models scenes/pendulum.xml
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import mujoco
from measured_process import Run, run

ROOT = Path(__file__).resolve().parents[1]
BASELINE = ROOT / "../shared/bench/steploop.sh"
MODELS = [
    ROOT / "../shared/models/humanoid/humanoid.xml",
    ROOT / "../shared/models/car/car.xml",
    ROOT / "scenes/pendulum.xml",
]
TASK = ROOT / "scenes/humanoid_stand.yaml"
NETWORK = ROOT / "scenes/policies/humanoid_stand.onnx"
MJRUN = (sys.executable, "-m", "mjrun")
FEW = 200  # rows that measure start-up
PLAIN_TIME = 0.4  # CPU time [s] of a plain trace with the rows of the more expensive ones; start-up takes as long
ALIKE = ["--probe", "qpos", "--probe", "qvel"]  # the columns that the loops keep
CONTROLLER = """
import numpy as np

def act(model, data):
    data.ctrl[:] = 0.1 * np.sin(data.time)
"""
PASSING = """
import numpy as np

def sine(data, ctrl):
    ctrl[:] = 0.1 * np.sin(data.time)

def act(model, data):
    sine(data, data.ctrl)
"""
KEEPING = """
import numpy as np

class Keeper:
    def __call__(self, model, data):
        self.data = data
        data.ctrl[:] = 0.1 * np.sin(data.time)

act = Keeper()
"""
LOOP = """
import sys
import mujoco

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data, qpos, qvel = mujoco.MjData(model), [], []
for _ in range(int(sys.argv[2])):
    mujoco.mj_step1(model, data)
    act(model, data)
    mujoco.mj_step2(model, data)
    qpos.append(data.qpos.copy())
    qvel.append(data.qvel.copy())
"""
FUNCTION = """
import numpy as np

WEIGHTS = np.random.default_rng(1).normal(0, 0.1, (11, 10))

def act(observation):
    return np.tanh(WEIGHTS @ observation)
"""
POLICY_LOOP = """
import os
import sys
import mujoco
import numpy as np

ACTUATORS = ["waist_pitch"] + [
    f"{side}_{joint}"
    for joint in ("hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
    for side in ("left", "right")
]

if len(sys.argv) > 4:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    session = onnxruntime.InferenceSession(sys.argv[4], options, ["CPUExecutionProvider"])
    feed, fetch = session.get_inputs()[0].name, [session.get_outputs()[0].name]

    def act(observation):
        return session.run(fetch, {feed: observation.astype(np.float32)[None]})[0][0].astype(float)

model = mujoco.MjModel.from_xml_path(sys.argv[1])
model.opt.timestep = 0.004
data, qpos, qvel = mujoco.MjData(model), [], []
mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
data.qvel[:2] = np.loadtxt(sys.argv[3])
renderer = mujoco.Renderer(model, 240, 320) if "MUJOCO_GL" in os.environ else None
driven = np.array([model.actuator(name).id for name in ACTUATORS])
stance = data.ctrl[driven]
left, right, pelvis = (model.body(name).id for name in ("left_foot", "right_foot", "pelvis"))
for step in range(int(sys.argv[2])):
    mujoco.mj_step1(model, data)
    if step % 5 == 0:
        feet = (data.xpos[left] + data.xpos[right]) / 2
        lean = data.subtree_com[0, :2] - feet[:2]
        observation = np.concatenate([lean, data.qvel[:3], data.xmat[pelvis, 6:8], data.qvel[3:6]])
        data.ctrl[driven] = 0.5 * np.tanh(act(observation)) + stance
    if renderer and step % 10 == 0:
        renderer.update_scene(data)
        renderer.render()
    mujoco.mj_step2(model, data)
    qpos.append(data.qpos.copy())
    qvel.append(data.qvel.copy())
"""


def trace(model: Path, steps: int, *options: str) -> Run:
    """Runs `mjrun trace` without its output."""
    return run(sys.executable, "-m", "mjrun", "trace", str(model), "--steps", str(steps), "-q", *options)


def bare(script: Path, model: Path, steps: int) -> float:
    """Returns the microseconds per step of the loop in C."""
    done = subprocess.run(
        [str(script), str(model), str(steps)],
        env={**os.environ, "PYTHON": sys.executable},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)["us_per_step"]


def compare(script: Path, model: Path, steps: int, repeats: int) -> float:
    """Prints the medians, and the median of the ratios of adjacent runs; returns the lowest CPU time of a row [us]."""
    loops, rows, costs, peak = [], [], [], 0
    for _ in range(repeats):
        loops.append(bare(script, model, steps))
        idle, busy = trace(model, FEW), trace(model, steps)
        rows.append(1e6 * (busy.wall - idle.wall) / (steps - FEW))
        costs.append(1e6 * (busy.cpu - idle.cpu) / (steps - FEW))
        peak = max(peak, busy.peak)
    ratio = statistics.median(row / loop for row, loop in zip(rows, loops, strict=True))
    print(
        f"{model.stem:12} {steps:8} rows   C loop {statistics.median(loops):7.2f} us/step   "
        f"trace {statistics.median(rows):7.2f} us/row   ratio {ratio:.3f}   peak {peak / 1e6:.0f} MB"
    )
    return min(costs)


def extras(model: Path, steps: int, repeats: int, folder: Path) -> None:
    """Prints the lowest CPU times per row of more expensive traces, of a plain one and of a loop in Python."""
    controllers = {"controller": CONTROLLER, "passing": PASSING, "keeping": KEEPING}
    for name, text in controllers.items():
        (folder / f"{name}.py").write_text(text)
    code = folder / "controller.py"
    table = folder / "controls.npz"
    trace(model, steps, "--probe", "ctrl", "-o", str(table))
    cases: dict[str, Callable[[int], Run]] = {
        name: partial(trace_with, model, options)
        for name, options in {
            "plain": [],
            "contacts": ["--contacts", str(folder / "contacts.csv")],
            **{name: ["--probe", name] for name in ("contact_force", f"contact/world/{first_body(model)}")},
            **{name: ["--probe", name] for name in ("cacc", "subtree_linvel", "qfrc_inverse", "warning")},
            "noise": ["--ctrl-noise", "1e-9"],
            "table": ["--ctrl-from", str(table)],
            **{name: ["--controller", f"{folder / name}.py:act"] for name in controllers},
            "alike": ["--controller", f"{code}:act", *ALIKE, "-o", str(folder / "alike.npz")],
            "every 10th": ["--controller", f"{code}:act", "--control-dt", str(10 * timestep(model))],
        }.items()
        if actuated(model) or not {"--controller", "--ctrl-from", "--ctrl-noise"} & {*options}
    }
    if actuated(model):
        loop = folder / "loop.py"
        loop.write_text(f"{CONTROLLER}\n{LOOP}")
        cases["loop"] = lambda count: run(sys.executable, str(loop), str(model), str(count))

    costs = lowest_costs(cases, steps, repeats)
    texts = [f"{name} {cost:.1f} us ({cost / costs['plain']:.2f} x)" for name, cost in costs.items()]
    print(f"{model.stem:12} {steps:8} rows   {'   '.join(texts)}")
    for name in [*controllers, "alike"] if actuated(model) else ():
        print(f"{'':12} {name} / loop in Python: {costs[name] / costs['loop']:.2f}")


def policies(steps: int, repeats: int, folder: Path) -> None:
    """Prints the lowest CPU times per step of an episode and of the loop, for each policy and output."""
    model, code, loop = ROOT / "scenes/humanoid.xml", folder / "weights.py", folder / "policy_loop.py"
    code.write_text(FUNCTION)
    loop.write_text(f"{FUNCTION}\n{POLICY_LOOP}")
    start, noise = folder / "start.csv", folder / "noise.txt"
    run(*MJRUN, "trace", str(TASK), "--policy", "zero", "--steps", "1", "-q", "--probe", "qvel", "-o", str(start))
    noise.write_text("\n".join(start.read_text().splitlines()[1].split(",")[1:3]))  # of qvel, after the time
    video = ["video", "--size", "320x240", "--fps", "25", "--jobs", "1", "-o", str(folder / "video.mp4")]
    for name, policy, network in (("ONNX", str(NETWORK), [str(NETWORK)]), ("function", f"{code}:act", [])):
        alike = ["trace", *ALIKE, "-o", str(folder / "alike.npz")]
        for command, count in ((["trace"], steps), (alike, steps), (video, steps // 20)):
            ours = [*MJRUN, *command, str(TASK), "--policy", policy, "-q", "--steps"]
            theirs = [sys.executable, str(loop), str(model)]
            gl = {"MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")} if command is video else {}
            cases = {"ours": partial(run_steps, ours, []), "loop": partial(run_steps, theirs, [str(noise), *network])}
            with environment(gl):
                costs = lowest_costs(cases, count, repeats)
            one, other = costs["ours"], costs["loop"]
            print(
                f"{TASK.stem}, {command[0]}{' alike' * (command is alike)}, policy {name}: {one:.1f} us/step   "
                f"loop in Python {other:.1f} us/step   ratio {one / other:.2f}"
            )


def lowest_costs(cases: Mapping[str, Callable[[int], Run]], steps: int, repeats: int) -> dict[str, float]:
    """Returns the CPU time of a step [us] of each case, which runs a number of steps, without that of its start.

    All run alternately, and both the whole run and the start count with their lowest times.
    """
    times = {name: ([], []) for name in cases}
    for _ in range(repeats):
        for name, case in cases.items():
            for each, count in zip(times[name], (FEW, steps), strict=True):
                each.append(case(count).cpu)
    return {name: 1e6 * (min(busy) - min(idle)) / (steps - FEW) for name, (idle, busy) in times.items()}


def run_steps(command: Sequence[str], options: Sequence[str], steps: int) -> Run:
    """Runs a command with a number of steps before its options."""
    return run(*command, str(steps), *options)


@contextmanager
def environment(values: dict[str, str]) -> Generator[None]:
    """Sets environment variables; MUJOCO_GL is absent unless it is among them."""
    before = os.environ.pop("MUJOCO_GL", None)
    os.environ.update(values)
    try:
        yield
    finally:
        os.environ.pop("MUJOCO_GL", None)
        os.environ.update({} if before is None else {"MUJOCO_GL": before})


def trace_with(model: Path, options: Sequence[str], steps: int) -> Run:
    return trace(model, steps, *options)


def timestep(model: Path) -> float:
    return mujoco.MjModel.from_xml_path(str(model)).opt.timestep


def first_body(model: Path) -> str:
    return mujoco.MjModel.from_xml_path(str(model)).body(1).name


def actuated(model: Path) -> bool:
    return mujoco.MjModel.from_xml_path(str(model)).nu > 0


def long_run(model: Path, steps: int) -> None:
    """Prints the wall time and memory of a long trace, and the memory of a tenth of it."""
    short, whole = trace(model, steps // 10), trace(model, steps)
    print(
        f"{model.stem:12} {steps} rows in {whole.wall:.1f} s, peak {whole.peak / 1e6:.0f} MB; "
        f"{steps // 10} rows, peak {short.peak / 1e6:.0f} MB"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=Path, nargs="+", default=MODELS)
    parser.add_argument("--steps", type=int, default=50_000)
    parser.add_argument("--long", type=int, default=1_000_000, help="rows of the long run")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--baseline", type=Path, default=BASELINE)
    given = parser.parse_args()
    if given.steps <= 100 * FEW:  # of which videos have a hundredth
        parser.error(f"--steps {given.steps}: give more than {100 * FEW}")
    if not given.baseline.exists():
        raise SystemExit(f"there is no {given.baseline}; name the loop in C with --baseline")
    costs = [compare(given.baseline, model, given.steps, given.repeats) for model in given.models]
    with tempfile.TemporaryDirectory() as folder:
        for model, cost in zip(given.models, costs, strict=True):
            extras(model, FEW + round(1e6 * PLAIN_TIME / cost), given.repeats, Path(folder))
        policies(given.steps // 5, given.repeats, Path(folder))
    long_run(given.models[-1], given.long)


if __name__ == "__main__":
    main()
