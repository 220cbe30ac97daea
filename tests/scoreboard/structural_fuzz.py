"""Mutated models, documents, tables and expressions: the result is success or one of our errors.

Cases are numbered, and the number is the seed: a case that fails occurs again in the next run. Cases that once failed
are kept, as small as possible, as CRASHERS.
"""

import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path

from tests.scoreboard import mutations
from tests.scoreboard.command import QUICK_IMPORTS, CommandServer, modules_of_mjrun
from tests.scoreboard.data import inputs_of
from tests.scoreboard.every_model import SCENES, SHARED
from tests.scoreboard.measure import Tally, measured, side_by_side

LIMIT = 120.0  # [s] of one run on a busy machine
MEMORY = 6144  # [MiB] of addresses
COUNTS = {"model": 900, "document": 900, "table": 420, "expression": 500}
QUICK = {"model": 4, "document": 4, "table": 0, "expression": 4}
LIBRARIES = ("matplotlib.backends.backend_svg", "h5py", "scipy.io", "pyarrow.feather", "pyarrow.csv")
FORMATS = ("csv", "jsonl", "npz", "parquet", "feather", "h5", "mat")
DONE, READ = frozenset({0, 1, 2, 3, 4, 7, 8}), frozenset({0, 3})

INPUTS = inputs_of(__name__)
PENDULUM = INPUTS["PENDULUM"]
RUN = INPUTS["RUN"]
FIT = INPUTS["FIT"]
DATA = "t,angle,torque\n" + "".join(f"{i / 50},{i * i / 30},{i % 3 / 10}\n" for i in range(30))


@dataclass(frozen=True)
class _Case:
    """One run: a file to write first, the command line, and its exit codes."""

    name: str
    file: str
    content: str | bytes
    arguments: Sequence[str]
    codes: Collection[int] = DONE


@measured("structural fuzz", "0 exceptions of other classes than ours: no 70, traceback, signal or hang", 2500)
def structural_fuzz(quick: bool) -> Tally:
    """Tries all cases with two servers that work at once; quickly, a few cases."""
    tally = Tally()
    counts = QUICK if quick else COUNTS
    turns = range(1 if quick else 2)
    if not quick and not SHARED.is_dir():
        tally.leave_out("mutations of the models of ../shared/models: the folder is not here")
    for ended, faults in side_by_side(partial(_try_all, counts, len(turns)), turns):
        tally.expect(not faults, f"{ended}: {'; '.join(faults)}")
    return tally


def _try_all(counts: dict[str, int], turns: int, turn: int) -> Iterator[tuple[str, list[str]]]:
    imports = (*modules_of_mjrun(), *LIBRARIES) if counts is COUNTS else QUICK_IMPORTS
    with CommandServer(LIMIT, MEMORY, imports) as server, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _prepare(folder, server, with_tables=counts["table"] > 0)
        crashers = (_Case(f"crasher {i}", *crasher) for i, crasher in enumerate(INPUTS["CRASHERS"]))
        cases = chain(crashers, *(KINDS[kind](folder, count) for kind, count in counts.items()))
        for i, case in enumerate(cases):
            if i % turns == turn:
                if case.file:
                    text = case.content
                    content = text.encode("utf-8", "surrogateescape") if isinstance(text, str) else text
                    (folder / case.file).write_bytes(content)
                ended = server.run(*case.arguments, folder=folder)
                shutil.rmtree(folder / "out", ignore_errors=True)
                yield f"{case.name}: {ended}", ended.faults_unless(case.codes)


def _prepare(folder: Path, server: CommandServer, with_tables: bool) -> None:
    """Writes the inputs of the cases: scenes, a pendulum, and tables of it."""
    for path in SCENES.iterdir():
        if path.name not in ("pendulum.xml", "schema"):
            (folder / path.name).symlink_to(path)
    (folder / "pendulum.xml").write_text(PENDULUM)
    (folder / "data.csv").write_text(DATA)
    if with_tables:
        for suffix in FORMATS:
            server.run("trace", "pendulum.xml", "--steps", "8", "-o", f"sound.{suffix}", folder=folder)


def _models(folder: Path, count: int) -> Iterator[_Case]:
    paths = sorted(SCENES.glob("*.xml")) + (sorted(SHARED.rglob("*.xml")) if SHARED.is_dir() and count > 99 else [])
    # A mutation is written to another folder, so its model must need no other file.
    sources = [text for text in mutations.texts(paths) if "file=" not in text and len(text) < 40_000]
    for seed in range(count):
        commands: Sequence[tuple[Sequence[str], frozenset[int]]] = (
            (("info", "model.xml", "bodies", "joints", "actuators", "keyframes"), READ),
            (("trace", "model.xml", "--steps", "3"), READ | {4}),
            (
                ("trace", "model.xml", "--steps", "3", "-o", "trace.npz", "--contacts", "contacts.csv"),
                READ | {4},
            ),
        )
        arguments, codes = commands[seed % 3]
        yield _Case(f"model {seed}", "model.xml", mutations.mjcf(seed, sources), arguments, codes)


def _documents(folder: Path, count: int) -> Iterator[_Case]:
    runs = [*mutations.texts([p for p in sorted(SCENES.glob("*.yaml")) if "videos:" in p.read_text()]), RUN]
    studies = mutations.texts(sorted((SCENES / "studies").glob("*.yaml")))
    studies = [text.replace("../", "") for text in studies]
    tasks = [text for text in mutations.texts(sorted(SCENES.glob("*.yaml"))) if "rewards:" in text]
    cameras = mutations.texts(sorted((SCENES / "cameras").glob("*.yaml")))
    kinds: Sequence[tuple[Sequence[str], Sequence[str]]] = (
        (runs, ("run", "fuzz.yaml", "--dry-run")),
        (runs, ("run", "fuzz.yaml", "--dry-run", "--json")),
        (studies, ("sweep", "fuzz.yaml", "--dry-run")),
        (tasks, ("info", "fuzz.yaml", "observations", "actions", "rewards")),
        ([RUN], ("run", "fuzz.yaml", "-o", "out")),
        (cameras, ("video", "pendulum.xml", "--steps", "3", "--camera", "fuzz.yaml", "--print-document")),
        (studies, ("sweep", "fuzz.yaml", "--print-document")),
    )
    for seed in range(count):
        sources, arguments = kinds[seed % len(kinds)]
        if seed % 20 == 19:
            sources, arguments = [FIT], ("fit", "fuzz.yaml", "-o", "fitted.xml")
        elif seed % 20 == 9:
            sources, arguments = tasks, ("eval", "fuzz.yaml", "--policy", "zero", "--episodes", "1", "-o", "out")
        yield _Case(f"document {seed}", "fuzz.yaml", mutations.document(seed, sources), arguments)


def _tables(folder: Path, count: int) -> Iterator[_Case]:
    for seed in range(count):
        suffix = FORMATS[seed % len(FORMATS)]
        file = f"fuzz.{suffix}"
        content = mutations.data(seed, [(folder / f"sound.{suffix}").read_bytes()])
        commands: Sequence[Sequence[str]] = (
            ("diff", file, "sound.csv"),
            ("trace", "pendulum.xml", "--steps", "3", "--ctrl-from", file, "-o", "trace.csv"),
            ("plot", file, "-o", "plot.svg"),
            ("trace", "pendulum.xml", "--steps", "3", "--golden", file),
            ("diff", "sound.npz", file, "--columns", "qpos/*"),
        )
        yield _Case(f"table {seed}", file, content, commands[seed % len(commands)])


def _expressions(folder: Path, count: int) -> Iterator[_Case]:
    trace = ("trace", "pendulum.xml", "--steps", "2")
    for seed in range(count):
        text = mutations.expression(seed)
        commands: Sequence[Sequence[str]] = (
            (*trace, "--assert", text),
            (*trace, "--probe", text),
            (*trace, "--set", f"geom/rod.size={text}"),
            (*trace, "--qpos", f"hinge={text}"),
            ("sweep", "pendulum.xml", "--vary", f"opt.timestep={text}", "--metric", f"m={text}", "--dry-run"),
            ("video", "pendulum.xml", "--steps", "3", "--camera", f"orbit:distance={text}", "--print-document"),
        )
        yield _Case(f"expression {seed}", "", "", commands[seed % len(commands)])


KINDS: dict[str, Callable[[Path, int], Iterator[_Case]]] = {
    "model": _models,
    "document": _documents,
    "table": _tables,
    "expression": _expressions,
}
