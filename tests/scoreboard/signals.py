"""SIGINT and SIGTERM at random moments of every command, in processes of their own: they end, and leave nothing."""

import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from tests.scoreboard.command import ROOT, Ended
from tests.scoreboard.measure import Measure, Tally
from tests.scoreboard.real_command import RealCommand, contents, noise

SEED = 17
MOMENTS = 10  # of each case
AT_MOST = 1.0  # [s] from the signal to the end, on a quiet machine
PULSES = 10  # how often an empty Python can start and end meanwhile, on a busy one
HANG = 90.0  # [s]
ENDLESS = 3.0  # [s] in which moments of what never ends are drawn
SMALL = ("--size", "160x120")
METRIC = ("--metric", "most=max(qpos/hinge)", "-o", "study")

SCENE = """<mujoco><statistic extent="2"/><worldbody><light pos="0 0 3"/><geom type="plane" size="3 3 .1"/>
<body name="pole" pos="0 0 1"><joint name="hinge" axis="0 1 0" damping="0.1"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0.5 0 0"/></body></worldbody></mujoco>"""
MANY = '<mujoco><worldbody><replicate count="{}" offset="0.1 0 0"><geom size="0.01"/></replicate></worldbody></mujoco>'
DOCUMENT = """model: scene.xml
duration: 0.3
videos: [{output: out.mp4, size: 160x120, fps: 10}]
images: [{output: out.png, size: 160x120, time: 0.2}]
traces: [{output: out.csv}, {output: out.npz}]
"""
HANGING = "#!/bin/sh\nsleep 600 &\nexec sleep 600\n"  # an ffmpeg with a child that holds its standard error


@dataclass(frozen=True)
class Case:
    """A command line, and what it writes.

    Attributes:
      arguments: after `mjrun`.
      replaces: older outputs, which are there before it starts.
      resumes: whether it keeps what is known in a folder, which the same command continues.
      endless: whether it never ends by itself.
      hanging_encoder: whether its ffmpeg never ends.
    """

    arguments: tuple[str, ...]
    replaces: tuple[str, ...] = ()
    resumes: bool = False
    endless: bool = False
    hanging_encoder: bool = False


CASES = {
    "trace": Case(("trace", "scene.xml", "--duration", "30", "-o", "out.csv"), ("out.csv",)),
    "trace, npz": Case(("trace", "scene.xml", "--duration", "20", "-o", "out.npz"), ("out.npz",)),
    "video": Case(("video", "scene.xml", "--duration", "0.5", *SMALL, "-o", "out.mp4"), ("out.mp4",)),
    "video, folder": Case(("video", "scene.xml", "--duration", "0.3", *SMALL, "-o", "out/"), ("out/000000.png",)),
    "video, pattern": Case(("video", "scene.xml", "--duration", "0.3", *SMALL, "-o", "f%03d.png"), ("f000.png",)),
    "video, AV1": Case(
        ("video", "scene.xml", "--duration", "0.3", "--codec", "av1", *SMALL, "-o", "out.mkv"), ("out.mkv",)
    ),
    "video, Filament": Case(
        ("video", "scene.xml", "--duration", "0.2", "--renderer", "filament", *SMALL, "-o", "out.mp4"), ("out.mp4",)
    ),
    "video, hanging encoder": Case(
        ("video", "scene.xml", "--duration", "0.3", *SMALL, "-o", "out.mp4"),
        ("out.mp4",),
        endless=True,
        hanging_encoder=True,
    ),
    "image": Case(("image", "scene.xml", "--size", "800x600", "-o", "out.png"), ("out.png",)),
    "image, Filament": Case(("image", "scene.xml", "--renderer", "filament", "-o", "out.png"), ("out.png",)),
    "run": Case(("run", "all.yaml"), ("out.mp4", "out.png", "out.csv", "out.npz")),
    "sweep": Case(
        ("sweep", "scene.xml", "--duration", "3", "--vary", "joint/hinge.damping=0..1:40", "--jobs", "2", *METRIC),
        resumes=True,
    ),
    "fit": Case(
        ("fit", "scene.xml", "log.csv", "--free", "joint/hinge.damping=0..1", "--starts", "2", "-o", "out.xml"),
        ("out.xml",),
    ),
    "eval": Case(
        ("eval", "gym:InvertedPendulum-v5", "--policy", "random", "--episodes", "8", "-o", "results"), resumes=True
    ),
    "plot": Case(("plot", "log.csv", "-o", "out.png"), ("out.png",)),
    "diff": Case(("diff", "log.csv", "log.csv")),
    "check": Case(("check", "scene.xml", "large.xml")),
    "bench": Case(("bench", "scene.xml", "--budget", "1")),
    "info": Case(("info", "scene.xml")),
    "compiling": Case(("info", "large.xml")),
    "compiling for ever": Case(("trace", "endless.xml", "-o", "out.csv"), ("out.csv",), endless=True),
}
QUICK = (("compiling for ever", 1.2, signal.SIGTERM), ("trace", 0.1, signal.SIGINT))  # of what cannot have ended

Whole = tuple[Ended, dict[str, bytes]]  # a run that nothing disturbed, and the files that are there then


@dataclass
class Signals:
    """Sends signals to runs of cases."""

    folder: Path
    tally: Tally = field(default_factory=Tally)
    too_early: int = 0
    slowest: float = 0

    def make_inputs(self, *, with_log: bool) -> None:
        """The files that the cases read, the log of measurements only on request."""
        inputs = self.folder / "inputs"
        inputs.mkdir()
        (inputs / "scene.xml").write_text(SCENE)
        (inputs / "large.xml").write_text(MANY.format(4000))
        (inputs / "endless.xml").write_text(MANY.format(10**6))
        (inputs / "all.yaml").write_text(DOCUMENT)
        (inputs / "hanging").write_text(HANGING)
        (inputs / "hanging").chmod(0o755)
        if not with_log:
            return
        damped = ("--set", "joint/hinge.damping=0.3", "--rate", "100", "--probe", "qpos")
        with RealCommand(("trace", "scene.xml", *damped, "--duration", "3", "-o", "log.csv"), inputs) as run:
            ended = run.wait(HANG)
            assert ended.code == 0, ended

    def undisturbed(self, case: Case) -> Whole:
        """The case, left alone."""
        with self._start(case) as run:
            ended = run.wait(HANG)
            self.tally.expect(ended.code == 0 and not run.leftovers(5), f"undisturbed: {ended}")
            return ended, contents(run.folder)

    def send(self, name: str, number: signal.Signals, moment: float, whole: Whole | None) -> None:
        """Sends a signal at a moment [s after the start], and judges how the run ends."""
        case = CASES[name]
        with self._start(case) as run:
            before = contents(run.folder)
            time.sleep(moment)
            sent = time.monotonic()
            run.process.send_signal(number)
            ended = run.wait(HANG)
            took = time.monotonic() - sent
            faults = run.leftovers(5)
            limit = max(AT_MOST, PULSES * _pulse())
            if _in_python(ended):
                self.too_early += 1
                return

            has_finished = whole is not None and ended.code == whole[0].code
            if ended.code not in (128 + number, -number) and not has_finished:
                faults.append("another exit code")
            if took > limit:
                faults.append(f"{took:.2f} s after the signal, {limit:.2f} s allowed")
            self.slowest = max(self.slowest, took)
            faults += noise(ended)
            after = contents(run.folder)
            states = [whole[1]] if has_finished and whole else [before, *([whole[1]] if whole else [])]
            if case.resumes:
                faults += self._resumption(run.folder, case, whole)
            elif after not in states:
                faults.append(f"files: {_changes(before, after)}")
            self.tally.expect(not faults, f"{name}, {number.name} at {moment:.2f} s: {'; '.join(faults)}: {ended}")

    def _resumption(self, folder: Path, case: Case, whole: Whole | None) -> list[str]:
        """What is wrong with what the same command makes of what it finds."""
        with RealCommand(case.arguments, folder) as run:
            ended = run.wait(HANG)
            if ended.code != 0:
                return [f"not continued: {ended}"]
            assert whole is not None
            missing = set(whole[1]) - set(contents(folder))
            missing = {name for name in missing if "/parts/" not in name}
            return [f"continued without {', '.join(sorted(missing))}"] if missing else []

    def _start(self, case: Case) -> RealCommand:
        folder = Path(tempfile.mkdtemp(dir=self.folder))
        shutil.copytree(self.folder / "inputs", folder, dirs_exist_ok=True)
        for name in case.replaces:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(b"old")
        encoder = {"IMAGEIO_FFMPEG_EXE": str(folder / "hanging")} if case.hanging_encoder else {}
        return RealCommand(case.arguments, folder, encoder)


def _pulse() -> float:
    """How long an empty Python takes to start and end now [s]."""
    began = time.monotonic()
    subprocess.run([sys.executable, "-c", "pass"], check=True)
    return time.monotonic() - began


def _in_python(ended: Ended) -> bool:
    """Whether the signal came before Python had read the first line of mjrun, about which nobody can do anything."""
    lines = [line for line in ended.message.splitlines() if line.lstrip().startswith("File ")]
    return bool(noise(ended)) and not any(f'"{ROOT}/mjrun/' in line for line in lines)


def _changes(before: dict[str, bytes], after: dict[str, bytes]) -> str:
    names = sorted(name for name in {*before, *after} if before.get(name) != after.get(name))
    return ", ".join(f"{name} ({len(after[name])} bytes)" if name in after else f"{name} (gone)" for name in names)


def run(quick: bool) -> Tally:
    """Draws the moments of each case from the time that it takes."""
    generator = random.Random(SEED)
    with tempfile.TemporaryDirectory() as folder:
        signals = Signals(Path(folder))
        signals.make_inputs(with_log=not quick)
        for name, moment, number in QUICK if quick else ():
            signals.send(name, number, moment, None)
        for name, case in {} if quick else CASES.items():
            whole = None if case.endless else signals.undisturbed(case)
            longest = ENDLESS if whole is None else whole[0].seconds
            for part in range(MOMENTS):
                number = generator.choice([signal.SIGINT, signal.SIGTERM])
                signals.send(name, number, longest * (part + generator.random()) / MOMENTS, whole)
    if signals.too_early:
        signals.tally.left_out.append(
            f"{signals.too_early} signals came before Python had read the first line of mjrun, and Python ended"
        )
    return signals.tally


MEASURE = Measure(
    "SIGINT, SIGTERM",
    "ends within 1 s (a busy machine: in the time of ten empty Pythons), 130/143, nothing half-written, no orphan",
    200,
    run,
)
