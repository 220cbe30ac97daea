"""The integration state: all that a simulation needs to go on bit for bit.

Which bodies sleep is not part of it: a restored simulation with `sleep` enabled starts awake.
"""

import mujoco
import numpy as np

STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)  # FULLPHYSICS lacks the warm start: not bit-identical
INPUTS = int(mujoco.mjtState.mjSTATE_USER)  # controls, applied forces, mocap poses, active equalities, userdata
PHYSICS = int(mujoco.mjtState.mjSTATE_PHYSICS)  # what inputs move
CTRL = int(mujoco.mjtState.mjSTATE_CTRL)


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


def controls(model: mujoco.MjModel) -> slice:
    """Where in an integration state the controls are: its parts stand in the order of their bits."""
    start = size(model, CTRL - 1)
    return slice(start, start + model.nu)
