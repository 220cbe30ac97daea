"""The long table of contacts: a row for each contact of an instant, who touches whom and with what force.

Forces and torques are those that geom1 exerts on geom2, as `mj_contactForce` gives them; geom1 feels the opposite.
The normal points from geom1 to geom2, so what pushes them apart is positive along it. Torques are about the contact
point. The contact frame is the normal and the two tangents that follow it in `mjContact.frame`.
"""

import mujoco
import numpy as np

from mjrun.model.column import Column
from mjrun.model.names import names

FRAME, WORLD = ("normal", "tangent1", "tangent2"), ("x", "y", "z")
ACTION = "{} that geom1 exerts on geom2, {} frame"
TORQUE = "torque about the contact point"


def contact_columns(model: mujoco.MjModel) -> list[Column]:
    """The columns of `contacts`: time first; geoms and bodies are indices into their labels.

    What touches may be a flex: `flex/cloth`, or `flex:0` without a name. It has a body only where the contact is at
    a vertex that is one.
    """
    flexes = (mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_FLEX, i) for i in range(model.nflex))
    touching = (*names(model, "geom"), *(f"flex/{name}" if name else f"flex:{i}" for i, name in enumerate(flexes)))
    touching = touching or ("",)  # texts even where nothing can touch
    bodies = tuple(names(model, "body"))
    return [
        Column("time", "s", "simulated time, exact"),
        Column("contact", "", "index of the contact within its instant"),
        *(Column(f"geom{i}", "", "geom or flex; the normal points from geom1 to geom2", labels=touching) for i in "12"),
        *(Column(f"body{i}", "", f"body of geom{i}", labels=bodies) for i in "12"),
        Column("dist", "m", "distance between the two; negative is penetration"),
        *(Column(f"pos/{part}", "m", "contact point, world frame") for part in WORLD),
        *(Column(f"normal/{part}", "", "direction from geom1 to geom2, world frame") for part in WORLD),
        *(Column(f"force/{part}", "N", ACTION.format("force", "contact")) for part in FRAME),
        *(Column(f"torque/{part}", "N·m", ACTION.format(TORQUE, "contact")) for part in FRAME),
        *(Column(f"world_force/{part}", "N", ACTION.format("force", "world")) for part in WORLD),
        *(Column(f"world_torque/{part}", "N·m", ACTION.format(TORQUE, "world")) for part in WORLD),
    ]


def contacts(model: mujoco.MjModel, data: mujoco.MjData, time: float) -> np.ndarray:
    """A row for each contact, in MuJoCo's order: `(ncon, len(contact_columns(model)))` float64.

    A contact that makes no constraint, as in the gap or for want of memory, is there without a force.

    Args:
      data: of one instant, as after `mj_forward`.
      time: of that instant [s].
    """
    found, count = data.contact, data.ncon
    wrenches = np.empty((count, 6))
    for index, wrench in enumerate(wrenches):
        mujoco.mj_contactForce(model, data, index, wrench)
    frames = found.frame.reshape(count, 3, 3)  # rows: normal, two tangents
    world = wrenches.reshape(count, 2, 3) @ frames
    parts = (
        np.full(count, time),
        np.arange(count),
        np.where(found.geom < 0, model.ngeom + found.flex, found.geom),
        _bodies(model, found.geom, found.flex, found.vert),
        found.dist,
        found.pos,
        frames[:, 0],
        wrenches,
        world.reshape(count, 6),
    )
    return np.column_stack(parts)


def _bodies(model: mujoco.MjModel, geom: np.ndarray, flex: np.ndarray, vertex: np.ndarray) -> np.ndarray:
    """The bodies of what touches, −1 for none; `vertex` counts within its flex. All are `(ncon, 2)`."""
    bodies = np.full(geom.shape, -1)
    rigid, soft = geom >= 0, vertex >= 0
    bodies[rigid] = model.geom_bodyid[geom[rigid]]
    bodies[soft] = model.flex_vertbodyid[model.flex_vertadr[flex[soft]] + vertex[soft]]
    return bodies
