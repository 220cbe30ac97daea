"""The same command gives identical results: twice, with any number of processes, in another folder or environment."""

import hashlib
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import h5py
import mujoco
import numpy as np
from imageio_ffmpeg import get_ffmpeg_exe
from pyarrow import feather, parquet

from mjrun.options.sweep import PARTS
from tests.scoreboard.command import QUICK_IMPORTS, ROOT, VARIABLES, CommandServer, Ended
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Tally, measured

LIMIT = 600.0  # [s], on a busy machine
SCENES = ROOT / "scenes"
QUICK = ("contacts",)
IMPORTS = (*QUICK_IMPORTS, "pyarrow.parquet", "scipy.stats", "mjrun.study.study")
VIDEOS = (".mp4", ".gif", ".apng", ".mkv", ".webm", ".png")  # their decoded frames are promised
STABLE = (".mkv", ".webm", ".png")  # so are their bytes, by the same command, which they contain
BYTES = ", the bytes"
# Keys for the time, place and duration, and for the number of processes, which changes nothing else.
VOLATILE = {"command", "wall", "path", "files", "created", "seconds", "file", "jobs", "output", "videos", "document"}
GERMAN = "de_DE.UTF-8"  # has a comma in numbers, wherever a locale decides

INPUTS = inputs_of(__name__)
MAKINGS: dict[str, str] = INPUTS["MAKINGS"]  # command lines by name
JOBS = "{jobs}"  # in a command line: the number of processes
Made = dict[str, str]  # the digest of each file, and of standard output


def furnish(folder: Path) -> Path:
    """Makes a folder with all files that the command lines read."""
    folder.mkdir(parents=True)
    for path in (path for path in SCENES.iterdir() if path.suffix in (".xml", ".yaml", ".csv")):
        shutil.copy(path, folder)
    for name in ("policies", "studies", "cameras"):
        shutil.copytree(SCENES / name, folder / name)
    (folder / "model.xml").write_text(INPUTS["MODEL"])
    (folder / "run.yaml").write_text(INPUTS["RUN"])
    (folder / "swing.csv").write_text("\n".join(["time,qpos/hinge", *_swing(), ""]))
    return folder


def _swing() -> Iterator[str]:
    """Yields rows of a log of the pendulum with another damping, with an error of measurement."""
    model = mujoco.MjModel.from_xml_path(str(SCENES / "pendulum.xml"))
    model.dof_damping[0] = 0.1
    data = mujoco.MjData(model)
    data.qpos[0] = 0.5
    for row in range(600):
        yield f"{row * model.opt.timestep:.4f},{data.qpos[0] + 1e-3 * math.sin(row**2):.9f}"
        mujoco.mj_step(model, data)


@measured(
    "determinism: twice, jobs 1/2/4, other folder, locale, time zone, hash seed, umask",
    "identical traces, tables, pixels and decoded frames",
    150,
)
def determinism(quick: bool) -> Tally:
    tally = Tally()
    with (
        tempfile.TemporaryDirectory() as scratch,
        CommandServer(LIMIT, imports=QUICK_IMPORTS if quick else IMPORTS) as server,
    ):
        folder = furnish(Path(scratch, "first"))
        other = furnish(Path(scratch, "another folder", "ünd deeper"))
        environments = {} if quick else _environments(Path(scratch), tally)
        for making in QUICK if quick else MAKINGS:
            _try(server, making, folder, other, environments, tally, quick=quick)
    return tally


def _arguments(making: str, jobs: int = 2) -> list[str]:
    return MAKINGS[making].replace(JOBS, str(jobs)).split(" ")


def _try(
    server: CommandServer,
    making: str,
    folder: Path,
    other: Path,
    environments: Mapping[str, Mapping[str, str]],
    tally: Tally,
    *,
    quick: bool,
) -> None:
    has_jobs = JOBS in MAKINGS[making]
    expected = _made(server.run(*_arguments(making), folder=folder), folder)
    tally.expect(bool(expected), f"{making}: it failed, or made nothing")
    if not expected:
        return

    def same(made: Made | None, how: str, *, same_command: bool = True) -> None:
        made = made or {"its exit code": ""}
        names = [name for name in sorted({*expected, *made}) if same_command or not name.endswith(BYTES)]
        differing = [name for name in names if expected.get(name) != made.get(name)]
        tally.expect(not differing, f"{making}, {how}: {', '.join(differing[:5])} differ")

    if not quick or not has_jobs:
        same(_made(server.run(*_arguments(making), folder=folder), folder), "again")
        same(_made(server.run(*_arguments(making), folder=other), other), "in another folder")
    for jobs in (1, 2, 4) if has_jobs else ():
        if jobs != 2 and not (quick and jobs > 1):
            made = _made(server.run(*_arguments(making, jobs), folder=folder), folder)
            same(made, f"{jobs} processes", same_command=False)
    for name, environment in environments.items():
        same(_made(_run_afresh(making, folder, environment), folder), name)


def _environments(scratch: Path, tally: Tally) -> dict[str, dict[str, str]]:
    """Returns variables that must change nothing, with a description; `UMASK` is the umask of the process."""
    found = {
        "another time zone, hash seed 1, LC_ALL=C, umask 077": {
            "TZ": "Pacific/Apia",
            "PYTHONHASHSEED": "1",
            "LC_ALL": "C",
            "UMASK": "077",
        }
    }
    numbers = {"TZ": "Asia/Kathmandu", "PYTHONHASHSEED": "2", "LC_ALL": GERMAN, "UMASK": "002", "LANG": GERMAN}
    localedef = shutil.which("localedef")
    target = scratch / GERMAN
    if localedef:
        command = [localedef, "-i", "de_DE", "-f", "UTF-8", str(target)]
        subprocess.run(command, capture_output=True, check=False)
    if target.exists():
        found["another time zone, hash seed 2, a German locale"] = {**numbers, "LOCPATH": str(scratch)}
    else:
        tally.leave_out("a German locale: localedef cannot make it here")
    return found


def _run_afresh(making: str, folder: Path, environment: Mapping[str, str]) -> Ended:
    """Runs a command line in a new interpreter, with the locale of the environment for all of C."""
    start = "import locale, sys; locale.setlocale(locale.LC_ALL, ''); from mjrun.cli.main import run; "
    ended = subprocess.run(
        [sys.executable, "-c", start + "sys.exit(run(sys.argv[1:]))", *_arguments(making)],
        cwd=folder,
        env={**os.environ, **VARIABLES, **environment},
        umask=int(environment["UMASK"], 8),
        capture_output=True,
        timeout=LIMIT,
        check=False,
    )
    return Ended(tuple(_arguments(making)), ended.returncode, ended.stdout, ended.stderr, 0)


def _made(ended: Ended, folder: Path) -> Made | None:
    """Returns the digests of the outputs of a run, and removes them; None if it failed."""
    made: Made = {}
    if ended.arguments[:1] in (("info",), ("check",), ("schema",)) or b"time," in ended.stdout[:5]:
        made["standard output"] = _digest(ended.stdout.replace(str(folder).encode(), b""))
    paths = sorted(path for path in folder.iterdir() if path.name.split(".")[0] in ("out", "run", "touch"))
    for path in paths:
        if path.name == "run.yaml":
            continue
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file() and file.parent.name != PARTS:  # points are divided by measured seconds
                made[str(file.relative_to(folder))] = _file_digest(file)
                if file.suffix in STABLE:
                    made[f"{file.relative_to(folder)}{BYTES}"] = _digest(file.read_bytes())
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
    return None if ended.code else made


def _file_digest(path: Path) -> str:
    """Returns a digest of the promised content of a file: without the time and place of its making."""
    match path.suffix:
        case ".json":
            return _digest(json.dumps(_plain(json.loads(path.read_text())), sort_keys=True).encode())
        case ".parquet" | ".feather":
            return _table_digest(path)
        case ".npz":
            with np.load(path) as arrays:
                return _digest(*(arrays[name].tobytes() for name in sorted(arrays.files) if arrays[name].ndim))
        case ".h5":
            return _hdf5_digest(path)
        case suffix if suffix in VIDEOS:
            return _frames_digest(path)
        case _:
            return _digest(path.read_bytes())


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items() if key not in VOLATILE}
    return [_plain(inner) for inner in value] if isinstance(value, list) else value


def _table_digest(path: Path) -> str:
    table = parquet.read_table(path) if path.suffix == ".parquet" else feather.read_table(path)
    names = [name for name in table.column_names if name != "wall"]
    return _digest(repr(names).encode(), *(repr(table[name].to_pylist()).encode() for name in names))


def _hdf5_digest(path: Path) -> str:
    parts: list[bytes] = []
    with h5py.File(path) as file:
        file.visititems(
            lambda name, item: parts.append(name.encode() + item[()].tobytes() if hasattr(item, "dtype") else b"")
        )
    return _digest(*parts)


def _frames_digest(path: Path) -> str:
    command = [get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-f", "framemd5", "-"]
    return _digest(subprocess.run(command, capture_output=True, check=True).stdout)


def _digest(*parts: bytes) -> str:
    whole = hashlib.sha256()
    for part in parts:
        whole.update(part)
    return whole.hexdigest()
