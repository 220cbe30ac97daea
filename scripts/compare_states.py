"""Compare what two checkouts of mjrun make: every command of README.md and docs/, and every scene's run document.

    python scripts/compare_states.py OLD NEW [--filter REGEX] [--small] [--jobs N] [--cache DIR]

Each checkout runs its own commands, with this interpreter. Videos and images are compared by their decoded frames,
tables and recordings by their values, and everything else by its bytes; manifests, embedded metadata, wall times and
parts of studies are left out. Prose (messages, and what `info`, `check`, `schema` and the like print) is listed where
it differs, but does not count. Exits with 1 when an output, an exit code or a command of OLD is different or missing in
NEW.
"""

import argparse
import difflib
import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from importlib.metadata import distributions
from itertools import zip_longest
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import yaml
from PIL import Image, ImageSequence

Parts = dict[str, str]  # what a file holds: the name of each part, and its digest

RENAMED = {"films": "videos", "stills": "images"}  # keys of documents, old to new
VOLATILE = re.compile(r"(\w+_)?wall")  # JSON keys of wall times
TOOK = re.compile(rb"( in|;) [\d.]+ s(, [\d.]+ frames/s)?(?=$|, by )")  # in the sentence about a result
SLOW = re.compile(rb" ms per frame|: \d+ of \d+ (frames|points|episodes)$")  # messages about what takes long
PARTS = "parts"  # the folder of a study's results as they came, which its tables hold in order
SHOWN = 6  # differences of one command that are listed
LINE = 110  # characters shown of a line

SIZE, FPS, DURATION = "160x120", 10, 1  # of --small


@dataclass(frozen=True)
class Command:
    """A line of shell, and which of its results count."""

    text: str

    @property
    def timed(self) -> bool:
        """True if it reports on this machine, so that only its exit code and the names of its files repeat."""
        return self.text.startswith(("mjrun bench", "mjrun doctor"))

    @property
    def prose(self) -> bool:
        """True if it prints information, whose wording may change."""
        return bool(re.match(r"mjrun (info|check|schema)\b|.* --(list|dry-run)\b", self.text))

    @property
    def label(self) -> str:
        """The command in one line."""
        return " ".join(self.text.split())


@dataclass(frozen=True)
class Run:
    """The outputs of a command: `folder` has its files in `files/`, its `stdout` and its `stderr`."""

    folder: Path
    exit: int
    seconds: float


@dataclass
class Comparison:
    """A command of the old state beside its counterpart: where outputs differ, and where only prose does."""

    old: Command
    new: Command
    differences: list[str] = field(default_factory=list)
    prose: list[str] = field(default_factory=list)


# What files hold


def contents(path: Path) -> Parts:
    """Returns the parts of a file that must be equal in two states; its bytes if it cannot be read."""
    try:
        return READERS.get(path.suffix.lower(), _bytes)(path)
    except Exception as error:  # a damaged output is a result too
        return {"unreadable": f"{type(error).__name__}", **_bytes(path)}


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _bytes(path: Path) -> Parts:
    return {"bytes": _digest(path.read_bytes())}


def _video(path: Path) -> Parts:
    """Returns each decoded frame in its pixel format, with its time stamps, and the stream's header."""
    ffmpeg = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-map", "0", "-f", "framemd5", "-"]
    lines = subprocess.run(ffmpeg, capture_output=True, text=True, check=True).stdout.splitlines()
    frames = [line for line in lines if not line.startswith("#")]
    header = [line for line in lines if line.startswith("#") and "#software" not in line]
    return {"header": "\n".join(header), **{f"frame {i}": line for i, line in enumerate(frames)}}


def _image(path: Path) -> Parts:
    """Returns each stored frame: mode, size, pixels, palette, transparency, duration."""
    parts: Parts = {}
    with Image.open(path) as image:
        for i, frame in enumerate(ImageSequence.Iterator(image)):
            info = [frame.info.get(key) for key in ("transparency", "duration")]
            stored = (frame.mode, frame.size, frame.getpalette(), info)
            parts[f"frame {i}"] = _digest(repr(stored).encode() + frame.tobytes())
    return parts


def _arrays(arrays: Iterable[tuple[str, np.ndarray]]) -> Parts:
    """Returns each array's type, shape and bits; a single text is metadata."""
    return {
        name: f"{array.dtype} {array.shape} {_digest(np.ascontiguousarray(array).tobytes())}"
        for name, array in arrays
        if not (array.dtype.kind == "U" and array.ndim == 0)
    }


def _npy(path: Path) -> Parts:
    return _arrays([("array", np.load(path))])


def _npz(path: Path) -> Parts:
    with np.load(path) as file:
        return _arrays((name, file[name]) for name in file.files)


def _mat(path: Path) -> Parts:
    from scipy.io import loadmat, whosmat

    variables = loadmat(path, chars_as_strings=True)
    numeric = [(name, np.asarray(variables[name])) for name, _, kind in whosmat(path) if kind != "struct"]
    return _arrays((name, array) for name, array in numeric if array.dtype.kind not in "OU" or array.size > 1)


def _arrow(path: Path) -> Parts:
    """Returns each column's type and values, floats by their bits."""
    from pyarrow import feather, parquet

    table = (parquet.read_table if path.suffix == ".parquet" else feather.read_table)(path)
    columns = ((name, table[name].combine_chunks()) for name in table.column_names)
    arrays = {name: column.to_numpy(zero_copy_only=False) for name, column in columns}
    return {
        name: f"{table.schema.field(name).type} {_digest(repr(list(array)).encode())}"
        if array.dtype == object
        else f"{array.dtype} {_digest(array.tobytes())}"
        for name, array in arrays.items()
    }


def _json(path: Path) -> Parts:
    """Returns each key's value without wall times; for a manifest or a benchmark, only its kind."""
    document = json.loads(path.read_text("utf-8"))
    if isinstance(document, dict) and {"mjrun", "machine"} & set(document):
        return {"kind": "manifest"}
    if not isinstance(document, dict):
        document = {"document": document}
    return {key: json.dumps(_lasting(value)) for key, value in document.items() if not VOLATILE.fullmatch(key)}


def _lasting(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _lasting(entry) for key, entry in value.items() if not VOLATILE.fullmatch(key)}
    return [_lasting(entry) for entry in value] if isinstance(value, list) else value


def _yaml(path: Path) -> Parts:
    """Returns a document by its keys, under their new names."""
    document = yaml.safe_load(path.read_text("utf-8"))
    return {_renamed(key): json.dumps(value, sort_keys=True) for key, value in document.items()}


READERS: dict[str, Callable[[Path], Parts]] = {
    **dict.fromkeys((".mp4", ".mkv", ".webm", ".mov", ".exr"), _video),
    **dict.fromkeys((".png", ".jpg", ".webp", ".gif", ".apng", ".tiff"), _image),
    **dict.fromkeys((".parquet", ".feather"), _arrow),
    ".npy": _npy,
    ".npz": _npz,
    ".mat": _mat,
    ".json": _json,
    ".yaml": _yaml,
}


# Comparing


def difference(old: Path, new: Path) -> str:
    """Returns the difference of two files in a few words; empty if there is none."""
    before, after = contents(old), contents(new)
    different = [name for name in {**before, **after} if before.get(name) != after.get(name)]
    if not different:
        return "" if list(before) == list(after) else "the order of its parts differs"
    return f"{len(different)} of {len({**before, **after})} parts differ, first: {different[0]}"


def compare(old: Run, new: Run, comparison: Comparison) -> None:
    """Adds the differences of two runs to `comparison`."""
    command, differences = comparison.old, comparison.differences
    if old.exit != new.exit:
        differences.append(f"exit code {old.exit}, now {new.exit}")
    for before, after in _paired_files(old.folder / "files", new.folder / "files", comparison):
        text = "" if command.timed else difference(before, after)
        if text:
            where = comparison.prose if command.prose else differences
            where.append(f"{after.relative_to(new.folder / 'files')}: {text}")
    if not command.timed:
        (payload, prose), (new_payload, new_prose) = (_printed(run, command) for run in (old, new))
        differences += [f"stdout: {line}" for line in _first_difference(payload, new_payload)]
        comparison.prose += _first_difference(prose, new_prose)


def _paired_files(old: Path, new: Path, comparison: Comparison) -> Iterator[tuple[Path, Path]]:
    """Files of one name, and renamed ones; those without a counterpart are added to the differences."""
    before, after = ({str(path.relative_to(root)): path for path in _files(root)} for root in (old, new))
    for name in [name for name in before if name in after]:
        yield before.pop(name), after.pop(name)
    for name in list(before):
        renamed = next((other for other in after if Path(other).suffix == Path(name).suffix), None)
        if renamed and comparison.old.text != comparison.new.text:
            comparison.prose.append(f"{name} is now called {renamed}")
            yield before.pop(name), after.pop(renamed)
    comparison.differences += [f"{name} is missing" for name in before] + [f"{name} is new" for name in after]


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file() and PARTS not in path.relative_to(folder).parts)


def _printed(run: Run, command: Command) -> tuple[list[bytes], list[bytes]]:
    """Returns the lines of standard output that are a payload, and all prose, without wall times."""
    lines = (run.folder / "stdout").read_bytes().splitlines()
    prose = [line for line in lines if command.prose or TOOK.search(line)]
    messages = [line for line in (run.folder / "stderr").read_bytes().splitlines() if not SLOW.search(line)]
    return [line for line in lines if line not in prose], [TOOK.sub(b"", line) for line in prose + messages]


def _first_difference(old: list[bytes], new: list[bytes]) -> list[str]:
    """Returns the first line in which two texts differ, before and after; nothing if they are equal."""
    if old == new:
        return []
    lines = next((b, a) for b, a in zip_longest(old, new, fillvalue=b"(nothing)") if b != a)
    texts = [line.decode("utf-8", "replace") for line in lines]
    start = max(0, next((i for i, (b, a) in enumerate(zip(*texts, strict=False)) if b != a), 0) - LINE // 2)
    return [" → ".join(text[start : start + LINE] for text in texts)]


# Commands


def commands(checkout: Path, small: bool) -> tuple[list[Command], list[str]]:
    """Returns the commands that a checkout is compared by, and those of its pages that are left out."""
    pages = [checkout / "README.md", *sorted((checkout / "docs").glob("*.md"))]
    text = "\n".join(page.read_text("utf-8") for page in pages)
    shell = "".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).replace("\\\n", " ")
    lines = [line for line in shell.splitlines() if line.strip()]
    left_out = [line for line in lines if line.startswith(("make ", "pip "))]
    programs = [_shrunk(code) if small else code for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL)]
    texts = [line for line in lines if line not in left_out]
    texts += [f"python -W ignore -c {shlex.quote(code)}" for code in programs]
    texts += [f"mjrun run scenes/{path.name} -o out" for path in sorted((checkout / "scenes").glob("*.yaml"))]
    return [Command(text) for text in dict.fromkeys(texts)], left_out


def _shrunk(code: str) -> str:
    code = re.sub(r"\b(at|time)=[\d.]+", rf"\1={DURATION / 2}", code)
    code = re.sub(r"\bduration=[\d.]+", f"duration={DURATION}", code)
    return re.sub(r"(mjrun\.(?:Video|Image)\((?!.*size).*)\)\.run", rf"\1, size=({SIZE.replace('x', ', ')})).run", code)


def pair(old: list[Command], new: list[Command]) -> tuple[list[Comparison], list[Command], list[Command]]:
    """Commands beside their counterparts, equal or alike in text; and those that only one side has."""
    rest = list(new)
    alike: dict[int, Command] = {}
    for cutoff in (1.0, 0.75):
        for i, command in enumerate(old):
            names = {_renamed(other.text): other for other in reversed(rest)}
            matches = difflib.get_close_matches(_renamed(command.text), names, n=1, cutoff=cutoff)
            if i not in alike and matches:
                alike[i] = names[matches[0]]
                rest.remove(alike[i])
    missing = [command for i, command in enumerate(old) if i not in alike]
    return [Comparison(old[i], alike[i]) for i in sorted(alike)], missing, rest


def _renamed(text: str) -> str:
    for old, new in RENAMED.items():
        text = re.sub(rf"\b{old}\b", new, text)
    return text


# Running


@dataclass(frozen=True)
class State:
    """A checkout whose commands are run, one at a time, in the same working folder as the other's."""

    checkout: Path
    store: Path
    small: bool
    jobs: str = "1"

    def run(self, command: Command, cached: bool = False) -> Run:
        """Runs a command, or returns the outputs of an earlier run."""
        folder = self.store / _digest(command.text.encode())[:16]
        outcome = folder / "outcome.json"
        if not (cached and outcome.exists()):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            outcome.write_text(json.dumps({"command": command.text, **self._execute(command, folder)}))
        result = json.loads(outcome.read_text())
        return Run(folder, result["exit"], result["seconds"])

    def fingerprint(self) -> str:
        """Returns a hash of everything that outputs depend on: code, scenes, installed libraries, changed commands."""
        sources = [*_files(self.checkout / "scenes"), *sorted((self.checkout / "mjrun").rglob("*.py"))]
        libraries = sorted(f"{each.name} {each.version}" for each in distributions() if each.name != "mjrun")
        return _digest(repr(([_bytes(path) for path in sources], libraries, self._programs())).encode())[:16]

    def _execute(self, command: Command, folder: Path) -> dict[str, float]:
        with tempfile.TemporaryDirectory() as temporary:
            work = Path(temporary) / "work"
            shutil.copytree(self.checkout / "scenes", work / "scenes")
            shell = ["sh", "-ec", command.text]
            start = time.monotonic()
            with (folder / "stdout").open("wb") as stdout, (folder / "stderr").open("wb") as stderr:
                environment = self._installed(Path(temporary) / "bin")
                done = subprocess.run(shell, cwd=work, env=environment, stdout=stdout, stderr=stderr)
            seconds = time.monotonic() - start
            shutil.rmtree(work / "scenes")
            shutil.move(work, folder / "files")
        return {"exit": done.returncode, "seconds": round(seconds, 1)}

    def _installed(self, folder: Path) -> dict[str, str]:
        """Returns an environment in which `mjrun` and `python` are the checkout's, made in `folder`."""
        folder.mkdir()
        for name, script in self._programs().items():
            (folder / name).write_text(script)
            (folder / name).chmod(0o755)
        return {**os.environ, "PYTHONPATH": str(self.checkout), "PATH": f"{folder}:{os.environ['PATH']}"}

    def _programs(self) -> dict[str, str]:
        # How busy the machine is decides neither a comparison with a baseline nor the number of drawing processes.
        more = {"bench": '$(case "$*" in *--fail-above*) echo "--fail-above 100000%";; esac)'}
        more |= dict.fromkeys(("video", "run"), f"--jobs {self.jobs}")
        if self.small:
            more["bench"] += " --budget 0.2"
            more["video"] += f" --size {SIZE} --fps {FPS} --duration {DURATION}"
            more["run"] += f" {self._small_document()}"
            more["image"] = f"--size {SIZE}"
        cases = " ".join(f'{name}) set -- "$@" {options};;' for name, options in more.items())
        python = f'exec "{sys.executable}"'
        return {
            "python": f'#!/bin/sh\n{python} "$@"\n',
            "mjrun": f'#!/bin/sh\ncase $1 in {cases} esac\n{python} -m mjrun "$@"\n',
        }

    def _small_document(self) -> str:
        """Assignments that make what a scene's document draws small, by the keys that this state has."""
        documents = "".join(path.read_text("utf-8") for path in (self.checkout / "scenes").glob("*.yaml"))
        old = re.search(r"^films:", documents, re.MULTILINE)
        videos, images = RENAMED if old else RENAMED.values()
        return f"{videos}[0].size={SIZE} {videos}[0].fps={FPS / 2} {images}[0].size={SIZE}"


# The report


def report(comparison: Comparison, old: Run, new: Run) -> str:
    """Prints a command's line of the table, with its differences below; returns its verdict."""
    verdict = "DIFFERS" if comparison.differences else "prose" if comparison.prose else "equal"
    print(f"{verdict:8}{old.exit:5}{old.seconds:8.1f}{new.seconds:8.1f}  {comparison.new.label[:LINE]}")
    if comparison.old.text != comparison.new.text:
        print(f"{'':31}was: {comparison.old.label[:LINE]}")
    for lines, title in ((comparison.differences, "DIFFERS"), (comparison.prose, "prose")):
        print("".join(f"{'':31}{title}: {line}\n" for line in lines[:SHOWN]), end="")
        if len(lines) > SHOWN:
            print(f"{'':31}… and {len(lines) - SHOWN} more")
    sys.stdout.flush()
    return verdict


def main() -> int:
    """Runs the comparison that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path, help="a checkout")
    parser.add_argument("new", type=Path, help="a checkout that is to make the same")
    parser.add_argument("--filter", default="", metavar="REGEX", help="run only commands in which this is found")
    parser.add_argument(
        "--small", action="store_true", help=f"draw at {SIZE} and {FPS} fps, and {DURATION} s of each video"
    )
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keep all outputs here, and run OLD only once")
    parser.add_argument("--jobs", default="1", metavar="N", help="let mjrun draw with so many processes [default: 1]")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        store = (options.cache or Path(temporary)).resolve()
        old, new = (State(path.resolve(), store, options.small, options.jobs) for path in (options.old, options.new))
        old = replace(old, store=store / f"old-{old.fingerprint()}")
        return _compare_states(old, replace(new, store=store / "new"), options.filter)


def _compare_states(old: State, new: State, pattern: str) -> int:
    (old_commands, _), (new_commands, left_out) = (commands(state.checkout, state.small) for state in (old, new))
    pairs, missing, added = pair(old_commands, new_commands)
    verdicts: Counter[str] = Counter()
    print(f"{'':8}{'exit':>5}{'old, s':>8}{'new, s':>8}")
    for comparison in pairs:
        if re.search(pattern, comparison.new.text):
            runs = old.run(comparison.old, cached=True), new.run(comparison.new)
            compare(*runs, comparison)
            verdicts[report(comparison, *runs)] += 1
    for title, texts in (("Only in OLD", missing), ("Only in NEW", added)):
        print("".join(f"{title}: {command.label[:LINE]}\n" for command in texts), end="")
    print(f"Not run: {', '.join(left_out)}")
    print(", ".join(f"{count} {verdict}" for verdict, count in verdicts.items()), f"and {len(missing)} missing")
    return 1 if verdicts["DIFFERS"] or missing else 0


if __name__ == "__main__":
    sys.exit(main())
