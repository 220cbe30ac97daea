"""Many commands at once on one output, one folder, one study."""

import shlex
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from tests.scoreboard.command import QUICK_IMPORTS, CommandServer, Ended, contents
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Tally, measured

CROWD = 6  # commands at once
ROUNDS = 6
LIMIT = 300.0  # [s]
REFUSED = (2, 7)  # exit codes of a command that reports another one
INPUTS = inputs_of(__name__)
SCENE, DOCUMENT, STUDY = INPUTS["SCENE"], INPUTS["DOCUMENT"], INPUTS["STUDY"]
OUTPUTS: dict[str, str] = INPUTS["OUTPUTS"]


@dataclass
class Crowds:
    """Runs commands at the same time."""

    servers: Sequence[CommandServer]
    folder: Path
    tally: Tally

    def try_outputs(self, name: str, rounds: int) -> None:
        """Tries commands that replace one output: in the end there are the files of one of them, and no others."""
        command = OUTPUTS[name]
        alone = []
        for number in range(1, len(self.servers) + 1):
            folder = self._place(f"{name} {number}")
            ended = self._run(0, command, number, folder)
            self.tally.expect(ended.code == 0 and not ended.faults, f"alone: {ended} {ended.faults}")
            alone.append(contents(folder))

        folder = self._place(name)
        for _ in range(rounds):
            done = self._at_once(command, folder)
            self._judge(f"{name}: files of no single run", done, contents(folder) in alone)

    def try_study(self, rounds: int) -> None:
        """Tries the same study several times at once: its table is complete in the end."""
        folder = self._place("alone")
        ended = self._run(0, STUDY, 1, folder)
        self.tally.expect(ended.code == 0, f"alone: {ended}")
        expected = self._table(folder)
        for number in range(rounds):
            folder = self._place(f"study {number}")
            done = self._at_once(STUDY, folder)
            ended = self._run(0, STUDY, 1, folder)  # nothing is left to simulate
            self._judge("one study", [*done, ended], self._table(folder) == expected)

    def try_folders(self, name: str, command: str, rounds: int) -> None:
        """Tries different results in one folder: one command writes them, and the others report that."""
        for number in range(rounds):
            folder = self._place(f"{name} {number}")
            done = self._at_once(command, folder)
            winners = sum(ended.code == 0 for ended in done)
            self._judge(name, done, winners >= 1)

    def _at_once(self, command: str, folder: Path) -> list[Ended]:
        with ThreadPoolExecutor(len(self.servers)) as pool:
            runs = [pool.submit(self._run, n, command, n + 1, folder) for n in range(len(self.servers))]
            return [run.result() for run in runs]

    def _run(self, server: int, command: str, number: int, folder: Path) -> Ended:
        return self.servers[server].run(*shlex.split(command.format(number=number)), folder=folder)

    def _judge(self, label: str, done: Sequence[Ended], is_whole: bool) -> None:
        """Counts each run; all of them fail if the result is not whole."""
        for ended in done:
            is_right = ended.code == 0 or (ended.code in REFUSED and "another" in ended.message)
            self.tally.expect(is_whole and is_right and not ended.faults, f"{label}: {ended} {ended.faults}")

    def _table(self, folder: Path) -> str:
        ended = self.servers[0].run("sweep", "study", "--csv", "-q", folder=folder)
        return ended.stdout.decode()

    def _place(self, name: str) -> Path:
        folder = self.folder / name.replace(" ", "_")
        folder.mkdir()
        (folder / "scene.xml").write_text(SCENE)
        for number in range(1, len(self.servers) + 1):
            (folder / f"run{number}.yaml").write_text(DOCUMENT.format(number=number))
        return folder


@measured("many commands at once", "one whole result; the other commands report that another one is running", 200)
def crowds(quick: bool) -> Tally:
    """Tries all outputs and folders; quickly, one output of two commands."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        servers = [
            stack.enter_context(CommandServer(LIMIT, imports=QUICK_IMPORTS)) for _ in range(2 if quick else CROWD)
        ]
        crowd = Crowds(servers, Path(folder), tally)
        for name in ("documents",) if quick else OUTPUTS:
            crowd.try_outputs(name, 1 if quick else ROUNDS)
        if quick:
            return tally
        crowd.try_study(2)
        crowd.try_folders("other studies", INPUTS["OTHER_STUDY"], 2)
        crowd.try_folders("evaluations", INPUTS["EVALUATION"], 2)
    return tally
