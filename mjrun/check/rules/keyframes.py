"""Keyframes that a simulation cannot start from as written."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.finding import Fix, Violation
from mjrun.check.rule import GENERATED, SAFE, UNSAFE, rule, words_fix
from mjrun.check.rules.limits import beyond_range, beyond_span, joints_beyond_range
from mjrun.errors import counted, listing
from mjrun.model.names import BALL, FREE, SCALAR_JOINTS, actuator_parts
from mjrun.model.text_edits import number_word

# The fields of a keyframe, and the values with which MuJoCo completes them.
FIELDS = {"qpos": "qpos0", "qvel": "0", "act": "0", "ctrl": "0", "mpos": "pos", "mquat": "quat"}
SIZE_REMEDY = "write one number for each; `mjrun info` lists them by joint, actuator and address"
TOLERANCE = 1e-3  # of the length of a quaternion, which is 1; files have few digits


@rule("MJ401", "error", "keyframe not finite")
def keyframes_not_finite(context: CheckContext) -> Iterator[Violation]:
    """Yields keyframes with numbers that are not finite, or so large that MuJoCo considers them unstable."""
    model = context.model
    for key in range(model.nkey):
        for name in FIELDS:
            values = getattr(model, f"key_{name}")[key]
            bad = np.flatnonzero(~(abs(values) < mujoco.mjMAXVAL))
            if bad.size:
                message = f"{name}[{bad[0]}] is {values[bad[0]]:g}"
                remedy = f"write a finite number below {mujoco.mjMAXVAL:g}"
                yield context.violation("keyframe", key, message, remedy)


@rule("MJ402", "warning", "keyframe beyond a joint range", fix=UNSAFE)
def keyframes_beyond_range(context: CheckContext) -> Iterator[Violation]:
    """Yields keyframes that put joints beyond their ranges."""
    model = context.model
    for key in range(model.nkey):
        qpos = model.key_qpos[key]
        if not np.isfinite(qpos).all() or np.array_equal(qpos, model.qpos0):
            continue  # MJ304 reports qpos0
        joints = joints_beyond_range(context, key)
        if not joints:
            continue
        first, *others = joints
        more = f" (and {counted(len(others), 'more joint')} beyond theirs)" if others else ""
        message = f"{context.object('joint', first)} is {beyond_range(model, first, qpos)}{more}"
        entries = [_entry(context, key, "qpos", int(model.jnt_qposadr[joint])) for joint in joints]
        numbers = listing(entries) if all(entries) else "the position of the joint"
        remedy = f"change {numbers} in the keyframe, or the range of the joint"
        yield context.violation("keyframe", key, message, remedy, fix=partial(_joints_within, context, key, joints))


def _joints_within(context: CheckContext, key: int, joints: Sequence[int]) -> Fix | str:
    """Returns the fix that moves hinges and slides to the nearest bound."""
    model, words = context.model, dict[int, str]()
    for joint in joints:
        if model.jnt_type[joint] in SCALAR_JOINTS:
            address = int(model.jnt_qposadr[joint])
            words[address] = number_word(np.clip(model.key_qpos[key, address], *model.jnt_range[joint]))
    return keyframe_fix(context, key, "qpos", words)


def keyframe_fix(context: CheckContext, key: int, field: str, words: Mapping[int, str]) -> Fix | str:
    """Returns the fix that replaces numbers of a keyframe, by their index in the compiled model.

    The keyframe of an attached model counts only the joints and actuators of that model.
    """
    if context.place("keyframe", key).origin:
        return GENERATED
    change = (f"key_{field}", context.name("keyframe", key))
    return words_fix(context, context.element("keyframe", key), field, words, change)


@rule("MJ403", "warning", "keyframe beyond a control range", fix=UNSAFE)
def controls_beyond_range(context: CheckContext) -> Iterator[Violation]:
    """Yields keyframes with a control or an activation beyond its range, unless the controls are omitted and thus 0."""
    model = context.model
    clamps = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    for key in range(model.nkey):
        element = context.element("keyframe", key)
        has_ctrl = "ctrl" in element.attributes if element else model.key_ctrl[key].any()
        owners = [actuator for _, actuator in actuator_parts(model, model.actuator_ctrlnum)]
        for i in map(int, np.flatnonzero(model.actuator_ctrllimited)) if has_ctrl else ():
            if beyond := beyond_span(float(model.key_ctrl[key, i]), model.actuator_ctrlrange[i]):
                clamped = "; MuJoCo clamps it" if clamps else ""
                message = f"the control of {context.object('actuator', owners[i])} is {beyond}{clamped}"
                number = _entry(context, key, "ctrl", i) or "the control of the actuator"
                remedy = f"change {number} in the keyframe, or the actuator's ctrlrange"
                words = {i: number_word(np.clip(model.key_ctrl[key, i], *model.actuator_ctrlrange[i]))}
                fix = partial(keyframe_fix, context, key, "ctrl", words)
                yield context.violation("keyframe", key, message, remedy, fix=fix)
        yield from _activations(context, key)


def _activations(context: CheckContext, key: int) -> Iterator[Violation]:
    model = context.model
    for i in map(int, np.flatnonzero(model.actuator_actlimited & (model.actuator_actadr >= 0))):
        last = int(model.actuator_actadr[i] + model.actuator_actnum[i] - 1)  # the one that is limited
        if beyond := beyond_span(float(model.key_act[key, last]), model.actuator_actrange[i]):
            message = f"the activation of {context.object('actuator', i)} is {beyond}"
            number = _entry(context, key, "act", last) or "the activation of the actuator"
            remedy = f"change {number} in the keyframe, or the actuator's actrange"
            words = {last: number_word(np.clip(model.key_act[key, last], *model.actuator_actrange[i]))}
            fix = partial(keyframe_fix, context, key, "act", words)
            yield context.violation("keyframe", key, message, remedy, fix=fix)


@rule("MJ404", "warning", "keyframe with a bad quaternion", fix=SAFE)
def quaternions_not_normalized(context: CheckContext) -> Iterator[Violation]:
    """Yields keyframes with a quaternion that is not a rotation; MuJoCo normalizes it, and reads 0 as no rotation."""
    model = context.model
    offsets = {FREE: 3, BALL: 0}
    for key in range(model.nkey):
        for joint in range(model.njnt):
            offset = offsets.get(int(model.jnt_type[joint]))
            if offset is None:
                continue
            start = int(model.jnt_qposadr[joint]) + offset
            length = float(np.linalg.norm(_written_qpos(context, key)[start : start + 4]))
            if abs(length - 1) > TOLERANCE:
                message = f"the quaternion of {context.object('joint', joint)} has length {length:.4g}, not 1"
                last = _entry(context, key, "qpos", start + 3)
                numbers = f"qpos[{start}] to {last}" if last else "the orientation of the joint"
                fix = partial(_normalized, context, key, start)
                yield context.violation("keyframe", key, message, f"change {numbers} in the keyframe", fix=fix)


def _normalized(context: CheckContext, key: int, start: int) -> Fix | str:
    """Returns the fix that writes the quaternion which MuJoCo uses."""
    element = context.element("keyframe", key)
    if element is None or len(_words(context, key, "qpos")) != context.model.nq:
        return GENERATED
    quaternion = context.model.key_qpos[key, start : start + 4]
    words = {start + i: number_word(number) for i, number in enumerate(quaternion)}
    return Fix(context.editor.with_words(element, "qpos", words))


@rule("MJ405", "error", "keyframe of the wrong size")
def incomplete_keyframes(context: CheckContext) -> Iterator[Violation]:
    """Yields keyframes with fewer numbers than the model has, or than the file needs that the model includes.

    MuJoCo completes them. Attached models may add numbers: a keyframe need not be complete in a model that attaches
    any. Those with too many numbers do not load, and MuJoCo rejects some incomplete ones: see `compile_errors`.
    """
    for key in range(0 if context.source.attached else context.model.nkey):
        file = context.place("keyframe", key).file
        for field, filled in FIELDS.items():
            count, size = len(_words(context, key, field)), getattr(context.model, f"key_{field}").shape[1]
            if 0 < count < size and file != context.path:
                size = _size_within(context, file, field)
            if 0 < count < size:
                message = f"{size_message(field, count, size)}; MuJoCo uses {filled} for the rest"
                yield context.violation("keyframe", key, message, SIZE_REMEDY, "warning")


def _size_within(context: CheckContext, file: Path, field: str) -> int:
    """Returns the number of values up to the last object of an included file; 0 without such objects."""
    model = context.model
    kind, ends = {
        "qpos": ("joint", [*model.jnt_qposadr[1:], model.nq]),
        "qvel": ("joint", [*model.jnt_dofadr[1:], model.nv]),
        "ctrl": ("actuator", [*np.cumsum(model.actuator_ctrlnum)]),
    }.get(field, ("", []))
    inside = [int(end) for i, end in enumerate(ends) if context.place(kind, i).file == file]
    return max(inside, default=0)


def size_message(field: str, count: int, size: int) -> str:
    """Returns a message that a keyframe has `count` numbers in a field of which the model has `size`."""
    return f"{field} of the keyframe has {count} number{'s' * (count != 1)}, but the model has {size}"


def _written_qpos(context: CheckContext, key: int) -> np.ndarray:
    """Returns the positions as written; the compiler has normalized those of the model."""
    try:
        written = np.array([float(word) for word in _words(context, key, "qpos")])
    except ValueError:
        written = np.empty(0)
    return written if written.size == context.model.nq else context.model.key_qpos[key]


def _entry(context: CheckContext, key: int, field: str, index: int) -> str:
    """Returns a number of a keyframe, as `qpos[3]`; empty if it is missing, or declared by an attached model."""
    words = _words(context, key, field)
    return f"{field}[{index}]" if index < len(words) and not context.place("keyframe", key).origin else ""


def _words(context: CheckContext, key: int, field: str) -> list[str]:
    """Returns the numbers in a field of a keyframe as written."""
    element = context.element("keyframe", key)
    return element.attributes.get(field, "").split() if element else []
