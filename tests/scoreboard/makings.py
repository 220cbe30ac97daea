"""Command lines that write what mjrun can write, small, for measures that run all of them."""

import math
import shutil
from dataclasses import dataclass
from pathlib import Path

SCENES = Path(__file__).resolve().parents[2] / "scenes"
FOLDERS = ("policies", "studies", "cameras")

MODEL = """<mujoco>
  <visual><global offwidth="64" offheight="48"/></visual>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="2 2 .1" rgba=".4 .5 .6 1"/>
    <camera name="side" pos="0 -2 .8" xyaxes="1 0 0 0 .3 1"/>
    <body name="arm" pos="0 0 .6">
      <joint name="hinge" axis="0 1 0" pos="0 0 .3" damping=".1"/>
      <geom name="arm" type="box" size=".2 .1 .1" rgba="1 0 0 1"/>
    </body>
    <body name="ball" pos=".6 0 .12">
      <freejoint name="ball"/>
      <geom name="ball" size=".1" rgba="0 1 0 1"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/></sensor>
</mujoco>
"""
RUN = """model: model.xml
duration: 0.1
seed: 4
ctrl_noise: 1
videos: [{output: run.mkv, size: 64x48, camera: side, quality: draft}]
images: [{output: run.png, time: 0.05, size: 64x48, camera: side, quality: draft}]
traces: [{output: run.csv, probe: [qpos, qvel, energy]}]
"""
SMALL = "--size 64x48 --camera side --quality draft"
NOISE = "--ctrl-noise 1 --seed 4"
LONG = f"{NOISE} --duration 0.2"
JOBS = "{jobs}"  # in a command line: how many processes may work on it


@dataclass(frozen=True)
class Making:
    """A command line that writes something.

    Attributes:
      name: of what is made.
      line: after `mjrun`, split at spaces.
      draws: whether it needs a renderer.
    """

    name: str
    line: str
    draws: bool = False

    @property
    def has_jobs(self) -> bool:
        """Whether it may be told how many processes work on it."""
        return JOBS in self.line

    def arguments(self, jobs: int = 2) -> list[str]:
        """After `mjrun`."""
        return self.line.replace(JOBS, str(jobs)).split(" ")


EVAL = "eval car_drive.yaml --policy policies/car_drive.onnx --episodes 6 duration=0.4 --jobs {jobs} -o out"
SWEEP = "--vary geom/ball.size[0]=uniform(0.05,0.1) --samples 6 --metric low=min(qpos/ball/z) --jobs {jobs} -o out"
MAKINGS = (
    *(
        Making(f"trace {suffix}", f"trace model.xml {LONG} --probe qpos,qvel,energy,sensor -o out.{suffix}")
        for suffix in ("csv", "parquet", "npz", "jsonl", "h5", "mat", "feather")
    ),
    Making("trace on standard output", f"trace model.xml {LONG} --csv"),
    Making("contacts", f"trace model.xml {LONG} --contacts touch.csv -o out.csv"),
    Making("sweep", f"sweep model.xml {LONG} {SWEEP}"),
    Making("study document", "sweep studies/energy_by_timestep.yaml duration=0.2 --jobs {jobs} -o out"),
    Making("eval", EVAL),
    Making("eval of two policies", f"{EVAL} --compare random --metric effort=mean(abs(ctrl/forward))"),
    Making("episode", "trace car_drive.yaml --policy random --seed 3 --duration 0.5 -o out.csv"),
    Making("fit", "fit pendulum.xml swing.csv --free joint/hinge.damping=0.01..1 --allow-unidentifiable -o out.xml"),
    Making("recording", f"trace model.xml {LONG} -o out.csv --recording out.npz --save-key out.xml"),
    Making("image", f"image model.xml {NOISE} -t 0.1 {SMALL} -o out.png", draws=True),
    Making("depth", f"image model.xml {NOISE} -t 0.1 {SMALL} --view depth -o out.npy", draws=True),
    *(
        Making(f"video {suffix}", f"video model.xml {LONG} {SMALL} --jobs {JOBS} -o out.{suffix}", draws=True)
        for suffix in ("mp4", "mkv", "webm", "gif", "apng")
    ),
    Making("frames", f"video model.xml {LONG} {SMALL} --jobs {JOBS} -o out/", draws=True),
    Making("run document", "run run.yaml --jobs {jobs}", draws=True),
    Making("eval with films", f"{EVAL} --films 1 --size 64x48 --quality draft", draws=True),
    Making("plot png", "plot pendulum_fit.csv -o out.png"),
    Making("plot svg", "plot pendulum_fit.csv -o out.svg"),
    Making("plot pdf", "plot pendulum_fit.csv -o out.pdf"),
    Making("info", "info model.xml --json"),
    Making("check", "check model.xml car.xml --jobs {jobs} --json"),
    Making("schema", "schema run"),
)


def furnish(folder: Path) -> Path:
    """Makes a folder with all that the command lines read."""
    folder.mkdir(parents=True)
    for path in (path for path in SCENES.iterdir() if path.suffix in (".xml", ".yaml", ".csv")):
        shutil.copy(path, folder)
    for name in FOLDERS:
        shutil.copytree(SCENES / name, folder / name)
    (folder / "model.xml").write_text(MODEL)
    (folder / "run.yaml").write_text(RUN)
    rows = [f"{0.01 * row:.2f},{0.3 * math.sin(0.1 * row)!r}" for row in range(120)]
    (folder / "swing.csv").write_text("\n".join(["time,qpos/hinge", *rows, ""]))
    return folder
