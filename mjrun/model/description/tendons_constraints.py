"""Tendons, equality constraints, and which geoms may touch."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco

from mjrun.model.description.plain_values import (
    GEOM,
    JOINT,
    SITE,
    TENDON,
    Pair,
    body_name,
    enum_name,
    floats,
    limited_range,
    object_name,
    without_trailing_zeros,
)
from mjrun.model.description.units import tendon_unit

WRAPPED = {"joint": JOINT, "site": SITE, "sphere": GEOM, "cylinder": GEOM}
# What an equality constraint binds where MuJoCo leaves the kind open, since its type tells.
BOUND = {
    "joint": JOINT,
    "tendon": TENDON,
    "flex": mujoco.mjtObj.mjOBJ_FLEX,
    "flexvert": mujoco.mjtObj.mjOBJ_FLEX,
    "flexstrain": mujoco.mjtObj.mjOBJ_FLEX,
    "distance": GEOM,
}


@dataclass(frozen=True)
class PathPoint:
    """What a tendon passes: a `joint` with its coefficient, a `site`, a `sphere` or `cylinder` of that geom,
    or a `pulley`, which has a divisor and no name.
    """

    kind: str
    name: str | None
    coefficient: float | None


@dataclass(frozen=True)
class Tendon:
    """A tendon.

    Attributes:
      id, name: of the tendon.
      type: `fixed`, a weighted sum of joints, or `spatial`, along sites and around geoms.
      unit: of its length: `m`, or `rad` for a sum of angles; empty where joints of both kinds are summed.
      path: what it passes, in order.
      length0: in the model's own configuration [unit].
      range: of its length [unit]; None without limits.
      spring_length: between which its spring is slack [unit].
      stiffness, damping: [force/unit], [force·s/unit]; a force is N, or N·m per rad.
      stiffness_polynomial, damping_polynomial: coefficients of the higher orders.
      armature, frictionloss: [kg or kg·m²], [force].
      actuator_force_range: of all actuators together [force]; None without limits.
    """

    id: int
    name: str
    type: str
    unit: str
    path: tuple[PathPoint, ...]
    length0: float
    range: Pair | None
    spring_length: tuple[float, ...]
    stiffness: float
    stiffness_polynomial: tuple[float, ...]
    damping: float
    damping_polynomial: tuple[float, ...]
    armature: float
    frictionloss: float
    actuator_force_range: Pair | None


def tendons(model: mujoco.MjModel) -> Iterator[Tendon]:
    """Every tendon, in order of id."""
    for i in range(model.ntendon):
        start, count = int(model.tendon_adr[i]), int(model.tendon_num[i])
        yield Tendon(
            id=i,
            name=object_name(model, TENDON, i) or "",
            type=enum_name(mujoco.mjtTendon, model.tendon_type[i]),
            unit=tendon_unit(model, i),
            path=tuple(_point(model, k) for k in range(start, start + count)),
            length0=float(model.tendon_length0[i]),
            range=limited_range(model.tendon_limited[i], model.tendon_range[i]),
            spring_length=floats(model.tendon_lengthspring[i]),
            stiffness=float(model.tendon_stiffness[i]),
            stiffness_polynomial=without_trailing_zeros(model.tendon_stiffnesspoly[i]),
            damping=float(model.tendon_damping[i]),
            damping_polynomial=without_trailing_zeros(model.tendon_dampingpoly[i]),
            armature=float(model.tendon_armature[i]),
            frictionloss=float(model.tendon_frictionloss[i]),
            actuator_force_range=limited_range(model.tendon_actfrclimited[i], model.tendon_actfrcrange[i]),
        )


def _point(model: mujoco.MjModel, i: int) -> PathPoint:
    kind = enum_name(mujoco.mjtWrap, model.wrap_type[i])
    name = object_name(model, WRAPPED[kind], model.wrap_objid[i]) if kind in WRAPPED else None
    return PathPoint(kind, name, float(model.wrap_prm[i]) if kind in ("joint", "pulley") else None)


@dataclass(frozen=True)
class Equality:
    """An equality constraint.

    Attributes:
      id, name: of the constraint.
      type: `connect`, `weld`, `joint`, `tendon`, `flex` …
      object_kind, object1, object2: what it binds; the second is None where it binds to a constant or the world.
      active: at the start.
      data: its numbers in MuJoCo's order, without the zeros at the end: anchors, a relative pose, coefficients of a
        polynomial, as the type has it.
      solref, solimp: of its solver.
    """

    id: int
    name: str
    type: str
    object_kind: str
    object1: str | None
    object2: str | None
    active: bool
    data: tuple[float, ...]
    solref: tuple[float, ...]
    solimp: tuple[float, ...]


def equalities(model: mujoco.MjModel) -> Iterator[Equality]:
    """Every equality constraint, in order of id."""
    for i in range(model.neq):
        law = enum_name(mujoco.mjtEq, model.eq_type[i])
        kind = BOUND.get(law, model.eq_objtype[i])
        yield Equality(
            id=i,
            name=object_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, i) or "",
            type=law,
            object_kind=enum_name(mujoco.mjtObj, kind),
            object1=object_name(model, kind, model.eq_obj1id[i]),
            object2=object_name(model, kind, model.eq_obj2id[i]),
            active=bool(model.eq_active0[i]),
            data=without_trailing_zeros(model.eq_data[i]),
            solref=floats(model.eq_solref[i]),
            solimp=floats(model.eq_solimp[i]),
        )


@dataclass(frozen=True)
class ContactPair:
    """Two geoms that touch by rules of their own.

    Attributes:
      id, name, geom1, geom2: the pair and its geoms.
      condim, friction: friction is along two tangents, torsional [m], rolling about two [m].
      margin, gap: [m].
      solref, solimp: of its solver.
    """

    id: int
    name: str
    geom1: str | None
    geom2: str | None
    condim: int
    friction: tuple[float, ...]
    margin: float
    gap: float
    solref: tuple[float, ...]
    solimp: tuple[float, ...]


def pairs(model: mujoco.MjModel) -> Iterator[ContactPair]:
    """Every contact pair, in order of id."""
    for i in range(model.npair):
        yield ContactPair(
            id=i,
            name=object_name(model, mujoco.mjtObj.mjOBJ_PAIR, i) or "",
            geom1=object_name(model, GEOM, model.pair_geom1[i]),
            geom2=object_name(model, GEOM, model.pair_geom2[i]),
            condim=int(model.pair_dim[i]),
            friction=floats(model.pair_friction[i]),
            margin=float(model.pair_margin[i]),
            gap=float(model.pair_gap[i]),
            solref=floats(model.pair_solref[i]),
            solimp=floats(model.pair_solimp[i]),
        )


@dataclass(frozen=True)
class Exclude:
    """Two bodies whose geoms never touch."""

    id: int
    name: str
    body1: str
    body2: str


def excludes(model: mujoco.MjModel) -> Iterator[Exclude]:
    """Every excluded pair of bodies, in order of id."""
    for i in range(model.nexclude):
        signature = int(model.exclude_signature[i])  # as MuJoCo packs it: body1 << 16 + body2
        name = object_name(model, mujoco.mjtObj.mjOBJ_EXCLUDE, i) or ""
        yield Exclude(i, name, body_name(model, signature >> 16), body_name(model, signature & 0xFFFF))
