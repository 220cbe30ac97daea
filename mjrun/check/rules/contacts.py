"""Geoms that collide with nothing, bodies that nothing stops, and geoms that penetrate each other deeply at a start."""

import itertools
from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.finding import Place, Violation
from mjrun.check.rule import rule
from mjrun.check.rules.bodies import INFINITE
from mjrun.check.rules.meshes import CAPSULE, CYLINDER, MESH, SPHERE, Surface
from mjrun.model.names import FREE


@rule("MJ504", "error", "nothing can collide")
def disjoint_collisions(context: CheckContext) -> Iterator[Violation]:
    """Yields a free body in a scene where no contype has a bit in common with the conaffinity of another geom.

    Models without static geoms are parts of scenes, which may declare the contacts.
    """
    model = context.model
    joint = _falling_joint(model)
    static = model.body_weldid[model.geom_bodyid] == 0
    if joint is None or not static.any() or model.npair or model.nflex or _any_collision(model):
        return
    body = int(model.jnt_bodyid[joint])
    message = "it moves freely, but no two geoms of the model can collide: it falls through everything"
    remedy = 'write contype="1" and conaffinity="1", the default, for geoms that should collide, or <contact><pair …/>'
    yield context.violation("body", body, message, remedy)


@rule("MJ508", "note", "no floor")
def missing_floor(context: CheckContext) -> Iterator[Violation]:
    """Yields a free body in a model without static geoms."""
    model = context.model
    joint = _falling_joint(model)
    if joint is None or model.nflex or (model.body_weldid[model.geom_bodyid] == 0).any():
        return
    message = "it falls freely: the model has no floor"
    remedy = 'add <geom type="plane" size="0 0 1"/> to the <worldbody>, or include the model in a scene'
    yield context.violation("body", int(model.jnt_bodyid[joint]), message, remedy)


@rule("MJ509", "warning", "gravity upwards")
def upward_gravity(context: CheckContext) -> Iterator[Violation]:
    """Yields models in which bodies fall upwards."""
    model = context.model
    upwards = float(model.opt.gravity[2])
    if upwards > 0 and model.nv and not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        message = f"gravity points upwards, with {upwards:.4g} m/s² along z"
        remedy = f'write <option gravity="0 0 {-upwards:.4g}"/>'
        yield Violation(message, remedy, Place(context.path))


@rule("MJ510", "note", "link that does not collide")
def links_without_collisions(context: CheckContext) -> Iterator[Violation]:
    """Yields the first visible link without colliding geoms between links that collide, such as one of an arm."""
    model = context.model
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    collides[[*model.pair_geom1, *model.pair_geom2]] = True
    links = model.body_weldid[model.geom_bodyid]
    colliding = {int(link) for link in links[collides & (model.geom_bodyid != 0)]}
    chains = {link: _links_above(model, link) for link in {int(link) for link in links} | colliding}
    above_others = {link for other in colliding for link in chains[other]}
    passing = [link for link in sorted(chains.keys() - colliding) if link in above_others and chains[link] & colliding]
    if passing:
        more = f" (and {len(passing) - 1} more)" if len(passing) > 1 else ""
        message = f"none of its geoms collides, but links before and after it do: it passes through everything{more}"
        remedy = "add a geom that collides, such as a capsule, or the missing contype and conaffinity"
        yield context.violation("body", passing[0], message, remedy)


def _links_above(model: mujoco.MjModel, link: int) -> set[int]:
    """Returns the bodies between a body and the world, each the first of those that are welded together."""
    above = set[int]()
    while link:
        link = int(model.body_weldid[model.body_parentid[link]])
        above.add(link)
    return above


def _falling_joint(model: mujoco.MjModel) -> int | None:
    """Returns the first free joint of a body that gravity pulls down and contacts could stop; None without one."""
    disabled = model.opt.disableflags
    contacts = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    if disabled & (contacts | mujoco.mjtDisableBit.mjDSBL_GRAVITY) or not model.opt.gravity.any():
        return None
    falls = model.body_gravcomp[model.jnt_bodyid] == 0
    joints = np.flatnonzero((model.jnt_type == FREE) & falls)
    return int(joints[0]) if joints.size else None


def _any_collision(model: mujoco.MjModel) -> bool:
    """Returns whether the bits of any two geoms that can move relative to each other let them collide."""
    bodies: dict[tuple[int, int], set[int]] = {}  # by contype and conaffinity
    for geom in range(model.ngeom):
        bits = int(model.geom_contype[geom]), int(model.geom_conaffinity[geom])
        bodies.setdefault(bits, set()).add(int(model.body_weldid[model.geom_bodyid[geom]]))
    return any(
        one[0] & other[1] and len(bodies[one] | bodies[other]) > 1 for one, other in itertools.product(bodies, repeat=2)
    )


def filled_mesh(context: CheckContext, start: int | None, pair: tuple[int, int]) -> int | None:
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


def deep_penetrations(context: CheckContext, start: int | None) -> dict[tuple[int, int], tuple[float, float]]:
    """Returns the pairs of geoms that penetrate each other deeply at a start, as `penetration_depths` does."""
    model, deep = context.model, dict[tuple[int, int], tuple[float, float]]()
    for pair, (depth, share) in penetration_depths(context, start).items():
        is_static = (model.body_weldid[model.geom_bodyid[list(pair)]] == 0).any()
        deepest = context.thresholds.static_penetration if is_static else context.thresholds.penetration
        if share > context.thresholds.penetration_share and depth > deepest:
            deep[pair] = (depth, share)
    return deep


def penetration_depths(context: CheckContext, start: int | None) -> dict[tuple[int, int], tuple[float, float]]:
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
