"""Hostile input files, each with the command that reads it and the result that it must have."""

import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.scoreboard.command import CONTROL, CommandServer, Ended, contents
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Tally

CANARY = "code_has_run"  # a file that code from a hostile file would make
SECRET = "DISCLOSED-b7f1"  # the content of a file outside the folder; it must be in no message
BETWEEN = "between.txt"  # the name of that file

INPUTS = inputs_of(__name__)
IMPORTS = INPUTS["IMPORTS"]  # modules that most of the commands import as they run
MODEL, TASK, TAGS, WRONG = INPUTS["MODEL"], INPUTS["TASK"], INPUTS["TAGS"], INPUTS["WRONG"]
LAUGHS = "a0: &a0 [lol, lol, lol, lol, lol, lol, lol, lol, lol]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)
TIME = np.arange(20) * 0.01
CSV = "time,qpos/hinge,ctrl/motor\n" + "".join(f"{t},{np.sin(t)},{np.cos(t)}\n" for t in TIME)

Content = bytes | str | Callable[[Path], object]


@dataclass(frozen=True)
class Form:
    """One hostile form.

    Attributes:
      name: a few words for the list of failures.
      arguments: the command line after `mjrun`.
      codes: the exit codes that are right.
      files: the files to write first, by path: content, or a function that writes it there.
      says: words that the message must contain.
      changes: paths, or folders, whose files a run may change.
      limit: seconds that it may take on a busy machine.
      quick: true for the part that the tests run.
    """

    name: str
    arguments: tuple[str, ...]
    codes: tuple[int, ...]
    files: Mapping[str, Content] = field(default_factory=dict[str, Content])
    says: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()
    limit: float = 60
    quick: bool = False


def write(folder: Path, files: Mapping[str, Content]) -> None:
    """Writes files into a folder."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if callable(content):
            content(path)
        elif isinstance(content, str):
            path.write_text(content, "utf-8")
        else:
            path.write_bytes(content)


def changed(good: str, change: str | tuple[str, str]) -> str:
    """Returns a text that a valid one becomes: `change` with `{good}` filled in, or one text replaced by another."""
    return change.replace("{good}", good) if isinstance(change, str) else good.replace(*change)


def faults(form: Form, ended: Ended, before: Mapping[str, bytes], after: Mapping[str, bytes]) -> list[str]:
    """Returns the faults of a run."""
    found = ended.faults if ended.code is None else ended.faults_unless(form.codes)
    found += [f"does not say {word!r}" for word in form.says if word not in ended.message]
    if CONTROL.search(ended.stdout.decode("utf-8", "replace")):
        found.append("control bytes on standard output")
    if SECRET in ended.output:
        found.append("shows what another file holds")
    if CANARY in after:
        found.append("has run code of the file")
    own = [name for name in before if not name.startswith(form.changes)] if form.changes else [*before]
    found += [f"{name} has changed" for name in own if after.get(name) != before[name]]
    if ended.code in (2, 3, 4, 5, 6, 7):  # nothing was made
        found += [f"left {name}" for name in after if name not in before and not name.startswith("__pycache__")]
    return found


def try_forms(
    forms: Iterable[Form], base: Mapping[str, Content], tally: Tally, imports: Sequence[str] = IMPORTS
) -> None:
    """Runs each form in a new folder with the files of `base`, and counts it; `imports` are those of its server."""
    with tempfile.TemporaryDirectory() as top, CommandServer(memory=6144, imports=imports) as server:
        Path(top, BETWEEN).write_text(f"{SECRET}\n")
        template = Path(top, "template")
        template.mkdir()
        write(template, base)
        for form in forms:
            folder = Path(top, "case")
            shutil.copytree(template, folder)
            write(folder, form.files)
            before = contents(folder)
            ended = server.run(*form.arguments, folder=folder, limit=form.limit)
            found = faults(form, ended, before, contents(folder))
            tally.expect(not found, f"{form.name}: {'; '.join(found)}: {ended}")
            shutil.rmtree(folder)
