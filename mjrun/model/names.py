"""Kinds of objects, their names and ids, names of controls and components, and members of MuJoCo's enums by name."""

from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from fnmatch import fnmatchcase
from functools import cache
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import UnknownNameError

# The prefix of the model fields of each kind of object: `jnt_type` of `njnt` joints.
PREFIXES = {
    "body": "body",
    "joint": "jnt",
    "geom": "geom",
    "site": "site",
    "camera": "cam",
    "actuator": "actuator",
    "keyframe": "key",
    "sensor": "sensor",
    "tendon": "tendon",
    "light": "light",
    "equality": "eq",
    "flex": "flex",
    "skin": "skin",
    "mesh": "mesh",
    "hfield": "hfield",
    "texture": "tex",
    "material": "mat",
    "pair": "pair",
    "exclude": "exclude",
    "numeric": "numeric",
    "text": "text",
    "tuple": "tuple",
    "plugin": "plugin",
}
COUNTS = {kind: f"n{prefix}" for kind, prefix in PREFIXES.items()}
KIND_OF_COUNT = {count: kind for kind, count in COUNTS.items()}
KINDS = {
    kind: getattr(mujoco.mjtObj, "mjOBJ_KEY" if kind == "keyframe" else f"mjOBJ_{kind.upper()}") for kind in PREFIXES
}
KIND_OF = {int(obj): kind for kind, obj in KINDS.items()} | {int(mujoco.mjtObj.mjOBJ_XBODY): "body"}
PLURALS = {"body": "bodies", "equality": "equalities", "flex": "flexes", "mesh": "meshes"}

# Fields of MjData with the places of objects, in the order in which a bare name is looked up.
PLACES = {"body": "xpos", "geom": "geom_xpos", "site": "site_xpos"}

FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
SCALAR_JOINTS = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
JOINT_TRANSMISSIONS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
VECTOR, QUATERNION = ("x", "y", "z"), ("qw", "qx", "qy", "qz")
ROTATION = ("wx", "wy", "wz")
# The components of qpos and qvel of a joint by its type.
QPOS_COMPONENTS: dict[int, tuple[str, ...]] = {FREE: VECTOR + QUATERNION, BALL: QUATERNION}
QVEL_COMPONENTS: dict[int, tuple[str, ...]] = {FREE: ("vx", "vy", "vz", *ROTATION), BALL: ROTATION}


def names(model: mujoco.MjModel, kind: str) -> list[str]:
    """Returns the names of all objects of `kind` in order of id; an unnamed one is `kind:id`."""
    return object_names(model, kind, range(getattr(model, COUNTS[kind])))


def object_names(model: mujoco.MjModel, kind: str, ids: Iterable[int]) -> list[str]:
    """Returns the names of the objects of `kind` with these ids."""
    return [mujoco.mj_id2name(model, KINDS[kind], i) or f"{kind}:{i}" for i in ids]


def object_name(model: mujoco.MjModel, obj: int, index: int) -> str | None:
    """Returns the name of an object of the type `obj`, one of `mjtObj`; None for index −1."""
    return None if index < 0 else object_names(model, KIND_OF[int(obj)], [int(index)])[0]


def identify(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Returns the id of the object of `kind` called `name`; `name` may also be an index or `kind:index`.

    Raises:
      UnknownNameError: no object matches; the message lists all names.
    """
    valid = names(model, kind)
    if name in valid:
        return valid.index(name)
    index = name.removeprefix(f"{kind}:")
    if is_index(index, len(valid)):
        return int(index)
    raise UnknownNameError(kind, name, valid, plural=PLURALS.get(kind, ""))


def is_index(text: str, count: int) -> bool:
    """Returns whether `text` is an index below `count`."""
    return text.isascii() and text.isdigit() and len(text) < 10 and int(text) < count


def matching(model: mujoco.MjModel, kind: str, pattern: str) -> list[int]:
    """Returns the ids of all objects of `kind` whose names match `pattern`, with the wildcards `*`, `?` and `[…]`.

    Raises:
      UnknownNameError: no object matches.
    """
    valid = names(model, kind)
    if pattern not in valid:
        ids = [i for i, name in enumerate(valid) if fnmatchcase(name, pattern)]
        if ids:
            return ids
    return [identify(model, kind, pattern)]


def actuator_parts(model: mujoco.MjModel, counts: Iterable[int]) -> list[tuple[str, int]]:
    """Returns the name and the actuator of each of its `counts` parts: `motor`; with several parts, `servo/0` …"""
    parts = []
    for actuator, (name, count) in enumerate(zip(names(model, "actuator"), map(int, counts), strict=True)):
        parts += [(f"{name}/{i}" if count > 1 else name, actuator) for i in range(count)]
    return parts


def actuators_of(model: mujoco.MjModel, joint: int) -> list[int]:
    """Returns the actuators of a joint."""
    is_of_joint = np.isin(model.actuator_trntype, JOINT_TRANSMISSIONS) & (model.actuator_trnid[:, 0] == joint)
    return np.flatnonzero(is_of_joint).tolist()


def control_names(model: mujoco.MjModel) -> list[str]:
    """Returns the names of all controls in the order of `ctrl`."""
    return [name for name, _ in actuator_parts(model, model.actuator_ctrlnum)]


def control_slices(model: mujoco.MjModel, pattern: str) -> list[slice]:
    """Returns the positions in `ctrl` of the actuators that match `pattern`, or of the single control of that name.

    Raises:
      UnknownNameError: no actuator or control matches.
    """
    if pattern in (valid := control_names(model)):
        return [slice(valid.index(pattern), valid.index(pattern) + 1)]
    starts, counts = model.actuator_ctrladr, model.actuator_ctrlnum
    return [slice(int(starts[i]), int(starts[i] + counts[i])) for i in matching(model, "actuator", pattern)]


def enum_members(enum: Any) -> dict[str, int]:
    """Returns the members of a MuJoCo enum by their short names in lower case.

    `mjtVisFlag.mjVIS_CONTACTPOINT` is `contactpoint`; counters (`mjNVISFLAG`) are omitted.
    """
    return {
        name.partition("_")[2].lower(): int(value)
        for name, value in enum.__members__.items()
        if not name.startswith("mjN")
    }


def enum_name(enum: Any, value: Any) -> str:
    """Returns the short name of a member of a MuJoCo enum, `hinge`; the number as text if it is not a member."""
    return _spellings(enum).get(int(value), str(int(value)))


@cache
def _spellings(enum: Any) -> dict[int, str]:
    return {value: name for name, value in enum_members(enum).items()}


def enum_value(enum: Any, kind: str, name: str) -> int:
    """Returns the value of the member of `enum` called `name`: `elliptic`, `ELLIPTIC` or `mjCONE_ELLIPTIC`.

    Raises:
      UnknownNameError: `enum` has no such member.
    """
    valid = enum_members(enum)
    if name.lower() in valid:
        return valid[name.lower()]
    if name in enum.__members__ and not name.startswith("mjN"):
        return int(enum.__members__[name])
    raise UnknownNameError(kind, name, list(valid))


def is_enum(value: object) -> bool:
    """Returns whether `value` is a member of one of MuJoCo's enums."""
    return isinstance(value, Enum) or hasattr(type(value), "__members__")


def distinct(names: Iterable[str], key: Callable[[str], str] = str) -> Iterator[str]:
    """Yields names, with the lowest free number appended to those whose `key` occurred before: `a`, `a_2`."""
    taken = set[str]()
    for name in names:
        different, number = name, 1
        while key(different) in taken:
            number += 1
            different = f"{name}_{number}"
        taken.add(key(different))
        yield different
