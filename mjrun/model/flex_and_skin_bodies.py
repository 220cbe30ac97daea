"""The bodies of flexes and skins."""

import mujoco
import numpy as np


def carriers(model: mujoco.MjModel, flex: int) -> np.ndarray:
    """Returns the bodies of the vertices of a flex, or of the nodes that its vertices are interpolated between."""
    vertices, nodes = model.flex_vertadr[flex], model.flex_nodeadr[flex]
    rows = (
        model.flex_vertbodyid[vertices : vertices + model.flex_vertnum[flex]],
        model.flex_nodebodyid[nodes : nodes + model.flex_nodenum[flex]],
    )
    return np.concatenate([bodies[bodies >= 0] for bodies in rows])


def flex_owners(model: mujoco.MjModel) -> np.ndarray:
    """Returns the body that each flex belongs to `(nflex,)`: the first that carries it, except the world, if possible.

    The world carries vertices that are pinned.
    """
    return np.array([next(filter(None, carriers(model, flex)), 0) for flex in range(model.nflex)], int)


def skin_owners(model: mujoco.MjModel) -> np.ndarray:
    """Returns the body that each skin belongs to `(nskin,)`, that of its first bone; −1 for none."""
    bones = zip(model.skin_boneadr.tolist(), model.skin_bonenum.tolist(), strict=True)
    return np.array([model.skin_bonebodyid[first] if count else -1 for first, count in bones], int)
