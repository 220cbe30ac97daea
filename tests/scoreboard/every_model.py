"""Every model of `../shared/models` and every scene, small, through every command that takes one."""

import re
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path

from tests.scoreboard.backend import working_backend
from tests.scoreboard.bare_mujoco import LOADS
from tests.scoreboard.command import ROOT, CommandServer, Ended, modules_of_mjrun
from tests.scoreboard.measure import Measure, Tally

SHARED = ROOT.parent / "shared" / "models"
SCENES = ROOT / "scenes"
LIMIT = 300.0  # [s] of one run: drawing in software on a busy machine
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


def run(quick: bool) -> Tally:
    """Tries all models, or a scene; two servers work at once."""
    tally = Tally()
    models = [SCENES / "swing.xml"] if quick else sorted(SCENES.glob("*.xml"))
    if not quick and SHARED.is_dir():
        models += sorted(SHARED.rglob("*.xml"))
    elif not quick:
        tally.left_out.append("the models of ../shared/models: the folder is not here")
    backend = "" if quick else working_backend()
    if not quick and not backend:
        tally.left_out.append("image, video and images of documents: no backend works here")

    halves = [models] if quick else [models[::2], models[1::2]]
    with ThreadPoolExecutor(len(halves)) as threads:
        for ended, faults in chain.from_iterable(threads.map(lambda half: [*_try_all(half, backend, quick)], halves)):
            tally.expect(not faults, f"{ended}: {'; '.join(faults)}")
    return tally


def _try_all(models: Sequence[Path], backend: str, quick: bool) -> Iterator[tuple[Ended, list[str]]]:
    imports = (
        ("mjrun.cli.commands.info", "mjrun.cli.commands.trace", "mjrun.outputs.trace") if quick else modules_of_mjrun()
    )
    with CommandServer(LIMIT, imports=imports) as server, tempfile.TemporaryDirectory() as name:
        for i, model in enumerate(models):
            folder = Path(name, str(i))
            folder.mkdir()
            bare = server.run(model, folder=folder, call="tests.scoreboard.bare_mujoco:load")
            commands = _quick_commands(model) if quick else _commands(model, folder, backend)
            for arguments, codes in commands:
                ended = server.run(*arguments, folder=folder)
                yield ended, _faults(ended, codes if bare.code == LOADS else REFUSED)


def _quick_commands(model: Path) -> Iterator[Command]:
    yield ("info", str(model)), OK
    yield ("trace", str(model), "--steps", "3"), OK
    yield ("info", f"{model}.missing.xml"), REFUSED


def _commands(model: Path, folder: Path, backend: str) -> Iterator[Command]:
    """Every command, with the exit codes that it may have for a model that loads."""
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


def _faults(ended: Ended, codes: frozenset[int]) -> list[str]:
    """What is wrong with a run."""
    faults = list(ended.faults)
    if ended.code not in codes:
        faults.append(f"exit code {ended.code}, not {' or '.join(map(str, sorted(codes)))}")
    said = ended.message + ended.stdout.decode("utf-8", "replace")
    if ended.code == 3 and ".missing" not in said and not LINE.search(said):
        faults.append("the refusal names no line")
    return faults


MEASURE = Measure(
    "every model through every command",
    "0 tracebacks, 0 signals, MuJoCo's own verdict, every refusal with its exit code, file and line",
    600,
    run,
)
