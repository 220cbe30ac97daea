"""Bare MuJoCo, as a run that mjrun's is compared with: does it load a model?"""

import sys
from pathlib import Path

import mujoco

LOADS, REFUSED = 0, 3


def load(arguments: list[str]) -> int:
    """Loads the model of a path; the exit code that a command which only loads it should have."""
    path = Path(arguments[0])
    try:
        if path.suffix == ".mjb":
            mujoco.MjModel.from_binary_path(str(path))
        elif path.suffix in (".zip", ".mjz"):
            mujoco.MjSpec.from_file(str(path)).compile()
        else:
            mujoco.MjModel.from_xml_path(str(path))
    except Exception as error:
        sys.stderr.write(f"{error}\n")
        return REFUSED
    return LOADS
