"""Frames per second of `mjrun export --format lerobot`, compared with `mjrun video` of the same episodes and cameras.

Both play the same seeds of a task and render the same cameras. The videos are made one after the other, each on all
cores, with all cameras beside each other in one file; the dataset is made by as many processes as there are cores.
Ratios are frames per second of the export to those of the videos; above 1 is better. A third figure is the dataset
without images, in episodes per second.

    python benchmarks/export_episodes.py
    python benchmarks/export_episodes.py --episodes 16 --size 640x480 --camera fixed --camera track
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path

from measured_process import run

from mjrun.platform.cores import available_cores

ROOT = Path(__file__).resolve().parents[1]
MJRUN = [sys.executable, "-m", "mjrun"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default=str(ROOT / "scenes/car_drive.yaml"))
    parser.add_argument("--policy", default=str(ROOT / "scenes/policies/car_drive.onnx"))
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--fps", default="50", help="rate of actions, of which each has a frame")
    parser.add_argument("--camera", action="append")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    cameras = options.camera or ["fixed", "track"]
    seen = [word for camera in cameras for word in ("--camera", camera)] + ["--size", options.size]
    of_policy = [options.task, "--policy", options.policy, "-q"]
    ratios, rates, frames = list[float](), dict[str, list[float]](), 0
    for _ in range(options.repeats):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            start = time.perf_counter()
            for seed in range(options.episodes):
                output = ["--seed", str(seed), "--fps", options.fps, "-o", str(folder / f"{seed}.mp4")]
                run(*MJRUN, "video", *of_policy, *seen, *output)
            videos = time.perf_counter() - start
            count = ["--episodes", str(options.episodes), "--format", "lerobot"]
            images = run(*MJRUN, "export", *of_policy, *count, *seen, "-o", str(folder / "images"))
            numbers = run(*MJRUN, "export", *of_policy, *count, "-o", str(folder / "numbers"))
            frames = json.loads((folder / "images/meta/info.json").read_text())["total_frames"] * len(cameras)
        measured = {
            "videos": frames / videos,
            "export": frames / images.wall,
            "numbers": options.episodes / numbers.wall,
        }
        for what, rate in measured.items():
            rates.setdefault(what, []).append(rate)
        ratios.append(measured["export"] / measured["videos"])
    what = f"{frames} frames of {', '.join(cameras)}, {options.size}"
    print(f"{options.episodes} episodes, {what}, {available_cores()} cores")
    shown = {what: statistics.median(values) for what, values in rates.items()}
    print(f"mjrun video   {shown['videos']:.1f} frames/s")
    print(f"mjrun export  {shown['export']:.1f} frames/s, {statistics.median(ratios):.2f} of mjrun video")
    print(f"  numbers     {shown['numbers']:.1f} episodes/s, without images")


if __name__ == "__main__":
    main()
