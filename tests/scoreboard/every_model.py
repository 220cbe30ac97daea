"""Every model of `../shared/models` and every scene, small, through every command that takes a model."""

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from tests.scoreboard.command import QUICK_IMPORTS, ROOT, CommandServer, Ended, modules_of_mjrun
from tests.scoreboard.measure import Tally, lanes, measured, side_by_side

SHARED = ROOT.parent / "shared" / "models"
SCENES = ROOT / "scenes"
LIMIT = 300.0  # [s] of one run: rendering in software on a busy machine
LINE = re.compile(r"\.(xml|obj|msh|png|stl):\d+")  # a file and a line in it
DOCUMENT = """model: {model}
steps: 3
traces: [{{output: trace.csv, probe: [qpos, energy, contact]}}]
plots: [{{output: plot.svg, probe: [energy]}}]
"""
IMAGE = "images: [{output: image.png, size: 64x48, quality: draft}]\n"
TABLE = "time,qpos/nobody\n" + "".join(f"{i / 100},{i}\n" for i in range(50))
Command = tuple[Sequence[str], frozenset[int]]
OK, MEASURED, SIMULATED, FAULTY = frozenset({0}), frozenset({0, 8}), frozenset({0, 4}), frozenset({0, 1})
REFUSED, USAGE, NO_WINDOW = frozenset({3}), frozenset({2}), frozenset({5})

BARE_MUJOCO = "tests.scoreboard.every_model:load_with_mujoco"  # a call for `CommandServer.run`
LOADS, NOT_FINITE, REFUSES = 0, 1, 3  # its exit codes


def load_with_mujoco(arguments: list[str]) -> int:
    """Loads the model of a path with MuJoCo alone; a name that is not UTF-8 and an impossible timestep are refused."""
    path = Path(arguments[0])
    try:
        if path.suffix == ".mjb":
            model = mujoco.MjModel.from_binary_path(str(path))
        elif path.suffix in (".zip", ".mjz"):
            model = mujoco.MjSpec.from_file(str(path)).compile()
        else:
            model = mujoco.MjModel.from_xml_path(str(path))
        bytes(model.names).decode()
    except Exception as error:
        sys.stderr.write(f"{error}\n")
        return REFUSES
    if not 0 < model.opt.timestep <= 1e12:
        return REFUSES
    return LOADS if _is_finite(model) and _is_finite(model.opt) else NOT_FINITE


def _is_finite(numbers: mujoco.MjModel | mujoco.MjOption) -> bool:
    values = (getattr(numbers, name) for name in dir(numbers) if not name.startswith("_"))
    arrays = (value for value in values if isinstance(value, float | np.ndarray))
    return all(np.isfinite(array).all() for array in map(np.asarray, arrays) if array.dtype.kind == "f")


@cache
def working_backend() -> str:
    """Returns the name of an OpenGL backend that works, usually `egl`; empty if there is none."""
    program = "from mjrun.rendering.backend import BackendDetector as D; print(D('auto').result().name)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    return done.stdout.strip() if not done.returncode else ""


@measured(
    "every model through every command",
    "0 tracebacks, 0 signals, MuJoCo's own verdict, every refusal with its exit code, file and line",
    600,
)
def every_model(quick: bool) -> Tally:
    """Tries all models with two servers that work at once; quickly, one scene."""
    tally = Tally()
    models = [SCENES / "swing.xml"] if quick else sorted(SCENES.glob("*.xml"))
    if not quick and SHARED.is_dir():
        models += sorted(SHARED.rglob("*.xml"))
    elif not quick:
        tally.leave_out("the models of ../shared/models: the folder is not here")
    backend = "" if quick else working_backend()
    if not quick and not backend:
        tally.leave_out("image, video and images of documents: no backend works here")

    for ended, faults in side_by_side(lambda part: _try_all(part, backend, quick), lanes(models, quick)):
        tally.expect(not faults, f"{ended}: {'; '.join(faults)}")
    return tally


def _try_all(models: Sequence[Path], backend: str, quick: bool) -> Iterator[tuple[Ended, list[str]]]:
    imports = QUICK_IMPORTS if quick else modules_of_mjrun()
    with CommandServer(LIMIT, imports=imports) as server, tempfile.TemporaryDirectory() as name:
        for i, model in enumerate(models):
            folder = Path(name, str(i))
            folder.mkdir()
            bare = server.run(model, folder=folder, call=BARE_MUJOCO)
            commands = _quick_commands(model) if quick else _commands(model, folder, backend)
            for arguments, codes in commands:
                ended = server.run(*arguments, folder=folder)
                faults = ended.faults_unless(codes if bare.code == LOADS else REFUSED)
                if ended.code == 3 and ".missing" not in ended.output and not LINE.search(ended.output):
                    faults.append("the refusal names no line")
                yield ended, faults


def _quick_commands(model: Path) -> Iterator[Command]:
    yield ("info", str(model)), OK
    yield ("trace", str(model), "--steps", "3"), OK
    yield ("info", f"{model}.missing.xml"), REFUSED


def _commands(model: Path, folder: Path, backend: str) -> Iterator[Command]:
    """Yields every command, with its exit codes for a model that loads."""
    path = str(model)
    (folder / "run.yaml").write_text(DOCUMENT.format(model=model) + (IMAGE if backend else ""))
    (folder / "data.csv").write_text(TABLE)
    yield ("info", path), OK
    yield ("info", path, "--json"), OK
    yield ("info", path, "--columns"), OK
    yield ("check", path, "--steps", "5"), FAULTY
    yield ("trace", path, "--steps", "5"), SIMULATED
    yield ("trace", path, "--steps", "3", "-o", "trace.parquet", "--contacts", "contacts.csv"), SIMULATED
    yield ("sweep", path, "--vary", "opt.timestep=.0005,.001", "--steps", "3", "--jobs", "1", "-o", "study"), MEASURED
    yield ("bench", path, "--budget", "0.1", "--steps", "3", "--repeats", "2", "--threads", "1"), OK
    yield ("export", path, "--duration", "0.05", "-o", "scene.glb"), SIMULATED
    yield ("diff", path, path), OK
    yield ("fit", path, "data.csv", "--free", "opt.density=0..2"), USAGE
    yield ("eval", path, "--policy", "random"), USAGE
    yield ("view", path, "--no-browser", "--steps", "3"), NO_WINDOW
    yield ("run", "run.yaml", *(["--gl", backend] if backend else []), "-o", "run"), SIMULATED
    if backend:
        drawn = ("--size", "64x48", "--quality", "draft", "--gl", backend)
        yield ("image", path, *drawn, "-o", "image.png"), OK
        yield ("image", path, *drawn, "--view", "seg", "--view", "depth", "-o", "views.png"), OK
        yield ("video", path, *drawn, "--jobs", "1", "--duration", "0.05", "-o", "video.mp4"), SIMULATED
    document = model.with_suffix(".yaml")
    if document.is_file():
        yield ("run", str(document), "--dry-run", "-o", "document"), OK
