"""Cost of a variant of a model, beside what users write to vary it by hand.

A point of a study or an episode that varies numbers of a model needs its own model. The cost of mjrun's, which is bit
for bit the compiled one, is compared with an edit of an MjSpec that is compiled again, and with numbers that are
written into the compiled model, followed by `mj_setConst`; the latter leaves the inertias of bodies unchanged. All are
timed alternately in one run by CPU time, so that other work on the machine has little effect; ratios are medians of
those of adjacent runs, and below 1 is faster.

    python benchmarks/variation.py
    python benchmarks/variation.py --models ../shared/models/humanoid/humanoid.xml --variants 200
    python benchmarks/variation.py --models ../shared/models/humanoid/humanoid.xml --element 4
"""

import argparse
import copy
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from mjrun.model.mujoco_globals import without_log
from mjrun.model.override import ELEMENTS, Override
from mjrun.model.sources import parse_source
from mjrun.model.variants import VariantLoader

ROOT = Path(__file__).resolve().parents[1]
MODELS = [ROOT / "../shared/models/humanoid/humanoid.xml", ROOT / "../shared/models/car/car.xml"]
# A field of an element of the kind, and the array that a user writes.
FIELDS = {
    "geom.friction": "geom_friction",
    "body.pos": "body_pos",
    "joint.damping": "dof_damping",
    "geom.size": "geom_size",
}


def ours(path: str, target: str, factors: np.ndarray) -> Callable[[], None]:
    """Returns a function that loads the variants as a study does."""
    variants = VariantLoader()

    def run() -> None:
        for factor in factors.tolist():
            variants.reuse(variants.load(parse_source(path, [Override(f"scale:{target}", repr(factor))])))

    return run


def compiled(path: str, kind: str, field: str, index: int, factors: np.ndarray) -> Callable[[], None]:
    """Returns a function that edits a specification and compiles it."""
    spec = mujoco.MjSpec.from_file(path)

    def run() -> None:
        for factor in factors.tolist():
            edited = spec.copy()
            element = getattr(edited, ELEMENTS[kind])[index]
            setattr(element, field, np.array(getattr(element, field)) * factor)
            edited.compile()

    return run


def written(path: str, array: str, index: int, factors: np.ndarray) -> Callable[[], None]:
    """Returns a function that writes into the compiled model."""
    model = mujoco.MjModel.from_xml_path(path)
    varied, data = copy.copy(model), mujoco.MjData(model)

    def run() -> None:
        for factor in factors.tolist():
            getattr(varied, array)[index] = getattr(model, array)[index] * factor
            mujoco.mj_setConst(varied, data)

    return run


def seconds(run: Callable[[], None]) -> float:
    """Returns the CPU time of a function [s]."""
    start = time.process_time()
    run()
    return time.process_time() - start


def compare(path: Path, name: str, index: int, count: int, repeats: int) -> None:
    """Prints the row of a field of an element of a model."""
    kind, field = name.split(".")
    factors = np.random.default_rng(0).uniform(0.9, 1.1, count)
    spec = mujoco.MjSpec.from_file(str(path))
    element = getattr(spec, ELEMENTS[kind])[index]
    runs = [
        ours(str(path), f"{kind}/{element.name or index}.{field}", factors),
        compiled(str(path), kind, field, index, factors),
        written(str(path), FIELDS[name], index, factors),
    ]
    for run in runs:
        run()  # warms up, and proves the first values
    times = [[seconds(run) for run in runs] for _ in range(repeats)]
    own, compiling, writing = (1e3 * statistics.median(column) / count for column in zip(*times, strict=True))
    against = [statistics.median(row[0] / row[index] for row in times) for index in (1, 2)]
    print(
        f"{path.stem:12} {name:14} mjrun {own:6.3f} ms   compiled {compiling:6.3f} ms   written {writing:6.3f} ms   "
        f"{against[0]:5.2f} x compiled {against[1]:6.2f} x written"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=Path, nargs="+", default=MODELS)
    parser.add_argument("--element", type=int, default=1, help="index of the body, joint and geom that vary")
    parser.add_argument("--variants", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    with without_log():
        for path in given.models:
            for name in FIELDS:
                compare(path, name, given.element, given.variants, given.repeats)


if __name__ == "__main__":
    main()
