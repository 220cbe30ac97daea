"""SIGINT and SIGTERM at random moments of every command, run as users run it: it ends, and leaves nothing behind."""

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tests.scoreboard.command import ROOT, VARIABLES, Ended, contents
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Tally, measured

SEED = 17
MOMENTS = 10  # of each case
AT_MOST = 1.0  # [s] from the signal to the end, on a quiet machine
PULSES = 10  # how often an empty Python can start and end in that time, on a busy one
HANG = 90.0  # [s]
ENDLESS = 3.0  # [s] in which moments of endless cases are drawn
MANY = '<mujoco><worldbody><replicate count="{}" offset="0.1 0 0"><geom size="0.01"/></replicate></worldbody></mujoco>'
HANGING = "#!/bin/sh\nsleep 600 &\nexec sleep 600\n"  # an ffmpeg with a child that holds its standard error
MARK = "MJRUN_SCOREBOARD_RUN"
BEGINNING = ("__init__.py", "__main__.py")  # of the package, before `main` holds signals back
NOISE = ("Traceback (most recent call last)", "Exception ignored", "KeyboardInterrupt", "Fatal Python error")


@dataclass(frozen=True)
class Case:
    """A command line, and its outputs.

    Attributes:
      line: the command line after `mjrun`.
      replaces: older outputs that exist before it starts.
      resumes: true if it keeps results in a folder, from which the same command continues.
      endless: true if it never ends by itself.
      hanging_encoder: true if its ffmpeg never ends.
    """

    line: str
    replaces: tuple[str, ...] = ()
    resumes: bool = False
    endless: bool = False
    hanging_encoder: bool = False


INPUTS = inputs_of(__name__)
SCENE, DOCUMENT = INPUTS["SCENE"], INPUTS["DOCUMENT"]
CASES = {name: Case(**settings) for name, settings in INPUTS["CASES"].items()}
# Early; a busy machine may be late.
QUICK = (("compiling for ever", 1.2, signal.SIGTERM), ("trace", 0.1, signal.SIGINT))


@dataclass
class RealCommand:
    """One run of mjrun in a new interpreter, which starts at once.

    All processes that a run starts inherit its mark, by which they are found later.

    Attributes:
      arguments: the command line after `mjrun`.
      folder: the working folder.
      environment: variables to set.
      temporary: its folder for temporary files, which must be empty in the end.
    """

    arguments: tuple[str | bytes, ...]
    folder: Path
    environment: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._mark = uuid.uuid4().hex
        self._home = tempfile.TemporaryDirectory()
        self.temporary = Path(self._home.name, "tmp")
        self.temporary.mkdir()
        variables = {**os.environ, **VARIABLES, "TMPDIR": str(self.temporary), MARK: self._mark}
        self._began = time.monotonic()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is signal.SIG_IGN:  # as in the background of a shell; runs inherit it
                signal.signal(number, signal.SIG_DFL)
        with self._stream("stdout").open("wb") as stdout, self._stream("stderr").open("wb") as stderr:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "mjrun", *self.arguments],
                cwd=self.folder,
                env={**variables, **self.environment},
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=stderr,
                start_new_session=True,
            )

    def __enter__(self) -> "RealCommand":
        return self

    def __exit__(self, *_: object) -> None:
        """Kills all processes that still run."""
        for pid in self.running():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()
        self._home.cleanup()

    def wait(self, limit: float) -> Ended:
        """Returns the result, waiting for at most `limit` [s]."""
        try:
            code: int | None = self.process.wait(limit)
        except subprocess.TimeoutExpired:
            code = None
        out, err = (self._stream(name).read_bytes() for name in ("stdout", "stderr"))
        line = tuple(os.fsdecode(argument) for argument in self.arguments)
        return Ended(line, code, out, err, time.monotonic() - self._began)

    def running(self) -> list[int]:
        """Returns the processes of this run that have not ended."""
        mark, found = f"{MARK}={self._mark}".encode(), list[int]()
        for environment in Path("/proc").glob("[0-9]*/environ"):
            with contextlib.suppress(OSError):
                if mark in environment.read_bytes():
                    found.append(int(environment.parent.name))
        return found

    def leftovers(self, grace: float) -> list[str]:
        """Returns what an ended run has left: processes after `grace` [s], temporary files, hidden files."""
        deadline = time.monotonic() + grace
        while self.running() and time.monotonic() < deadline:
            time.sleep(0.02)
        found = [f"process {pid}: {_command_line(pid)}" for pid in self.running()]
        found += [f"temporary file {path.name}" for path in self.temporary.iterdir()]
        found += [f"file {path.relative_to(self.folder)}" for path in self.folder.rglob(".*.part")]
        return found

    def _stream(self, name: str) -> Path:
        return Path(self._home.name, name)


Whole = tuple[Ended, dict[str, bytes]]  # an undisturbed run, and the files after it


@dataclass
class Signals:
    """Runs cases and sends them signals."""

    folder: Path
    tally: Tally = field(default_factory=Tally)
    at_most: float = AT_MOST
    too_early: int = 0
    slowest: float = 0

    def make_inputs(self, *, with_log: bool) -> None:
        """Writes the files that the cases read; the log of measurements only on request."""
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
        """Runs a case without a signal."""
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
            limit = max(self.at_most, PULSES * _pulse())
            if _too_early(ended):
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
        """Returns the faults of the same command continuing from the files that it finds."""
        with RealCommand(tuple(case.line.split()), folder) as run:
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
        return RealCommand(tuple(case.line.split()), folder, encoder)


def _pulse() -> float:
    """Measures how long an empty Python takes to start and end now [s]."""
    began = time.monotonic()
    subprocess.run([sys.executable, "-c", "pass"], check=True)
    return time.monotonic() - began


def _too_early(ended: Ended) -> bool:
    """Tells whether the signal came before mjrun, which begins with the imports of `BEGINNING`, could hold it back."""
    lines = [line for line in ended.message.splitlines() if line.lstrip().startswith(f'File "{ROOT}/mjrun/')]
    return bool(noise(ended)) and all(any(f"/mjrun/{place}" in line for place in BEGINNING) for line in lines)


def _changes(before: dict[str, bytes], after: dict[str, bytes]) -> str:
    names = sorted(name for name in {*before, *after} if before.get(name) != after.get(name))
    return ", ".join(f"{name} ({len(after[name])} bytes)" if name in after else f"{name} (gone)" for name in names)


def noise(ended: Ended) -> list[str]:
    """Returns the messages of Python itself in the output of a run."""
    return [word for word in NOISE if word in ended.message]


def _command_line(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")[:200]
    except OSError:
        return "(gone)"


@measured(
    "SIGINT, SIGTERM",
    "ends within 1 s (a busy machine: in the time of ten empty Pythons), 130/143, nothing half-written, no orphan",
    200,
)
def signals(quick: bool) -> Tally:
    """Draws the moments of each case from the time that it takes."""
    generator = random.Random(SEED)
    with tempfile.TemporaryDirectory() as folder:
        sender = Signals(Path(folder), at_most=10 * AT_MOST if quick else AT_MOST)  # tests run on busy machines
        sender.make_inputs(with_log=not quick)
        for name, moment, number in QUICK if quick else ():
            case = CASES[name]
            sender.send(name, number, moment, None if case.endless else sender.undisturbed(case))
        for name, case in {} if quick else CASES.items():
            whole = None if case.endless else sender.undisturbed(case)
            longest = ENDLESS if whole is None else whole[0].seconds
            for part in range(MOMENTS):
                number = generator.choice([signal.SIGINT, signal.SIGTERM])
                sender.send(name, number, longest * (part + generator.random()) / MOMENTS, whole)
    if sender.too_early:
        sender.tally.leave_out(f"{sender.too_early} signals came before mjrun could hold them back, and Python ended")
    return sender.tally
