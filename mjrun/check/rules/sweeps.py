"""Hinges that turn their link through its parent, with which MuJoCo does not collide it."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.rule import Violation, rule
from mjrun.check.rules.body_sizes import INFINITE

HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
INNER = 0.75  # part of a box that is well inside; links may touch beside the hinge
SAMPLES = 24  # positions of a hinge, at least 15 degrees apart in a full turn


@rule("MJ313", "note", "hinge that turns its link through its parent")
def links_through_parents(context: LintContext) -> Iterator[Violation]:
    """Yields the first hinge that turns a colliding geom into one of its parent, and out of it again on the other side.

    The others are counted. A geom is inside another one if its centre is well inside the other one's box.
    """
    model, found = context.model, dict[int, tuple[int, int]]()
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        return
    for joint in map(int, np.flatnonzero(model.jnt_type == HINGE)):
        if not model.jnt_limited[joint] and model.jnt_range[joint].any():
            continue  # MJ302 or MJ303 says why its range has no effect
        low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-np.pi, np.pi)
        if high - low >= context.thresholds.link_turn and (pair := _entered(context, joint, low, high)):
            found[joint] = pair
    if found:
        joint, (geom, other) = next(iter(found.items()))
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        limits = "its range allows" if model.jnt_limited[joint] else "without a range, it can turn"
        message = (
            f"{limits} {context.object('geom', geom)} through {context.object('geom', other)}, "
            f"with which MuJoCo does not collide it{more}"
        )
        yield context.violation("joint", joint, message, 'limit it: range="-90 90" (in the unit of <compiler angle=…>)')


def _entered(context: LintContext, joint: int, low: float, high: float) -> tuple[int, int] | None:
    """Returns a geom that a hinge turns through a geom of the parent, and that one; None if all stay outside."""
    model = context.model
    link = int(model.body_weldid[model.jnt_bodyid[joint]])
    parent = int(model.body_weldid[model.body_parentid[link]])
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    collides &= ~np.isin(model.geom_type, INFINITE)
    owners = model.body_weldid[model.geom_bodyid]
    own, others = (np.flatnonzero(collides & (owners == body)) for body in (link, parent))
    if not (parent and own.size and others.size):
        return None

    data = mujoco.MjData(model)
    address, is_closed = int(model.jnt_qposadr[joint]), not model.jnt_limited[joint]
    positions = np.linspace(low, high, SAMPLES, endpoint=not is_closed)
    centres = np.empty((SAMPLES + 1, own.size, 3))
    for i, position in enumerate([*positions, model.qpos0[address]]):
        data.qpos[address] = position
        mujoco.mj_kinematics(model, data)
        centres[i] = _centres(model, data, own)
    # The hinge does not move the parent. Offsets are relative to the half sizes of its boxes: up to 1 inside.
    frames, sizes = data.geom_xmat[others].reshape(-1, 3, 3), np.maximum(model.geom_aabb[others, 3:], mujoco.mjMINVAL)
    along = np.einsum("sabj,bji->sabi", centres[:, :, None] - _centres(model, data, others), frames)
    offsets = (abs(along) / sizes).max(axis=3)
    ends = offsets[[-1]] if is_closed else offsets[[0, -2, -1]]
    turn_inside = (offsets[:-1] < INNER).sum(axis=0) * (high - low) / SAMPLES
    passes = (ends > 1).all(axis=0) & (turn_inside > context.thresholds.link_overlap)
    pairs = np.argwhere(passes)
    return (int(own[pairs[0, 0]]), int(others[pairs[0, 1]])) if pairs.size else None


def _centres(model: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray) -> np.ndarray:
    """Returns the centres of the boxes of geoms in the world, `(n, 3)` [m]."""
    frames = data.geom_xmat[geoms].reshape(-1, 3, 3)
    return data.geom_xpos[geoms] + (frames @ model.geom_aabb[geoms, :3, None])[:, :, 0]
