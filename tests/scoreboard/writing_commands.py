"""Commands that write, each with an older version of what it makes, and what an undisturbed run of it leaves."""

import io
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tests.scoreboard.command import CommandServer
from tests.scoreboard.data import inputs_of

INPUTS = inputs_of(__name__)
MODEL = INPUTS["MODEL"]
RUN = INPUTS["RUN"]
TASK = INPUTS["TASK"]
STUDY = "sweep ../inputs/model.xml --vary qpos/hinge=0..1:4 --metric peak=max(qvel/hinge) --duration 0.1 --chunk 2"
SWEEP = f"{STUDY} --jobs 1"
FIT = (
    "fit ../inputs/model.xml ../inputs/a.csv --free joint/hinge.damping=0.01..1 --starts 1"
    " -o x.xml --html x.html --ranges ranges.yaml --comparison x.csv"
)
EXCITE = (
    "fit ../inputs/model.xml --set actuator/motor.ctrlrange=-1,1 --free joint/hinge.damping=0.01..1 --duration 1"
    " --excite x.csv"
)
EVAL, PLOT = "eval ../inputs/task.yaml --policy zero --episodes 2 --jobs 1 -o e", "plot ../inputs/a.csv"
DRAW, OTHER, DAMPED = "--size 32x24", "--qpos hinge=0.5", "--set joint/hinge.damping=0.3"
TRACE, IMAGE = "trace ../inputs/model.xml --duration 0.1", f"image ../inputs/model.xml {DRAW}"
VIDEO = f"video ../inputs/model.xml {DRAW} --duration 0.2 --fps 20"
LIMIT = 240.0  # [s], far more than any of them takes on a busy machine
QUICK, QUICK_IMPORTS = ("contacts",), ("orjson", "mjrun.outputs.perform", "mjrun.outputs.trace")
IMPORTS = (  # what they import, once for all
    *("pyarrow.parquet", "orjson", "h5py", "scipy.io", "scipy.optimize", "yaml", "PIL.Image", "rich.console"),
    *("matplotlib.figure", "matplotlib.backends.backend_agg", "imageio_ffmpeg"),
    *(
        "mjrun.outputs.perform",
        "mjrun.outputs.trace",
        "mjrun.outputs.image",
        "mjrun.outputs.video",
        "mjrun.outputs.plot",
        "mjrun.outputs.diff",
    ),
    *("mjrun.study.study", "mjrun.evaluation.evaluation", "mjrun.fit.fit", "mjrun.document.run"),
)
TEXT = (".json", ".jsonl", ".csv", ".html", ".svg", ".xml", ".yaml", ".md")


@dataclass(frozen=True)
class Command:
    """A command line, run in a folder `out` beside `inputs`.

    Attributes:
      other: more arguments, for an older version of its outputs.
      draws, slow: whether it renders, or takes seconds; of such commands fewer cases are tried.
      whole: folders whose files are replaced together.
      in_steps: whether what it makes before it fails stays: a study is continued.
      first: command lines to run before it.
    """

    name: str
    line: str
    other: str = OTHER
    draws: bool = False
    slow: bool = False
    whole: tuple[str, ...] = ()
    in_steps: bool = False
    first: tuple[str, ...] = ()

    @property
    def pace(self) -> int:
        """0, 1 or 2, how long it takes."""
        return 2 if self.slow else int(self.draws)

    @property
    def arguments(self) -> list[str]:
        return self.line.split()


COMMANDS = (
    *(Command(suffix, f"{TRACE} -o x.{suffix}") for suffix in ("csv", "jsonl", "npz", "parquet", "mat", "h5")),
    Command("contacts", f"{TRACE} -o x.csv --contacts contacts.csv"),
    Command("manifest", f"{TRACE} -o x.csv --contacts contacts.npz --manifest m.json"),
    Command("recording", f"{TRACE} -o x.csv --recording r.npz"),
    Command("keyframe", f"{TRACE} -o x.csv --save-key ../out/key.xml:swung"),
    *(Command(suffix, f"{IMAGE} -o x.{suffix}", draws=True) for suffix in ("png", "jpg")),
    *(Command(f"depth {suffix}", f"{IMAGE} --view depth -o x.{suffix}", draws=True) for suffix in ("exr", "npy")),
    Command("labels", f"{IMAGE} --view seg -o x.png", draws=True),
    Command("coco", f"{IMAGE} --view seg -o x.json", draws=True),
    Command("calibration", f"{IMAGE} -o x.png --calibration c.json --manifest m.json", draws=True),
    Command("point cloud", f"{IMAGE} -o x.png --pointcloud x.ply", draws=True),
    Command("separate", f"{IMAGE} --view rgb --view depth --separate -o x.png", draws=True),
    *(Command(suffix, f"{VIDEO} -o x.{suffix}", draws=True) for suffix in ("mp4", "webm", "gif", "apng", "mkv")),
    Command("folder", f"{VIDEO} -o frames/", draws=True, whole=("frames",)),
    Command("pattern", f"{VIDEO} -o f_%04d.png --manifest m.json", draws=True),
    Command("run", "run ../inputs/run.yaml -o .", "ctrl.motor=0.5", draws=True),
    Command("run page", "run ../inputs/run.yaml -o . --html run.html", "ctrl.motor=0.5", draws=True, slow=True),
    Command("sweep", f"{SWEEP} -o s", DAMPED, slow=True, in_steps=True),
    Command("sweep keep", f"{SWEEP} -o s --keep trace", DAMPED, slow=True, in_steps=True),
    Command("plan", f"{STUDY} -o s --plan plan.jsonl", DAMPED),
    Command(
        "task", "sweep plan.jsonl --task 1/1", "", slow=True, in_steps=True, first=(f"{STUDY} -o s --plan plan.jsonl",)
    ),
    Command(
        "collect",
        "sweep plan.jsonl --collect",
        "",
        slow=True,
        in_steps=True,
        first=(f"{STUDY} -o s --plan plan.jsonl", "sweep plan.jsonl --task 1/1"),
    ),
    Command("fit", FIT, "--confidence 0.9", slow=True),
    Command("excite", EXCITE, "--duration 2", slow=True),
    Command("eval", EVAL, "--seed 5", slow=True),
    Command("eval films", f"{EVAL} --films 1 {DRAW}", "--seed 5", draws=True, slow=True),
    *(
        Command(f"plot {suffix}", f"{PLOT} -o p.{suffix}", "--title older", draws=True)
        for suffix in ("png", "svg", "pdf")
    ),
    Command("plot page", f"{PLOT} --html p.html -o p.png", "--title older", draws=True),
    Command("diff", "diff ../inputs/a.png ../inputs/b.png -o worst.png", "--max-changed 1%", draws=True),
    Command("golden", "diff --golden golden.csv ../inputs/model.xml --duration 0.1 --update"),
    Command(
        "bench",
        "bench ../inputs/model.xml --budget 0.1 --repeats 2 --threads 1 --save base.json",
        "--repeats 3",
        draws=True,
    ),
)


def command_server(quick: bool) -> CommandServer:
    """What runs them. `quick` imports only what those commands need."""
    return CommandServer(LIMIT, imports=QUICK_IMPORTS if quick else IMPORTS)


def make_inputs(folder: Path, server: CommandServer, *, draw: bool = True) -> None:
    """Writes what the commands read.

    Raises:
      RuntimeError: mjrun could not make it.
    """
    folder.mkdir()
    (folder / "model.xml").write_text(MODEL)
    (folder / "run.yaml").write_text(RUN)
    (folder / "task.yaml").write_text(TASK)
    lines = ["trace model.xml --duration 1 --ctrl motor=0.3 --every 2 --probe qpos,qvel,ctrl -o a.csv"]
    if draw:
        lines += [f"image model.xml {DRAW} -o a.png", f"image model.xml {DRAW} {OTHER} -o b.png"]
    for line in lines:
        ended = server.run(*line.split(), folder=folder)
        if ended.code:
            raise RuntimeError(str(ended))


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder, by their path in it."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@dataclass(frozen=True)
class Reference:
    """What undisturbed runs leave: the same twice, to see what depends on the wall clock."""

    first: Mapping[str, bytes]
    second: Mapping[str, bytes]

    def holds(self, name: str, content: bytes) -> bool:
        """Whether a file is as these runs have left it."""
        if name not in self.first:
            return False
        first, second = self.first[name], self.second[name]
        return content == first or (first != second and _agree(name, content, first, second))


def run_first(command: Command, out: Path, server: CommandServer) -> None:
    """A new folder with what has to be there before a command.

    Raises:
      RuntimeError: it failed.
    """
    new_folder(out)
    for line in command.first:
        ended = server.run(*line.split(), folder=out)
        if ended.code:
            raise RuntimeError(str(ended))


def new_folder(path: Path) -> Path:
    """An empty folder in the place of what was there."""
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir()
    return path


def _agree(name: str, content: bytes, first: bytes, second: bytes) -> bool:
    """Whether a file agrees with two of the same command wherever these agree with each other."""
    if name.endswith(".parquet"):
        return _same_columns(content, first, second)
    if name.endswith("base.json"):
        return _is_baseline(content, first)
    if not name.endswith(TEXT):
        return False
    lines, one, other = content.splitlines(), first.splitlines(), second.splitlines()
    if len({len(lines), len(one), len(other)}) > 1:
        return False
    return all(a == b for a, b, c in zip(lines, one, other, strict=True) if b == c)


def _is_baseline(content: bytes, other: bytes) -> bool:
    """Whether a file holds timings of what another one does: it is as long in all but its numbers."""
    texts = [re.sub(rb"-?\d+(\.\d+)?(e[-+]?\d+)?", b"0", each) for each in (content, other)]
    return texts[0] == texts[1]


def _same_columns(content: bytes, first: bytes, second: bytes) -> bool:
    import pyarrow
    import pyarrow.parquet

    try:
        table, one, other = (pyarrow.parquet.read_table(io.BytesIO(each)) for each in (content, first, second))
    except pyarrow.ArrowException:
        return False
    if not table.column_names == one.column_names == other.column_names:
        return False
    return all(table[name].equals(one[name]) for name in one.column_names if one[name].equals(other[name]))
