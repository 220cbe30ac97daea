"""Memory is flat: 10,000 frames, points or episodes, or a million rows, take no more of it than a warm-up did."""

import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tests.scoreboard.command import ROOT
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Measure, Tally

LIMIT = 3600.0  # seconds, on a machine that does much else
PAUSE = 0.05  # seconds between two looks
MOST = 10 * 2**20  # bytes of growth
MOST_MODELS = 64 * 2**20  # the same where each has a model: what malloc keeps of freed ones varies by a third of it
INPUTS = inputs_of(__name__)
MODEL = INPUTS["MODEL"]
TASK = INPUTS["TASK"]
# Half a MiB when compiled, of which every episode has its own: hundreds of them show what is not freed.
LARGE = INPUTS["LARGE"]
VARIED = INPUTS["VARIED"]
DRIVEN = MODEL.replace("</worldbody>", '</worldbody><actuator><motor name="motor" joint="up"/></actuator>')
# A process of little memory of its own starts the command, as the peak of one that becomes another counts for that.
START = (
    "import resource, subprocess, sys; code = subprocess.call(sys.argv[2:]); "
    "open(sys.argv[1], 'w').write(str(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)); sys.exit(code)"
)


@dataclass(frozen=True)
class Growing:
    """A command line whose work grows.

    Attributes:
      what: there is more of.
      line: after `mjrun`, split at spaces, with `{n}` for how many, and `{seconds}` for as many thousandths.
      warm, whole: how many there are after the warm-up, by when buffers are full, and in all.
      most: bytes of growth.
    """

    what: str
    line: str
    warm: int
    whole: int
    most: int = MOST

    def arguments(self, count: int) -> list[str]:
        """After `mjrun`."""
        seconds = f"{count // 1000}.{count % 1000:03}"
        return self.line.replace("{n}", str(count)).replace("{seconds}", seconds).split(" ")


DRAWN = "--size 64x48 --camera side --quality draft --fps 1000 --duration {seconds}"
ROWS = "trace model.xml --steps {n} --probe qpos,qvel,energy"
SWEEP = "sweep model.xml --steps 2 --vary geom/ball.mass=uniform(1,2) --metric x=last(qpos/up) --samples {n} --jobs 2"
MODELS = "sweep large.xml --steps 2 --vary site/tip.pos[2]=uniform(0,.1) --vary geom/floor.friction[0]=uniform(.5,1)"
MODELS += " --metric x=last(qpos/up) --jobs 1 -o study"
EPISODES = "eval varied.yaml --policy zero --episodes {n} --jobs 1 -o results"
QUICK = (
    Growing("rows", f"{ROWS} -o out.csv", 20_000, 120_000),
    Growing("models of episodes", EPISODES, 150, 450, MOST_MODELS),
)
CASES = (
    *(
        Growing("rows", f"{ROWS} -o out.{suffix}", 400_000, 1_400_000)
        for suffix in ("csv", "parquet", "feather", "jsonl")
    ),
    *(  # which read columns back in pieces of a group
        Growing("rows", f"{ROWS} -o out.{suffix}", 800_000, 1_800_000) for suffix in ("npz", "h5")
    ),
    Growing("rows", f"{ROWS} --csv", 400_000, 1_400_000),
    Growing("rows", f"{ROWS} --contacts touch.npz -o out.npz", 400_000, 1_400_000),
    Growing("rows", f"{ROWS} --assert max(qpos/up)<1 --recording states.npz -o out.csv", 400_000, 1_400_000),
    Growing("frames", f"video model.xml {DRAWN} -o out.mp4", 1000, 11_000),
    Growing("frames", f"video model.xml {DRAWN} -o out/", 1000, 11_000),
    Growing("frames", f"video model.xml {DRAWN} --plot qpos --view rgb --view depth -o out.mkv", 1000, 11_000),
    # Parquet's dictionaries of ten thousand different numbers are full.
    Growing("points", f"{SWEEP} -o study", 11_000, 21_000),
    Growing("episodes", "eval task.yaml --policy zero --episodes {n} --jobs 2 -o results", 11_000, 21_000),
    Growing("models of episodes", EPISODES, 500, 10_500, MOST_MODELS),
    Growing("models of points", f"{MODELS} --samples {{n}}", 1000, 11_000, MOST_MODELS),
    Growing("models of points in a chunk", f"{MODELS} --samples 600 --chunk {{n}}", 64, 600, MOST_MODELS),
)


@dataclass(frozen=True)
class Peak:
    """The memory of a command line.

    Attributes:
      largest: the peak of the largest of its processes [bytes], as the kernel counts.
      together: that of all their private memory, as it was seen [bytes].
    """

    largest: int
    together: int


def run(quick: bool) -> Tally:
    tally = Tally()
    for case in QUICK if quick else CASES:
        peaks: list[Peak] = []
        for count in (case.warm, case.whole):
            with tempfile.TemporaryDirectory() as folder:
                code, peak = _peak(case.arguments(count), Path(folder))
            tally.expect(code == 0, f"{case.line}: {count:,} {case.what}: exit code {code}")
            peaks.append(peak)
        for name in ("largest", "together"):
            first, last = (getattr(peak, name) for peak in peaks)
            sizes = f"{first / 2**20:.1f} MiB for {case.warm:,}, {last / 2**20:.1f} MiB for {case.whole:,} {case.what}"
            tally.expect(last - first <= case.most, f"{case.line}: {sizes} ({name})")
    return tally


def _peak(arguments: list[str], folder: Path) -> tuple[int, Peak]:
    """The exit code of a command line, and its memory."""
    (folder / "model.xml").write_text(DRIVEN)
    (folder / "task.yaml").write_text(TASK)
    (folder / "large.xml").write_text(LARGE)
    (folder / "varied.yaml").write_text(VARIED)
    largest = folder / "largest"
    process = subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", START, str(largest), sys.executable, "-m", "mjrun", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    together, deadline = 0, time.monotonic() + LIMIT
    while process.poll() is None:
        together = max(together, sum(map(_private, _descendants(process.pid))))
        if time.monotonic() > deadline:
            os.killpg(process.pid, 9)
        time.sleep(PAUSE)
    return process.returncode, Peak(1024 * int(largest.read_text() or 0) if largest.exists() else 0, together)


def _descendants(pid: int) -> list[int]:
    """The process and all that it has started, however they call themselves."""
    found = [pid]
    for each in found:
        with suppress(OSError):
            for tasks in Path(f"/proc/{each}/task").iterdir():
                found += map(int, (tasks / "children").read_text().split())
    return found


def _private(pid: int) -> int:
    """The memory that a process has not from a file [bytes], shared by those that share it; none if it has ended."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss_Anon:"):
                return 1024 * int(line.split()[1])
    return 0


MEASURE = Measure(
    "memory: 10,000 frames, 1,000,000 rows, 10,000 points and episodes",
    "≤ 10 MiB more after the warm-up, ≤ 64 MiB where each point or episode has a model",
    60,
    run,
)
