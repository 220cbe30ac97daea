"""Known bugs of the installed MuJoCo, and the models that they affect."""

import mujoco

SPARSE_NEWTON = (
    "MuJoCo 4.0.0 factors the sparse Newton matrix wrongly for some models (issue 3767, fixed in 4.0.1); "
    "upgrade, or set opt.jacobian=dense"
)


def bugs_of_version(version: str) -> list[str]:
    """Returns the known bugs of a version of MuJoCo."""
    return [SPARSE_NEWTON] if version == "4.0.0" else []


def bugs_of_model(model: mujoco.MjModel) -> list[str]:
    """Returns the known bugs of the installed MuJoCo that can change the motion of `model`."""
    sparse_newton = model.opt.solver == mujoco.mjtSolver.mjSOL_NEWTON and mujoco.mj_isSparse(model)
    return bugs_of_version(mujoco.mj_versionString()) if sparse_newton else []
