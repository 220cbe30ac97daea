"""Pipelines, difficult file names and locales: mjrun is quiet and right in all of them."""

import os
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tests.scoreboard.command import CONTROL, QUICK_IMPORTS, VARIABLES, CommandServer, Ended
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Tally, measured

LIMIT = 120.0  # [s]
CLOSED = 141  # exit code of a command whose reader is gone
DIFFERENT = 1  # exit code of `mjrun diff`
INPUTS = inputs_of(__name__)
SCENE = INPUTS["SCENE"]
SHORTENED: dict[str, int | bytes] = INPUTS["SHORTENED"]
WHOLE: dict[str, bytes | None] = INPUTS["WHOLE"]
NAMES: dict[str, str | bytes] = INPUTS["NAMES"]
LOCALES: dict[str, dict[str, str]] = INPUTS["LOCALES"]
QUICK_LINES = 1
QUICK_NAMES = ("newline", "not UTF-8")


@dataclass
class Pipelines:
    """Runs pipelines in a folder."""

    folder: Path
    tally: Tally

    def make_inputs(self, *, with_tables: bool) -> None:
        """Writes the files that the pipelines read."""
        for name in ("scene.xml", "Kübel 模型.xml"):
            (self.folder / name).write_text(SCENE)
        for name, timestep in () if not with_tables else (("table.csv", "0.002"), ("other.csv", "0.001")):
            made = self._bash(f"mjrun trace scene.xml --duration 0.1 --set opt.timestep={timestep} --csv > {name}")
            assert made.returncode == 0, made.stderr

    def shortened(self, line: str, expected: int | bytes) -> None:
        """Tries a command whose reader leaves early."""
        done = self._bash(line)
        is_right = (
            done.stdout.count(b"\n") == expected if isinstance(expected, int) else done.stdout.startswith(expected)
        )
        codes = (0, CLOSED, DIFFERENT) if "diff" in line else (0, CLOSED)
        self._expect(line, done, done.returncode in codes and is_right and not done.stderr)

    def whole(self, line: str, expected: bytes | None) -> None:
        """Tries commands that run to the end."""
        done = self._bash(line)
        self._expect(line, done, done.returncode == 0 and expected in (None, done.stdout) and not done.stderr)

    def in_locale(self, line: str, name: str) -> None:
        """Tries a command in another locale: its output and messages must be the same."""
        here, there = self._bash(line), self._bash(line, LOCALES[name])
        errors = re.sub(rb"(?m)^bash: warning: setlocale: .*\n", b"", there.stderr)  # the shell's own
        same = [there.returncode == here.returncode, there.stdout == here.stdout, errors == here.stderr]
        self._expect(f"locale {name}: {line}", there, all(same))

    def _bash(self, line: str, environment: dict[str, str] | None = None) -> subprocess.CompletedProcess[bytes]:
        python = shlex.quote(sys.executable)
        script = f'set -o pipefail\nmjrun() {{ {python} -m mjrun "$@"; }}\npython() {{ {python} "$@"; }}\n'
        if "xargs" in line:
            line = line.replace("mjrun", f"{python} -m mjrun")
        variables = {**os.environ, **VARIABLES, **(environment or {})}
        return subprocess.run(
            ["bash", "-c", script + line],
            cwd=self.folder,
            env=variables,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=LIMIT,
        )

    def _expect(self, line: str, done: subprocess.CompletedProcess[bytes], holds: bool) -> None:
        self.tally.expect(holds, f"{line}: code {done.returncode}, {done.stdout[:80]!r}, {done.stderr[-300:]!r}")


@dataclass
class Names:
    """Runs commands on models and outputs with difficult names."""

    server: CommandServer
    folder: Path
    tally: Tally

    def try_all(self, label: str, quick: bool) -> None:
        """Tries every command that reads or writes a file, with one name; the numbers must not depend on it."""
        stem = os.fsdecode(NAMES[label])
        folder = self.folder / label
        folder.mkdir()
        (folder / f"{stem}.xml").write_text(SCENE)
        # As everywhere, a name that begins with a dash is an option unless a folder precedes it.
        model = f"./{stem}.xml" if stem.startswith("-") else f"{stem}.xml"
        short = ("--duration", "0.1")
        if label in ("not UTF-8", "backslashes"):  # MuJoCo cannot open them
            self._succeeds(folder, "info", model, code=3)
            (folder / model).rename(folder / "scene.xml")
            model = "scene.xml"
        self._makes(folder, f"{stem}.csv", "trace", model, *short, "-o", f"{stem}.csv")
        self._succeeds(folder, "info", model)
        self._succeeds(folder, "info", "--", model.removeprefix("./"))
        self._succeeds(folder, "info", "nothing" + model, code=3)
        if quick:
            return

        table = f"./{stem}.csv" if stem.startswith("-") else f"{stem}.csv"
        self._makes(folder, f"{stem}.npz", "trace", model, *short, "-o", f"{stem}.npz", "--manifest", f"{stem}.json")
        self._makes(folder, f"{stem}.png", "image", model, "--size", "64x64", "-o", f"{stem}.png")
        self._makes(folder, f"{stem}.mp4", "video", model, *short, "--size", "64x64", "-o", f"{stem}.mp4")
        self._makes(folder, f"{stem}.svg", "plot", table, "-o", f"{stem}.svg")
        self._succeeds(folder, "diff", table, table)
        self._succeeds(folder, "check", model)
        self._succeeds(folder, "check", model, "--json")
        self._succeeds(folder, "trace", model, *short, "--recording", f"{stem}.rec.npz", "-o", "other.csv")
        self._succeeds(folder, "trace", model, "--replay", f"{stem}.rec.npz", "-o", "other.csv")
        study = ("--vary", "opt.timestep=0.001,0.002", "--metric", "last=max(time)")
        self._succeeds(folder, "sweep", model, *short, *study, "-o", f"{stem}.study")
        (folder / f"{stem}.yaml").write_bytes(b"model: scene.xml\nduration: 0.1\ntraces: [{output: run.csv}]\n")
        (folder / "scene.xml").write_text(SCENE)
        self._makes(folder, "run.csv", "run", table.removesuffix(".csv") + ".yaml")
        trace = (folder / f"{stem}.csv").read_bytes() if (folder / f"{stem}.csv").exists() else b""
        plain = (self.folder / "plain" / "plain.csv").read_bytes()
        self.tally.expect(trace == plain, f"the trace of {label} has other numbers")
        self.tally.expect(not list(self.folder.rglob("pwned")), f"a name was run as a command: {label}")

    def _makes(self, folder: Path, name: str, *arguments: str) -> None:
        ended = self.server.run(*arguments, folder=folder)
        path = folder / name
        self._expect(ended, ended.code == 0 and path.is_file() and path.stat().st_size > 0)

    def _succeeds(self, folder: Path, *arguments: str, code: int = 0) -> None:
        ended = self.server.run(*arguments, folder=folder)
        self._expect(ended, ended.code == code)

    def _expect(self, ended: Ended, holds: bool) -> None:
        shown = CONTROL.search(ended.stdout.decode("utf-8", "replace"))
        self.tally.expect(holds and not ended.faults and not shown, f"{ended} {ended.faults}")


@measured("pipelines, file names, locales", "quiet and right", 200)
def pipelines(quick: bool) -> Tally:
    """Tries all lines, locales and names; quickly, one line and two names."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as name:
        runner = Pipelines(Path(name, "pipelines"), tally)
        runner.folder.mkdir()
        runner.make_inputs(with_tables=not quick)
        for line, expected in list(SHORTENED.items())[: QUICK_LINES if quick else None]:
            runner.shortened(line, expected)
        for line, whole in () if quick else WHOLE.items():
            runner.whole(line, whole)
        for line in () if quick else INPUTS["IN_LOCALES"]:
            for locale in LOCALES:
                runner.in_locale(line, locale)
        with CommandServer(LIMIT, imports=QUICK_IMPORTS) as server:
            names = Names(server, Path(name), tally)
            for label in QUICK_NAMES if quick else NAMES:
                names.try_all(label, quick)
    return tally
