"""The integration state: all that a simulation needs to go on bit for bit.

Which bodies sleep is not part of it: a restored simulation with `sleep` enabled starts awake.
"""

import mujoco
import numpy as np

STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)  # FULLPHYSICS lacks the warm start: not bit-identical


def size(model: mujoco.MjModel) -> int:
    """Numbers in a state of `model`."""
    return mujoco.mj_stateSize(model, STATE)


def save(model: mujoco.MjModel, data: mujoco.MjData, into: np.ndarray | None = None) -> np.ndarray:
    """The state in `data` as an array `(size,)` float64: `into`, or a new one."""
    state = np.empty(size(model)) if into is None else into
    mujoco.mj_getState(model, data, state, STATE)
    return state


def restore(model: mujoco.MjModel, data: mujoco.MjData, state: np.ndarray) -> None:
    """Puts `state` into `data`; what is derived from it is stale until `mj_forward`."""
    mujoco.mj_setState(model, data, state, STATE)
