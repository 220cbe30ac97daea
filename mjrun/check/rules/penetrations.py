"""Geoms that penetrate each other deeply at a start, and meshes whose convex hulls are the cause."""

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.rules.body_sizes import INFINITE
from mjrun.check.rules.meshes import CAPSULE, CYLINDER, MESH, SPHERE, Surface


def filled_mesh(context: LintContext, start: int | None, pair: tuple[int, int]) -> int | None:
    """Returns the mesh of two geoms whose hull, but not whose surface, encloses the centre of the other; else None."""
    model, data = context.model, context.data_at(start)
    for geom, other in (pair, pair[::-1]):
        if model.geom_type[geom] != MESH:
            continue
        mesh = int(model.geom_dataid[geom])
        surface, hull = Surface.of(model, mesh), Surface.hull(model, mesh)
        if hull is None or abs(hull.volume) < context.thresholds.hull_volume * abs(surface.volume):
            continue
        centre = data.geom_xpos[other] + data.geom_xmat[other].reshape(3, 3) @ model.geom_aabb[other, :3]
        point = (centre - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
        if hull.encloses(point) and not surface.encloses(point):
            return geom
    return None


def deep_penetrations(context: LintContext, start: int | None) -> dict[tuple[int, int], tuple[float, float]]:
    """Returns the pairs of geoms that penetrate each other deeply at a start, as `penetration_depths` does."""
    model, deep = context.model, dict[tuple[int, int], tuple[float, float]]()
    for pair, (depth, share) in penetration_depths(context, start).items():
        is_static = (model.body_weldid[model.geom_bodyid[list(pair)]] == 0).any()
        deepest = context.thresholds.static_penetration if is_static else context.thresholds.penetration
        if share > context.thresholds.penetration_share and depth > deepest:
            deep[pair] = (depth, share)
    return deep


def penetration_depths(context: LintContext, start: int | None) -> dict[tuple[int, int], tuple[float, float]]:
    """Returns the depth [m] of each pair of geoms in contact, and its ratio to the smaller geom's half size."""
    depths: dict[tuple[int, int], float] = {}
    contacts = context.data_at(start).contact
    active = np.flatnonzero((contacts.geom.min(axis=1, initial=0) >= 0) & (contacts.efc_address >= 0))
    for (one, other), distance in zip(contacts.geom[active].tolist(), contacts.dist[active].tolist(), strict=True):
        depths[one, other] = max(depths.get((one, other), 0.0), -distance)
    sizes = {pair: min(_half_size(context.model, geom) for geom in pair) for pair in depths}
    return {pair: (depth, depth / sizes[pair]) for pair, depth in depths.items() if sizes[pair] > 0}


def _half_size(model: mujoco.MjModel, geom: int) -> float:
    """Returns half of a geom's smallest extent [m]; infinite for planes and height fields."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind in INFINITE:
        return np.inf
    if kind == SPHERE:
        return float(size[0])
    if kind in (CAPSULE, CYLINDER):
        return float(size[0] if kind == CAPSULE else min(size[:2]))
    return float(min(model.geom_aabb[geom, 3:]))
