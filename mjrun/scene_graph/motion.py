"""The motion of a scene: the poses of its moving nodes at each frame."""

from collections.abc import Iterable, Sequence

import mujoco
import numpy as np

from mjrun.model.state import restore, widened
from mjrun.scene_graph.graph import SceneGraph, SceneMotion
from mjrun.scene_graph.walk import matrix_quaternion, toward


def scene_motion(
    graph: SceneGraph, model: mujoco.MjModel, states: Iterable[np.ndarray], times: Sequence[float]
) -> SceneMotion:
    """Computes the poses of all moving nodes.

    Args:
      model: the model of the graph.
      states: the integration state of each frame.
      times: the time of each frame in the file [s].
    """
    moving = graph.moving
    nodes = [graph.nodes[index] for index in moving]
    of_kind = {kind: [i for i, node in enumerate(nodes) if node.kind == kind] for kind in ("body", "camera", "light")}
    ids = {kind: [nodes[i].id for i in chosen] for kind, chosen in of_kind.items()}
    positions, quaternions = np.empty((len(times), len(nodes), 3)), np.empty((len(times), len(nodes), 4))
    data = mujoco.MjData(model)
    for frame, state in enumerate(states):
        restore(model, data, widened(model, state))
        compute_poses(model, data)
        positions[frame, of_kind["body"]] = data.xpos[ids["body"]]
        quaternions[frame, of_kind["body"]] = data.xquat[ids["body"]]
        positions[frame, of_kind["camera"]] = data.cam_xpos[ids["camera"]]
        positions[frame, of_kind["light"]] = data.light_xpos[ids["light"]]
        for i, camera in zip(of_kind["camera"], ids["camera"], strict=True):
            quaternions[frame, i] = matrix_quaternion(data.cam_xmat[camera])
        for i, light in zip(of_kind["light"], ids["light"], strict=True):
            quaternions[frame, i] = toward(data.light_xdir[light])
    return SceneMotion(np.asarray(times, float), moving, positions, quaternions)


def compute_poses(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Computes the poses of bodies, geoms, sites, cameras and lights."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
