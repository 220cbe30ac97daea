"""Names and numbers of a compiled model as plain values."""

from collections.abc import Iterable
from functools import cache
from typing import Any

import mujoco
import numpy as np

from mjrun.model.names import enum_members

BODY, JOINT, GEOM = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_GEOM
SITE, CAMERA, TENDON = mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_CAMERA, mujoco.mjtObj.mjOBJ_TENDON
# Kinds of objects that mjrun does not call by MuJoCo's short word.
WORDS = {"xbody": "body", "key": "keyframe"}

SINGLE: type = np.float32
Pair = tuple[float, float]


@cache
def _spellings(enum: Any) -> dict[int, str]:
    return {value: name for name, value in enum_members(enum).items()}


def enum_name(enum: Any, value: Any) -> str:
    """The short name of a member of a MuJoCo enum, `hinge`; the number as text where there is none."""
    return _spellings(enum).get(int(value), str(int(value)))


def object_name(model: mujoco.MjModel, kind: Any, index: Any) -> str | None:
    """The name of an object, `joint:3` if it has none; None where there is no object, index −1."""
    if index < 0:
        return None
    word = enum_name(mujoco.mjtObj, kind)
    return mujoco.mj_id2name(model, int(kind), int(index)) or f"{WORDS.get(word, word)}:{index}"


def object_names(model: mujoco.MjModel, kind: Any, start: Any, count: Any) -> tuple[str, ...]:
    """The names of `count` objects of a kind, from id `start` on."""
    return tuple(object_name(model, kind, int(start) + i) or "" for i in range(int(count)))


def body_name(model: mujoco.MjModel, index: Any) -> str:
    """The name of a body."""
    return object_name(model, BODY, index) or ""


def decimal_float(value: Any) -> float:
    """A number as a float; in single precision the shortest decimal that rounds to it, 0.1 and not 0.10000000149."""
    return float(str(value)) if isinstance(value, SINGLE) else float(value)


def floats(values: Iterable[Any]) -> tuple[float, ...]:
    """Numbers as floats."""
    return tuple(decimal_float(value) for value in values)


def without_trailing_zeros(values: Iterable[Any]) -> tuple[float, ...]:
    """Numbers as floats, without the zeros at the end."""
    numbers = list(floats(values))
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


def limited_range(limited: Any, values: np.ndarray) -> Pair | None:
    """A range, or None if it is not enforced."""
    return (float(values[0]), float(values[1])) if limited else None
