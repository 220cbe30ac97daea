"""Bodies whose size does not fit their mass, its centre, or what they show; boxes around the geoms of welded bodies."""

from collections.abc import Iterator, Mapping

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.rule import Violation, rule
from mjrun.check.rules.meshes import convex_volume

MIN_DENSE_MASS = 0.05  # [kg]; placeholders between two joints are lighter
SAME_BOX = 0.8  # of the box of all geoms that those that collide fill, if the others repeat them
TOLERANCE = 0.01  # [m] by which the boxes of visual and colliding geoms are larger, so that flat ones overlap
MAX_GRAVITY = 50.0  # [m/s²]; with more, lengths are in centimetres or millimetres
INFINITE = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


@rule("MJ207", "warning", "density that no material has")
def impossible_densities(context: CheckContext) -> Iterator[Violation]:
    """Yields moving bodies that are denser than lead, or lighter than foam; the worst of both kinds."""
    model, limits = context.model, context.thresholds
    if np.linalg.norm(model.opt.gravity) > MAX_GRAVITY:
        return
    volumes = {body: _volume(context, body, geoms) for body, geoms in moving_geoms(model).items()}
    densities = {body: _mass(model, body) / volume for body, volume in volumes.items() if volume > 0}
    dense = {b: d for b, d in densities.items() if d > limits.density and _mass(model, b) > MIN_DENSE_MASS}
    thin = {b: d for b, d in densities.items() if 0 < d < limits.min_density}

    if dense:
        worst = max(dense, key=lambda body: dense[body])
        severity = "error" if dense[worst] > limits.absurd_density else ""
        yield _density_violation(context, worst, dense, "lead has 11340", "g or mm", severity)
    if thin:
        worst = min(thin, key=lambda body: thin[body])
        severity = "note" if thin[worst] > limits.absurd_min_density else ""
        yield _density_violation(context, worst, thin, "packaging foam has 20", "t or cm", severity)


def _density_violation(
    context: CheckContext, body: int, densities: Mapping[int, float], known: str, units: str, severity: str
) -> Violation:
    more = f" (and {len(densities) - 1} more)" if len(densities) > 1 else ""
    density, mass = densities[body], _mass(context.model, body)
    message = (
        f"its mass of {mass:.3g} kg in {mass / density:.3g} m³ makes {density:.3g} kg/m³; water has 1000, {known}{more}"
    )
    remedy = f"correct its mass or its size: is one of them in {units}? MuJoCo's units are kg and m"
    return context.violation("body", body, message, remedy, severity)


@rule("MJ208", "warning", "centre of mass outside the body")
def distant_centres_of_mass(context: CheckContext) -> Iterator[Violation]:
    """Yields moving bodies whose centre of mass is far outside the box around their geoms."""
    model, data = context.model, context.data_at(None)
    for body, geoms in moving_geoms(model).items():
        welded = np.flatnonzero(model.body_weldid == body)
        mass = model.body_mass[welded]
        if not mass.sum() > 0:
            continue
        centre = (mass @ data.xipos[welded] / mass.sum() - data.xpos[body]) @ data.xmat[body].reshape(3, 3)
        low, high = box(context, body, geoms)
        offset = float(np.linalg.norm(np.maximum(0, np.maximum(low - centre, centre - high))))
        if offset > context.thresholds.centre_offset * (high - low).max():
            heaviest = int(welded[mass.argmax()])
            message = (
                f"its centre of mass is {offset:.3g} m outside its geoms, which fill a box of {_sides(context, body)} m"
            )
            remedy = "correct pos of its <inertial>, which is in m relative to the body, or add the missing geoms"
            yield context.violation("body", heaviest, message, remedy)


@rule("MJ209", "note", "huge body")
def large_bodies(context: CheckContext) -> Iterator[Violation]:
    """Yields moving bodies that are larger than a house."""
    if np.linalg.norm(context.model.opt.gravity) > MAX_GRAVITY:
        return
    for body, geoms in moving_geoms(context.model).items():
        low, high = box(context, body, geoms)
        if (high - low).max() > context.thresholds.body_size:
            message = f"its geoms fill a box of {_sides(context, body)} m"
            remedy = 'if its lengths are in mm or cm, scale them; meshes by <mesh scale="0.001 0.001 0.001"/>'
            yield context.violation("body", body, message, remedy)


@rule("MJ507", "note", "collisions elsewhere than the visible shape")
def displaced_collisions(context: CheckContext) -> Iterator[Violation]:
    """Yields moving bodies whose visual and colliding geoms hardly overlap."""
    model = context.model
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    for body, geoms in moving_geoms(model).items():
        visual, colliding = geoms[~collides[geoms]], geoms[collides[geoms]]
        if not (visual.size and colliding.size):
            continue
        (low, high), (other_low, other_high) = box(context, body, visual), box(context, body, colliding)
        common = np.minimum(high, other_high) - np.maximum(low, other_low) + 2 * TOLERANCE
        volumes = [float(np.prod(sides + 2 * TOLERANCE)) for sides in (high - low, other_high - other_low)]
        share = float(np.prod(np.maximum(0, common))) / min(volumes)
        if share < context.thresholds.shape_overlap:
            message = f"its visual and its colliding geoms share {100 * share:.0f} % of the smaller one's box"
            yield context.violation("body", body, message, "check pos, quat and size of its colliding geoms")


def moving_geoms(model: mujoco.MjModel) -> dict[int, np.ndarray]:
    """Returns the geoms of each moving body and of those welded to it; no bodies with infinite geoms, and no flexes."""
    owners = model.body_weldid[model.geom_bodyid]
    infinite = owners[np.isin(model.geom_type, INFINITE)]
    left_out = {0, *flex_bodies(model), *(int(body) for body in infinite)}
    return {body: np.flatnonzero(owners == body) for body in sorted({int(b) for b in owners} - left_out)}


def box(context: CheckContext, body: int, geoms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the lowest and the highest corner of the box around `geoms` in the frame of a body, `(3,)` [m]."""
    data = context.data_at(None)
    points = (context.geom_corners[geoms].reshape(-1, 3) - data.xpos[body]) @ data.xmat[body].reshape(3, 3)
    return points.min(axis=0), points.max(axis=0)


def _volume(context: CheckContext, body: int, geoms: np.ndarray) -> float:
    """Returns the volume of a body [m³], at most that of its box.

    Visual geoms often repeat the colliding ones; they count where they reach farther.
    """
    model = context.model
    collides = (model.geom_contype[geoms] | model.geom_conaffinity[geoms]) != 0
    whole = _box_volume(context, body, geoms)
    volume = _convex_volumes(model, geoms[collides])
    if _box_volume(context, body, geoms[collides]) < SAME_BOX * whole:
        volume = max(volume, _convex_volumes(model, geoms[~collides]))
    return min(volume, whole)


def _convex_volumes(model: mujoco.MjModel, geoms: np.ndarray) -> float:
    return sum(convex_volume(model, int(geom)) for geom in geoms)


def _box_volume(context: CheckContext, body: int, geoms: np.ndarray) -> float:
    low, high = box(context, body, geoms) if geoms.size else (np.zeros(3), np.zeros(3))
    return float(np.prod(high - low))


def _mass(model: mujoco.MjModel, body: int) -> float:
    """Returns the mass of a body and of those welded to it [kg]."""
    return float(model.body_mass[model.body_weldid == body].sum())


def _sides(context: CheckContext, body: int) -> str:
    low, high = box(context, body, moving_geoms(context.model)[body])
    return " × ".join(f"{side:.3g}" for side in high - low)


def flex_bodies(model: mujoco.MjModel) -> set[int]:
    """Returns the bodies that carry a flex."""
    return {int(b) for b in np.concatenate([model.flex_vertbodyid, model.flex_nodebodyid])}
