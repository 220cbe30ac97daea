"""The integration state: all that a simulation needs to go on bit for bit.

Which bodies sleep is not part of it: a restored simulation with `sleep` enabled starts awake.
"""

from collections.abc import Mapping

import mujoco
import numpy as np

STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)  # FULLPHYSICS lacks the warm start: not bit-identical
INPUTS = int(mujoco.mjtState.mjSTATE_USER)  # controls, applied forces, mocap poses, active equalities, userdata
PHYSICS = int(mujoco.mjtState.mjSTATE_PHYSICS)  # what inputs move
CTRL = int(mujoco.mjtState.mjSTATE_CTRL)
APPLIED_FORCES = int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)
# What an integration state consists of, in MuJoCo's own names for sizes.
SIZES = ("nq", "nv", "na", "nu", "nbody", "neq", "nmocap", "nhistory", "nuserdata", "npluginstate", "nplastic")
# The fields of MjData that an integration state holds, in the order in which it does, and how many numbers each has.
FIELDS: dict[str, tuple[str, int]] = {
    "time": ("", 1),
    "qpos": ("nq", 1),
    "qvel": ("nv", 1),
    "act": ("na", 1),
    "history": ("nhistory", 1),
    "qacc_warmstart": ("nv", 1),
    "ctrl": ("nu", 1),
    "qfrc_applied": ("nv", 1),
    "xfrc_applied": ("nbody", 6),
    "eq_active": ("neq", 1),
    "mocap_pos": ("nmocap", 3),
    "mocap_quat": ("nmocap", 4),
    "userdata": ("nuserdata", 1),
    "plugin_state": ("npluginstate", 1),
    "plastic": ("nplastic", 1),
}


def size(model: mujoco.MjModel, spec: int = STATE) -> int:
    """Numbers in a state of `model`; `spec` says which parts, as `mjtState` bits."""
    return mujoco.mj_stateSize(model, spec)


def save(model: mujoco.MjModel, data: mujoco.MjData, spec: int = STATE) -> np.ndarray:
    """The state in `data` as a new array `(size,)` float64."""
    state = np.empty(size(model, spec))
    mujoco.mj_getState(model, data, state, spec)
    return state


def restore(model: mujoco.MjModel, data: mujoco.MjData, state: np.ndarray, spec: int = STATE) -> None:
    """Puts `state` into `data`; what is derived from it is stale until `mj_forward`."""
    mujoco.mj_setState(model, data, state, spec)


def part(model: mujoco.MjModel, spec: int) -> slice:
    """Where in an integration state the components of `spec` are: `mjtState` bits side by side, whose order it has."""
    lowest = spec & -spec
    start = size(model, lowest - 1)
    return slice(start, start + size(model, spec))


def controls(model: mujoco.MjModel) -> slice:
    """Where in an integration state the controls are."""
    return part(model, CTRL)


def sizes(model: mujoco.MjModel) -> dict[str, int]:
    """The sizes of `model` from which the layout of its integration states follows, by MuJoCo's names."""
    return {name: int(getattr(model, name)) for name in SIZES}


def fields(model_sizes: Mapping[str, int]) -> dict[str, slice]:
    """Where in an integration state each field of MjData is, in order; those of no size are left out.

    Args:
      model_sizes: as `sizes` gives them, and recordings hold them.
    """
    slices: dict[str, slice] = {}
    start = 0
    for name, (counted, each) in FIELDS.items():
        count = each * model_sizes[counted] if counted else each
        if count:
            slices[name] = slice(start, start + count)
        start += count
    return slices
