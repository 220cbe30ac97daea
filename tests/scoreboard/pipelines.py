"""Pipelines, nasty file names and the locale C: mjrun is quiet and right in all of them."""

import os
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tests.scoreboard.command import CONTROL, ROOT, CommandServer, Ended
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Measure, Tally

LIMIT = 120.0  # [s]
CLOSED = 141  # of a command whose reader has gone
DIFFERENT = 1  # of `mjrun diff`
SCENE = """<mujoco><statistic extent="2"/><worldbody><light pos="0 0 3"/><geom type="plane" size="3 3 .1"/>
<body name="Pöl 棒" pos="0 0 1"><joint name="Gelenk-é" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0.5 0 0"/></body></worldbody></mujoco>"""
SMALL = "--size 64x64 --duration 0.1"

# Lines of bash, and what of standard output must be right: the number of its lines, or the bytes that it begins with.
# All are run with `set -o pipefail`, may end with 0 or 141, and say nothing on standard error.
SHORTENED: dict[str, int | bytes] = {
    "mjrun trace scene.xml --duration 20 --csv | head -n 3": 3,
    "mjrun trace scene.xml --duration 20 --csv | head -n 1": 1,
    "mjrun trace scene.xml --duration 20 --format jsonl | head -n 2": 2,
    "mjrun trace scene.xml --duration 20 --csv | head -c 4": b"time",
    "mjrun image scene.xml -q --size 64x64 -o - | head -c 4": b"\x89PNG",
    f"mjrun video scene.xml -q {SMALL} --duration 5 -o - | head -c 8 | tail -c 4": b"ftyp",
    f"mjrun video scene.xml -q {SMALL} --format rgb -o - | head -c 3 | wc -c": b"3",
    "mjrun plot table.csv -q -o - | head -c 4": b"\x89PNG",
    "mjrun info scene.xml | head -n 1": 1,
    "mjrun info scene.xml --json | head -n 1": b"{",
    "mjrun check scene.xml --json | head -n 1": b"{",
    "mjrun diff table.csv table.csv --json | head -n 1": b"{",
    "mjrun diff table.csv other.csv | head -n 1": 1,
    "mjrun bench scene.xml --budget 0.2 -q --json | head -n 1": b"{",
    "mjrun schema run | head -n 1": b"{",
    "mjrun doctor | head -n 1": 1,
    "mjrun --help | head -n 1": 1,
    "mjrun video --help | head -n 2": 2,
    "mjrun sweep scene.xml -q --duration 0.1 --vary opt.timestep=0.001,0.002 --metric 'a=max(time)' -o study --csv"
    " | head -n 1": 1,
}
# The same, but to the end: these must end with 0, and print these very bytes if there are any.
WHOLE: dict[str, bytes | None] = {
    "mjrun trace scene.xml --duration 0.1 --csv | mjrun diff table.csv -": None,
    "mjrun trace scene.xml --duration 0.1 --csv | tail -n +2 | wc -l": b"51\n",
    "mjrun trace scene.xml --duration 0.1 --csv | mjrun plot - -q -o plot.png && head -c 4 plot.png": b"\x89PNG",
    "mjrun trace scene.xml --duration 0.1 --csv | tee copy.csv | cmp - table.csv": b"",
    "cat scene.xml | mjrun trace - --duration 0.1 --csv | cmp - table.csv": b"",
    "mjrun info - --json < scene.xml | python -c 'import json, sys; print(len(json.load(sys.stdin)))' | wc -l": b"1\n",
    "mjrun video scene.xml -q --size 64x64 --duration 0.1 --fps 20 --format rgb -o - | wc -c": b"24576\n",
    "mjrun image scene.xml -q --size 64x64 -o - > picture.png && mjrun diff picture.png picture.png": None,
    "printf '%s\\0' scene.xml | xargs -0 mjrun check -q": b"",
    "for i in 1 2; do mjrun trace scene.xml --duration 0.1 --csv; done | wc -l": b"104\n",
    "mjrun trace scene.xml --duration 0.1 --csv 2>/dev/null | cmp - table.csv": b"",
    "mjrun trace scene.xml --duration 0.1 --csv < /dev/null | cmp - table.csv": b"",
    "mjrun trace scene.xml --duration 0.1 --csv <&- | cmp - table.csv": b"",
    "(trap '' PIPE; mjrun trace scene.xml --duration 0.1 --csv | cmp - table.csv)": b"",
}
QUICK_LINES = 1

NAMES: dict[str, bytes] = {
    "plain": b"plain",
    "spaces": b" a  b ",
    "newline": b"two\nlines",
    "leading dash": b"-o",
    "quotes": b'it\'s "q" `x`',
    "UTF-8": "Kübel 模型 é".encode(),
    "not UTF-8": b"caf\xe9\xff",
    "pattern": b"%05d",
    "percent": b"100%s%%",
    "very long": b"n" * 240,
    "command": b"$(touch pwned); touch pwned &",
    "wildcards": b"*?[a-z]{1,2}",
    "escapes": "\x1b[31mred\x07\x9b".encode(),
    "assignment": b"a=b,c:d;e#f@1",
    "backslashes": b"C:\\new\\table",
    "dots": b"..x...y..",
}
QUICK_NAMES = ("newline", "not UTF-8")

INPUTS = inputs_of(__name__)
LOCALES: dict[str, dict[str, str]] = INPUTS["LOCALES"]
IN_LOCALES = INPUTS["IN_LOCALES"]


@dataclass
class Pipelines:
    """Runs pipelines in a folder."""

    folder: Path
    tally: Tally

    def make_inputs(self, *, with_tables: bool) -> None:
        """What the pipelines read."""
        for name in ("scene.xml", "Kübel 模型.xml"):
            (self.folder / name).write_text(SCENE)
        for name, timestep in () if not with_tables else (("table.csv", "0.002"), ("other.csv", "0.001")):
            made = self._bash(f"mjrun trace scene.xml --duration 0.1 --set opt.timestep={timestep} --csv > {name}")
            assert made.returncode == 0, made.stderr

    def shortened(self, line: str, expected: int | bytes) -> None:
        """A command whose reader goes away early."""
        done = self._bash(line)
        is_right = (
            done.stdout.count(b"\n") == expected if isinstance(expected, int) else done.stdout.startswith(expected)
        )
        codes = (0, CLOSED, DIFFERENT) if "diff" in line else (0, CLOSED)
        self._expect(line, done, done.returncode in codes and is_right and not done.stderr)

    def whole(self, line: str, expected: bytes | None) -> None:
        """Commands that go on to the end."""
        done = self._bash(line)
        self._expect(line, done, done.returncode == 0 and expected in (None, done.stdout) and not done.stderr)

    def in_locale(self, line: str, name: str) -> None:
        """A command that does the same in every locale, also when it fails."""
        here, there = self._bash(line), self._bash(line, LOCALES[name])
        errors = re.sub(rb"(?m)^bash: warning: setlocale: .*\n", b"", there.stderr)  # the shell's own
        same = [there.returncode == here.returncode, there.stdout == here.stdout, errors == here.stderr]
        self._expect(f"locale {name}: {line}", there, all(same))

    def _bash(self, line: str, environment: dict[str, str] | None = None) -> subprocess.CompletedProcess[bytes]:
        python = shlex.quote(sys.executable)
        script = f'set -o pipefail\nmjrun() {{ {python} -m mjrun "$@"; }}\npython() {{ {python} "$@"; }}\n'
        if "xargs" in line:
            line = line.replace("mjrun", f"{python} -m mjrun")
        variables = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "120", "NO_COLOR": "1", **(environment or {})}
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
    """Runs commands on models, and into outputs, of a name."""

    server: CommandServer
    folder: Path
    tally: Tally

    def try_all(self, label: str, quick: bool) -> None:
        """Every command that takes or makes a file, with files of one name; the numbers do not depend on it."""
        stem = os.fsdecode(NAMES[label])
        folder = self.folder / label
        folder.mkdir()
        (folder / f"{stem}.xml").write_text(SCENE)
        # As everywhere, a name that begins with a dash is an option unless something stands before it.
        model = f"./{stem}.xml" if stem.startswith("-") else f"{stem}.xml"
        short = ("--duration", "0.1")
        if label in ("not UTF-8", "backslashes"):  # which MuJoCo cannot open
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


def run(quick: bool) -> Tally:
    """Tries all of it."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as name:
        pipelines = Pipelines(Path(name, "pipelines"), tally)
        pipelines.folder.mkdir()
        pipelines.make_inputs(with_tables=not quick)
        for line, expected in list(SHORTENED.items())[: QUICK_LINES if quick else None]:
            pipelines.shortened(line, expected)
        for line, whole in () if quick else WHOLE.items():
            pipelines.whole(line, whole)
        for line in () if quick else IN_LOCALES:
            for locale in LOCALES:
                pipelines.in_locale(line, locale)
        with CommandServer(limit=LIMIT) as server:
            names = Names(server, Path(name), tally)
            for label in QUICK_NAMES if quick else NAMES:
                names.try_all(label, quick)
    return tally


MEASURE = Measure("pipelines, file names, locales", "quiet and right", 200, run)
