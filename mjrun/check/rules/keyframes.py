"""Keyframes that a simulation cannot start from as they are."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.finding import Sighting
from mjrun.check.rules.limits import beyond_range, beyond_span
from mjrun.model.joints import BALL, FREE
from mjrun.model.names import actuator_parts

# What a keyframe holds, and what MuJoCo takes where its text ends.
FIELDS = {"qpos": "qpos0", "qvel": "0", "act": "0", "ctrl": "0", "mpos": "pos", "mquat": "quat"}
LONGEST = 1e-3  # by which a quaternion's length may differ from 1; files are written with few digits


def infinite(subject: LintContext) -> Iterator[Sighting]:
    """Keyframes with numbers that are not finite, or that MuJoCo takes for unstable."""
    model = subject.model
    for key in range(model.nkey):
        for name in FIELDS:
            values = getattr(model, f"key_{name}")[key]
            bad = np.flatnonzero(~(abs(values) < mujoco.mjMAXVAL))
            if bad.size:
                message = f"{name}[{bad[0]}] is {values[bad[0]]:g}"
                yield _sighting(subject, key, message, f"write a finite number below {mujoco.mjMAXVAL:g}")


def beyond_joints(subject: LintContext) -> Iterator[Sighting]:
    """Keyframes that put a joint beyond its range."""
    model = subject.model
    for key in range(model.nkey):
        qpos = model.key_qpos[key]
        if not np.isfinite(qpos).all() or np.array_equal(qpos, model.qpos0):
            continue  # the latter is told of the joints themselves
        for joint in map(int, np.flatnonzero(model.jnt_limited)):
            if beyond := beyond_range(model, joint, qpos):
                message = f"{subject.object('joint', joint)} is {beyond}"
                what = _entry(subject, key, "qpos", int(model.jnt_qposadr[joint])) or "the position of the joint"
                remedy = f"change {what} in the keyframe, or the range of the joint"
                yield _sighting(subject, key, message, remedy)


def beyond_controls(subject: LintContext) -> Iterator[Sighting]:
    """Keyframes with a control or an activation beyond its range; controls that were not given are 0."""
    model = subject.model
    clamps = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    for key in range(model.nkey):
        element = subject.element("keyframe", key)
        given = "ctrl" in element.attributes if element else model.key_ctrl[key].any()
        owners = [actuator for _, actuator in actuator_parts(model, model.actuator_ctrlnum)]
        for i in map(int, np.flatnonzero(model.actuator_ctrllimited)) if given else ():
            if beyond := beyond_span(float(model.key_ctrl[key, i]), model.actuator_ctrlrange[i]):
                then = "; MuJoCo clamps it" if clamps else ""
                message = f"the control of {subject.object('actuator', owners[i])} is {beyond}{then}"
                what = _entry(subject, key, "ctrl", i) or "the control of the actuator"
                yield _sighting(subject, key, message, f"change {what} in the keyframe, or the actuator's ctrlrange")
        yield from _activations(subject, key)


def _activations(subject: LintContext, key: int) -> Iterator[Sighting]:
    model = subject.model
    for i in map(int, np.flatnonzero(model.actuator_actlimited & (model.actuator_actadr >= 0))):
        last = int(model.actuator_actadr[i] + model.actuator_actnum[i] - 1)  # the one that is limited
        if beyond := beyond_span(float(model.key_act[key, last]), model.actuator_actrange[i]):
            message = f"the activation of {subject.object('actuator', i)} is {beyond}"
            what = _entry(subject, key, "act", last) or "the activation of the actuator"
            yield _sighting(subject, key, message, f"change {what} in the keyframe, or the actuator's actrange")


def long_quaternions(subject: LintContext) -> Iterator[Sighting]:
    """Keyframes with an orientation that is no rotation; MuJoCo scales it to length 1, and takes 0 for none."""
    model = subject.model
    places = {FREE: 3, BALL: 0}
    for key in range(model.nkey):
        for joint in range(model.njnt):
            offset = places.get(int(model.jnt_type[joint]))
            if offset is None:
                continue
            start = int(model.jnt_qposadr[joint]) + offset
            length = float(np.linalg.norm(_given_qpos(subject, key)[start : start + 4]))
            if abs(length - 1) > LONGEST:
                message = f"the quaternion of {subject.object('joint', joint)} has length {length:.4g}, and not 1"
                last = _entry(subject, key, "qpos", start + 3)
                what = f"qpos[{start}] to {last}" if last else "the orientation of the joint"
                yield _sighting(subject, key, message, f"change {what} in the keyframe")


def short(subject: LintContext) -> Iterator[Sighting]:
    """Keyframes whose text in the model's own file holds fewer numbers than the model needs; MuJoCo fills them up.

    What the model attaches may add numbers of its own: there the text of a keyframe need not be complete.
    """
    for key in range(0 if subject.source.attached else subject.model.nkey):
        if subject.place("keyframe", key).file != subject.path:
            continue
        for field, filled in FIELDS.items():
            given, needed = len(_words(subject, key, field)), getattr(subject.model, f"key_{field}").shape[1]
            if 0 < given < needed:
                message = f"{field} of the keyframe holds {_counted(given)}, and the model has {needed}"
                remedy = "write one number for each; `mjrun info` lists them by joint, actuator and address"
                sighting = _sighting(subject, key, f"{message}; MuJoCo takes {filled} for the rest", remedy)
                yield sighting._replace(severity="warning")


def _counted(number: int) -> str:
    return f"{number} number{'s' * (number != 1)}"


def _given_qpos(subject: LintContext, key: int) -> np.ndarray:
    """The positions as they are written: the compiler has scaled those of the model."""
    try:
        written = np.array([float(word) for word in _words(subject, key, "qpos")])
    except ValueError:
        written = np.empty(0)
    return written if written.size == subject.model.nq else subject.model.key_qpos[key]


def _entry(subject: LintContext, key: int, field: str, index: int) -> str:
    """A number of a keyframe as its text counts it; empty where that is an attached model's, or has not so many."""
    words = _words(subject, key, field)
    return f"{field}[{index}]" if index < len(words) and not subject.place("keyframe", key).origin else ""


def _words(subject: LintContext, key: int, field: str) -> list[str]:
    """What the text of a keyframe holds for a field."""
    element = subject.element("keyframe", key)
    return element.attributes.get(field, "").split() if element else []


def _sighting(subject: LintContext, key: int, message: str, remedy: str) -> Sighting:
    return Sighting(message, remedy, subject.object("keyframe", key), subject.place("keyframe", key))
