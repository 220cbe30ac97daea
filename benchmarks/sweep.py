"""Throughput of `mjrun sweep`, compared with one C loop per core over the same models, and with a Python loop.

A study is timed as a whole process, including metrics; the time of a study of one point per core is subtracted as
start-up. The loop in C is a script with the arguments MODEL NSTEP that prints one line of JSON with `us_per_step`,
specified by --baseline; on each core, one runs after the other. The loops use models with the frictions of the study,
the same start and the same number of steps, since the cost of a step depends on the friction, and they take as many
steps as the study, unless these are more than RUNS simulations. All of them count, as all points of the study do; but
each is a new process, so that the first steps find cold caches. The Python loop keeps its process.
Ratios above 1 are better. The start-up of a study of one point is printed beside that of a trace.

    python benchmarks/sweep.py
    python benchmarks/sweep.py --models scenes/pendulum.xml --points 400
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle, islice
from pathlib import Path

import mujoco
import numpy as np

from mjrun.platform.cores import available_cores

ROOT = Path(__file__).resolve().parents[1]
BASELINE = ROOT / "../shared/bench/steploop.sh"
MODELS = [ROOT / "../shared/models/humanoid/humanoid.xml", ROOT / "../shared/models/car/car.xml"]
METRICS = ("drift=max(abs(energy/drift))", "height=last(com/z)", "touching=share(contact/ncon > 0)")
VARIED = 16  # models of the loops in C
START_UPS = 5  # runs that measure a start-up, per repetition
RUNS = 400  # most loops in C, each of which is a process
CORES = available_cores()
# The same study as a hand-written script; prints seconds.
PYTHON_LOOP = """
import sys, time
import mujoco, numpy as np
path, points, steps = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
start = time.perf_counter()
for friction in np.linspace(0.3, 1, points):
    model = mujoco.MjModel.from_xml_path(path)
    model.geom_friction[:, 0] = friction
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    energies, contacts = [], 0
    for _ in range(steps):
        mujoco.mj_step(model, data)
        energies.append(data.energy.sum())
        contacts += data.ncon > 0
        height = data.subtree_com[0, 2]
print(time.perf_counter() - start)
"""


def study(model: Path, points: int, steps: int, folder: Path) -> float:
    """Times a study in a new folder [s]."""
    command = [sys.executable, "-m", "mjrun", "sweep", str(model), "--steps", str(steps), "-q"]
    command += ["--vary", f"geom/*.friction[0]=0.3..1:{points}" if points > 1 else "seed=1"]
    for metric in METRICS:
        command += ["--metric", metric]
    with tempfile.TemporaryDirectory(dir=folder) as output:
        return _wall([*command, "-o", output])


def trace(model: Path, steps: int) -> float:
    """Times a trace of one of the simulations [s]."""
    return _wall([sys.executable, "-m", "mjrun", "trace", str(model), "--steps", str(steps), "-q"])


def varied_models(model: Path, folder: Path) -> list[Path]:
    """Writes models with frictions of the study, evenly chosen."""
    paths = [folder / f"{model.stem}{index}.xml" for index in range(VARIED)]
    for path, friction in zip(paths, np.linspace(0.3, 1, VARIED), strict=True):
        spec = mujoco.MjSpec.from_file(str(model))
        for geom in spec.geoms:
            geom.friction[0] = friction
        path.write_text(spec.to_xml(), encoding="utf-8")
    return paths


def c_loops(script: Path, models: list[Path], steps: int, runs: int) -> float:
    """Returns the steps per second of loops in C over the models in turn, on all cores at once."""

    def loop(model: Path) -> float:
        environment = {**os.environ, "PYTHON": sys.executable}
        command = [str(script), str(model), str(steps)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return json.loads(done.stdout)["us_per_step"]

    with ThreadPoolExecutor(CORES) as pool:
        return CORES * 1e6 / statistics.mean(pool.map(loop, islice(cycle(models), runs)))


def python_loop(model: Path, points: int, steps: int) -> float:
    """Returns the steps per second of a Python loop on one core."""
    command = [sys.executable, "-c", PYTHON_LOOP, str(model), str(points), str(steps)]
    seconds = float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return points * steps / seconds


def compare(script: Path, model: Path, total: int, steps: int, repeats: int, folder: Path) -> None:
    """Prints the medians, and the median of the ratios of adjacent runs."""
    points = max(2 * CORES, total // steps)
    models = varied_models(model, folder)
    c_loops(script, models[:1], 10, 1)  # builds it
    in_c, in_python, studies = [], [], []
    for _ in range(repeats):
        in_c.append(c_loops(script, models, steps, min(points, RUNS)))
        in_python.append(python_loop(model, max(1, points // 10), steps))
        start_up = study(model, CORES, steps, folder)
        seconds = study(model, points, steps, folder) - start_up
        studies.append((points - CORES) * steps / max(1e-9, seconds))
    ratio = statistics.median(ours / loop for ours, loop in zip(studies, in_c, strict=True))
    against_python = statistics.median(ours / loop for ours, loop in zip(studies, in_python, strict=True))
    c, ours = statistics.median(in_c), statistics.median(studies)
    print(
        f"{model.stem:12} {points:6} points of {steps:5} steps   C on {CORES} cores {c:9.0f} steps/s   "
        f"sweep {ours:9.0f} steps/s   ratio {ratio:.3f}   of a Python loop {against_python:.2f}"
    )


def start_up(model: Path, repeats: int, folder: Path) -> None:
    """Prints the lowest wall times of a trace and of a study of one point."""
    pairs = [(trace(model, 10), study(model, 1, 10, folder)) for _ in range(START_UPS * repeats)]
    plain, ours = map(min, zip(*pairs, strict=True))
    print(f"{model.stem:12} start-up: trace {plain:.2f} s, sweep of one point {ours:.2f} s, ratio {ours / plain:.2f}")


def _wall(command: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=Path, nargs="+", default=MODELS)
    parser.add_argument("--total", type=int, default=400_000, help="steps of all points together")
    parser.add_argument("--steps", type=int, nargs="+", default=[2000, 100], help="of each point")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--baseline", type=Path, default=BASELINE)
    given = parser.parse_args()
    if not given.baseline.exists():
        raise SystemExit(f"there is no {given.baseline}: --baseline names the loop in C")

    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # without bytecode, compiling would be most of the start-up
    with tempfile.TemporaryDirectory() as folder:
        for model in given.models:
            for steps in given.steps:
                compare(given.baseline, model, given.total, steps, given.repeats, Path(folder))
            start_up(model, given.repeats, Path(folder))


if __name__ == "__main__":
    main()
