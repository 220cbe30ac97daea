"""Bodies and what is fixed to them: joints, geoms, sites."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco

from mjrun.model.description.plain_values import (
    BODY,
    GEOM,
    JOINT,
    SITE,
    Pair,
    body_name,
    enum_name,
    floats,
    limited_range,
    object_name,
    object_names,
    without_trailing_zeros,
)
from mjrun.model.description.units import joint_unit
from mjrun.model.joint_components import QPOS_COMPONENTS, QVEL_COMPONENTS

# How many of a geom's three sizes its type has.
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2}
AXES = ("slide", "hinge")


@dataclass(frozen=True)
class Body:
    """A body and what hangs on it.

    Attributes:
      id, name: of the body.
      parent: id of the body that it is attached to; −1 for the world.
      depth: how many bodies lie between it and the world, plus one; 0 for the world.
      joints, geoms, sites: names, in order.
      joint_types, geom_types: the types of its joints and geoms, in the same order.
      mass, subtree_mass: of the body, and of all that hangs on it too [kg].
      position: in its parent [m].
      centre_of_mass: in the body [m].
      inertia: about its principal axes [kg·m²].
      gravity_compensation: the share of its weight that is lifted.
      mocap: moved by mocap data.
    """

    id: int
    name: str
    parent: int
    depth: int
    joints: tuple[str, ...]
    joint_types: tuple[str, ...]
    geoms: tuple[str, ...]
    geom_types: tuple[str, ...]
    sites: tuple[str, ...]
    mass: float
    subtree_mass: float
    position: tuple[float, ...]
    centre_of_mass: tuple[float, ...]
    inertia: tuple[float, ...]
    gravity_compensation: float
    mocap: bool


def bodies(model: mujoco.MjModel) -> tuple[Body, ...]:
    """Every body; a parent comes before its children."""
    depths = [0] * model.nbody
    for i in range(1, model.nbody):
        depths[i] = depths[model.body_parentid[i]] + 1
    sites: list[list[str]] = [[] for _ in range(model.nbody)]
    for i in range(model.nsite):
        sites[model.site_bodyid[i]].append(object_name(model, SITE, i) or "")
    return tuple(_body(model, i, depths[i], tuple(sites[i])) for i in range(model.nbody))


def _body(model: mujoco.MjModel, i: int, depth: int, sites: tuple[str, ...]) -> Body:
    joint, joint_count, geom, geom_count = (
        int(field[i]) for field in (model.body_jntadr, model.body_jntnum, model.body_geomadr, model.body_geomnum)
    )
    return Body(
        id=i,
        name=object_name(model, BODY, i) or "",
        parent=int(model.body_parentid[i]) if i else -1,
        depth=depth,
        joints=object_names(model, JOINT, joint, joint_count),
        joint_types=tuple(enum_name(mujoco.mjtJoint, model.jnt_type[joint + k]) for k in range(joint_count)),
        geoms=object_names(model, GEOM, geom, geom_count),
        geom_types=tuple(enum_name(mujoco.mjtGeom, model.geom_type[geom + k]) for k in range(geom_count)),
        sites=sites,
        mass=float(model.body_mass[i]),
        subtree_mass=float(model.body_subtreemass[i]),
        position=floats(model.body_pos[i]),
        centre_of_mass=floats(model.body_ipos[i]),
        inertia=floats(model.body_inertia[i]),
        gravity_compensation=float(model.body_gravcomp[i]),
        mocap=bool(model.body_mocapid[i] >= 0),
    )


@dataclass(frozen=True)
class Joint:
    """A joint. Its `unit` is `rad` for hinge and ball, `m` for slide, and empty for free, which has both.

    Attributes:
      id, name, body: the joint and the body that it moves.
      type: `free`, `ball`, `slide` or `hinge`.
      unit: of its position.
      axis: in the body; None for ball and free.
      anchor: in the body [m].
      range: of its position [unit]; of a ball the angle; None without limits.
      qpos, qpos_size: where its position is in `qpos`.
      dof, dof_size: where its velocity is in `qvel`.
      qpos0: its position in the model's own configuration.
      spring_reference: where its spring rests [unit]; None for ball and free.
      stiffness, damping: [force/unit], [force·s/unit]; a force is N, or N·m per rad.
      stiffness_polynomial, damping_polynomial: coefficients of the higher orders.
      armature, frictionloss: [kg or kg·m²], [force].
      actuator_force_range: of all actuators together [force]; None without limits.
    """

    id: int
    name: str
    body: str
    type: str
    unit: str
    axis: tuple[float, ...] | None
    anchor: tuple[float, ...]
    range: Pair | None
    qpos: int
    qpos_size: int
    dof: int
    dof_size: int
    qpos0: tuple[float, ...]
    spring_reference: float | None
    stiffness: float
    stiffness_polynomial: tuple[float, ...]
    damping: float
    damping_polynomial: tuple[float, ...]
    armature: float
    frictionloss: float
    actuator_force_range: Pair | None


def joints(model: mujoco.MjModel) -> Iterator[Joint]:
    """Every joint, in order of id."""
    for i in range(model.njnt):
        kind, qpos, dof = int(model.jnt_type[i]), int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i])
        size, name = len(QPOS_COMPONENTS.get(kind, ("",))), enum_name(mujoco.mjtJoint, kind)
        yield Joint(
            id=i,
            name=object_name(model, JOINT, i) or "",
            body=body_name(model, model.jnt_bodyid[i]),
            type=name,
            unit=joint_unit(model, i),
            axis=floats(model.jnt_axis[i]) if name in AXES else None,
            anchor=floats(model.jnt_pos[i]),
            range=limited_range(model.jnt_limited[i], model.jnt_range[i]),
            qpos=qpos,
            qpos_size=size,
            dof=dof,
            dof_size=len(QVEL_COMPONENTS.get(kind, ("",))),
            qpos0=floats(model.qpos0[qpos : qpos + size]),
            spring_reference=float(model.qpos_spring[qpos]) if name in AXES else None,
            stiffness=float(model.jnt_stiffness[i]),
            stiffness_polynomial=without_trailing_zeros(model.jnt_stiffnesspoly[i]),
            damping=float(model.dof_damping[dof]),
            damping_polynomial=without_trailing_zeros(model.dof_dampingpoly[dof]),
            armature=float(model.dof_armature[dof]),
            frictionloss=float(model.dof_frictionloss[dof]),
            actuator_force_range=limited_range(model.jnt_actfrclimited[i], model.jnt_actfrcrange[i]),
        )


@dataclass(frozen=True)
class Geom:
    """A geom.

    Attributes:
      id, name, body: the geom and its body.
      type: `box`, `capsule`, `mesh` …
      asset: the mesh or height field that it shows; None for a primitive.
      size: as its type has it, in half lengths and radii [m]; of a mesh half the box around it.
      position: in the body [m].
      contype, conaffinity: two geoms can touch where a bit of one meets a bit of the other.
      condim, friction: of its contacts; friction is sliding, torsional [m], rolling [m].
      margin, gap: [m].
      group: by which it is shown or hidden.
      material: None without one.
    """

    id: int
    name: str
    body: str
    type: str
    asset: str | None
    size: tuple[float, ...]
    position: tuple[float, ...]
    contype: int
    conaffinity: int
    condim: int
    friction: tuple[float, ...]
    margin: float
    gap: float
    group: int
    material: str | None


def geoms(model: mujoco.MjModel) -> Iterator[Geom]:
    """Every geom, in order of id."""
    for i in range(model.ngeom):
        kind = enum_name(mujoco.mjtGeom, model.geom_type[i])
        shown = mujoco.mjtObj.mjOBJ_HFIELD if kind == "hfield" else mujoco.mjtObj.mjOBJ_MESH
        yield Geom(
            id=i,
            name=object_name(model, GEOM, i) or "",
            body=body_name(model, model.geom_bodyid[i]),
            type=kind,
            asset=object_name(model, shown, model.geom_dataid[i]),
            size=floats(model.geom_size[i][: SIZES.get(kind, 3)]),
            position=floats(model.geom_pos[i]),
            contype=int(model.geom_contype[i]),
            conaffinity=int(model.geom_conaffinity[i]),
            condim=int(model.geom_condim[i]),
            friction=floats(model.geom_friction[i]),
            margin=float(model.geom_margin[i]),
            gap=float(model.geom_gap[i]),
            group=int(model.geom_group[i]),
            material=object_name(model, mujoco.mjtObj.mjOBJ_MATERIAL, model.geom_matid[i]),
        )


@dataclass(frozen=True)
class Site:
    """A site: its body, shape, size [m], position in the body [m] and group."""

    id: int
    name: str
    body: str
    type: str
    size: tuple[float, ...]
    position: tuple[float, ...]
    group: int


def sites(model: mujoco.MjModel) -> Iterator[Site]:
    """Every site, in order of id."""
    for i in range(model.nsite):
        kind = enum_name(mujoco.mjtGeom, model.site_type[i])
        yield Site(
            id=i,
            name=object_name(model, SITE, i) or "",
            body=body_name(model, model.site_bodyid[i]),
            type=kind,
            size=floats(model.site_size[i][: SIZES.get(kind, 3)]),
            position=floats(model.site_pos[i]),
            group=int(model.site_group[i]),
        )
