"""Milliseconds per frame of one view and of all views of a camera, and of each quality, in one process.

Ratios are relative to colour alone at the model's quality, of wall time and of the time of all cores. Scene update and
drawing are timed, without encoding.

    python benchmarks/views.py
    python benchmarks/views.py --size 1280x720 --models scenes/humanoid.xml
"""

import argparse
import statistics
import time
from contextlib import ExitStack, closing
from pathlib import Path

import mujoco

from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.rendering.backend import BackendDetector, WorkingBackend
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.visual import SegmentationIds, Visual
from mjrun.simulation.simulation import Simulation

ROOT = Path(__file__).resolve().parents[1]
MODELS = [ROOT / "scenes/dominos.xml", ROOT / "../shared/models/humanoid/22_humanoids.xml"]
CASES = {
    "rgb": ("model", ["rgb"]),
    "depth": ("model", ["depth"]),
    "rgb + depth + seg": ("model", ["rgb", "depth", "seg"]),
    "high": ("high", ["rgb"]),
    "draft": ("draft", ["rgb"]),
}


def costs(
    model: mujoco.MjModel, size: tuple[int, int], backend: WorkingBackend, frames: int
) -> dict[str, list[tuple[float, float]]]:
    """Times cases alternately, after a frame that compiles shaders: seconds of wall time and of all cores per frame."""
    state = Simulation(model).stepper(model).state()
    free = BoundCameraScript(parse_camera("free", model), model, size).pose(state)
    found: dict[str, list[tuple[float, float]]] = {case: [] for case in CASES}
    with ExitStack() as stack:
        renderers = {
            quality: stack.enter_context(
                closing(ClassicRenderer(model, size, backend, Visual(quality=quality), SegmentationIds(model)))
            )
            for quality in dict.fromkeys(quality for quality, _ in CASES.values())
        }
        for _ in range(frames + 1):
            for case, (quality, views) in CASES.items():
                renderers[quality].make_current()
                start, cpu = time.perf_counter(), time.process_time()
                renderers[quality].set_state(state)
                renderers[quality].render(free, views)
                found[case].append((time.perf_counter() - start, time.process_time() - cpu))
    return {case: times[1:] for case, times in found.items()}


def ratio(times: list[tuple[float, float]], base: list[tuple[float, float]], which: int) -> float:
    """Returns the median of the ratios of each turn, which cancels what slows down both."""
    return statistics.median(one[which] / other[which] for one, other in zip(times, base, strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=Path, nargs="+", default=MODELS)
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--frames", type=int, default=10)
    options = parser.parse_args()
    backend = BackendDetector("auto").result()
    width, height = map(int, options.size.split("x"))
    print(f"{options.size}, {backend.renderer}")
    for path in options.models:
        model = mujoco.MjModel.from_xml_path(str(path))
        measured = costs(model, (width, height), backend, options.frames)
        shown = "   ".join(
            f"{name} {1e3 * statistics.median(wall for wall, _ in times):.1f} ms "
            f"({ratio(times, measured['rgb'], 0):.3f}, of all cores {ratio(times, measured['rgb'], 1):.3f})"
            for name, times in measured.items()
        )
        print(f"{path.stem:14} {shown}")


if __name__ == "__main__":
    main()
