"""Bodies whose mass, inertia and size do not fit each other, make a model ill-conditioned, or move it unintendedly."""

from collections.abc import Iterator, Mapping
from functools import partial

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.finding import Fix, Violation
from mjrun.check.rule import GENERATED, UNSAFE, rule
from mjrun.check.rules.meshes import convex_volume, geom_mass
from mjrun.errors import listing
from mjrun.model.xml_source import Element

MIN_DENSE_MASS = 0.05  # [kg]; placeholders between two joints are lighter
SAME_BOX = 0.8  # of the box of all geoms that those that collide fill, if the others repeat them
TOLERANCE = 0.01  # [m] by which the boxes of visual and colliding geoms are larger, so that flat ones overlap
MAX_GRAVITY = 50.0  # [m/s²]; with more, lengths are in centimetres or millimetres
INFINITE = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
NEGLIGIBLE = 1e-4  # mass and inertia of a body relative to the largest in the model
EQUAL = 1e-3  # relative difference of equal inertias
ORIENTATIONS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")
IDENTITY = (1.0, 0.0, 0.0, 0.0)
ROUND = (int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_ELLIPSOID))
SHAPES = {"visual", "collision"}  # the elements with the geoms of a link


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


@rule("MJ203", "note", "geom without mass")
def geoms_without_mass(context: CheckContext) -> Iterator[Violation]:
    """Yields geoms that collide and have no mass, on a moving body whose mass comes from geoms that collide."""
    model, inferred = context.model, bodies_with_inferred_mass(context)
    geoms = [geom for geom in context.spec.geoms if 0 <= geom.id < model.ngeom] if context.spec else []
    massless = [geom for geom in geoms if int(model.geom_bodyid[geom.id]) in inferred and _is_massless(model, geom)]
    bodies = {int(model.geom_bodyid[geom.id]) for geom in massless}
    visual = [g for g in geoms if int(model.geom_bodyid[g.id]) in bodies and not _collides(model, g.id)]
    bodies -= {int(model.geom_bodyid[geom.id]) for geom in visual if geom_mass(context, geom)}
    for geom in massless:
        if int(model.geom_bodyid[geom.id]) in bodies:
            message = "it collides, but adds no mass to its body"
            remedy = 'give it a density or mass, or contype="0" conaffinity="0" if it is only visual'
            yield context.violation("geom", geom.id, message, remedy)


def _is_massless(model: mujoco.MjModel, geom: mujoco.MjsGeom) -> bool:
    """Returns whether a geom of a moving body collides, but has no mass."""
    moves = model.body_weldid[model.geom_bodyid[geom.id]] != 0
    massless = 0 in (geom.mass, geom.density if np.isnan(geom.mass) else 1)
    return bool(moves and massless and _collides(model, geom.id) and model.geom_type[geom.id] not in INFINITE)


def bodies_with_inferred_mass(context: CheckContext) -> set[int]:
    """Returns the bodies whose mass and inertia MuJoCo infers from their geoms."""
    spec = context.spec
    if spec is None:
        return set()
    always = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    return {body.id for body in spec.bodies if always or not body.explicitinertial}


def _collides(model: mujoco.MjModel, geom: int) -> bool:
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


@rule("MJ204", "warning", "extreme principal inertias")
def extreme_principal_inertias(context: CheckContext) -> Iterator[Violation]:
    """Yields bodies that rotate and have almost no inertia about one of their axes."""
    model = context.model
    generated = flex_bodies(model)
    for body in range(1, model.nbody):
        low, high = model.body_inertia[body].min(), model.body_inertia[body].max()
        if body in generated or not model.body_dofnum[body] or high <= context.thresholds.principal_inertia_ratio * low:
            continue
        message = f"its principal inertias, {low:.3g} and {high:.3g} kg m², differ by a factor of {_ratio(high, low)}"
        remedy = "make its geoms less thin, or give it <inertial diaginertia=…>, or its joints some armature"
        yield context.violation("body", body, message, remedy)


@rule("MJ205", "warning", "extreme inertias in one tree")
def extreme_inertia_ratios(context: CheckContext) -> Iterator[Violation]:
    """Yields kinematic trees whose joints move very different inertias, which costs digits in every step."""
    model = context.model
    for tree in range(model.ntree):
        tree_dofs = [int(dof) for dof in np.flatnonzero(model.dof_treeid == tree)]
        for rotates in (False, True):
            dofs = np.array([dof for dof in tree_dofs if _rotates(model, dof) == rotates], int)
            inertia = model.dof_M0[dofs]
            if dofs.size < 2 or inertia.max() <= context.thresholds.tree_inertia_ratio * inertia.min():
                continue

            light, heavy = (int(model.dof_jntid[dofs[i]]) for i in (inertia.argmin(), inertia.argmax()))
            unit = "kg m²" if rotates else "kg"
            message = (
                f"it moves {inertia.min():.3g} {unit}, and {context.object('joint', heavy)} of the same tree "
                f"{inertia.max():.3g} {unit}: a factor of {_ratio(inertia.max(), inertia.min())}"
            )
            remedy = "give the light joint some armature, or check the masses and their unit, kg"
            yield context.violation("joint", light, message, remedy)


@rule("MJ206", "warning", "inertia that the body cannot have", fix=UNSAFE)
def impossible_inertias(context: CheckContext) -> Iterator[Violation]:
    """Yields bodies whose explicit inertia does not fit their geoms and those of the bodies that are welded to them.

    The half trace less a principal inertia is the mass times the mean square distance along that axis, which cannot
    exceed the square of how far the mass reaches. That is unknown for links of a URDF without <collision>.
    """
    model = context.model
    inferred = bodies_with_inferred_mass(context)  # even with an <inertial> if the compiler says so
    moves = (model.body_weldid != 0) | (model.nv == 0)  # without joints, it is a part of other models
    heaviest = model.body_mass[moves].max(initial=0)
    most_inert = model.body_inertia[moves].max(initial=0)
    for body in [b.id for b in context.spec.bodies if b.id not in inferred] if context.spec else ():
        heavy = model.body_mass[body] > NEGLIGIBLE * heaviest
        inert = model.body_inertia[body].max() > NEGLIGIBLE * most_inert
        if not (moves[body] and model.body_mass[body] > 0 and (heavy or inert)):
            continue
        links = _fused_links(context, body)
        if any(_loses_its_shape(context, link) for link in links):
            continue
        if problem := _inertia_problem(context, body):
            fixed = [link.attributes["name"] for link in links[1:] if any(e.tag == "inertial" for e in link.children)]
            others = f" or those of the links fixed to it ({listing(fixed)})" if fixed else ""
            removal = "or remove it so that MuJoCo infers it from the geoms; units are kg and m"
            remedy = f"correct its <inertial>{others}, {removal}"
            fix = partial(_inferred_inertia, context, body)
            yield context.violation("body", body, problem, remedy, fix=fix)


@rule("MJ210", "note", "mass of visual geoms")
def visual_masses(context: CheckContext) -> Iterator[Violation]:
    """Yields the moving body that gets most of its mass from the density of geoms that do not collide, beside others.

    A geom with an explicit mass is meant to have it.
    """
    model, shares = context.model, dict[int, float]()
    inferred = bodies_with_inferred_mass(context)
    for body in context.spec.bodies if context.spec else ():
        geoms = [geom for geom in body.geoms if geom.id < model.ngeom] if body.id in inferred else []
        colliding = [geom for geom in geoms if _collides(model, geom.id)]
        visual = [geom for geom in geoms if not _collides(model, geom.id) and np.isnan(geom.mass)]
        if not (model.body_weldid[body.id] and visual and colliding):
            continue
        shown, total = (sum(geom_mass(context, geom) for geom in part) for part in (visual, geoms))
        if shown > context.thresholds.visual_mass_share * total and any(geom_mass(context, geom) for geom in colliding):
            shares[body.id] = shown / total
    if shares:
        worst = max(shares, key=lambda body: shares[body] * model.body_mass[body])
        more = f" (and {len(shares) - 1} more)" if len(shares) > 1 else ""
        message = (
            f"{100 * shares[worst]:.0f} % of its mass of {model.body_mass[worst]:.3g} kg comes from geoms that do not "
            f"collide{more}"
        )
        remedy = 'write mass="0" for visual geoms, best in their <default class=…>, or give the body an <inertial>'
        yield context.violation("body", worst, message, remedy)


def _inertia_problem(context: CheckContext, body: int) -> str:
    """Returns the reason why a body cannot have its inertia, or an empty text."""
    model = context.model
    mass, inertia = float(model.body_mass[body]), model.body_inertia[body]
    spread = np.sqrt(np.maximum(inertia.sum() / 2 - inertia, 0) / mass)
    shown = " ".join(f"{value:.3g}" for value in inertia)

    reach = _reach(context, body, model.body_weldid[model.geom_bodyid] == model.body_weldid[body])
    if reach.all() and (ratio := (spread / reach).max()) > context.thresholds.inertia_spread:
        return (
            f"its inertia {shown} kg m² is too large: its mass of {mass:.3g} kg would have to sit "
            f"{ratio:.1f} times farther out than its geoms reach"
        )
    own = _reach(context, body, model.geom_bodyid == body)
    if own.all() and np.ptp(inertia) <= EQUAL * inertia.max():
        slenderness, farther = own.max() / own.min(), (spread / own).max()
        reason = ""
        if farther > context.thresholds.placeholder_spread:
            reason = f"its mass would have to sit {farther:.1f} times farther out than its own geoms reach"
        elif slenderness > context.thresholds.placeholder_slenderness:
            reason = f"its geoms are {slenderness:.1f} times as long as wide"
        if reason:
            return f"its inertia is {inertia[0]:.3g} kg m² about every axis, but {reason}: is it a placeholder?"
    solid = _solid_inertia(context, body) if own.all() else np.zeros(3)
    if (small := inertia < context.thresholds.min_inertia_share * solid).any():
        ratio = (solid[small] / np.maximum(inertia[small], mujoco.mjMINVAL)).max()
        return (
            f"its inertia {shown} kg m² is too small: about one axis, a solid of its shape and mass has {ratio:.3g} "
            "times as much"
        )
    return ""


def _solid_inertia(context: CheckContext, body: int) -> np.ndarray:
    """Returns the inertia of ellipsoids in place of the round geoms of a body, and of boxes around the others, filled
    with its mass, along its principal axes, `(3,)` [kg m²].
    """
    model, data = context.model, context.data_at(None)
    geoms = np.flatnonzero(model.geom_bodyid == body)
    halves = model.geom_aabb[geoms, 3:]
    volumes = np.prod(halves, axis=1)
    if not volumes.sum() > 0:
        return np.zeros(3)
    shares = volumes / volumes.sum()
    frames = data.ximat[body].reshape(3, 3).T @ data.geom_xmat[geoms].reshape(-1, 3, 3)
    centres = data.geom_xpos[geoms] @ data.ximat[body].reshape(3, 3)
    centres += np.einsum("gij,gj->gi", frames, model.geom_aabb[geoms, :3])
    parts = np.where(np.isin(model.geom_type[geoms], ROUND), 1 / 5, 1 / 3)[:, None]  # of the squares of half sizes
    distances = (centres - shares @ centres) ** 2 + np.einsum("gij,gj->gi", frames**2, parts * halves**2)
    squares = shares @ distances
    return model.body_mass[body] * (squares.sum() - squares)


def _reach(context: CheckContext, body: int, selected: np.ndarray) -> np.ndarray:
    """Returns how far the `selected` geoms `(ngeom,)` reach from the centre of mass of a body, along its principal
    axes, `(3,)` [m]; zeros without geoms, or with a plane or height field.
    """
    model, data = context.model, context.data_at(None)
    geoms = np.flatnonzero(selected)
    if not geoms.size or np.isin(model.geom_type[geoms], INFINITE).any():
        return np.zeros(3)
    axes = data.ximat[body].reshape(3, 3)
    return abs((context.geom_corners[geoms].reshape(-1, 3) - data.xipos[body]) @ axes).max(axis=0)


def _rotates(model: mujoco.MjModel, dof: int) -> bool:
    joint = model.dof_jntid[dof]
    kind = int(model.jnt_type[joint])
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        return dof - model.jnt_dofadr[joint] > 2
    return kind != mujoco.mjtJoint.mjJNT_SLIDE


def _ratio(high: float, low: float) -> str:
    return f"{high / low:.2g}" if low > 0 else "infinity"


def _inferred_inertia(context: CheckContext, body: int) -> Fix | str:
    """Returns the fix that gives a body the inertia of its geoms, of which the mass is scaled to that of the body."""
    element = context.element("body", body)
    inertial = element.child("inertial") if element else None
    model = _model_with_inferred_inertia(context, body)
    if inertial is None:
        return GENERATED
    if model is None or not model.body_mass[body] > 0:
        return "its geoms have no mass from which its inertia could be inferred"
    scale = context.model.body_mass[body] / model.body_mass[body]
    quat = model.body_iquat[body]
    values = {"pos": model.body_ipos[body], "diaginertia": scale * model.body_inertia[body]}
    values |= {} if np.allclose(quat, IDENTITY, atol=1e-9) else {"quat": quat}
    outdated = [name for name in (*ORIENTATIONS, "fullinertia") if name in inertial.attributes and name not in values]
    edits = [context.editor.without(inertial, name) for name in outdated]
    edits += [context.editor.with_value(inertial, name, _numbers(value)) for name, value in values.items()]
    name = context.name("body", body)
    return Fix(tuple(edits), tuple((field, name) for field in ("body_inertia", "body_ipos", "body_iquat")))


def _model_with_inferred_inertia(context: CheckContext, body: int) -> mujoco.MjModel | None:
    """Returns the model with the inertia of one body inferred from its geoms; None if they have none."""
    if context.spec is None:
        return None
    spec = context.spec.copy()
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    changed = spec.bodies[[each.id for each in context.spec.bodies].index(body)]
    changed.explicitinertial, changed.mass, changed.inertia[:], changed.ipos[:] = False, 0, 0, np.nan
    try:
        return spec.compile()
    except ValueError:
        return None


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values.tolist())


def _fused_links(context: CheckContext, body: int) -> list[Element]:
    """Returns the links that a body consists of, that of its name first; none unless they are those of a URDF."""
    root = context.source.root
    if root is None or root.tag != "robot" or context.spec is None or not context.spec.compiler.fusestatic:
        return []
    links = {element.attributes.get("name", ""): element for element in root.children if element.tag == "link"}
    fixed = [e for e in root.children if e.tag == "joint" and e.attributes.get("type") == "fixed"]
    ends = [(_end(joint, "parent"), _end(joint, "child")) for joint in fixed]
    names = [context.name("body", body)]
    for name in names:
        names += [child for parent, child in ends if parent == name and child not in names]
    return [links[name] for name in filter(None, names) if name in links]


def _loses_its_shape(context: CheckContext, link: Element) -> bool:
    """Returns whether MuJoCo discards all geoms of a link, which are only visual ones."""
    tags = {child.tag for child in link.children}
    return context.spec is not None and bool(context.spec.compiler.discardvisual) and tags & SHAPES == {"visual"}


def _end(joint: Element, tag: str) -> str:
    end = joint.child(tag)
    return end.attributes.get("link", "") if end else ""
