"""The same command makes the same: twice, by any number of processes, in another folder and another environment."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mjrun.options.sweep import PARTS
from tests.scoreboard.command import ROOT, CommandServer, Ended
from tests.scoreboard.makings import MAKINGS, Making, furnish
from tests.scoreboard.measure import Measure, Tally

LIMIT = 600.0  # seconds, on a machine that does much else
QUICK = ("trace parquet", "contacts", "sweep")
JOBS = (1, 2, 4)
PICTURES = (".mp4", ".gif", ".apng", ".mkv", ".webm", ".png")  # of which the decoded frames are promised
STABLE = (".mkv", ".webm", ".png")  # of which the bytes are promised too, by the same command, which they hold
BYTES = ", the bytes"
# What says when, where and how long; and how many processes did the work, which changes nothing else.
VOLATILE = {"command", "wall", "path", "files", "created", "seconds", "file", "jobs", "output", "films", "document"}
GERMAN = "de_DE.UTF-8"  # a comma in numbers, wherever a locale decides

Made = dict[str, str]  # the digest of each file, and of standard output


def run(quick: bool) -> Tally:
    tally = Tally()
    with tempfile.TemporaryDirectory() as scratch, CommandServer(LIMIT) as server:
        folder = furnish(Path(scratch, "first"))
        other = furnish(Path(scratch, "another folder", "ünd deeper"))
        environments = _environments(Path(scratch), tally)
        for making in MAKINGS:
            if not quick or making.name in QUICK:
                _try(server, making, folder, other, environments, tally, quick=quick)
    return tally


def _try(
    server: CommandServer,
    making: Making,
    folder: Path,
    other: Path,
    environments: Mapping[str, Mapping[str, str]],
    tally: Tally,
    *,
    quick: bool,
) -> None:
    expected = _made(server.run(*making.arguments(), folder=folder), folder)
    tally.expect(bool(expected), f"{making.name}: it failed, or made nothing")
    if not expected:
        return

    def same(found: Made | None, how: str, *, same_command: bool = True) -> None:
        found = found or {"its exit code": ""}
        names = [name for name in sorted({*expected, *found}) if same_command or not name.endswith(BYTES)]
        differing = [name for name in names if expected.get(name) != found.get(name)]
        tally.expect(not differing, f"{making.name}, {how}: {', '.join(differing[:5])} differ")

    if not quick or not making.has_jobs:
        same(_made(server.run(*making.arguments(), folder=folder), folder), "again")
        same(_made(server.run(*making.arguments(), folder=other), other), "in another folder")
    for jobs in JOBS if making.has_jobs else ():
        if jobs != 2 and not (quick and jobs > 1):
            same(
                _made(server.run(*making.arguments(jobs), folder=folder), folder),
                f"{jobs} processes",
                same_command=False,
            )
    for name, environment in {} if quick else environments.items():
        same(_made(_run_afresh(making, folder, environment), folder), name)


def _environments(scratch: Path, tally: Tally) -> dict[str, dict[str, str]]:
    """Variables that must change nothing, by what they are; `UMASK` stands for that of the process."""
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
        tally.left_out.append("a German locale: localedef cannot make it here")
    return found


def _run_afresh(making: Making, folder: Path, environment: Mapping[str, str]) -> Ended:
    """Runs a command line in an interpreter of its own, with the locale that the environment says for all of C."""
    start = "import locale, sys; locale.setlocale(locale.LC_ALL, ''); from mjrun.cli.main import run; "
    ended = subprocess.run(
        [sys.executable, "-c", start + "sys.exit(run(sys.argv[1:]))", *making.arguments()],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "120", "NO_COLOR": "1", **environment},
        umask=int(environment["UMASK"], 8),
        capture_output=True,
        timeout=LIMIT,
        check=False,
    )
    return Ended(tuple(making.arguments()), ended.returncode, ended.stdout, ended.stderr, 0)


def _made(ended: Ended, folder: Path) -> Made | None:
    """What a run has made, which is removed; None if it failed."""
    made: Made = {}
    if ended.arguments[:1] in (("info",), ("check",), ("schema",)) or b"time," in ended.stdout[:5]:
        made["standard output"] = _digest(ended.stdout.replace(str(folder).encode(), b""))
    paths = sorted(path for path in folder.iterdir() if path.name.split(".")[0] in ("out", "run", "touch"))
    for path in paths:
        if path.name == "run.yaml":
            continue
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file() and file.parent.name != PARTS:  # points are divided by measured seconds
                made[str(file.relative_to(folder))] = digest(file)
                if file.suffix in STABLE:
                    made[f"{file.relative_to(folder)}{BYTES}"] = _digest(file.read_bytes())
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
    return None if ended.code else made


def digest(path: Path) -> str:
    """Of what a file holds, as far as it is promised: less what says when and where it was made."""
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
        case suffix if suffix in PICTURES:
            return _frames_digest(path)
        case _:
            return _digest(path.read_bytes())


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items() if key not in VOLATILE}
    return [_plain(inner) for inner in value] if isinstance(value, list) else value


def _table_digest(path: Path) -> str:
    from pyarrow import feather, parquet

    table = parquet.read_table(path) if path.suffix == ".parquet" else feather.read_table(path)
    kept = [name for name in table.column_names if name != "wall"]
    return _digest(repr(kept).encode(), *(repr(table[name].to_pylist()).encode() for name in kept))


def _hdf5_digest(path: Path) -> str:
    import h5py

    parts: list[bytes] = []
    with h5py.File(path) as file:
        file.visititems(
            lambda name, item: parts.append(name.encode() + item[()].tobytes() if hasattr(item, "dtype") else b"")
        )
    return _digest(*parts)


def _frames_digest(path: Path) -> str:
    from imageio_ffmpeg import get_ffmpeg_exe

    command = [get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-f", "framemd5", "-"]
    return _digest(subprocess.run(command, capture_output=True, check=True).stdout)


def _digest(*parts: bytes) -> str:
    whole = hashlib.sha256()
    for part in parts:
        whole.update(part)
    return whole.hexdigest()


MEASURE = Measure(
    "determinism: twice, jobs 1/2/4, other folder, locale, time zone, hash seed, umask",
    "identical traces, tables, pixels and decoded frames",
    150,
    run,
)
