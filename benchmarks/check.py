"""Time of `mjrun check` for a folder of models, compared with loading and compiling them once on all cores.

Three programs take turns: a bare script that compiles each model with MuJoCo in as many processes as there are cores;
`mjrun check --no-cache`, which also applies all rules and takes 200 steps; `mjrun check` when nothing has changed since
the last one. Times are those of whole processes, from start to end: wall time, which other programs on the machine
disturb, and CPU time of all processes, each the lowest of several runs. Ratios below 1 are better.

    python benchmarks/check.py
    python benchmarks/check.py --models ../mujoco_menagerie --repeats 1
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

from measured_process import Run, run

from mjrun.check.check import find_models

COMPILE = """
import os, sys
from concurrent.futures import ProcessPoolExecutor

def load(path):
    import mujoco
    try:
        mujoco.MjModel.from_xml_path(path)
    except ValueError:
        pass

if __name__ == "__main__":
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        list(pool.map(load, sys.argv[1:]))
"""
CHECK = [sys.executable, "-m", "mjrun", "check", "--fail-on", "error"]
ACCEPTED = (0, 1, 3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=Path, default=Path(__file__).parents[1] / "scenes")
    parser.add_argument("--most", type=int, default=300, help="number of models to check")
    parser.add_argument("--steps", type=int, default=200, help="number of steps that a check simulates")
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    models = [path for path in find_models([arguments.models])[0] if path.endswith(".xml")][: arguments.most]

    with tempfile.TemporaryDirectory() as folder:
        os.environ["MJRUN_CACHE"] = folder
        os.environ["MUJOCO_GL"] = "disable"
        script = Path(folder, "compile.py")
        script.write_text(COMPILE)
        check = [*CHECK, "--steps", str(arguments.steps), *models]
        run(*check, accepted=ACCEPTED)
        programs = {
            "load and compile": [sys.executable, str(script), *models],
            "check everything": [*check, "--no-cache"],
            "check unchanged": check,
        }
        runs: dict[str, list[Run]] = {name: [] for name in programs}
        for _ in range(arguments.repeats):
            for name, command in programs.items():
                runs[name].append(run(*command, accepted=ACCEPTED))

    print(f"{len(models)} models, {len(os.sched_getaffinity(0))} cores, lowest of {arguments.repeats}")
    print(f"{'':18}{'wall':>9}{'ratio':>8}{'CPU':>10}{'ratio':>8}")
    base = {kind: min(getattr(each, kind) for each in runs["load and compile"]) for kind in ("wall", "cpu")}
    for name, measured in runs.items():
        wall, cpu = (min(getattr(each, kind) for each in measured) for kind in ("wall", "cpu"))
        print(f"{name:18}{wall:8.2f}s{wall / base['wall']:8.2f}{cpu:9.2f}s{cpu / base['cpu']:8.2f}")


if __name__ == "__main__":
    main()
