"""Faults in a simulation and at its start.

At the start: geoms that overlap, forces that launch bodies, springs too stiff for the timestep. Later: instability,
unexplained energy, warnings of MuJoCo.
"""

from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.finding import Finding, Fix, Violation
from mjrun.check.rule import UNSAFE, Rule, rule
from mjrun.check.rules.contacts import deep_penetrations, filled_mesh
from mjrun.check.rules.decomposition_fix import decomposed
from mjrun.check.rules.keyframes import keyframe_fix
from mjrun.check.rules.limits import joints_beyond_range, tendons_beyond_range
from mjrun.errors import SimulationError, UnstableError, clean
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.names import FREE, KINDS
from mjrun.model.source import bugs_of_model
from mjrun.model.text_edits import escaped, number_word
from mjrun.physics.stepper import PhysicsStepper

UNSTABLE = Rule("MJ701", "error", "unstable simulation")
ENERGY_GAIN = Rule("MJ702", "warning", "passive model gains energy")
WARNING = Rule("MJ703", "warning", "MuJoCo warns while stepping")
FAILED_STEP = Rule("MJ704", "error", "MuJoCo fails while stepping")
KNOWN_BUG = Rule("MJ705", "note", "known bug of the installed MuJoCo")
CODES = frozenset(rule.code for rule in (UNSTABLE, ENERGY_GAIN, WARNING, FAILED_STEP, KNOWN_BUG))

SAMPLES = 25  # of the energy
EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
APART = 1e-3  # of an equality that does not hold [m, rad]
ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)
UPRIGHT = 0.99  # the least vertical part of the normal of a floor
DECIMALS = 6  # of heights [m]
GRAVITY = 9.81  # [m/s²] for models without gravity
ROUNDING = 1e-9  # relative, of a timestep
DECOMPOSE = "replace it by convex parts, as `obj2mjcf --decompose` and CoACD make them, or by primitive geoms"


def simulate(context: CheckContext, steps: int) -> Iterator[Finding]:
    """Yields the faults within `steps` steps from the model's initial state, without controls."""
    for bug in bugs_of_model(context.model):
        message, _, remedy = bug.partition("; ")
        yield KNOWN_BUG.in_model(context.path, message, remedy)
    if steps and context.model.nv + context.model.na:
        yield from _step(context, steps)


def _step(context: CheckContext, steps: int) -> Iterator[Finding]:
    energies: list[tuple[float, float]] = []
    passive = True
    with collected_warnings() as warnings, _energy_flags(context.model):
        try:
            stepper = PhysicsStepper(context.model, mujoco.MjData(context.model), in_place=True)
            for step in sorted({round(k * steps / SAMPLES) for k in range(SAMPLES + 1)}):
                stepper.advance(step)
                data = stepper.instant()
                energies.append((float(data.energy[0]), float(data.energy[1])))
                passive = passive and not data.actuator_force.any()
        except SimulationError as error:
            message, _, remedy = str(error).partition("\n")
            rule = UNSTABLE if isinstance(error, UnstableError) else FAILED_STEP
            yield rule.in_model(context.path, message, remedy)
            return

    for text in warnings:
        line = "; ".join(text.split("\n"))
        yield WARNING.in_model(context.path, f"within {steps} steps MuJoCo warns: {line}")
    if passive and not _is_strained(context) and _conserves_energy(context.model):
        yield from _energy_gain(context, np.array(energies))


def _is_strained(context: CheckContext) -> bool:
    """Returns whether constraints store energy at the start, such as joints beyond a range; other rules report them."""
    data = context.data_at(None)
    apart = abs(data.efc_pos[data.efc_type == EQUALITY]).max(initial=0.0)
    beyond = joints_beyond_range(context, None) or tendons_beyond_range(context)
    return bool(beyond or apart > APART or deep_penetrations(context, None))


@contextmanager
def _energy_flags(model: mujoco.MjModel) -> Generator[None]:
    """Lets MuJoCo compute the energy, which does not affect the motion, and restores all flags of `model`."""
    enabled, disabled = model.opt.enableflags, model.opt.disableflags
    model.opt.enableflags |= ENERGY
    try:
        yield
    finally:
        model.opt.enableflags, model.opt.disableflags = enabled, disabled


def _conserves_energy(model: mujoco.MjModel) -> bool:
    """Returns whether nothing in `model` can do work that MuJoCo's energy does not include."""
    return not (
        model.nplugin
        or model.nflex
        or model.nmocap
        or model.body_gravcomp.any()
        or model.geom_surfacevel.any()
        or model.geom_adhesion.any()
        or model.opt.wind.any()
    )


def _energy_gain(context: CheckContext, energies: np.ndarray) -> Iterator[Finding]:
    """Yields a finding if potential plus kinetic energy, `(n, 2)` [J], ever exceeds its initial value."""
    model, total, kinetic = context.model, energies.sum(axis=1), energies[:, 1]
    fall = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity) * model.stat.meansize)
    gain, scale = float(total.max() - total[0]), float(kinetic.max()) + fall
    if gain <= context.thresholds.energy_gain * scale or not np.isfinite(gain):
        return
    message = (
        f"nothing drives it, but its energy grows by {gain:.3g} J, {100 * gain / scale:.0f} % of its energy scale: "
        f"from {total[0]:.4g} to {total.max():.4g} J"
    )
    remedy = "use a smaller timestep, or integrator rk4 or implicitfast; look for negative damping and initial overlaps"
    yield ENERGY_GAIN.in_model(context.path, message, remedy)


# --- the start ---------------------------------------------------------------------------------------


@rule("MJ501", "warning", "initial penetration", fix=UNSAFE)
def initial_penetrations(context: CheckContext) -> Iterator[Violation]:
    """Yields geoms that penetrate each other deeply: the worst pair of each start, and no pair twice."""
    reported: set[tuple[int, int]] = set()
    for start in context.starts:
        deep = {pair: depth for pair, depth in deep_penetrations(context, start).items() if pair not in reported}
        reported |= deep.keys()
        if not deep:
            continue

        worst = max(deep, key=lambda pair: deep[pair][1])
        moves = context.model.body_weldid[context.model.geom_bodyid[list(worst)]] != 0
        one, other = worst if moves[0] else worst[::-1]
        depth, share = deep[worst]
        others = f" (and {len(deep) - 1} more)" if len(deep) > 1 else ""
        message = (
            f"{context.start_phrase(start)} it penetrates {context.object('geom', other)} by {depth:.3g} m, "
            f"{100 * share:.0f} % of the smaller one's half size{others}"
        )
        remedy = "move one of them" if start is None else "move one of them in the keyframe"
        if moves.all():  # without its contacts with the world, a body falls through the floor
            bodies = [clean(context.name("body", int(context.model.geom_bodyid[geom]))) for geom in (one, other)]
            exclude = f'<contact><exclude body1="{bodies[0]}" body2="{bodies[1]}"/></contact>'
            remedy += f", or exclude their contact: {exclude}"
        if (mesh := filled_mesh(context, start, worst)) is not None:
            message += f"; the convex hull of {context.object('geom', mesh)} fills the cavity between them"
            remedy = DECOMPOSE
        place = context.place("geom", one) if start is None else context.place("keyframe", start)
        fix = partial(_separated, context, start, worst, deep.keys())
        yield Violation(message, remedy, place, context.object("geom", one), fix=fix)


def _separated(
    context: CheckContext, start: int | None, worst: tuple[int, int], pairs: Collection[tuple[int, int]]
) -> Fix | str:
    """Returns the fix of the worst of several pairs if the hull of a mesh causes it, or else of the others."""
    geom, reason = filled_mesh(context, start, worst), ""
    if geom is not None:
        decomposition = decomposed(context, start, geom, worst)
        if isinstance(decomposition, Fix):
            return decomposition
        reason = decomposition
    apart = {pair for pair in pairs if filled_mesh(context, start, pair) is None}
    others = _without_contacts(context, start, apart)
    return others if isinstance(others, Fix) or not reason else reason


@rule("MJ506", "warning", "hull that fills a cavity", fix=UNSAFE)
def filled_cavities(context: CheckContext) -> Iterator[Violation]:
    """Yields meshes that collide as their convex hull, in a cavity of which another geom starts."""
    reported = set[int]()
    for start in context.starts:
        for pair in deep_penetrations(context, start):
            mesh = filled_mesh(context, start, pair)
            if mesh is None or mesh in reported:
                continue
            reported.add(mesh)
            other = pair[0] if mesh == pair[1] else pair[1]
            inside = f"{context.start_phrase(start)} {context.object('geom', other)} is in a cavity of its mesh"
            message = f"{inside}, which collides as its convex hull, without cavities"
            fix = partial(decomposed, context, start, mesh, pair)
            yield context.violation("geom", mesh, message, DECOMPOSE, fix=fix)


@rule("MJ502", "warning", "violent initial forces")
def violent_initial_forces(context: CheckContext) -> Iterator[Violation]:
    """Yields bodies that contacts, limits or equalities launch when a simulation starts at rest.

    Starts with a deep penetration or a joint beyond its range are left to the rules that report these.
    """
    model, reported = context.model, set[int]()
    gravity = float(np.linalg.norm(model.opt.gravity)) or GRAVITY
    for start in context.starts if model.nv else ():
        data = context.data_at(start)
        accelerations = constraint_accelerations(model, data)
        body = int(accelerations.argmax())
        if accelerations[body] <= context.thresholds.initial_acceleration * gravity or body in reported:
            continue
        if joints_beyond_range(context, start) or deep_penetrations(context, start):
            continue

        reported.add(body)
        size = f"{accelerations[body]:.3g} m/s², {accelerations[body] / gravity:.0f} times gravity"
        message = f"{context.start_phrase(start)} {_strongest_constraint(context, data)} accelerates it by {size}"
        remedy = "start where nothing overlaps, joints are within their ranges and equalities hold"
        yield context.violation("body", body, message, remedy)


def constraint_accelerations(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Returns accelerations of centres of mass by constraints alone, `(nbody,)` [m/s²]: J (qacc − qacc_smooth)."""
    qacc, jacobian, accelerations = data.qacc - data.qacc_smooth, np.zeros((3, model.nv)), np.zeros(model.nbody)
    if not data.nefc or not np.isfinite(qacc).all():
        return accelerations
    for body in np.flatnonzero(model.body_weldid):
        mujoco.mj_jacBodyCom(model, data, jacobian, None, int(body))
        accelerations[body] = np.linalg.norm(jacobian @ qacc)
    return accelerations


def _strongest_constraint(context: CheckContext, data: mujoco.MjData) -> str:
    """Returns the constraint with the largest force."""
    row = int(abs(data.efc_force).argmax())
    kind, index = mujoco.mjtConstraint(int(data.efc_type[row])), int(data.efc_id[row])
    if kind == mujoco.mjtConstraint.mjCNSTR_EQUALITY:
        return context.object("equality", index)
    if kind in (mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT, mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF):
        joint = index if kind == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT else int(context.model.dof_jntid[index])
        return f"the limit of {context.object('joint', joint)}"
    if kind in (mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON, mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON):
        return f"the limit of {context.object('tendon', index)}"
    geoms = [context.name("geom", int(geom)) for geom in data.contact.geom[index] if geom >= 0]
    return f"the contact of {' and '.join(repr(name) for name in geoms)}" if len(geoms) == 2 else "a contact"


class ConstraintSpring(NamedTuple):
    """The spring-damper of a constraint: the kind and id of its object, the attribute, and its two numbers."""

    kind: str
    id: int
    attribute: str
    solref: tuple[float, float]


@rule("MJ503", "warning", "timestep too large for a constraint")
def springs_too_stiff_for_timestep(context: CheckContext) -> Iterator[Violation]:
    """Yields contacts, limits and equalities that are too stiff for the timestep: the stiffest of each kind."""
    model = context.model
    stiff: dict[tuple[str, str], list[ConstraintSpring]] = {}
    for spring in _springs(model):
        if stiffness_problem(model, spring):
            stiff.setdefault((spring.kind, spring.attribute), []).append(spring)
    for springs in stiff.values():
        worst = min(springs, key=lambda spring: _time_constant(spring.solref))
        others = f" (and {len(springs) - 1} more)" if len(springs) > 1 else ""
        shown = " ".join(f"{number:g}" for number in worst.solref)
        message = (
            f"{worst.attribute}={shown!r}{others} is too stiff for the timestep {model.opt.timestep:g} s: "
            f"{stiffness_problem(model, worst)}"
        )
        yield context.violation(worst.kind, worst.id, message, _softer(model, springs))


def _springs(model: mujoco.MjModel) -> Iterator[ConstraintSpring]:
    """Yields the springs of all constraints that can act."""
    off = model.opt.disableflags
    bits = mujoco.mjtDisableBit
    if not off & (bits.mjDSBL_CONTACT | bits.mjDSBL_CONSTRAINT):
        collides = (model.geom_contype | model.geom_conaffinity) != 0
        for geom in np.flatnonzero(collides):
            yield ConstraintSpring("geom", int(geom), "solref", _pair(model.geom_solref[geom]))
        for pair in range(model.npair):
            yield ConstraintSpring("geom", int(model.pair_geom1[pair]), "solref", _pair(model.pair_solref[pair]))
    if not off & (bits.mjDSBL_LIMIT | bits.mjDSBL_CONSTRAINT):
        for joint in np.flatnonzero(model.jnt_limited):
            yield ConstraintSpring("joint", int(joint), "solreflimit", _pair(model.jnt_solref[joint]))
        for tendon in np.flatnonzero(model.tendon_limited):
            yield ConstraintSpring("tendon", int(tendon), "solreflimit", _pair(model.tendon_solref_lim[tendon]))
    if not off & (bits.mjDSBL_EQUALITY | bits.mjDSBL_CONSTRAINT):
        for equality in np.flatnonzero(model.eq_active0):
            yield ConstraintSpring("equality", int(equality), "solref", _pair(model.eq_solref[equality]))


def _pair(solref: np.ndarray) -> tuple[float, float]:
    return float(solref[0]), float(solref[1])


def stiffness_problem(model: mujoco.MjModel, spring: ConstraintSpring) -> str:
    """Returns the reason why a spring is too stiff for the timestep h; empty if it is not.

    MuJoCo's manual, Modeling, Solver parameters: the time constant of solref should be at least 2h, and with refsafe
    MuJoCo uses 2h instead of a smaller one. Computation, integrator `discrete`: contacts and limits whose timeconst
    times dampratio is below h are replaced, the rest is stable. The direct format, −stiffness −damping, is not
    guarded: v' = v − h (b v + k x), x' = x + h v' is stable while 2 h b + h² k < 4 (Jury's criterion).
    """
    step, (first, second) = model.opt.timestep, spring.solref
    safe = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE
    discrete = model.opt.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE
    if discrete:
        resolved = spring.kind == "equality" or first <= 0 or first * second >= step * (1 - ROUNDING)
        return "" if resolved or not safe else "timeconst × dampratio is below it, and MuJoCo uses a softer one"
    if first <= 0:
        return "" if 2 * step * -second + step**2 * -first < 4 else "it gains energy"
    if first >= 2 * step * (1 - ROUNDING):
        return ""
    return f"MuJoCo uses {2 * step:g} instead" if safe else "it may become unstable"


def _time_constant(solref: tuple[float, float]) -> float:
    """Returns the time in which a spring acts [s]."""
    return solref[0] if solref[0] > 0 else float(1 / np.sqrt(max(-solref[0], 1e-12)))


def _softer(model: mujoco.MjModel, springs: list[ConstraintSpring]) -> str:
    positive = [spring.solref[0] for spring in springs if spring.solref[0] > 0]
    if not positive:
        return "use a smaller timestep, or less stiffness and damping"
    step = model.opt.timestep
    return f"write a time constant of at least {2 * step:g}, or a timestep of at most {min(positive) / 2:g}"


def _without_contacts(context: CheckContext, start: int | None, pairs: Collection[tuple[int, int]]) -> Fix | str:
    """Returns the fix of geoms that penetrate each other at a start.

    In the initial state, moving bodies exclude each other. In a keyframe, floating bodies are lifted out of the floor.
    """
    return _excluded(context, pairs) if start is None else _lifted(context, start, pairs)


def _excluded(context: CheckContext, pairs: Collection[tuple[int, int]]) -> Fix | str:
    model, root = context.model, context.source.root
    bodies = {tuple(sorted(int(model.geom_bodyid[geom]) for geom in pair)) for pair in pairs}
    moving = sorted(pair for pair in bodies if model.body_weldid[list(pair)].all())
    names = [[mujoco.mj_id2name(model, KINDS["body"], body) or "" for body in pair] for pair in moving]
    excludes = [f'<exclude body1="{escaped(a)}" body2="{escaped(b)}"/>' for a, b in names if a and b]
    if root is None or not excludes:
        return "only contacts between moving bodies with names can be excluded"
    contact = next((e for e in root.children if e.tag == "contact" and e.file == context.path), None)
    if contact:
        edits = [context.editor.with_child(contact, exclude) for exclude in excludes]
    else:
        edits = [context.editor.with_child(root, "\n  ".join(["<contact>", *excludes]) + "\n</contact>")]
    return Fix(tuple(edits), (("exclude", "exclude:*"),))


def _lifted(context: CheckContext, key: int, pairs: Collection[tuple[int, int]]) -> Fix | str:
    model, heights = context.model, dict[int, float]()
    for contact in context.data_at(key).contact:
        pair = tuple(map(int, contact.geom))
        floors = [geom for geom in pair if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE]
        upwards = contact.frame[2] if floors == [pair[0]] else -contact.frame[2]
        if pair not in pairs or len(floors) != 1 or upwards < UPRIGHT:
            continue
        body = int(model.geom_bodyid[next(geom for geom in pair if geom != floors[0])])
        joint = int(model.body_jntadr[model.body_rootid[body]])
        if joint >= 0 and model.jnt_type[joint] == FREE:
            address = int(model.jnt_qposadr[joint]) + 2
            heights[address] = max(heights.get(address, 0.0), -float(contact.dist))
    lifted = {address: model.key_qpos[key, address] + height for address, height in heights.items()}
    if not heights:
        return "only a floating body that penetrates a horizontal plane from above can be lifted"
    words = {address: number_word(round(height + 0.5 * 10**-DECIMALS, DECIMALS)) for address, height in lifted.items()}
    return keyframe_fix(context, key, "qpos", words)
