"""Commands that write, each with an older version of its outputs, and the files of an undisturbed run."""

import io
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pyarrow
from pyarrow import parquet

from tests.scoreboard.command import QUICK_IMPORTS, CommandServer
from tests.scoreboard.data import inputs_of

INPUTS = inputs_of(__name__)
DRAW, OTHER = "--size 32x24", "--qpos hinge=0.5"
LIMIT = 240.0  # [s], far more than any of them takes on a busy machine
QUICK = ("contacts",)
TEXT = (".json", ".jsonl", ".csv", ".html", ".svg", ".xml", ".yaml", ".md")


@dataclass(frozen=True)
class Command:
    """A command line, run in a folder `out` beside `inputs`.

    Attributes:
      name: its name in the list of failures.
      line: the command line after `mjrun`.
      other: more arguments, for an older version of its outputs.
      draws: true if it renders.
      slow: true if it takes seconds; of slow commands and those that render fewer cases are tried.
      whole: folders whose files are replaced together.
      in_steps: true if the outputs before a failure stay, since the same command continues from them.
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
        """Its duration: 0 short, 1 longer, 2 seconds."""
        return 2 if self.slow else int(self.draws)

    @property
    def arguments(self) -> list[str]:
        return self.line.split()


COMMANDS = tuple(Command(name, **settings) for name, settings in INPUTS["COMMANDS"].items())


def command_server(quick: bool) -> CommandServer:
    """Returns the server that runs the commands; `quick` imports only the modules of the quick ones."""
    return CommandServer(LIMIT, imports=QUICK_IMPORTS if quick else INPUTS["IMPORTS"])


def make_inputs(folder: Path, server: CommandServer, *, draw: bool = True) -> None:
    """Writes the files that the commands read.

    Raises:
      RuntimeError: mjrun could not make it.
    """
    folder.mkdir()
    (folder / "model.xml").write_text(INPUTS["MODEL"])
    (folder / "run.yaml").write_text(INPUTS["RUN"])
    (folder / "task.yaml").write_text(INPUTS["TASK"])
    lines = ["trace model.xml --duration 1 --ctrl motor=0.3 --every 2 --probe qpos,qvel,ctrl -o a.csv"]
    if draw:
        lines += [f"image model.xml {DRAW} -o a.png", f"image model.xml {DRAW} {OTHER} -o b.png"]
    for line in lines:
        ended = server.run(*line.split(), folder=folder)
        if ended.code:
            raise RuntimeError(str(ended))


@dataclass(frozen=True)
class Reference:
    """The files of two undisturbed runs, which differ where they depend on the wall clock."""

    first: Mapping[str, bytes]
    second: Mapping[str, bytes]

    def holds(self, name: str, content: bytes) -> bool:
        """Tells whether a file is the same as after these runs."""
        if name not in self.first:
            return False
        first, second = self.first[name], self.second[name]
        return content == first or (first != second and _agree(name, content, first, second))


def run_first(command: Command, out: Path, server: CommandServer) -> None:
    """Makes a new folder with the files that must exist before a command.

    Raises:
      RuntimeError: it failed.
    """
    new_folder(out)
    for line in command.first:
        ended = server.run(*line.split(), folder=out)
        if ended.code:
            raise RuntimeError(str(ended))


def new_folder(path: Path) -> Path:
    """Makes an empty folder, replacing an older one."""
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir()
    return path


def _agree(name: str, content: bytes, first: bytes, second: bytes) -> bool:
    """Tells whether a file agrees with two of the same command wherever these agree with each other."""
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
    """Tells whether two files of timings differ in their numbers only."""
    texts = [re.sub(rb"-?\d+(\.\d+)?(e[-+]?\d+)?", b"0", each) for each in (content, other)]
    return texts[0] == texts[1]


def _same_columns(content: bytes, first: bytes, second: bytes) -> bool:
    try:
        table, one, other = (parquet.read_table(io.BytesIO(each)) for each in (content, first, second))
    except pyarrow.ArrowException:
        return False
    if not table.column_names == one.column_names == other.column_names:
        return False
    return all(table[name].equals(one[name]) for name in one.column_names if one[name].equals(other[name]))
