"""Bodies on the left and on the right that differ, although their names say that they mirror each other."""

import re
from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.rule import Violation, rule
from mjrun.errors import clean
from mjrun.model.names import actuators_of

# The words for sides: left and right anywhere, L and R alone or beside front, rear, hind, back and middle.
SIDES = re.compile(r"left|right|(?<![a-z])(?:[frhbm][lr]|[lr][fhbm]|[lr])(?![a-z])", re.IGNORECASE)
ALIGNED = 0.9  # cosine between an axis and the line between both sides
MILLIMETRE = 0.001  # [m]
OTHER_SIDE = str.maketrans("lrLR", "rlRL")


@rule("MJ309", "warning", "left and right differ")
def unequal_sides(context: CheckContext) -> Iterator[Violation]:
    """Yields moving bodies on the left whose mass, colliding geoms or joints are not those on the right, mirrored.

    Limbs with different numbers of bodies, such as a leg and a prosthesis, are meant to differ.
    """
    model = context.model
    followers = _followers(model)
    bodies = {context.name("body", body): body for body in range(1, model.nbody) if model.body_weldid[body]}
    for name, body in bodies.items():
        other = bodies.get(other_side(name))
        if other is None or other <= body or followers[body] != followers[other]:
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
        gears = model.actuator_gear[[one, other], 0]
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
