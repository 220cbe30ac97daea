"""The stages of `mj_step`: its instant, in which every derived field belongs to the state, and its integrator.

Between the two stages the data can be read without a second computation of the instant.
"""

from collections.abc import Callable, Collection
from functools import partial

import mujoco
import numpy as np

from mjrun.model import state

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
    *state.FIELDS,
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
