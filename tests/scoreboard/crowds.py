"""Many commands at once on one output, one folder, one study."""

import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from tests.scoreboard.command import CommandServer, Ended
from tests.scoreboard.measure import Measure, Tally
from tests.scoreboard.real_command import contents

CROWD = 6  # commands at once
ROUNDS = 6
LIMIT = 300.0  # [s]
TOLD = (2, 7)  # exit codes of who was told that another one is at it
SCENE = """<mujoco><statistic extent="2"/><worldbody><light pos="0 0 3"/><geom type="plane" size="3 3 .1"/>
<body name="pole" pos="0 0 1"><joint name="hinge" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0.5 0 0"/></body></worldbody></mujoco>"""
DOCUMENT = """model: scene.xml
duration: 0.1
set: {{opt.gravity: 0 0 -{number}}}
traces: [{{output: a.csv}}, {{output: b.jsonl}}, {{output: c.npz}}]
"""
SMALL = ("--duration", "0.1", "--fps", "60", "--size", "64x64")

# Command lines in which {number} differs from run to run, and with it what is made.
SETTING = ("scene.xml", "--set", "opt.gravity=0 0 -{number}")
OUTPUTS: dict[str, tuple[str, ...]] = {
    "csv": ("trace", *SETTING, "--duration", "{number}", "-o", "out.csv"),
    "npz": ("trace", *SETTING, "--duration", "{number}", "-o", "out.npz"),
    "parquet": ("trace", *SETTING, "--duration", "{number}", "-o", "out.parquet"),
    "documents": ("run", "run{number}.yaml"),
    "image": ("image", *SETTING, "--time", "0.1", "--size", "64x64", "-o", "out.png"),
    "video": ("video", *SETTING, *SMALL, "-o", "out.mp4"),
    "folder of frames": ("video", *SETTING, *SMALL, "-o", "frames/"),
    "pattern of frames": ("video", *SETTING, *SMALL, "-o", "f%03d.png"),
}
STUDY = ("--metric", "last=max(time)", "-o", "study")
SAME_STUDY = ("sweep", "scene.xml", "--duration", "0.5", "--vary", "opt.timestep=0.001..0.002:12", *STUDY)
OTHER_STUDY = ("sweep", "scene.xml", "--duration", "0.{number}", "--vary", "opt.timestep=0.001,0.002", *STUDY)
SAME_EVALUATION = ("eval", "gym:InvertedPendulum-v5", "--policy", "random", "--episodes", "{number}", "-o", "results")


@dataclass
class Crowds:
    """Runs commands at once."""

    servers: Sequence[CommandServer]
    folder: Path
    tally: Tally

    def try_outputs(self, name: str, rounds: int) -> None:
        """Commands that replace one output: in the end there is what one of them makes, and nothing else."""
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
        """The same study: it is whole in the end, whoever has made it."""
        folder = self._place("alone")
        ended = self._run(0, SAME_STUDY, 1, folder)
        self.tally.expect(ended.code == 0, f"alone: {ended}")
        expected = self._table(folder)
        for number in range(rounds):
            folder = self._place(f"study {number}")
            done = self._at_once(SAME_STUDY, folder)
            ended = self._run(0, SAME_STUDY, 1, folder)  # which has nothing to do any more
            self._judge("one study", [*done, ended], self._table(folder) == expected)

    def try_folders(self, name: str, command: Sequence[str], rounds: int) -> None:
        """Different results in one folder: somebody has it, and the others are told."""
        for number in range(rounds):
            folder = self._place(f"{name} {number}")
            done = self._at_once(command, folder)
            winners = sum(ended.code == 0 for ended in done)
            self._judge(name, done, winners >= 1)

    def _at_once(self, command: Sequence[str], folder: Path) -> list[Ended]:
        with ThreadPoolExecutor(len(self.servers)) as pool:
            runs = [pool.submit(self._run, n, command, n + 1, folder) for n in range(len(self.servers))]
            return [run.result() for run in runs]

    def _run(self, server: int, command: Sequence[str], number: int, folder: Path) -> Ended:
        return self.servers[server].run(*(part.format(number=number) for part in command), folder=folder)

    def _judge(self, label: str, done: Sequence[Ended], is_whole: bool) -> None:
        """Each run is a case; one result that is not whole is a miss of all of them."""
        for ended in done:
            is_told = ended.code == 0 or (ended.code in TOLD and "another" in ended.message)
            self.tally.expect(is_whole and is_told and not ended.faults, f"{label}: {ended} {ended.faults}")

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


def run(quick: bool) -> Tally:
    """Tries all of it; quickly, one table and one study by two commands at once."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        servers = [stack.enter_context(CommandServer(limit=LIMIT)) for _ in range(2 if quick else CROWD)]
        crowds = Crowds(servers, Path(folder), tally)
        for name in ("documents",) if quick else OUTPUTS:
            crowds.try_outputs(name, 1 if quick else ROUNDS)
        if quick:
            return tally
        crowds.try_study(2)
        crowds.try_folders("other studies", OTHER_STUDY, 2)
        crowds.try_folders("evaluations", SAME_EVALUATION, 2)
    return tally


MEASURE = Measure("many commands at once", "one whole result, the others told", 200, run)
