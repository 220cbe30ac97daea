"""CPU time of short commands, compared with scripts that a user would write instead.

Every command and its baseline run alternately as whole processes, all of whose CPU time counts, also that of their
children. Each counts with its lowest time, so that other work on the machine has little effect. Help and completion are
compared by the difference from `import click`, everything else by the ratio. The model has one body, and the outputs
are as small as they can be, so that start-up is nearly all that is measured.

    python benchmarks/startup.py
    python benchmarks/startup.py --rows image run --repeats 5
"""

import argparse
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from measured_process import run

MODEL = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 1"><freejoint/><geom size=".1"/></body>
  </worldbody>
</mujoco>
"""
DOCUMENT = "{model: one.xml, steps: 100, traces: [{output: run.csv}]}"
CLICK = "import click"
STEPS = """
import mujoco
model = mujoco.MjModel.from_xml_path("one.xml")
data = mujoco.MjData(model)
for _ in range(100):
    mujoco.mj_step(model, data)
print(data.qpos)
"""
FRAME = """
import os
os.environ["MUJOCO_GL"] = "egl"
import mujoco
from PIL import Image
model = mujoco.MjModel.from_xml_path("one.xml")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 480, 640) as renderer:
    renderer.update_scene(data)
    Image.fromarray(renderer.render()).save("bare.png")
"""
MJRUN = [sys.executable, "-m", "mjrun"]
TRACE = [*MJRUN, "trace", "one.xml", "--steps", "100", "-o", "trace.csv", "-q"]


@dataclass(frozen=True)
class Row:
    """A command and its baseline; `is_difference` compares by the difference instead of the ratio."""

    command: list[str]
    baseline: list[str]
    is_difference: bool = False


def python(code: str) -> list[str]:
    """Returns the command that runs a script."""
    return [sys.executable, "-c", code]


ROWS = {
    "help": Row([*MJRUN, "--help"], python(CLICK), is_difference=True),
    "version": Row([*MJRUN, "--version"], python(CLICK), is_difference=True),
    "trace-help": Row([*MJRUN, "trace", "--help"], python(CLICK), is_difference=True),
    "completion": Row(
        ["env", "_MJRUN_COMPLETE=bash_complete", "COMP_LINE=mjrun trace --st", "COMP_BREAKS==", *MJRUN],
        python(CLICK),
        is_difference=True,
    ),
    "info": Row([*MJRUN, "info", "one.xml"], python(STEPS)),
    "trace": Row(TRACE, python(STEPS)),
    "run": Row([*MJRUN, "run", "run.yaml", "-o", "run", "-q"], TRACE),
    "image": Row([*MJRUN, "image", "one.xml", "--size", "640x480", "-o", "image.png", "-q"], python(FRAME)),
    "check": Row([*MJRUN, "check", "one.xml"], python(STEPS)),
}


def compare(rows: dict[str, Row], repeats: int) -> None:
    """Prints the lowest CPU times, and their difference or ratio."""
    for row in rows.values():  # writes the bytecode of all modules, and the shaders of the driver
        run(*row.command)
        run(*row.baseline)
    times = {name: ([], []) for name in rows}
    for _ in range(repeats):
        for name, row in rows.items():
            times[name][0].append(run(*row.command).cpu)
            times[name][1].append(run(*row.baseline).cpu)
    for name, row in rows.items():
        ours, theirs = (1e3 * min(each) for each in times[name])
        compared = f"{ours - theirs:+.0f} ms" if row.is_difference else f"{ours / theirs:.2f} x"
        print(f"{name:12} mjrun {ours:5.0f} ms   baseline {theirs:5.0f} ms   {compared}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=[*ROWS])
    parser.add_argument("--repeats", type=int, default=11)
    options = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # without bytecode, compiling would be most of the time
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        Path("one.xml").write_text(MODEL)
        Path("run.yaml").write_text(DOCUMENT)
        compare({name: ROWS[name] for name in options.rows}, options.repeats)
        os.chdir("/")


if __name__ == "__main__":
    main()
