"""Hostile files, each with the command that meets it and what must come of that."""

import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tests.scoreboard.command import CONTROL, CommandServer, Ended
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Tally

CANARY = "code_has_run"  # a file that code from a hostile file would make
SECRET = "DISCLOSED-b7f1"  # stands in a file outside the folder, and must be in no message
BETWEEN = "between.txt"  # the name of that file

# What most of the commands import as they run.
INPUTS = inputs_of(__name__)
IMPORTS = INPUTS["IMPORTS"]

Content = bytes | str | Callable[[Path], object]


@dataclass(frozen=True)
class Form:
    """One hostile form.

    Attributes:
      name: in a few words, for the list of failures.
      arguments: of mjrun.
      codes: the exit code that is expected; several where more than one is right.
      files: what is written before, by path: content, or a function that makes it there.
      says: words that the message must have.
      changes: paths, or folders, whose files a run may change.
      limit: seconds that it may take on a busy machine.
      quick: whether it belongs to the part that the tests run.
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


def contents(folder: Path) -> dict[str, bytes]:
    """The files in a folder, by path."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def faults(form: Form, ended: Ended, before: Mapping[str, bytes], after: Mapping[str, bytes]) -> list[str]:
    """What is wrong with how a run ended."""
    found = [each for each in ended.faults if not (ended.code in form.codes and each.startswith("exit code"))]
    if ended.code is not None and ended.code not in form.codes:
        found.append(f"expected code {' or '.join(map(str, form.codes))}")
    found += [f"does not say {word!r}" for word in form.says if word not in ended.message]
    output = ended.stdout.decode("utf-8", "replace") + ended.message
    if CONTROL.search(ended.stdout.decode("utf-8", "replace")):
        found.append("control bytes on standard output")
    if SECRET in output:
        found.append("shows what another file holds")
    if CANARY in after:
        found.append("has run code of the file")
    own = [name for name in before if not name.startswith(form.changes)] if form.changes else [*before]
    found += [f"{name} has changed" for name in own if after.get(name) != before[name]]
    if ended.code in (2, 3, 4, 5, 6, 7):  # nothing was made
        found += [f"left {name}" for name in after if name not in before and not name.startswith("__pycache__")]
    return found


def try_forms(forms: Iterable[Form], base: Mapping[str, Content], tally: Tally, memory: int = 6144) -> None:
    """Runs each form in a folder of its own, with the files of `base` in it, and counts it."""
    with tempfile.TemporaryDirectory() as top, CommandServer(memory=memory, imports=IMPORTS) as server:
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
