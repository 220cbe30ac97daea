"""A command that writes, disturbed, and the files that must exist afterwards."""

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pyarrow
from pyarrow import parquet

from tests.scoreboard.command import CommandServer, Ended, contents
from tests.scoreboard.file_operations import Fault
from tests.scoreboard.measure import Tally, lanes, side_by_side
from tests.scoreboard.writing_commands import (
    COMMANDS,
    QUICK,
    Command,
    Reference,
    command_server,
    make_inputs,
    new_folder,
    run_first,
)

ENCODER, CANNOT_WRITE, PARTLY = 6, 7, 8  # exit codes
EPISODES = "/mjrun/episodes/"  # in names of files of finished episodes, of datasets in steps
PARTS, MANIFESTS = "parts", ("study.json", "evaluation.json", "mjrun/dataset.json")  # of commands in steps
ENCODED = (
    "mp4",
    "gif",
    "webm",
    "apng",
    "mkv",
    "folder",
    "pattern",
    "eval videos",
    "lerobot",
)  # commands that use an encoder


def try_commands(disturb: "Callable[[Trial], None]", quick: bool) -> Tally:
    """Disturbs each command that writes, two of them at once; or only the quick ones."""
    commands = [command for command in COMMANDS if not quick or command.name in QUICK]
    tally = Tally()
    for each in side_by_side(lambda lane: [_tried(lane, disturb, quick)], lanes(commands, quick)):
        tally.add(each)
    return tally


def _tried(commands: Sequence[Command], disturb: "Callable[[Trial], None]", quick: bool) -> Tally:
    tally = Tally()
    with tempfile.TemporaryDirectory() as name, command_server(quick) as server:
        folder = Path(os.path.realpath(name))
        make_inputs(folder / "inputs", server, draw=not quick)
        for command in commands:
            try:
                trial = Trial(command, folder, server, tally)
            except RuntimeError as error:
                tally.expect(False, f"{command.name}, undisturbed: {error}")
            else:
                disturb(trial)
    return tally


class Trial:
    """Runs one command again and again, with or without an older version of its outputs.

    Attributes:
      folder: the folder of the case, with `out`, `inputs`, and `temporary` for temporary files.
      older: the files before a run that replaces outputs; nothing: those before a run that replaces none.
      new: the files after a run on `older`; fresh: those after a run on `nothing`.
      code: the exit code of an undisturbed run.
      seconds: its duration.
      prints: true if it writes to standard output.

    Raises:
      RuntimeError: the command writes nothing.
    """

    def __init__(self, command: Command, folder: Path, server: CommandServer, tally: Tally) -> None:
        self.command, self._server, self.tally = command, server, tally
        self.folder = new_folder(folder / "case")
        (self.folder / "inputs").symlink_to(folder / "inputs")
        self.out, self.temporary = self.folder / "out", new_folder(self.folder / "temporary")
        self._kept = {True: self.folder / "older", False: self.folder / "nothing"}

        run_first(command, self.out, server)
        self.nothing = self._keep("nothing")
        made = [self._make_new() for _ in range(2)]  # differences depend on the wall clock
        self.new = self.fresh = Reference(*made)
        if command.other:
            run_first(command, self.out, server)
            self._make([*command.arguments, *command.other.split()])
        else:
            self.start(with_older=False)
        self.older = self._keep("older")
        if command.in_steps:  # it keeps the older files
            self.new = Reference(self._make_new(with_older=True), self._make_new(with_older=True))

    def start(self, *, with_older: bool = True) -> None:
        """Restores the files before the command."""
        self._with_older = with_older
        new_folder(self.temporary)
        self.out.mkdir(exist_ok=True)
        for path in self.out.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        shutil.copytree(self._kept[with_older], self.out, symlinks=True, dirs_exist_ok=True)
        self._steps_before = self._steps()

    def run(self, fault: Fault | None = None, environment: Mapping[str, str] | None = None, **how: object) -> Ended:
        """Runs the command; the arguments are those of `CommandServer.run`."""
        variables = {"TMPDIR": str(self.temporary), **(environment or {})}
        arguments = self.command.arguments
        return self._server.run(*arguments, folder=self.out, environment=variables, fault=fault, **how)  # type: ignore

    def operations(self) -> list[str]:
        """Returns the operations on the folder; none, with a note, where the kernel cannot watch them."""
        try:
            return [operation for operation, _ in self.watch().operations]
        except OSError as error:
            self.tally.leave_out(str(error))
            return []

    def watch(self, number: int = 0, kind: str = "once") -> Ended:
        """Runs the command with a fault, or to list the operations on its folder.

        Raises:
          OSError: the kernel cannot watch a process.
        """
        return self.run(Fault(str(self.folder), number, kind))

    def judge(self, ended: Ended, case: str, codes: Sequence[int] = (CANNOT_WRITE,)) -> None:
        """Counts a case that may have failed: all files are old, or new, and the message names the new ones."""
        problems = ended.faults
        if ended.code == self.code:
            problems += self._differences(self._after, "new")
        elif ended.code == PARTLY or (self.command.in_steps and ended.code in codes):
            problems += self._mixture(ended.message)
        elif ended.code not in (*codes, *([ENCODER] if self.command.name in ENCODED else [])):
            problems.append(f"exit code {ended.code}")
        elif "the next run" in ended.message:
            self.judge_next(f"{case}, with a message that the next run repairs it", problems)
            return
        else:
            problems += self._differences(self._before, "old")
        if ended.code != self.code and not self._names_a_file(ended.message):
            problems.append("the message names no file")
        names = any(text in ended.message for text in (PARTS, "the results of all points are in the table"))
        if ended.code != self.code and self._steps() - self._steps_before and not names:
            problems.append("the message does not tell of the results in parts")
        are_kept = self.command.in_steps and ended.code != self.code
        left_over = [text for text in self._left_over() if not (are_kept and EPISODES in text)]
        self._count(ended, case, [*problems, *left_over])

    def judge_made(self, ended: Ended, case: str, code: int | None) -> None:
        """Counts a case that must write all files, whatever the exit code."""
        problems = [fault for fault in ended.faults if "without a word" not in fault]
        if ended.code != code:
            problems.append(f"exit code {ended.code}, not {code}")
        self._count(ended, case, [*problems, *self._differences(self._after, "new"), *self._left_over()])

    def judge_next(self, case: str, problems: Sequence[str] = ()) -> None:
        """Counts a case after which the same command, undisturbed, writes all files and removes leftovers."""
        ended = self.run()
        problems = [*problems, *ended.faults]
        if ended.code != self.code:
            problems.append(f"exit code {ended.code} of the next run")
        self._count(ended, case, [*problems, *self._differences(self._after, "new"), *self._left_over()])

    def torn(self) -> list[str]:
        """Returns faults of files that are neither old nor new, or gone; the next run removes hidden files."""
        now, problems = self._contents(), self._mixture(None)
        for folder in self.command.whole:
            inside = {name: content for name, content in now.items() if name.startswith(f"{folder}/")}
            for reference in (self._before, self._after):
                names = [name for name in reference.first if name.startswith(f"{folder}/")]
                if names == [*inside] and all(reference.holds(name, inside[name]) for name in names):
                    break
            else:
                problems.append(f"{folder} is a mixture")
        return problems

    @property
    def _before(self) -> Reference:
        return self.older if self._with_older else self.nothing

    @property
    def _after(self) -> Reference:
        return self.new if self._with_older else self.fresh

    def _make(self, arguments: Sequence[str]) -> Ended:
        return self._server.run(*arguments, folder=self.out, environment={"TMPDIR": str(self.temporary)})

    def _make_new(self, *, with_older: bool = False) -> Mapping[str, bytes]:
        self.start(with_older=with_older)
        ended = self._make(self.command.arguments)
        self.code, self.seconds, self.prints = ended.code, ended.seconds, bool(ended.stdout)
        made = self._contents()
        if not made:
            raise RuntimeError(str(ended))
        return made

    def _keep(self, name: str) -> Reference:
        shutil.copytree(self.out, self.folder / name, symlinks=True)
        return Reference(self._contents(), self._contents())

    def _contents(self) -> dict[str, bytes]:
        """Returns the files by name, without whole parts of results, which other processes than mjrun do not read.

        Their names and their number depend on the moments at which points end.
        """
        steps = self._steps()
        return {name: content for name, content in contents(self.out).items() if name not in steps}

    def _steps(self) -> set[str]:
        """Returns the names of the whole parts of results."""
        parts = [path for place in (PARTS, f"mjrun/{PARTS}") for path in self.out.glob(f"*/{place}/*.parquet")]
        return {str(path.relative_to(self.out)) for path in parts if _is_table(path)}

    def _count(self, ended: Ended, case: str, problems: Sequence[str]) -> None:
        last = "; ".join(ended.message.splitlines()[-3:])[-300:]
        listed = "; ".join(problems[:4])
        self.tally.expect(not problems, f"{self.command.name}: {case}: {listed} (code {ended.code}: {last})")

    def _differences(self, reference: Reference, which: str) -> list[str]:
        now = self._contents()
        missing = [f"{name} is missing" for name in reference.first if name not in now]
        return missing + [
            f"{name} is not the {which} one"
            for name in reference.first
            if name in now
            and not reference.holds(name, now[name])
            and not (self.command.in_steps and _same_study(name, now[name], reference.first[name]))
        ]

    def _mixture(self, message: str | None) -> list[str]:
        """Returns faults of files that are neither old nor new, and of new files that `message` does not name."""
        now, problems = self._contents(), list[str]()
        problems += [
            f"{name} is missing" for name in self._before.first if name in self._after.first and name not in now
        ]
        for name, content in now.items():
            if self._before.holds(name, content):
                continue
            if self._after.holds(name, content):
                if message is not None and not self.command.in_steps and self._name(name) not in message:
                    problems.append(f"{name} is new, and the message does not name it")
            elif self.command.in_steps and name.endswith(MANIFESTS) and _is_document(content):
                pass  # it counts the finished points
            elif name in self._before.first or name in self._after.first:
                problems.append(f"{name} is neither old nor new")
        return problems

    def _left_over(self) -> list[str]:
        known = {*self._before.first, *self._after.first}
        found = [name for name in self._contents() if name not in known]
        found += [str(path.relative_to(self.out)) for path in self.out.rglob(".*") if path.is_dir()]
        return [
            f"{name} is left over" for name in found + [f"$TMPDIR/{path.name}" for path in self.temporary.iterdir()]
        ]

    def _names_a_file(self, message: str) -> bool:
        known = {*self._before.first, *self._after.first}
        names = {part for name in known for part in (*Path(name).parts, self._name(name))}
        return any(name in message for name in names | {"temporary", "plan.jsonl"})

    def _name(self, path: str) -> str:
        """Returns the name of a file in messages, which name frames by their pattern."""
        name = Path(path).name
        return "f_%04d.png" if self.command.name == "pattern" and name.startswith("f_") else name


def _same_study(name: str, content: bytes, other: bytes) -> bool:
    """Tells whether two documents describe the same study, whichever part was known before the last run."""
    if not (name.endswith(MANIFESTS) and _is_document(content)):
        return False
    studies = [json.loads(content), json.loads(other)]
    for study in studies:
        study |= {"simulated": 0, "wall": 0, "kept": {**study.get("kept", {}), "made": 0}}
    return studies[0] == studies[1]


def _is_table(path: Path) -> bool:
    """Tells whether a Parquet file is whole."""
    try:
        parquet.read_table(path)
    except pyarrow.ArrowException:
        return False
    return True


def _is_document(content: bytes) -> bool:
    """Tells whether a text is a complete JSON object."""
    try:
        return isinstance(json.loads(content), dict)
    except ValueError:
        return False
