"""Ranges of joints, tendons and actuators that are missing, reversed, improbable or violated at the start.

MuJoCo rejects ranges in the text of a model one by one; their fixes change all of them.
"""

from collections.abc import Iterator, Sequence
from functools import partial

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.finding import Fix, Violation
from mjrun.check.rule import GENERATED, NOT_CERTAIN, SAFE, UNSAFE, rule, words_fix
from mjrun.check.rules.bodies import INFINITE
from mjrun.errors import option
from mjrun.model.names import JOINT_TRANSMISSIONS, SCALAR_JOINTS, actuator_parts
from mjrun.model.text_edits import ElementEditor, number_word
from mjrun.model.xml_source import ACTUATORS, Element, XmlSource, holder

ROUNDING = 6e-4  # the relative error of 1.57 as a quarter turn
SLACK = 0.01  # relative to a range; limits are soft, and keyframes are saved from simulations at their limits
# MuJoCo's enums equal integers, but numpy does not find them among integers.
HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
ROTATING = (HINGE, int(mujoco.mjtJoint.mjJNT_BALL))
FIELD_PREFIXES = {"joint": "jnt", "tendon": "tendon", "actuator": "actuator"}
FIELDS = {"actuatorfrcrange": "actfrcrange"}  # whose names differ from those of the attributes
ENDINGS = ("range", "limited")
INHERITED = tuple(f"actuator_{kind}{ending}" for kind in ("ctrl", "act") for ending in ENDINGS)  # with inheritrange
TRANSMISSIONS = {"joint": JOINT_TRANSMISSIONS, "tendon": (int(mujoco.mjtTrn.mjTRN_TENDON),)}
# The attributes with ranges, and those that enable them, of joints and tendons, and of actuators.
LIMITS = {"range": "limited", "actuatorfrcrange": "actuatorfrclimited"}
ACTUATOR_LIMITS = {"ctrlrange": "ctrllimited", "forcerange": "forcelimited", "actrange": "actlimited"}
RANGES = {
    **dict.fromkeys(("joint", "tendon", "spatial", "fixed"), tuple(LIMITS.items())),
    **dict.fromkeys(ACTUATORS, tuple(ACTUATOR_LIMITS.items())),
    "position": (*ACTUATOR_LIMITS.items(), ("inheritrange", "ctrllimited")),
    "intvelocity": (*ACTUATOR_LIMITS.items(), ("inheritrange", "actlimited")),
}
INNER = 0.75  # part of a box that is well inside; links may touch beside the hinge
SAMPLES = 24  # positions of a hinge, at least 15 degrees apart in a full turn


@rule("MJ301", "note", "actuator without limits")
def actuators_without_limits(context: CheckContext) -> Iterator[Violation]:
    """Yields actuators with neither a limited control nor a limited force."""
    model = context.model
    for i in range(model.nactuator):
        start, count = model.actuator_ctrladr[i], model.actuator_ctrlnum[i]
        target = int(model.actuator_trnid[i, 0])
        limited = model.actuator_ctrllimited[start : start + count].all() or model.actuator_forcelimited[i]
        # An activation limits its actuator; a muscle clamps its control to [0, 1] itself.
        limited = limited or model.actuator_actlimited[i] or model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_MUSCLE
        if model.actuator_trntype[i] in JOINT_TRANSMISSIONS:
            limited = limited or model.jnt_actfrclimited[target]
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_TENDON:
            limited = limited or model.tendon_actfrclimited[target]
        if not limited:
            message = "it has neither ctrlrange nor forcerange: nothing limits it"
            remedy = 'give it ctrlrange="-1 1" or forcerange="-10 10", or its joint actuatorfrcrange'
            yield context.violation("actuator", i, message, remedy)


@rule("MJ302", "warning", "reversed range", fix=SAFE)
def reversed_ranges(context: CheckContext) -> Iterator[Violation]:
    """Yields ranges whose first number is the larger one, which MuJoCo silently ignores."""
    model = context.model
    fields = (
        ("joint", "range", model.jnt_range, model.jnt_limited),
        ("joint", "actuatorfrcrange", model.jnt_actfrcrange, model.jnt_actfrclimited),
        ("tendon", "range", model.tendon_range, model.tendon_limited),
        ("tendon", "actuatorfrcrange", model.tendon_actfrcrange, model.tendon_actfrclimited),
        ("actuator", "ctrlrange", model.actuator_ctrlrange, model.actuator_ctrllimited),
        ("actuator", "forcerange", model.actuator_forcerange, model.actuator_forcelimited),
        ("actuator", "actrange", model.actuator_actrange, model.actuator_actlimited),
    )
    controls = [actuator for _, actuator in actuator_parts(model, model.actuator_ctrlnum)]
    for kind, attribute, ranges, limited in fields:
        for row in map(int, np.flatnonzero((ranges[:, 0] > ranges[:, 1]) & (limited == 0))):
            low, high = ranges[row]
            i = controls[row] if attribute == "ctrlrange" else row
            element = context.element(kind, i)
            message = f"its {attribute} {low:g} {high:g} is reversed and has no effect"
            remedy = f'write {attribute}="{high:g} {low:g}" (angles in the unit of <compiler angle=…>), or remove it'
            if element and element.within("robot"):
                remedy = f'write <limit lower="{high:g}" upper="{low:g}" …/>'
            fix = partial(_swapped, context, kind, i, attribute)
            yield context.violation(kind, i, message, remedy, fix=fix)


def _swapped(context: CheckContext, kind: str, index: int, attribute: str) -> Fix | str:
    """Returns the fix that swaps the numbers of a range, in the element or in the default class that sets it."""
    element = context.element(kind, index)
    owner = holder(element, attribute) if element else None
    if owner is None:
        return GENERATED
    words = owner.attributes[attribute].split()
    if len(words) != 2:
        return NOT_CERTAIN
    edits = context.editor.with_words(owner, attribute, {0: words[1], 1: words[0]})
    return Fix(edits, tuple(_changes(context, kind, index, attribute)))


def _changes(context: CheckContext, kind: str, index: int, attribute: str) -> Iterator[tuple[str, str]]:
    """Yields the fields that depend on a range, each with its object: those of actuators that inherit it, too."""
    model, stem = context.model, f"{FIELD_PREFIXES[kind]}_{FIELDS.get(attribute, attribute)[:-5]}"
    owner = context.name(kind, index)
    if attribute == "ctrlrange" and model.actuator_ctrlnum[index] > 1:
        owner = f"{owner}/*"  # all of its controls
    yield from ((f"{stem}{ending}", owner) for ending in ENDINGS)
    if attribute == "range":
        drives = (model.actuator_trnid[:, 0] == index) & np.isin(model.actuator_trntype, TRANSMISSIONS[kind])
        for actuator in map(int, np.flatnonzero(drives)):
            yield from ((field, context.name("actuator", actuator)) for field in INHERITED)


@rule("MJ304", "warning", "joint or tendon starts beyond its range")
def starts_beyond_range(context: CheckContext) -> Iterator[Violation]:
    """Yields joints and tendons that start beyond their range; as a note if a keyframe starts a joint within it."""
    model = context.model
    for joint in joints_beyond_range(context, None):
        message = f"it starts {beyond_range(model, joint, model.qpos0)}, and is pushed back from the first step on"
        keyframes = (key for key in context.starts if key is not None)
        within = next((key for key in keyframes if not beyond_range(model, joint, model.key_qpos[key])), None)
        if within is None:
            remedy = f"choose a range that includes the start, 0 or ref, or start from a keyframe with {option('key')}"
            yield context.violation("joint", joint, message, remedy)
        else:
            remedy = f"start from {context.object('keyframe', within)} with {option('key')}"
            yield context.violation("joint", joint, message, remedy, "note")
    for tendon, beyond in tendons_beyond_range(context).items():
        message = f"it starts {beyond}, and is pulled back from the first step on"
        remedy = f"choose a range that includes its initial length, or start from a keyframe with {option('key')}"
        yield context.violation("tendon", tendon, message, remedy, "note")  # usually a taut string


def tendons_beyond_range(context: CheckContext) -> dict[int, str]:
    """Returns the limited tendons that are beyond their range at the initial state, each with its position."""
    model, lengths = context.model, context.data_at(None).ten_length
    limited = map(int, np.flatnonzero(model.tendon_limited))
    positions = {each: beyond_span(float(lengths[each]), model.tendon_range[each], "m") for each in limited}
    return {tendon: beyond for tendon, beyond in positions.items() if beyond}


def joints_beyond_range(context: CheckContext, start: int | None) -> list[int]:
    """Returns the limited joints that are beyond their range at a start."""
    model = context.model
    qpos = model.qpos0 if start is None else model.key_qpos[start]
    return [joint for joint in map(int, np.flatnonzero(model.jnt_limited)) if beyond_range(model, joint, qpos)]


@rule("MJ305", "warning", "angle probably in the wrong unit", fix=UNSAFE)
def ranges_in_other_unit(context: CheckContext) -> Iterator[Violation]:
    """Yields ranges of joints in degrees that look like radians, and the other way round."""
    model, spec = context.model, context.spec
    for joint in map(int, np.flatnonzero(model.jnt_limited & np.isin(model.jnt_type, ROTATING))):
        place = context.place("joint", joint)
        attached = place.origin or (place.line is None and context.source.attached)  # the unit may differ there
        if attached or not spec:
            continue
        if explanation := _other_unit(model.jnt_range[joint], bool(spec.compiler.degree)):
            message, remedy, words = explanation
            yield context.violation("joint", joint, message, remedy, fix=partial(_converted, context, joint, words))


def _converted(context: CheckContext, joint: int, words: Sequence[str]) -> Fix | str:
    """Returns the fix that writes a range in the other unit, in the element or in the default class that sets it."""
    element = context.element("joint", joint)
    owner = holder(element, "range") if element else None
    return words_fix(context, owner, "range", dict(enumerate(words)), *_changes(context, "joint", joint, "range"))


def _other_unit(span: np.ndarray, degree: bool) -> tuple[str, str, Sequence[str]] | None:
    """Returns message, remedy and the right numbers for a range `(2,)` [rad] in one unit that looks like the other."""
    unit, meant = ("degree", "radian") if degree else ("radian", "degree")
    written = np.degrees(span) if degree else span
    if not (all(map(_quarter_turns, written[written != 0])) if degree else _whole_degrees(written)):
        return None
    low, high = np.degrees(written).round() if degree else np.radians(written)
    message = f"its range {written[0]:.6g} {written[1]:.6g} is in {unit}s, but looks like {meant}s"
    remedy = f'write <compiler angle="{meant}"/> if all angles are, or range="{low:.4g} {high:.4g}"'
    return message, remedy, [number_word(low), number_word(high)]


def _quarter_turns(angle: float) -> bool:
    """Returns whether an angle in radians is one to four quarter turns, written with two or more decimals."""
    quarters = abs(angle) / (np.pi / 2)
    return 1 <= round(quarters) <= 4 and abs(quarters / round(quarters) - 1) < ROUNDING


def _whole_degrees(span: np.ndarray) -> bool:
    """Returns whether a range looks like degrees: whole numbers, from an eighth of a turn to a full turn."""
    return bool((span == span.round()).all()) and 45 <= abs(span).max() <= 360


@rule("MJ308", "note", "improbable range of a hinge")
def improbable_turns(context: CheckContext) -> Iterator[Violation]:
    """Yields hinges that can turn by an improbably small or large angle, unless MJ305 reports them."""
    model, limits = context.model, context.thresholds
    turns = model.jnt_range[:, 1] - model.jnt_range[:, 0]
    reported = {finding.object for finding in ranges_in_other_unit.findings(context)}
    hinges = (model.jnt_limited != 0) & (model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE))
    for joint in map(int, np.flatnonzero(hinges & ((turns < limits.min_hinge_turn) | (turns > limits.hinge_turn)))):
        if context.object("joint", joint) in reported:
            continue
        if turns[joint] < limits.min_hinge_turn:
            message = (
                f"it can turn by {np.degrees(turns[joint]):.2g} degrees: is its range in radians, but read in degrees?"
            )
            remedy = 'write <compiler angle="radian"/> if all angles are, or lock the joint by removing it'
        else:
            message = (
                f"it can turn by {turns[joint] / (2 * np.pi):.3g} turns: is its range in degrees, but read in radians?"
            )
            remedy = 'write <compiler angle="degree"/> if all angles are, or remove the range if it turns freely'
        yield context.violation("joint", joint, message, remedy)


def beyond_range(model: mujoco.MjModel, joint: int, qpos: np.ndarray) -> str:
    """Returns the position of a limited joint if it is beyond its range; else an empty text."""
    kind, start = int(model.jnt_type[joint]), int(model.jnt_qposadr[joint])
    if kind in SCALAR_JOINTS:
        value, unit = float(qpos[start]), "rad" if kind == mujoco.mjtJoint.mjJNT_HINGE else "m"
    elif kind == mujoco.mjtJoint.mjJNT_BALL:
        turn = np.zeros(3)
        mujoco.mju_quat2Vel(turn, qpos[start : start + 4], 1)
        value, unit = float(np.linalg.norm(turn)), "rad"
    else:
        return ""
    return beyond_span(value, model.jnt_range[joint], unit)


def beyond_span(value: float, span: np.ndarray, unit: str = "") -> str:
    """Returns the position of `value` if it is beyond `span` `(2,)`; else an empty text."""
    low, high = map(float, span)
    slack = SLACK * (high - low)
    if low - slack <= value <= high + slack:
        return ""
    return f"at {f'{value:.4g} {unit}'.rstrip()}, outside [{low:.4g}, {high:.4g}]"


def enabled_ranges(source: XmlSource) -> Fix | str:
    """Returns the fix that enables every range of which the text does not state whether it applies."""
    editor = ElementEditor(source.mjcf_texts)
    edits = [
        editor.with_value(element, limit, "true")
        for element, span, limit in _ranges(source)
        if holder(element, limit) is None and any(element.numbers(span))
    ]
    return Fix(tuple(edits)) if edits else NOT_CERTAIN


def swapped_ranges(source: XmlSource) -> Fix | str:
    """Returns the fix that swaps the numbers of every reversed range."""
    editor = ElementEditor(source.mjcf_texts)
    edits = [
        edit
        for element, span in elements_with_reversed_range(source)
        for edit in editor.with_words(element, span, dict(enumerate(reversed(element.attributes[span].split()))))
    ]
    return Fix(tuple(edits)) if edits else NOT_CERTAIN


def elements_with_reversed_range(source: XmlSource) -> list[tuple[Element, str]]:
    """Returns each element with a reversed range, and the attribute with the range."""
    numbers = ((element, span, element.numbers(span)) for element, span, _ in _ranges(source))
    return [(element, span) for element, span, values in numbers if len(values) == 2 and values[0] > values[1]]


def _ranges(source: XmlSource) -> Iterator[tuple[Element, str, str]]:
    """Yields each element with a range, and the names of the attributes with the range and with what enables it."""
    for element in source.elements():
        for span, limit in RANGES.get(element.tag, ()):
            if span in element.attributes:
                yield element, span, limit


@rule("MJ313", "note", "hinge that turns its link through its parent")
def links_through_parents(context: CheckContext) -> Iterator[Violation]:
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


def _entered(context: CheckContext, joint: int, low: float, high: float) -> tuple[int, int] | None:
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
