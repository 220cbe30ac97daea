"""Milliseconds per frame of one view and of all views of a camera, and of each quality, in one process.

Ratios are to colour alone at the model's quality. Scene update and drawing are timed, not encoding.

    python benchmarks/views.py
    python benchmarks/views.py --size 1280x720 --models scenes/humanoid.xml
"""

import argparse
import statistics
import time
from pathlib import Path

import mujoco

from mjrun.camera.argument import parse_camera
from mjrun.camera.motion import CameraMotion
from mjrun.job.simulation import Simulation
from mjrun.rendering.backend import Backend
from mjrun.rendering.backend_detection import BackendDetection
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.segmentation import Segmentation
from mjrun.rendering.visual import Visual

ROOT = Path(__file__).resolve().parents[1]
MODELS = [ROOT / "scenes/dominos.xml", ROOT / "../shared/models/humanoid/22_humanoids.xml"]
CASES = {
    "rgb": ("model", ["rgb"]),
    "depth": ("model", ["depth"]),
    "rgb + depth + seg": ("model", ["rgb", "depth", "seg"]),
    "high": ("high", ["rgb"]),
    "draft": ("draft", ["rgb"]),
}


def cost(model: mujoco.MjModel, size: tuple[int, int], backend: Backend, case: str, frames: int) -> float:
    """The median of seconds per frame, after a frame that compiles shaders."""
    quality, views = CASES[case]
    state = Simulation(model).stepper(model).state()
    free = CameraMotion(parse_camera("free", model), model, size).pose(state)
    found = []
    with ClassicRenderer(model, size, backend, Visual(quality=quality), Segmentation(model)) as renderer:
        for _ in range(frames + 1):
            start = time.perf_counter()
            renderer.look(state)
            renderer.picture(free, views)
            found.append(time.perf_counter() - start)
    return statistics.median(found[1:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=Path, nargs="+", default=MODELS)
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--frames", type=int, default=10)
    given = parser.parse_args()
    backend = BackendDetection("auto").result()
    width, height = map(int, given.size.split("x"))
    print(f"{given.size}, {backend.renderer}")
    for path in given.models:
        model = mujoco.MjModel.from_xml_path(str(path))
        costs = {case: cost(model, (width, height), backend, case, given.frames) for case in CASES}
        shown = "   ".join(f"{name} {1e3 * c:.1f} ms ({c / costs['rgb']:.3f})" for name, c in costs.items())
        print(f"{path.stem:14} {shown}")


if __name__ == "__main__":
    main()
