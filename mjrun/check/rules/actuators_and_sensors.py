"""Actuators and sensors: servos that oscillate or leave the range of a joint, forces that add energy, and targets that
are another object than the name says, or cannot move. Bodies on the left and on the right that differ, although their
names say that they mirror each other.
"""

import re
from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from mjrun.check.context import OWNERS, CheckContext
from mjrun.check.finding import Violation
from mjrun.check.rule import rule
from mjrun.errors import clean
from mjrun.model.names import JOINT_TRANSMISSIONS, KIND_OF, KINDS, SCALAR_JOINTS, actuators_of

FIXED, AFFINE = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_AFFINE)
DISCRETE = int(mujoco.mjtIntegrator.mjINT_DISCRETE)
EULER, RK4 = int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtIntegrator.mjINT_RK4)
MAX_DECAY = {EULER: 2.0, RK4: 2.785}  # of the velocity in one timestep where kv is explicit; unstable beyond
SENSOR = mujoco.mjtSensor
MOTION = {  # sensors that are zero, or constant, on a body that cannot move
    int(kind)
    for kind in (
        *(SENSOR.mjSENS_ACCELEROMETER, SENSOR.mjSENS_VELOCIMETER, SENSOR.mjSENS_GYRO),
        *(SENSOR.mjSENS_FRAMELINVEL, SENSOR.mjSENS_FRAMEANGVEL, SENSOR.mjSENS_FRAMELINACC, SENSOR.mjSENS_FRAMEANGACC),
    )
}
TRANSMISSIONS = {
    int(mujoco.mjtTrn.mjTRN_JOINT): "joint",
    int(mujoco.mjtTrn.mjTRN_JOINTINPARENT): "joint",
    int(mujoco.mjtTrn.mjTRN_TENDON): "tendon",
    int(mujoco.mjtTrn.mjTRN_SITE): "site",
    int(mujoco.mjtTrn.mjTRN_BODY): "body",
}
# The words for sides: left and right anywhere, L and R alone or beside front, rear, hind, back and middle.
SIDES = re.compile(r"left|right|(?<![a-z])(?:[frhbm][lr]|[lr][fhbm]|[lr])(?![a-z])", re.IGNORECASE)
ALIGNED = 0.9  # cosine between an axis and the line between both sides
MILLIMETRE = 0.001  # [m]
OTHER_SIDE = str.maketrans("lrLR", "rlRL")


@rule("MJ312", "warning", "force that adds energy")
def negative_springs(context: CheckContext) -> Iterator[Violation]:
    """Yields joints, tendons and servos that push away from their rest position, or along their velocity."""
    model = context.model
    affine = model.actuator_biastype == AFFINE
    negative = (
        ("joint", "stiffness", model.jnt_stiffness),
        ("joint", "damping", model.dof_damping[model.jnt_dofadr]),
        ("tendon", "stiffness", model.tendon_stiffness),
        ("tendon", "damping", model.tendon_damping),
        ("actuator", "kp", -model.actuator_biasprm[:, 1] * affine),
        ("actuator", "kv", -model.actuator_biasprm[:, 2] * affine),
    )
    for kind, gain, values in negative:
        for i in map(int, np.flatnonzero(values < 0)):
            towards = "along its velocity" if gain in ("damping", "kv") else "away from its rest position"
            message = f"its {gain} of {values[i]:.4g} is negative: it pushes {towards}, which adds energy"
            index = 2 if gain == "kv" else 1
            remedy = f"correct its sign{f'; biasprm[{index}] of a <general> is −{gain}' if kind == 'actuator' else ''}"
            yield context.violation(kind, i, message, remedy)


class _Servo(NamedTuple):
    """An actuator with the force `gain · ctrl + bias − kp · length − kv · velocity`, where length = gear · qpos.

    Attributes:
      id: the actuator.
      joint: its joint, a hinge or a slide.
      kp, kv, gear: the gains, and the gear.
      limits: the joint positions at the ends of its control range, in ascending order; empty if it is unlimited.
    """

    id: int
    joint: int
    kp: float
    kv: float
    gear: float
    limits: tuple[float, ...]


@rule("MJ306", "note", "servo beyond its joint")
def servos_beyond_joints(context: CheckContext) -> Iterator[Violation]:
    """Yields servos whose control range exceeds the range of their joint by a tenth; the worst of each unit.

    It is a warning from five times the range on, as if degrees were meant.
    """
    model = context.model
    excesses = dict[_Servo, float]()
    for servo in _servos(model):
        low, high = model.jnt_range[servo.joint]
        if servo.limits and model.jnt_limited[servo.joint] and high > low:
            excess = max(low - servo.limits[0], servo.limits[1] - high) / (high - low)
            if excess > context.thresholds.servo_excess:
                excesses[servo] = float(excess)
    absurd = [servo for servo, excess in excesses.items() if excess > context.thresholds.absurd_servo_excess]
    others = [servo for servo in excesses if servo not in absurd]
    for servos, severity in ((absurd, "warning"), (others, "")):
        if servos:
            worst = max(servos, key=lambda servo: excesses[servo])
            yield _beyond(context, worst, excesses[worst], len(servos) - 1, severity)


def _beyond(context: CheckContext, servo: _Servo, excess: float, others: int, severity: str) -> Violation:
    model = context.model
    low, high = model.jnt_range[servo.joint]
    start, end = servo.limits
    more = f" (and {others} more)" if others else ""
    is_hinge = model.jnt_type[servo.joint] == mujoco.mjtJoint.mjJNT_HINGE
    unit = ": is one of them in degrees?" if severity and is_hinge else ""
    joint = context.object("joint", servo.joint)
    message = (
        f"its control range corresponds to positions from {start:.4g} to {end:.4g}, but {joint} ends at {low:.4g} and "
        f"{high:.4g}: {100 * excess:.0f} % of its travel beyond{unit}{more}"
    )
    gain, bias = model.actuator_gainprm[servo.id, 0], model.actuator_biasprm[servo.id, 0]
    first, last = sorted((servo.kp * servo.gear * position - bias) / gain for position in (low, high))
    remedy = f'write ctrlrange="{first:.4g} {last:.4g}", or inheritrange="1" for a <position>'
    return context.violation("actuator", servo.id, message, remedy, severity)


@rule("MJ307", "warning", "servo too stiff for the timestep")
def servos_too_stiff_for_timestep(context: CheckContext) -> Iterator[Violation]:
    """Yields servos that oscillate or brake faster than the timestep resolves; the worst of both kinds.

    The inertia of a joint is at most its entry in the inertia matrix at the start, for which h √(kp/M) is the phase of
    its oscillation in a step of h. The integrator `discrete` is stable for every gain. The implicit ones are for kv,
    and slow the oscillation down: x' = x + h v', (1 + d) v' = v − φ² x / h is stable while φ² < 4 + 2 d.
    """
    model = context.model
    if model.opt.integrator == DISCRETE:
        return
    servos = list(_servos(model))
    stiff = {servo: ratio for servo in servos if (ratio := _phase(model, servo) / context.thresholds.servo_phase) > 1}
    braking = {servo: ratio for servo in servos if (ratio := _decay(model, servo)) > 1}
    if stiff:
        worst = max(stiff, key=lambda servo: stiff[servo])
        message = (
            f"kp={worst.kp:.4g} makes it oscillate with a period of {2 * np.pi / _phase(model, worst):.2g} timesteps"
        )
        limits = worst.kp / stiff[worst] ** 2, model.opt.timestep / stiff[worst]
        yield _too_stiff(context, worst, message, f"kp of at most {limits[0]:.3g}", limits[1], len(stiff) - 1)
    if braking:
        worst = max(braking, key=lambda servo: braking[servo])
        message = f"kv={worst.kv:.4g} makes it unstable: it more than reverses the velocity in each timestep"
        limits = worst.kv / braking[worst], model.opt.timestep / braking[worst]
        yield _too_stiff(context, worst, message, f"kv of at most {limits[0]:.3g}", limits[1], len(braking) - 1)


def _too_stiff(context: CheckContext, servo: _Servo, message: str, gain: str, step: float, others: int) -> Violation:
    inertia = context.model.dof_M0[context.model.jnt_dofadr[servo.joint]]
    joint = context.object("joint", servo.joint)
    message += f" of {context.model.opt.timestep:g} s, as {joint} has an inertia of {inertia:.3g}"
    message += f" (and {others} more)" if others else ""
    integrator = "implicitfast" if gain.startswith("kv") else "discrete"
    remedy = f"use {gain}, a timestep of at most {step:.2g} s, integrator {integrator}, or more armature of the joint"
    return context.violation("actuator", servo.id, message, remedy)


def _phase(model: mujoco.MjModel, servo: _Servo) -> float:
    """Returns the phase of the oscillation of a servo in one timestep, reduced by damping that is implicit."""
    step, dof = model.opt.timestep, model.jnt_dofadr[servo.joint]
    damping = 0.0 if model.opt.integrator == RK4 else float(model.dof_damping[dof])
    if model.opt.integrator not in MAX_DECAY:
        damping += servo.kv * servo.gear**2
    inertia = float(model.dof_M0[dof]) + step * damping / 2
    return float(step * abs(servo.gear) * np.sqrt(servo.kp / inertia))


def _decay(model: mujoco.MjModel, servo: _Servo) -> float:
    """Returns the share of the velocity that kv removes in one timestep, relative to its limit; 0 if kv is implicit."""
    inertia = float(model.dof_M0[model.jnt_dofadr[servo.joint]])
    decay = float(model.opt.timestep * servo.kv * servo.gear**2 / inertia)
    return decay / MAX_DECAY.get(int(model.opt.integrator), np.inf)


def _servos(model: mujoco.MjModel) -> Iterator[_Servo]:
    """Yields the servos of hinges and slides."""
    for i in range(model.nactuator):
        joint = int(model.actuator_trnid[i, 0])
        if model.actuator_trntype[i] not in JOINT_TRANSMISSIONS or model.jnt_type[joint] not in SCALAR_JOINTS:
            continue
        if model.actuator_gaintype[i] != FIXED or model.actuator_biastype[i] != AFFINE:
            continue
        bias, kp, kv = model.actuator_biasprm[i, :3] * (1, -1, -1)
        gear, gain = float(model.actuator_gear[model.actuator_outadr[i], 0]), float(model.actuator_gainprm[i, 0])
        control = int(model.actuator_ctrladr[i])
        limits = tuple[float, ...]()
        if kp * gear * gain and model.actuator_ctrlnum[i] == 1 and model.actuator_ctrllimited[control]:
            targets = (gain * model.actuator_ctrlrange[control] + bias) / kp / gear
            limits = tuple(sorted(map(float, targets)))
        yield _Servo(i, joint, max(float(kp), 0.0), max(float(kv), 0.0), gear, limits)


@rule("MJ310", "warning", "name of the other side")
def signals_of_the_other_side(context: CheckContext) -> Iterator[Violation]:
    """Yields actuators and sensors that are named after the left one of two objects, and belong to the right one."""
    model = context.model
    for kind, index, target_kind, target in _targets(model):
        name, of = mujoco.mj_id2name(model, KINDS[kind], index), mujoco.mj_id2name(model, KINDS[target_kind], target)
        if not (name and of) or _alike(name, of) or not _alike(other_side(name), of):
            continue
        meant = mujoco.mj_name2id(model, KINDS[target_kind], other_side(of))
        if meant >= 0:
            verb = "drives" if kind == "actuator" else "measures"
            message = f"it {verb} {context.object(target_kind, target)}, which is on the other side than its name says"
            remedy = f"write {context.object(target_kind, meant)}, or rename it"
            yield context.violation(kind, index, message, remedy)


@rule("MJ311", "warning", "motion of a body that cannot move")
def sensors_of_fixed_bodies(context: CheckContext) -> Iterator[Violation]:
    """Yields the first sensor of velocities or accelerations on a body that is fixed to the world.

    One that measures relative to an object that moves is left out. Models whose world has no geoms are parts of scenes,
    in which they may move.
    """
    model = context.model
    fixed = [i for i in range(model.nsensor) if _is_motionless(model, i)] if model.body_geomnum[0] else []
    if fixed:
        more = f" (and {len(fixed) - 1} more)" if len(fixed) > 1 else ""
        kind, target = KIND_OF[int(model.sensor_objtype[fixed[0]])], int(model.sensor_objid[fixed[0]])
        message = f"it measures how {context.object(kind, target)} moves, which is fixed to the world{more}"
        remedy = "add the <freejoint/> that its body lacks, or attach the sensor to a body that moves"
        yield context.violation("sensor", fixed[0], message, remedy)


def _is_motionless(model: mujoco.MjModel, sensor: int) -> bool:
    """Returns whether a sensor measures the motion of a body other than the world that is fixed to the world, relative
    to something that is fixed, too.
    """
    if int(model.sensor_type[sensor]) not in MOTION:
        return False
    body = _body(model, int(model.sensor_objtype[sensor]), int(model.sensor_objid[sensor]))
    reference: int | None = 0
    if model.sensor_refid[sensor] >= 0:
        reference = _body(model, int(model.sensor_reftype[sensor]), int(model.sensor_refid[sensor]))
    if not body or reference is None:
        return False
    return not _moves(model, body) and not _moves(model, reference)


def _body(model: mujoco.MjModel, obj: int, index: int) -> int | None:
    """Returns the body of an object of the type `obj`; None for other kinds, such as cameras."""
    kind = KIND_OF.get(obj, "")
    return index if kind == "body" else int(getattr(model, OWNERS[kind])[index]) if kind in OWNERS else None


def _moves(model: mujoco.MjModel, body: int) -> bool:
    return bool(model.body_weldid[body] or model.body_mocapid[model.body_rootid[body]] >= 0)


def _targets(model: mujoco.MjModel) -> Iterator[tuple[str, int, str, int]]:
    """Yields the kind and id of actuators and sensors, each with the kind and id of what it belongs to."""
    for i in range(model.nactuator):
        if target_kind := TRANSMISSIONS.get(int(model.actuator_trntype[i])):
            yield "actuator", i, target_kind, int(model.actuator_trnid[i, 0])
    for i in range(model.nsensor):
        if (target_kind := KIND_OF.get(int(model.sensor_objtype[i]))) and model.sensor_objid[i] >= 0:
            yield "sensor", i, target_kind, int(model.sensor_objid[i])


def _alike(one: str, other: str) -> bool:
    """Returns whether one of two names contains the other."""
    return one in other or other in one


# --- left and right ----------------------------------------------------------------------------------


@rule("MJ309", "warning", "left and right differ")
def unequal_sides(context: CheckContext) -> Iterator[Violation]:
    """Yields moving bodies on the left whose mass, colliding geoms or joints are not those on the right, mirrored.

    Limbs with different numbers of bodies, such as a leg and a prosthesis, are meant to differ. Bodies of one element,
    in a model that is attached on both sides, are the same.
    """
    model = context.model
    followers = _followers(model)
    bodies = {context.name("body", body): body for body in range(1, model.nbody) if model.body_weldid[body]}
    for name, body in bodies.items():
        other = bodies.get(other_side(name))
        if other is None or other <= body or followers[body] != followers[other]:
            continue
        element = context.element("body", body)
        if element and element is context.element("body", other):
            continue
        if differences := list(_differences(context, body, other)):
            message = f"it differs from {context.object('body', other)}: {'; '.join(differences)}"
            remedy = "correct the wrong one; ranges and axes may be mirrored"
            yield context.violation("body", body, message, remedy)


def other_side(name: str) -> str:
    """Returns the name with the words for the other side; unchanged without such words."""
    return SIDES.sub(_mirrored_word, name)


def _mirrored_word(match: re.Match[str]) -> str:
    """Returns the word for the other side: `Left` for `Right`, `FL` for `FR`, `rh` for `lh`."""
    word = match[0]
    if len(word) > 2:
        other = "right" if word.lower() == "left" else "left"
        return other.upper() if word.isupper() else other.capitalize() if word[0].isupper() else other
    side = int(word[1:] in tuple("lrLR"))  # `RL` is rear left, `RF` right front
    return word[:side] + word[side].translate(OTHER_SIDE) + word[side + 1 :]


def _differences(context: CheckContext, left: int, right: int) -> Iterator[str]:
    """Yields the differences between two bodies."""
    model, limits = context.model, context.thresholds
    one, other = float(model.body_mass[left]), float(model.body_mass[right])
    if _difference(one, other) > limits.side_mass:
        yield f"masses {one:.4g} and {other:.4g} kg"

    inertias = [np.sort(model.body_inertia[body]) for body in (left, right)]
    if (worst := _difference(*inertias)) > limits.side_inertia:
        yield f"principal inertias by {100 * worst:.0f} %"

    sizes = [_colliding_sizes(model, body) for body in (left, right)]
    if len(sizes[0]) != len(sizes[1]):
        yield f"{len(sizes[0])} and {len(sizes[1])} colliding geoms"
    elif sizes[0] and (worst := _difference(np.array(sizes[0]), np.array(sizes[1]))) > limits.side_size:
        yield f"sizes of colliding geoms by {100 * worst:.0f} %"

    parents = [context.name("body", int(model.body_parentid[body])) for body in (left, right)]
    offsets = np.linalg.norm(model.body_pos[[left, right]], axis=1)
    if (
        parents[0] != parents[1] == other_side(parents[0])
        and abs(np.diff(offsets)) > limits.side_offset * offsets.max() + MILLIMETRE
    ):
        yield f"distances from {clean(parents[0])} and {clean(parents[1])}, {offsets[0]:.4g} and {offsets[1]:.4g} m"

    joints = [_joints(model, body) for body in (left, right)]
    if [model.jnt_type[j] for j in joints[0]] != [model.jnt_type[j] for j in joints[1]]:
        yield "other joints"
        return
    for pair in zip(*joints, strict=True):
        yield from _joint_differences(context, *pair)
        yield from _actuator_differences(context, *pair)


def _joint_differences(context: CheckContext, left: int, right: int) -> Iterator[str]:
    model, data, limits = context.model, context.data_at(None), context.thresholds
    name = clean(context.name("joint", left))
    home = _common_ancestor(model, int(model.jnt_bodyid[left]), int(model.jnt_bodyid[right]))
    axes = abs(data.xaxis[[left, right]] @ data.xmat[home].reshape(3, 3))
    if abs(axes[0] - axes[1]).max() > limits.side_axis:
        yield f"axes of {name}"
    one, other = model.jnt_range[left], model.jnt_range[right]
    limited = model.jnt_limited[[left, right]]
    if limited[0] != limited[1]:
        if one[0] <= one[1] and other[0] <= other[1]:  # else MJ302 reports it
            yield f"only one {name} has a range"
    elif limited[0]:
        same, mirrored = abs(one - other).max(), abs(one + other[::-1]).max()
        allowed = limits.side_range * np.ptp([one, other])
        if min(same, mirrored) > allowed:
            yield f"ranges of {name}, {one[0]:.4g} to {one[1]:.4g} and {other[0]:.4g} to {other[1]:.4g}"
        elif _turns_like(context, left, right) and same > allowed:
            yield f"{name} turns the other way: its range is mirrored, but its axis is not"
        elif _turns_like(context, left, right, -1) and mirrored > allowed:
            yield f"{name} turns the other way: its axis is mirrored, but its range is not"


def _actuator_differences(context: CheckContext, left: int, right: int) -> Iterator[str]:
    """Yields the differences of the actuators of two joints, if both joints have as many."""
    model, limits = context.model, context.thresholds
    drives = [actuators_of(model, joint) for joint in (left, right)]
    for one, other in zip(*drives, strict=False) if len(drives[0]) == len(drives[1]) else ():
        name = clean(context.name("actuator", one))
        gears = model.actuator_gear[model.actuator_outadr[[one, other]], 0]
        if _difference(*abs(gears)) > limits.side_force:
            yield f"gears of {name}, {gears[0]:.4g} and {gears[1]:.4g}"
        elif gears[0] * gears[1] < 0 and _counts_alike(model, left, right):
            yield f"{name} pulls the other way: its gear is {gears[0]:.4g}, and {gears[1]:.4g} on the other side"
        forces = [abs(model.actuator_forcerange[i]).max() * model.actuator_forcelimited[i] for i in (one, other)]
        if _difference(*forces) > limits.side_force:
            yield f"forceranges of {name}, up to {forces[0]:.4g} and {forces[1]:.4g}"
        gains = [abs(model.actuator_gainprm[i, 0]) for i in (one, other)]
        if _difference(*gains) > limits.side_force:
            yield f"gains of {name}, {gains[0]:.4g} and {gains[1]:.4g}"


def _counts_alike(model: mujoco.MjModel, left: int, right: int) -> bool:
    """Returns whether the ranges of two joints show that their angles have the same sign."""
    one, other = model.jnt_range[left], model.jnt_range[right]
    return bool(model.jnt_limited[left] and abs(one - other).max() < 0.1 * abs(one + other[::-1]).max())


def _turns_like(context: CheckContext, left: int, right: int, sense: int = 1) -> bool:
    """Returns whether two hinges turn in the same or the opposite sense about the line between them, like knees.

    Mirroring keeps the sense of such rotations, and so does moving an arm to the other side. That of others, such as
    the abduction of a hip, depends on which of both is meant.
    """
    model, data = context.model, context.data_at(None)
    line = data.xanchor[left] - data.xanchor[right]
    one, other = data.xaxis[[left, right]] @ line
    is_hinge = model.jnt_type[left] == mujoco.mjtJoint.mjJNT_HINGE
    return bool(is_hinge and min(abs(one), abs(other)) > ALIGNED * np.linalg.norm(line) and one * other * sense > 0)


def _followers(model: mujoco.MjModel) -> list[int]:
    """Returns the number of bodies that each body carries, directly or not."""
    counts = [0] * model.nbody
    for body in range(model.nbody - 1, 0, -1):
        counts[model.body_parentid[body]] += counts[body] + 1
    return counts


def _common_ancestor(model: mujoco.MjModel, one: int, other: int) -> int:
    """Returns the lowest body above two bodies."""
    while one != other:
        one, other = min(one, other), int(model.body_parentid[max(one, other)])
    return one


def _colliding_sizes(model: mujoco.MjModel, body: int) -> list[list[float]]:
    """Returns the half sizes of the colliding geoms of a body, in ascending order."""
    geoms = range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body])
    colliding = [geom for geom in geoms if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    return sorted(sorted(map(float, model.geom_aabb[geom, 3:])) for geom in colliding)


def _joints(model: mujoco.MjModel, body: int) -> range:
    return range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])


def _difference(one: np.ndarray | float, other: np.ndarray | float) -> float:
    """Returns the largest difference relative to the largest number; 0 for zeros."""
    largest = max(np.max(one), np.max(other))
    return float(np.max(abs(np.subtract(one, other))) / largest) if largest > 0 else 0.0
