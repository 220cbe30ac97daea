"""Bare MuJoCo, compared with mjrun: does it load a model, with names in UTF-8 and a timestep that can be?"""

import sys
from pathlib import Path

import mujoco
import numpy as np

LOADS, NOT_FINITE, REFUSED = 0, 1, 3


def load(arguments: list[str]) -> int:
    """Loads the model of a path; the exit code tells whether it loads, and whether all its numbers are finite."""
    path = Path(arguments[0])
    try:
        if path.suffix == ".mjb":
            model = mujoco.MjModel.from_binary_path(str(path))
        elif path.suffix in (".zip", ".mjz"):
            model = mujoco.MjSpec.from_file(str(path)).compile()
        else:
            model = mujoco.MjModel.from_xml_path(str(path))
        bytes(model.names).decode()
    except Exception as error:
        sys.stderr.write(f"{error}\n")
        return REFUSED
    if not 0 < model.opt.timestep <= 1e12:
        return REFUSED
    return LOADS if _is_finite(model) and _is_finite(model.opt) else NOT_FINITE


def _is_finite(numbers: mujoco.MjModel | mujoco.MjOption) -> bool:
    """Whether all numbers of a model, or of its options, are finite."""
    values = (getattr(numbers, name) for name in dir(numbers) if not name.startswith("_"))
    arrays = (value for value in values if isinstance(value, float | np.ndarray))
    return all(np.isfinite(array).all() for array in map(np.asarray, arrays) if array.dtype.kind == "f")
