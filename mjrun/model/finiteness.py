"""Whether all numbers of a model are finite. MuJoCo does not ask: it compiles NaN, and the simulation explodes."""

from functools import cache

import mujoco
import numpy as np

from mjrun.errors import quoted
from mjrun.model.names import KIND_OF_COUNT, KINDS

# Prefixes and endings of fields that no motion comes from, or that are looked at where they are used.
LEFT_OUT = ("key_", "numeric_", "tuple_", "mesh_normal", "mesh_polynormal")
LEFT_OUT_ENDINGS = ("_user", "_texcoord")
# Endings of bounds and tolerances, which may be infinite.
BOUNDS = ("range", "margin", "gap", "cutoff", "tolerance", "yield", "limited")
# Fields that follow from others: a fault of theirs is one of these others.
DERIVED = ("0", "_aabb", "_rbound", "_subtreemass", "_L")


def fault(model: mujoco.MjModel) -> str | None:
    """The first number of a model that is not finite, `its dof_damping is nan, of joint 'hip'`; None if there is none.

    Bounds may be infinite. Keyframes are not looked at: one that nobody starts from does no harm.
    """
    for name in _numbers(mujoco.MjOption):
        if (value := _bad(np.asarray(getattr(model.opt, name)), name)) is not None:
            return f"its opt.{name} is {value[1]}"
    for name in _numbers(mujoco.MjModel):
        if (value := _bad(getattr(model, name), name)) is not None:
            return f"its {name} is {value[1]}{_owner(model, name, value[0])}"
    return None


@cache
def _numbers(of: type) -> list[str]:
    """The fields of a model, or of its options, that hold numbers from which its motion comes."""
    example = mujoco.MjSpec().compile()
    owner = example.opt if of is mujoco.MjOption else example
    fields = {name: getattr(owner, name) for name in dir(owner) if not name.startswith("_")}
    names = [
        name
        for name, value in fields.items()
        if isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f")
        if not name.startswith(LEFT_OUT) and not name.endswith(LEFT_OUT_ENDINGS)
    ]
    return sorted(names, key=lambda name: name.endswith(DERIVED) and name != "qpos0")


def _bad(values: np.ndarray, name: str) -> tuple[int, float] | None:
    """The row and the value of the first number that cannot be."""
    if np.isfinite(values).all():
        return None
    wrong = np.isnan(values) if name.endswith(BOUNDS) else ~np.isfinite(values)
    if not wrong.any():
        return None
    index = int(wrong.argmax())  # of all numbers, row by row
    row = index // max(1, int(np.prod(values.shape[1:])))
    return row, float(values.flat[index])


def _owner(model: mujoco.MjModel, field: str, row: int) -> str:
    """Whose number it is, `, of joint 'hip'`."""
    prefix = field.partition("_")[0]
    if prefix == "dof":
        prefix, row = "jnt", int(model.dof_jntid[row])
    kind = KIND_OF_COUNT.get(f"n{prefix}")
    if kind is None:
        return ""
    name = mujoco.mj_id2name(model, KINDS[kind], row)
    return f", of {kind} {quoted(name) if name else row}"
