"""Bare MuJoCo, compared with mjrun: does it load a model, with names in UTF-8 and a timestep that can be?"""

import math
import sys
from pathlib import Path

import mujoco

LOADS, REFUSED = 0, 3


def load(arguments: list[str]) -> int:
    """Loads the model of a path; the exit code that a command which only loads it should have."""
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
    return LOADS if 0 < model.opt.timestep < math.inf else REFUSED
