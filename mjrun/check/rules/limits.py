"""Ranges that are missing, reversed or already left."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.finding import Sighting

WRITTEN = 6e-4  # relative, by which 1.57 differs from a quarter turn
SLACK = 0.01  # of a range; limits are soft, and keyframes are saved from simulations that lean on them
# MuJoCo's enums equal integers, but are not found among those of numpy.
JOINT_DRIVEN = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
TURNING = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_BALL))
SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def unbounded(subject: LintContext) -> Iterator[Sighting]:
    """Actuators whose control and force nothing limits."""
    model = subject.model
    for i in range(model.nactuator):
        start, count = model.actuator_ctrladr[i], model.actuator_ctrlnum[i]
        target = int(model.actuator_trnid[i, 0])
        limited = model.actuator_ctrllimited[start : start + count].all() or model.actuator_forcelimited[i]
        # What acts through an activation is as bounded as that; a muscle clamps its control to [0, 1] by itself.
        limited = limited or model.actuator_actlimited[i] or model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_MUSCLE
        if model.actuator_trntype[i] in JOINT_DRIVEN:
            limited = limited or model.jnt_actfrclimited[target]
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_TENDON:
            limited = limited or model.tendon_actfrclimited[target]
        if not limited:
            message = "it has neither ctrlrange nor forcerange: nothing bounds what it does"
            remedy = 'give it ctrlrange="-1 1" or forcerange="-10 10", or its joint actuatorfrcrange'
            yield Sighting(message, remedy, subject.object("actuator", i), subject.place("actuator", i))


def ignored(subject: LintContext) -> Iterator[Sighting]:
    """Ranges whose first number is the larger: MuJoCo then limits nothing, and says nothing."""
    model = subject.model
    fields = (
        ("joint", "range", model.jnt_range, model.jnt_limited),
        ("joint", "actuatorfrcrange", model.jnt_actfrcrange, model.jnt_actfrclimited),
        ("tendon", "range", model.tendon_range, model.tendon_limited),
        ("tendon", "actuatorfrcrange", model.tendon_actfrcrange, model.tendon_actfrclimited),
        ("actuator", "ctrlrange", model.actuator_ctrlrange, model.actuator_ctrllimited),
        ("actuator", "forcerange", model.actuator_forcerange, model.actuator_forcelimited),
        ("actuator", "actrange", model.actuator_actrange, model.actuator_actlimited),
    )
    for kind, attribute, ranges, limited in fields:
        for i in np.flatnonzero((ranges[:, 0] > ranges[:, 1]) & (limited == 0)):
            low, high = ranges[i]
            message = f"its {attribute} {low:g} {high:g} is reversed, and limits nothing"
            remedy = f'write {attribute}="{high:g} {low:g}" (angles as <compiler angle=…> says), or remove it'
            yield Sighting(message, remedy, subject.object(kind, int(i)), subject.place(kind, int(i)))


def outside(subject: LintContext) -> Iterator[Sighting]:
    """Joints and tendons that start beyond their range."""
    model = subject.model
    for joint in np.flatnonzero(model.jnt_limited):
        if beyond := beyond_range(model, int(joint), model.qpos0):
            message = f"it starts {beyond}, and is pushed back from the first step on"
            remedy = "choose a range that holds the start, 0 or ref, or start from a keyframe with --key"
            yield Sighting(message, remedy, subject.object("joint", int(joint)), subject.place("joint", int(joint)))
    for tendon in map(int, np.flatnonzero(model.tendon_limited)):
        if beyond := beyond_span(float(subject.at(None).ten_length[tendon]), model.tendon_range[tendon], "m"):
            message = f"it starts {beyond}, and is pulled back from the first step on"
            remedy = "choose a range that holds its first length, or start from a keyframe with --key"
            place = subject.place("tendon", tendon)
            yield Sighting(message, remedy, subject.object("tendon", tendon), place, "note")  # a taut string, as a rule


def other_unit(subject: LintContext) -> Iterator[Sighting]:
    """Ranges of joints in degrees that look like radians, and the other way round."""
    model, spec = subject.model, subject.spec
    for joint in map(int, np.flatnonzero(model.jnt_limited & np.isin(model.jnt_type, TURNING))):
        place = subject.place("joint", joint)
        attached = place.origin or (place.line is None and subject.source.attached)  # which has a unit of its own
        told = None if attached or not spec else _mistaken(model.jnt_range[joint], bool(spec.compiler.degree))
        if told:
            yield Sighting(*told, subject.object("joint", joint), place)


def _mistaken(span: np.ndarray, degree: bool) -> tuple[str, str] | None:
    """What there is to say of a range `(2,)` [rad] that was given in degrees, or in radians; None if it looks well."""
    said, meant = ("degree", "radian") if degree else ("radian", "degree")
    given = np.degrees(span) if degree else span
    if not (all(map(_part_of_a_turn, given[given != 0])) if degree else _whole_degrees(given)):
        return None
    low, high = np.degrees(given).round() if degree else np.radians(given)
    message = f"its range {given[0]:.6g} {given[1]:.6g} is in {said}s, and looks like {meant}s"
    return message, f'write <compiler angle="{meant}"/> if that is so of all angles, or range="{low:.4g} {high:.4g}"'


def _part_of_a_turn(angle: float) -> bool:
    """Whether an angle is one to four quarter turns in radians, written with two decimals or more."""
    quarters = abs(angle) / (np.pi / 2)
    return 1 <= round(quarters) <= 4 and abs(quarters / round(quarters) - 1) < WRITTEN


def _whole_degrees(span: np.ndarray) -> bool:
    """Whether a range reads like degrees: whole numbers from an eighth of a turn to a full one."""
    return bool((span == span.round()).all()) and 45 <= abs(span).max() <= 360


def beyond_range(model: mujoco.MjModel, joint: int, qpos: np.ndarray) -> str:
    """How far a limited joint lies beyond its range, in words; empty when it does not."""
    kind, start = int(model.jnt_type[joint]), int(model.jnt_qposadr[joint])
    low, high = map(float, model.jnt_range[joint])
    if kind in SCALAR:
        value, unit = float(qpos[start]), "rad" if kind == mujoco.mjtJoint.mjJNT_HINGE else "m"
    elif kind == mujoco.mjtJoint.mjJNT_BALL:
        turn = np.zeros(3)
        mujoco.mju_quat2Vel(turn, qpos[start : start + 4], 1)
        value, unit = float(np.linalg.norm(turn)), "rad"
    else:
        return ""
    return _beyond(value, low, high, unit)


def beyond_span(value: float, span: np.ndarray, unit: str = "") -> str:
    """How far `value` lies beyond `span` `(2,)`, in words; empty when it does not."""
    return _beyond(value, float(span[0]), float(span[1]), unit)


def _beyond(value: float, low: float, high: float, unit: str) -> str:
    slack = SLACK * (high - low)
    if low - slack <= value <= high + slack:
        return ""
    return f"at {f'{value:.4g} {unit}'.rstrip()}, outside [{low:.4g}, {high:.4g}]"
