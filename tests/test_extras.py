"""Tests of each extra with its libraries hidden: every command that needs one reports it, and the others work."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

import mjrun
from tests.packages import hidden, run_with
from tests.processes import PATIENCE
from tests.scoreboard.command import CommandServer, Ended, modules_of_mjrun

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
SCENES = ROOT / "scenes"
FRICTION = ["--vary", "geom/wood.friction[0]=0.1,0.2", "--metric", "x=last(xpos/wood/x)", "--jobs", "1"]
SWEEP = ["sweep", str(SCENES / "friction_ramp.xml"), "--duration", "0.02", *FRICTION]
WRAPPED = ["--controller", "wrapped.py:wrapped"]
EVAL = ["eval", str(SCENES / "car_drive.yaml"), "--policy", "zero", "--episodes", "1", "-o", "played"]
EPISODES = ["export", str(SCENES / "car_drive.yaml"), "--policy", "zero", "--episodes", "1", "-o", "new"]
FREE = ["--free", "joint/hinge.damping=0..1"]
FIT = ["fit", str(SCENES / "pendulum.xml"), "t.csv", *FREE, "--starts", "1", "-o", "f.xml"]
EXCITE = ["fit", str(SCENES / "pendulum.xml"), *FREE, "--excite", "chirp.csv"]
SWING = str(SCENES / "swing.xml")
TRACE = ["trace", str(SCENES / "pendulum.xml"), "--steps", "3"]
EXPORT = ["export", str(SCENES / "pendulum.xml"), "--steps", "3"]
ONNX = ["--policy", str(SCENES / "policies/car_drive.onnx")]
DRIVE = str(SCENES / "car_drive.yaml")
PLOTTED = "{model: scene:pendulum, steps: 3, plots: [{probe: energy, output: p.png}]}"
TRACED = "{model: scene:pendulum, steps: 3, traces: [{output: t2.csv}]}"

# The hidden library, the command, the library that it asks for, and the extra.
NEEDING = [
    ("pyarrow", [*TRACE, "-o", "new.parquet"], "writing .parquet needs pyarrow", "parquet"),
    ("pyarrow", [*TRACE, "-o", "new.feather"], "writing .feather needs pyarrow", "parquet"),
    ("pyarrow", [*TRACE, "--ctrl-from", "t.parquet"], "reading .parquet needs pyarrow", "parquet"),
    ("pyarrow", [*TRACE, "--replay", "t.feather"], "reading .feather needs pyarrow", "parquet"),
    ("pyarrow", ["diff", "t.parquet", "t.csv"], "reading .parquet needs pyarrow", "parquet"),
    ("pyarrow", ["plot", "t.parquet", "-o", "new.png"], "reading .parquet needs pyarrow", "parquet"),
    ("pyarrow", ["plot", "study", "-o", "new.png"], "needs pyarrow", ""),
    ("pyarrow", [*SWEEP, "-o", "new"], "mjrun sweep needs pyarrow", "sweep"),
    ("pyarrow", ["sweep", "study"], "needs pyarrow", "sweep"),
    ("cloudpickle", [*SWEEP, *WRAPPED, "-o", "new"], "code that cannot be imported needs cloudpickle", "sweep"),
    ("pyarrow", EVAL, "mjrun eval needs pyarrow", "eval"),
    ("pyarrow", [*EPISODES, "--format", "lerobot"], "--format lerobot needs pyarrow", "lerobot"),
    ("h5py", [*EPISODES, "--format", "minari"], "--format minari needs h5py", "minari"),
    ("scipy", [*TRACE, "-o", "new.mat"], "writing .mat needs scipy", "mat"),
    ("scipy", [*SWEEP, "-o", "new"], "mjrun sweep needs scipy", "sweep"),
    ("scipy", FIT, "mjrun fit needs scipy", "fit"),
    ("scipy", EXCITE, "mjrun fit needs scipy", "fit"),
    ("scipy", EVAL, "mjrun eval needs scipy", "eval"),
    ("h5py", [*TRACE, "-o", "new.h5"], "writing .h5 needs h5py", "hdf5"),
    ("h5py", ["diff", "t.h5", "t.csv"], "reading .h5 needs h5py", "hdf5"),
    ("mcap", [*EXPORT, "-o", "new.mcap"], "writing .mcap needs mcap", "mcap"),
    ("foxglove_schemas_protobuf", [*EXPORT, "-o", "new.mcap"], "writing .mcap needs foxglove-schemas-protobuf", "mcap"),
    ("pxr", [*EXPORT, "-o", "new.usdz"], "writing .usdc needs usd-core", "usd"),
    ("matplotlib", ["plot", "t.csv", "-o", "new.png"], "a plot needs matplotlib", "plot"),
    ("matplotlib", ["plot", "t.csv", "--html", "new.html"], "a plot needs matplotlib", "plot"),
    ("matplotlib", ["plot", "study", "-o", "new.png"], "a plot needs matplotlib", "plot"),
    ("matplotlib", ["run", "plotted.yaml", "-o", "new"], "a plot needs matplotlib", "plot"),
    ("matplotlib", ["run", "traced.yaml", "-o", "new", "--html", "new/new.html"], "a plot needs matplotlib", "plot"),
    ("matplotlib", [*FIT, "--html", "new.html"], "a plot needs matplotlib", "plot"),
    ("skimage", ["diff", "a.png", "a.png", "--min-ssim", "0.9"], "--min-ssim needs scikit-image", "diff"),
    ("distributed", [*SWEEP, "-o", "new", "--engine", "dask"], "mjrun sweep on Dask needs distributed", "dask"),
    ("ray", [*SWEEP, "-o", "new", "--engine", "ray"], "mjrun sweep on Ray needs ray", "ray"),
    ("submitit", [*SWEEP, "-o", "new", "--engine", "slurm"], "mjrun sweep on Slurm needs submitit", "slurm"),
    ("mujoco_warp", [*SWEEP, "-o", "new", "--engine", "warp"], "--engine warp needs mujoco-warp", "warp"),
    ("warp", ["bench", str(SCENES / "pendulum.xml"), "--engine", "warp"], "--engine warp needs warp-lang", "warp"),
    ("onnxruntime", ["trace", DRIVE, *ONNX, "--csv"], "a policy in ONNX needs onnxruntime", "policy"),
    ("onnxruntime", ["video", DRIVE, *ONNX, "-o", "new.mp4"], "a policy in ONNX needs onnxruntime", "policy"),
    ("onnxruntime", [*EVAL, *ONNX], "a policy in ONNX needs onnxruntime", "policy"),
    ("gymnasium", ["info", "gym:Ant-v5"], "gym:Ant-v5 needs gymnasium", "gym"),
    ("gymnasium", ["trace", "gym:Ant-v5", "--policy", "zero"], "gym:Ant-v5 needs gymnasium", "gym"),
    ("gymnasium", ["eval", "gym:Ant-v5", "--policy", "zero", "-o", "new"], "gym:Ant-v5 needs gymnasium", "gym"),
]
LIBRARIES = sorted({library for library, *_ in NEEDING})


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a table in every format, an image, a small study and two documents."""
    folder = tmp_path_factory.mktemp("made")
    simulation = mjrun.Simulation("scene:pendulum", key="level", steps=40)
    for suffix in ("csv", "parquet", "feather", "mat", "h5"):
        mjrun.Trace(simulation, str(folder / f"t.{suffix}"), probe=["qpos"]).run()
    done = run_with(folder, "-m", "mjrun", *SWEEP, "-o", "study", cwd=folder)
    assert done.returncode == 0, done.stderr
    mjrun.Image(simulation, str(folder / "a.png"), size=(32, 32)).run()
    (folder / "plotted.yaml").write_text(PLOTTED)
    (folder / "traced.yaml").write_text(TRACED)
    (folder / "wrapped.py").write_text("wrapped = lambda model, data: None\n")
    return folder


@pytest.fixture(scope="module")
def server() -> Iterator[CommandServer]:
    """A process that has imported mjrun, and no library of an extra; each command runs in a fork of it."""
    lazy = [name for name in modules_of_mjrun() if name.startswith("mjrun.") and name not in EAGER]
    with CommandServer(limit=PATIENCE, imports=lazy) as started:
        yield started


def run_hidden(server: CommandServer, folder: Path, libraries: list[str], command: list[str]) -> Ended:
    """Runs a command in a folder without some libraries."""
    environment = {"PYTHONPATH": str(hidden(folder.parent, *libraries))}
    return server.run(*command, folder=folder, environment=environment, call="tests.packages:run_without")


@pytest.mark.parametrize(
    ("library", "command", "sentence", "extra"),
    NEEDING,
)
def test_a_command_without_its_library_names_the_extra_that_installs_it(
    server: CommandServer, made: Path, tmp_path: Path, library: str, command: list[str], sentence: str, extra: str
) -> None:
    shutil.copytree(made, tmp_path / "here")
    done = run_hidden(server, tmp_path / "here", [library], command)
    assert done.code == 2, done
    assert sentence in done.message
    assert re.search(rf", which is not installed(;|\n ) pip install 'mjrun\[{extra}", done.message)
    assert not [*(tmp_path / "here").glob("new.*"), *(tmp_path / "here").glob("new/results.*")]


@pytest.mark.parametrize(
    "command",
    [
        [*TRACE, "-o", "new.csv"],
        ["diff", "t.csv", "t.mat"],
        ["diff", "a.png", "a.png"],
        ["info", "scene:car_drive", "observations"],
        ["check", str(SCENES / "pendulum.xml")],
        ["image", SWING, "--size", "32x32", "-o", "new.png"],
        ["video", SWING, "--duration", ".1", "--size", "160x120", "--plot", "energy", "-o", "new.gif"],
        ["trace", DRIVE, "--policy", "zero", "--steps", "20", "--csv"],
        ["schema", "run"],
        ["run", "traced.yaml", "-o", "new"],
        ["doctor"],
    ],
    ids=lambda command: command[0],
)
def test_without_any_extra_the_rest_works(
    server: CommandServer, made: Path, tmp_path: Path, command: list[str]
) -> None:
    shutil.copytree(made, tmp_path / "here")
    done = run_hidden(server, tmp_path / "here", LIBRARIES, command)
    assert done.code == 0, done.message


# Modules that import a library of an extra at their top, and are themselves imported within functions.
DRAWING = ("matplotlib_layout", "matplotlib_drawing")
STUDIES = ("matplotlib_drawing",)
EAGER = {
    "mjrun.gym",
    "mjrun.formats.arrow_columns",
    *(f"mjrun.formats.episodes.{name}" for name in ("lerobot", "minari")),
    "mjrun.formats.mcap",
    "mjrun.outputs.exports.mcap",
    "mjrun.formats.usd",
    *(f"mjrun.formats.tables.{name}" for name in ("feather", "hdf5", "parquet")),
    *(f"mjrun.formats.episodes.{name}" for name in ("lerobot", "minari")),
    *(f"mjrun.hdf5.{name}" for name in ("untrusted_content", "demonstrations")),
    *(f"mjrun.plotting.{name}" for name in DRAWING),
    *(f"mjrun.plotting.study.{name}" for name in STUDIES),
}

IMPORTING = """
import importlib, pkgutil, mjrun
for module in pkgutil.walk_packages(mjrun.__path__, "mjrun.", onerror=lambda name: None):
    try:
        importlib.import_module(module.name)
    except Exception as error:
        print(module.name, type(error).__name__)
"""


def test_modules_of_extras_are_imported_where_they_are_used(tmp_path: Path) -> None:
    done = run_with(hidden(tmp_path, *LIBRARIES, "torch", "stable_baselines3", "dask"), "-c", IMPORTING)
    assert {line.split()[0] for line in done.stdout.splitlines()} == EAGER, done.stderr
