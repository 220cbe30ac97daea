"""MuJoCo's abstract scene, with room for whatever is in it."""

import warnings

import mujoco

from mjrun.camera.pose import Pose, user_camera
from mjrun.model.mujoco_globals import collected_warnings

ALL = mujoco.mjtCatBit.mjCAT_ALL.value


def updated_scene(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    options: mujoco.MjvOption,
    pose: Pose,
    scene: mujoco.MjvScene,
    room: int = 0,
) -> mujoco.MjvScene:
    """`scene` with all that is visible from `pose`, or a larger one with the same flags if it does not fit.

    Args:
      room: geoms for which there must be room beside.
    """
    previous = mujoco.get_mju_user_warning()
    while True:
        pose.place(scene)
        with collected_warnings() as texts:
            mujoco.mjv_updateScene(model, data, options, None, user_camera(), ALL, scene)
        if scene.ngeom + room < scene.maxgeom:
            break
        larger = mujoco.MjvScene(model, max(2 * scene.maxgeom, scene.ngeom + room + 1))
        larger.flags[:] = scene.flags
        scene = larger
    for text in texts:  # but not that an earlier, smaller scene was full
        if previous:
            previous(text)
        else:
            warnings.warn(text, stacklevel=2)
    return scene
