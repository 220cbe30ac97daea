"""The integration state: everything that a simulation needs to continue bit for bit.

It does not include which bodies sleep: a restored simulation with `sleep` enabled starts awake. A step of `mj_step` has
two stages: its instant, in which every derived field belongs to the state, and its integrator. Between them the data
can be read without a second computation of the instant.
"""

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any

import mujoco
import numpy as np

from mjrun.model.names import names, object_names

STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)  # FULLPHYSICS lacks the warm start: not bit-identical
INPUTS = int(mujoco.mjtState.mjSTATE_USER)  # controls, applied forces, mocap poses, active equalities, userdata
MOTION = ("qpos", "qvel", "act", "history", "plastic")  # the fields that inputs move
# Inputs that a step uses from its beginning on: for poses and constraints, or in callbacks.
POSITION_INPUTS = ("eq_active", "mocap_pos", "mocap_quat", "userdata")
INPUT_FIELDS = ("ctrl", "qfrc_applied", "xfrc_applied", *POSITION_INPUTS)
CTRL = int(mujoco.mjtState.mjSTATE_CTRL)
APPLIED_FORCES = int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)
# The sizes that determine an integration state, by MuJoCo's names.
SIZES = ("nq", "nv", "na", "nu", "nbody", "neq", "nmocap", "nhistory", "nuserdata", "npluginstate", "nplastic")
# The fields of MjData in an integration state, in its order, with the size and the width that give their lengths.
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
    """Returns the length of a state of `model`; `spec` selects its parts, as `mjtState` bits."""
    return mujoco.mj_stateSize(model, spec)


def save(model: mujoco.MjModel, data: mujoco.MjData, spec: int = STATE) -> np.ndarray:
    """Returns the state in `data` as a new array `(size,)` float64."""
    state = np.empty(size(model, spec))
    mujoco.mj_getState(model, data, state, spec)
    return state


def restore(model: mujoco.MjModel, data: mujoco.MjData, state: np.ndarray, spec: int = STATE) -> None:
    """Writes `state` to `data`; derived quantities are stale until `mj_forward`."""
    mujoco.mj_setState(model, data, state, spec)


def widened(model: mujoco.MjModel, state: np.ndarray) -> np.ndarray:
    """Returns a state for `model` from that of the same model without its last bodies, on which no force acts."""
    missing = size(model) - len(state)
    return np.insert(state, part(model, APPLIED_FORCES).stop - missing, np.zeros(missing)) if missing else state


def part(model: mujoco.MjModel, spec: int) -> slice:
    """Returns the position in an integration state of the parts `spec`: adjacent `mjtState` bits."""
    lowest = spec & -spec
    start = size(model, lowest - 1)
    return slice(start, start + size(model, spec))


def controls(model: mujoco.MjModel) -> slice:
    """Returns the position of the controls in an integration state."""
    return part(model, CTRL)


def moving(model: mujoco.MjModel) -> slice:
    """Returns the position of positions and velocities in an integration state."""
    return part(model, int(mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_QVEL))


def sizes(model: mujoco.MjModel) -> dict[str, int]:
    """Returns the sizes of `model` that determine the layout of its integration states, by MuJoCo's names."""
    return {name: int(getattr(model, name)) for name in SIZES}


def layout(model: mujoco.MjModel) -> dict[str, Any]:
    """Returns what the numbers of an integration state of `model` belong to, as recordings contain it.

    Returns:
      The `sizes`, and `names`: those of joints, actuators and mocap bodies, in the order of the state.
    """
    mocap = np.flatnonzero(model.body_mocapid >= 0)
    bodies = object_names(model, "body", mocap[np.argsort(model.body_mocapid[mocap])].tolist())
    owners = {"joint": names(model, "joint"), "actuator": names(model, "actuator"), "mocap body": bodies}
    return {"sizes": sizes(model), "names": owners}


def fields(model_sizes: Mapping[str, int]) -> dict[str, slice]:
    """Returns the position of each field of MjData in an integration state, in order; empty fields are omitted.

    Args:
      model_sizes: the sizes as `sizes` returns them, and recordings contain them.
    """
    slices: dict[str, slice] = {}
    start = 0
    for name, (counted, each) in FIELDS.items():
        count = each * model_sizes[counted] if counted else each
        if count:
            slices[name] = slice(start, start + count)
        start += count
    return slices


Integrate = Callable[[mujoco.MjModel, mujoco.MjData], None]

FWDINV = int(mujoco.mjtEnableBit.mjENBL_FWDINV)
SPECULATIVE = int(mujoco.mjtEnableBit.mjENBL_SPECULATIVE)
INTEGRATORS: dict[int, Integrate] = {
    int(mujoco.mjtIntegrator.mjINT_EULER): mujoco.mj_Euler,
    int(mujoco.mjtIntegrator.mjINT_RK4): partial(mujoco.mj_RungeKutta, N=4),
    int(mujoco.mjtIntegrator.mjINT_IMPLICIT): mujoco.mj_implicit,
    int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST): mujoco.mj_implicit,
}
ACCELERATION = int(mujoco.mjtStage.mjSTAGE_ACC)
# Fields that are valid once positions and velocities are computed, before forces and accelerations.
MOTION_FIELDS = {
    *FIELDS,
    *("xpos", "xquat", "xmat", "xipos", "ximat", "xanchor", "xaxis", "subtree_com", "cdof", "cinert", "crb", "cvel"),
    *("geom_xpos", "geom_xmat", "site_xpos", "site_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir"),
    *("ten_length", "ten_velocity", "ten_J", "actuator_length", "actuator_velocity", "actuator_moment"),
    *("M", "qfrc_bias", "qfrc_passive", "ncon", "nefc"),
}


def integrator_of(model: mujoco.MjModel) -> Integrate | None:
    """Returns the function that completes a step of `model` after `mj_forward`; None if a step cannot be divided."""
    if model.opt.enableflags & (FWDINV | SPECULATIVE):
        return None
    return INTEGRATORS.get(int(model.opt.integrator))


def need_only_motion(model: mujoco.MjModel, fields: Collection[str]) -> bool:
    """Returns whether `fields` of MjData are valid once positions and velocities are computed."""
    fields = {*fields}
    if (model.sensor_needstage < ACCELERATION).all():
        fields -= {"sensordata"}
    return fields <= MOTION_FIELDS


def is_bounded(values: np.ndarray) -> bool:
    """Returns whether all `values` are within MuJoCo's limit of a stable simulation."""
    return bool(mujoco.mju_norm(values) < mujoco.mjMAXVAL or (abs(values) <= mujoco.mjMAXVAL).all())
