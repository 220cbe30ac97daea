"""Command lines that write what mjrun can write, small, for measures that run all of them."""

import math
import shutil
from dataclasses import dataclass
from pathlib import Path

from tests.scoreboard.data import inputs_of

SCENES = Path(__file__).resolve().parents[2] / "scenes"
FOLDERS = ("policies", "studies", "cameras")

INPUTS = inputs_of(__name__)
MODEL = INPUTS["MODEL"]
RUN = INPUTS["RUN"]
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
