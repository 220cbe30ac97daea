"""Wall time and peak memory of `mjrun video`, compared with the loop of the MuJoCo tutorial.

Both make the same video of the same model, alternately and as whole processes; ratios are mjrun / tutorial, so that
below 1 is better. mjrun draws with one process, with its default number, as a draft, and with values in text over the
frames. The tutorial loop is a script with the arguments MODEL OUT DURATION FPS WIDTH HEIGHT [CAMERA] [KEYFRAME],
specified by --baseline. The floor is the drawing itself: one process per core draws its share of the frames with
mujoco.Renderer, without encoding or storing.

    python benchmarks/video.py
    python benchmarks/video.py --model scenes/humanoid.xml --key jump --duration 2 --repeats 5
"""

import argparse
import math
import os
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import mujoco

from mjrun.platform.cores import available_cores

ROOT = Path(__file__).resolve().parents[1]
BASELINE = ROOT / "../shared/bench/tutorial_video.py"


BARE = """
import sys
import mujoco
path, camera, key, width, height, every, first, stride, count = sys.argv[1:]
model = mujoco.MjModel.from_xml_path(path)
model.vis.global_.offwidth, model.vis.global_.offheight = int(width), int(height)
data = mujoco.MjData(model)
if key:
    mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
with mujoco.Renderer(model, int(height), int(width)) as renderer:
    for frame in range(int(count)):
        if frame % int(stride) == int(first):
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera=-1 if camera == "free" else camera)
            renderer.render()
        mujoco.mj_step(model, data, nstep=round((frame + 1) * float(every)) - round(frame * float(every)))
"""


@dataclass(frozen=True)
class VideoCase:
    """The video that both sides make."""

    model: Path
    duration: str
    fps: str
    width: int
    height: int
    camera: str
    key: str | None

    @property
    def frames(self) -> int:
        """Number of frames."""
        return math.ceil(Fraction(self.duration) * Fraction(self.fps))

    def mjrun(self, out: Path, *options: str) -> list[str]:
        command = [sys.executable, "-m", "mjrun", "video", str(self.model), "-o", str(out), "-q", *options]
        command += ["--duration", self.duration, "--fps", self.fps, "--size", f"{self.width}x{self.height}"]
        return [*command, "--camera", self.camera, *(["--key", self.key] if self.key else [])]

    def tutorial(self, script: Path, out: Path) -> list[str]:
        size = [str(self.width), str(self.height)]
        command = [sys.executable, str(script), str(self.model), str(out), self.duration, self.fps, *size]
        return [*command, self.camera, *([self.key] if self.key else [])]

    def bare(self, share: int, cores: int) -> list[str]:
        every = 1 / (float(Fraction(self.fps)) * mujoco.MjModel.from_xml_path(str(self.model)).opt.timestep)
        options = [str(self.model), self.camera, self.key or "", self.width, self.height]
        return [sys.executable, "-c", BARE, *map(str, [*options, every, share, cores, self.frames])]


@dataclass(frozen=True)
class Cost:
    """Wall time [s] of processes, and the largest resident memory [bytes] of them and their children."""

    wall: float
    peak: int


def run(*commands: list[str], **environment: str) -> Cost:
    """Runs commands side by side without their output, and returns their cost."""
    start, children, peak = time.perf_counter(), {}, 0
    for command in commands:
        child = os.fork()
        if child == 0:
            null = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1):
                os.dup2(null, stream)
            os.execve(command[0], command, {**os.environ, "MUJOCO_GL": "egl", **environment})
        children[child] = command
    for child, command in children.items():
        _, status, usage = os.wait4(child, 0)
        peak = max(peak, usage.ru_maxrss * 1024)
        if status:
            raise SystemExit(f"failed: {' '.join(command)}")
    return Cost(time.perf_counter() - start, peak)


def show(name: str, costs: list[Cost], frames: int) -> None:
    """Prints the median and range of the wall time, the frames per second, and the median peak memory."""
    walls = [cost.wall for cost in costs]
    peak = statistics.median(cost.peak for cost in costs) / 1e6
    print(
        f"{name:27} {statistics.median(walls):7.2f} s  ({min(walls):.2f}-{max(walls):.2f})  "
        f"{frames / statistics.median(walls):6.1f} frames/s  {peak:5.0f} MB"
    )


def show_ratios(name: str, costs: list[Cost], baseline: list[Cost], to: str) -> None:
    """Prints the median of the ratios of adjacent runs."""
    pairs = list(zip(costs, baseline, strict=True))
    wall = statistics.median(a.wall / b.wall for a, b in pairs)
    peak = statistics.median(a.peak / b.peak for a, b in pairs)
    print(f"{f'{name} / {to}':27} wall {wall:.3f}   memory {peak:.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=ROOT / "scenes/dominos.xml")
    parser.add_argument("--duration", default="3")
    parser.add_argument("--fps", default="30")
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--camera", default="free")
    parser.add_argument("--key")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--baseline", type=Path, default=BASELINE)
    given = parser.parse_args()
    if not given.baseline.exists():
        raise SystemExit(f"there is no {given.baseline}; name the tutorial loop with --baseline")
    width, height = map(int, given.size.split("x"))
    video = VideoCase(given.model, given.duration, given.fps, width, height, given.camera, given.key)
    print(f"{video.model.name}, {video.duration} s at {video.fps} fps, {given.size}, {available_cores()} cores")
    ways = {
        "mjrun, 1 process": ("--jobs", "1"),
        "mjrun": (),
        "mjrun draft": ("--quality", "draft"),
        "mjrun text": ("--text", "{time:.2f} s  {energy/total}  {contact_force/normal/z}"),
    }
    costs: dict[str, list[Cost]] = {"tutorial": [], "floor": [], **{name: [] for name in ways}}
    cores = available_cores()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "video.mp4"
        for _ in range(given.repeats):
            costs["tutorial"].append(run(video.tutorial(given.baseline, out)))
            bare = [video.bare(share, cores) for share in range(cores)]
            costs["floor"].append(run(*bare, LP_NUM_THREADS="1"))
            for name, options in ways.items():
                costs[name].append(run(video.mjrun(out, *options)))
    for name, measured in costs.items():
        show(name, measured, video.frames)
    for name in ("floor", *ways):
        show_ratios(name, costs[name], costs["tutorial"], "tutorial")
    show_ratios("mjrun", costs["mjrun"], costs["floor"], "floor")
    show_ratios("mjrun text", costs["mjrun text"], costs["mjrun"], "mjrun")


if __name__ == "__main__":
    main()
