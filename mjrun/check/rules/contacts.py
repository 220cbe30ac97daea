"""Constraints at the start: geoms inside each other, forces that throw things, springs stiffer than the timestep."""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.finding import Sighting

DEEPEST = 0.1  # of the smaller geom's half size
HARDEST = 20.0  # times gravity; a contact of the default solref pushes so hard at a depth of 7 cm
GRAVITY = 9.81  # [m/s²] where a model has none
ROUND = 1e-9  # relative, of a timestep
SPHERE, CAPSULE = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)
ENDLESS = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


def penetrations(subject: LintContext) -> Iterator[Sighting]:
    """Geoms that lie deep in each other: the worst pair of each start, and no pair twice."""
    told: set[tuple[int, int]] = set()
    for start in subject.starts:
        shares = {pair: share for pair, share in _shares(subject, start).items() if share[1] > DEEPEST}
        new = {pair: share for pair, share in shares.items() if pair not in told}
        told |= new.keys()
        if not new:
            continue
        worst = max(new, key=lambda pair: new[pair][1])
        moves = subject.model.body_weldid[subject.model.geom_bodyid[list(worst)]] != 0
        one, other = worst if moves[0] else worst[::-1]
        depth, share = new[worst]
        others = f"; other pairs that do: {len(new) - 1}" if len(new) > 1 else ""
        size = f"{100 * share:.0f} % of the half size of the smaller"
        message = (
            f"{subject.called(start)} it lies {depth:.3g} m deep in {subject.object('geom', other)}, {size}{others}"
        )
        remedy = "move one of them, or let them not collide: <contact><exclude body1=… body2=…/>"
        place = subject.place("geom", one) if start is None else subject.place("keyframe", start)
        yield Sighting(message, remedy, subject.object("geom", one), place)


def _shares(subject: LintContext, start: int | None) -> dict[tuple[int, int], tuple[float, float]]:
    """Depth [m], and depth as a share of the smaller geom's half size, of every pair in contact."""
    deepest: dict[tuple[int, int], float] = {}
    for contact in subject.at(start).contact:
        pair = (int(contact.geom[0]), int(contact.geom[1]))
        if min(pair) >= 0 and contact.efc_address >= 0:
            deepest[pair] = max(deepest.get(pair, 0.0), -float(contact.dist))
    sizes = {pair: min(_half_size(subject.model, geom) for geom in pair) for pair in deepest}
    return {pair: (depth, depth / sizes[pair]) for pair, depth in deepest.items() if sizes[pair] > 0}


def _half_size(model: mujoco.MjModel, geom: int) -> float:
    """Half of a geom's smallest extent [m]; infinite for planes and terrains."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind in ENDLESS:
        return np.inf
    if kind == SPHERE:
        return float(size[0])
    if kind in (CAPSULE, CYLINDER):
        return float(size[0] if kind == CAPSULE else min(size[:2]))
    return float(min(model.geom_aabb[geom, 3:]))


def forces(subject: LintContext) -> Iterator[Sighting]:
    """Bodies that contacts, limits and equalities throw when a simulation starts at rest."""
    model, told = subject.model, set()
    weight = float(np.linalg.norm(model.opt.gravity)) or GRAVITY
    for start in subject.starts if model.nv else ():
        data = subject.at(start)
        thrown = _accelerations(model, data)
        body = int(thrown.argmax())
        if thrown[body] <= HARDEST * weight or body in told:
            continue
        told.add(body)
        size = f"{thrown[body]:.3g} m/s², {thrown[body] / weight:.0f} times gravity"
        message = f"{subject.called(start)} {_pusher(subject, data)} throws it with {size}"
        remedy = "start where nothing overlaps, joints are within their ranges and equalities hold"
        yield Sighting(message, remedy, subject.object("body", body), subject.place("body", body))


def _accelerations(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """What constraints alone give to the centres of mass, `(nbody,)` [m/s²]: J (qacc − qacc_smooth)."""
    push, jacobian, found = data.qacc - data.qacc_smooth, np.zeros((3, model.nv)), np.zeros(model.nbody)
    if not data.nefc or not np.isfinite(push).all():
        return found
    for body in np.flatnonzero(model.body_weldid):
        mujoco.mj_jacBodyCom(model, data, jacobian, None, int(body))
        found[body] = np.linalg.norm(jacobian @ push)
    return found


def _pusher(subject: LintContext, data: mujoco.MjData) -> str:
    """The constraint with the largest force."""
    row = int(abs(data.efc_force).argmax())
    kind, index = mujoco.mjtConstraint(int(data.efc_type[row])), int(data.efc_id[row])
    if kind == mujoco.mjtConstraint.mjCNSTR_EQUALITY:
        return subject.object("equality", index)
    if kind in (mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT, mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF):
        joint = index if kind == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT else int(subject.model.dof_jntid[index])
        return f"the limit of {subject.object('joint', joint)}"
    if kind in (mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON, mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON):
        return f"the limit of {subject.object('tendon', index)}"
    geoms = [subject.name("geom", int(geom)) for geom in data.contact.geom[index] if geom >= 0]
    return f"the contact of {' and '.join(repr(name) for name in geoms)}" if len(geoms) == 2 else "a contact"


class Spring(NamedTuple):
    """The spring-damper of a constraint: the kind and id of what it belongs to, the attribute, its two numbers."""

    kind: str
    id: int
    attribute: str
    solref: tuple[float, float]


def stiff_springs(subject: LintContext) -> Iterator[Sighting]:
    """Contacts, limits and equalities stiffer than the timestep resolves: the stiffest of each kind."""
    model = subject.model
    stiff: dict[tuple[str, str], list[Spring]] = {}
    for spring in _springs(model):
        if _trouble(model, spring):
            stiff.setdefault((spring.kind, spring.attribute), []).append(spring)
    for springs in stiff.values():
        worst = min(springs, key=lambda spring: _constant(spring.solref))
        others = f" (and {len(springs) - 1} more)" if len(springs) > 1 else ""
        shown = " ".join(f"{number:g}" for number in worst.solref)
        too = f"too stiff for the timestep {model.opt.timestep:g} s"
        message = f"{worst.attribute}={shown!r}{others} is {too}: {_trouble(model, worst)}"
        place = subject.place(worst.kind, worst.id)
        yield Sighting(message, _softer(model, springs), subject.object(worst.kind, worst.id), place)


def _springs(model: mujoco.MjModel) -> Iterator[Spring]:
    """The springs of all constraints that can act."""
    off = model.opt.disableflags
    bits = mujoco.mjtDisableBit
    if not off & (bits.mjDSBL_CONTACT | bits.mjDSBL_CONSTRAINT):
        collides = (model.geom_contype | model.geom_conaffinity) != 0
        for geom in np.flatnonzero(collides):
            yield Spring("geom", int(geom), "solref", _pair(model.geom_solref[geom]))
        for pair in range(model.npair):
            yield Spring("geom", int(model.pair_geom1[pair]), "solref", _pair(model.pair_solref[pair]))
    if not off & (bits.mjDSBL_LIMIT | bits.mjDSBL_CONSTRAINT):
        for joint in np.flatnonzero(model.jnt_limited):
            yield Spring("joint", int(joint), "solreflimit", _pair(model.jnt_solref[joint]))
        for tendon in np.flatnonzero(model.tendon_limited):
            yield Spring("tendon", int(tendon), "solreflimit", _pair(model.tendon_solref_lim[tendon]))
    if not off & (bits.mjDSBL_EQUALITY | bits.mjDSBL_CONSTRAINT):
        for equality in np.flatnonzero(model.eq_active0):
            yield Spring("equality", int(equality), "solref", _pair(model.eq_solref[equality]))


def _pair(solref: np.ndarray) -> tuple[float, float]:
    return float(solref[0]), float(solref[1])


def _trouble(model: mujoco.MjModel, spring: Spring) -> str:
    """Why a spring is too stiff for the timestep h; empty when it is not.

    MuJoCo's manual, Modeling, Solver parameters: the time constant of solref should be at least 2h, and with refsafe
    MuJoCo takes 2h instead of a smaller one. Computation, integrator `discrete`: contacts and limits whose timeconst
    times dampratio is below h are replaced, the rest is stable. The direct format, −stiffness −damping, is not
    guarded: v' = v − h (b v + k x), x' = x + h v' is stable while 2 h b + h² k < 4 (Jury's criterion).
    """
    step, (first, second) = model.opt.timestep, spring.solref
    safe = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE
    discrete = model.opt.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE
    if discrete:
        resolved = spring.kind == "equality" or first <= 0 or first * second >= step * (1 - ROUND)
        return "" if resolved or not safe else "timeconst × dampratio is below it, and MuJoCo takes a softer one"
    if first <= 0:
        return "" if 2 * step * -second + step**2 * -first < 4 else "it gains energy"
    if first >= 2 * step * (1 - ROUND):
        return ""
    return f"MuJoCo takes {2 * step:g} instead" if safe else "it may become unstable"


def _constant(solref: tuple[float, float]) -> float:
    """How fast a spring acts [s]."""
    return solref[0] if solref[0] > 0 else float(1 / np.sqrt(max(-solref[0], 1e-12)))


def _softer(model: mujoco.MjModel, springs: list[Spring]) -> str:
    positive = [spring.solref[0] for spring in springs if spring.solref[0] > 0]
    if not positive:
        return "take a smaller timestep, or less stiffness and damping"
    step = model.opt.timestep
    return f"write a time constant of at least {2 * step:g}, or a timestep of at most {min(positive) / 2:g}"
