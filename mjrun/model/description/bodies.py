"""Bodies and what is fixed to them: joints, geoms, sites, cameras, lights."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjrun.model.description.declaration import (
    ModelObject,
    Pair,
    computed,
    of_field,
    within_limits,
    without_trailing_zeros,
)
from mjrun.model.fields import floats
from mjrun.model.names import QPOS_COMPONENTS, QVEL_COMPONENTS, enum_members, enum_name, object_names
from mjrun.model.units import joint_unit

# How many of a geom's three sizes its type has.
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2}
AXES = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
ORTHOGRAPHIC = int(mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC)


def _depth(model: mujoco.MjModel, body: int) -> int:
    depth = 0
    while body:
        body, depth = model.body_parentid[body], depth + 1
    return depth


def _joints(model: mujoco.MjModel, body: int) -> range:
    return range(start := int(model.body_jntadr[body]), start + int(model.body_jntnum[body]))


def _geoms(model: mujoco.MjModel, body: int) -> range:
    return range(start := int(model.body_geomadr[body]), start + int(model.body_geomnum[body]))


def _types(enum: Any, values: np.ndarray) -> tuple[str, ...]:
    return tuple(enum_name(enum, value) for value in values)


@dataclass(frozen=True)
class Body(ModelObject):
    """A body and what hangs on it.

    Attributes:
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

    KIND = "body"

    parent: int = computed(lambda model, i: int(model.body_parentid[i]) if i else -1)
    depth: int = computed(_depth)
    joints: tuple[str, ...] = computed(lambda model, i: tuple(object_names(model, "joint", _joints(model, i))))
    joint_types: tuple[str, ...] = computed(
        lambda model, i: _types(mujoco.mjtJoint, model.jnt_type[list(_joints(model, i))])
    )
    geoms: tuple[str, ...] = computed(lambda model, i: tuple(object_names(model, "geom", _geoms(model, i))))
    geom_types: tuple[str, ...] = computed(
        lambda model, i: _types(mujoco.mjtGeom, model.geom_type[list(_geoms(model, i))])
    )
    sites: tuple[str, ...] = computed(
        lambda model, i: tuple(object_names(model, "site", np.flatnonzero(model.site_bodyid == i)))
    )
    mass: float = of_field("body_mass")
    subtree_mass: float = of_field("body_subtreemass", heading="subtree", is_detail=True)
    position: tuple[float, ...] = of_field("body_pos")
    centre_of_mass: tuple[float, ...] = of_field("body_ipos")
    inertia: tuple[float, ...] = of_field("body_inertia")
    gravity_compensation: float = of_field("body_gravcomp", heading="gravcomp", is_detail=True)
    mocap: bool = of_field("body_mocapid")


def _qpos0(model: mujoco.MjModel, joint: int) -> tuple[float, ...]:
    start = int(model.jnt_qposadr[joint])
    return floats(model.qpos0[start : start + _qpos_size(model, joint)])


def _qpos_size(model: mujoco.MjModel, joint: int) -> int:
    return len(QPOS_COMPONENTS.get(int(model.jnt_type[joint]), ("",)))


def _dof_size(model: mujoco.MjModel, joint: int) -> int:
    return len(QVEL_COMPONENTS.get(int(model.jnt_type[joint]), ("",)))


def _axis(model: mujoco.MjModel, joint: int) -> tuple[float, ...] | None:
    return floats(model.jnt_axis[joint]) if int(model.jnt_type[joint]) in AXES else None


def _spring_reference(model: mujoco.MjModel, joint: int) -> float | None:
    return float(model.qpos_spring[model.jnt_qposadr[joint]]) if int(model.jnt_type[joint]) in AXES else None


@dataclass(frozen=True)
class Joint(ModelObject):
    """A joint. Its `unit` is `rad` for hinge and ball, `m` for slide, and empty for free, which has both.

    Attributes:
      body: that it moves.
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

    KIND = "joint"

    body: str = of_field("jnt_bodyid", is_detail=True)
    type: str = of_field("jnt_type")
    unit: str = computed(joint_unit)
    axis: tuple[float, ...] | None = computed(_axis, is_detail=True)
    anchor: tuple[float, ...] = of_field("jnt_pos")
    range: Pair | None = within_limits("jnt_limited", "jnt_range")
    qpos: int = of_field("jnt_qposadr")
    qpos_size: int = computed(_qpos_size)
    dof: int = of_field("jnt_dofadr")
    dof_size: int = computed(_dof_size)
    qpos0: tuple[float, ...] = computed(_qpos0)
    spring_reference: float | None = computed(_spring_reference)
    stiffness: float = of_field("jnt_stiffness", is_detail=True)
    stiffness_polynomial: tuple[float, ...] = of_field("jnt_stiffnesspoly", then=without_trailing_zeros)
    damping: float = of_field("dof_damping", at="jnt_dofadr", is_detail=True)
    damping_polynomial: tuple[float, ...] = of_field("dof_dampingpoly", at="jnt_dofadr", then=without_trailing_zeros)
    armature: float = of_field("dof_armature", at="jnt_dofadr", is_detail=True)
    frictionloss: float = of_field("dof_frictionloss", at="jnt_dofadr", is_detail=True)
    actuator_force_range: Pair | None = within_limits("jnt_actfrclimited", "jnt_actfrcrange")


def _size(kind: str) -> Any:
    """The sizes of geoms or sites, as many as their types have."""

    def sizes(model: mujoco.MjModel, index: int) -> tuple[float, ...]:
        shape = enum_name(mujoco.mjtGeom, getattr(model, f"{kind}_type")[index])
        return floats(getattr(model, f"{kind}_size")[index][: SIZES.get(shape, 3)])

    return computed(sizes, unit="m")


@dataclass(frozen=True)
class Geom(ModelObject):
    """A geom.

    Attributes:
      body: of the geom.
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

    KIND = "geom"

    body: str = of_field("geom_bodyid")
    type: str = of_field("geom_type")
    asset: str | None = of_field("geom_dataid")
    size: tuple[float, ...] = _size("geom")
    position: tuple[float, ...] = of_field("geom_pos")
    contype: int = of_field("geom_contype")
    conaffinity: int = of_field("geom_conaffinity")
    condim: int = of_field("geom_condim", usual=3)
    friction: tuple[float, ...] = of_field("geom_friction", is_detail=True)
    margin: float = of_field("geom_margin", is_detail=True)
    gap: float = of_field("geom_gap", is_detail=True)
    group: int = of_field("geom_group", is_detail=True)
    material: str | None = of_field("geom_matid", is_detail=True)


@dataclass(frozen=True)
class Site(ModelObject):
    """A site: its body, shape, size [m], position in the body [m] and group."""

    KIND = "site"

    body: str = of_field("site_bodyid")
    type: str = of_field("site_type")
    size: tuple[float, ...] = _size("site")
    position: tuple[float, ...] = of_field("site_pos", is_detail=True)
    group: int = of_field("site_group", is_detail=True)


def _has_lens(model: mujoco.MjModel, camera: int) -> bool:
    return bool(model.cam_sensorsize[camera, 1])


def _is_flat(model: mujoco.MjModel, camera: int) -> bool:
    return int(model.cam_projection[camera]) == ORTHOGRAPHIC


def _fovy(model: mujoco.MjModel, camera: int) -> float | None:
    return None if _is_flat(model, camera) or _has_lens(model, camera) else float(model.cam_fovy[camera])


def _height(model: mujoco.MjModel, camera: int) -> float | None:
    return float(model.cam_fovy[camera]) if _is_flat(model, camera) else None


def _of_lens(field: str, part: slice, *, is_detail: bool = False) -> Any:
    """Numbers of cameras that have a sensor size, which have no angle of view."""

    def read(model: mujoco.MjModel, camera: int) -> tuple[float, ...] | None:
        return floats(getattr(model, field)[camera][part]) if _has_lens(model, camera) else None

    return computed(read, unit="m", is_detail=is_detail)


def _outputs(bits: int) -> tuple[str, ...]:
    return tuple(name for name, bit in enum_members(mujoco.mjtCamOutBit).items() if bits & bit)


@dataclass(frozen=True)
class Camera(ModelObject):
    """A camera.

    Attributes:
      body: that it is fixed to.
      mode: `fixed`, `track`, `trackcom`, `targetbody` or `targetbodycom`.
      target: the body that it turns to; None without one.
      projection: `perspective` or `orthographic`.
      fovy: angle of view from top to bottom [°]; None for a camera that is orthographic or has a sensor size.
      height: what an orthographic camera sees from top to bottom [m]; None for another.
      sensor_size, focal_length, principal_point: [m]; the point is where the optical axis meets the image, from
        its centre. None for a camera that fovy describes.
      resolution: width and height that it was made for [px]; (1, 1) if not set. Images do not follow it.
      outputs: kinds of images that it was made for: `rgb`, `depth` …
      position: in its body [m].
    """

    KIND = "camera"

    body: str = of_field("cam_bodyid")
    mode: str = of_field("cam_mode")
    target: str | None = of_field("cam_targetbodyid")
    projection: str = of_field("cam_projection")
    fovy: float | None = computed(_fovy, unit="°")
    height: float | None = computed(_height, unit="m")
    sensor_size: tuple[float, ...] | None = _of_lens("cam_sensorsize", slice(None))
    focal_length: tuple[float, ...] | None = _of_lens("cam_intrinsic", slice(0, 2), is_detail=True)
    principal_point: tuple[float, ...] | None = _of_lens("cam_intrinsic", slice(2, None))
    resolution: tuple[int, int] = of_field("cam_resolution")
    outputs: tuple[str, ...] = of_field("cam_output", then=_outputs)
    position: tuple[float, ...] = of_field("cam_pos", is_detail=True)


@dataclass(frozen=True)
class Light(ModelObject):
    """A light.

    Attributes:
      body: that it is fixed to.
      type: `spot`, `directional`, `point` or `image`.
      mode, target: as of a camera.
      position: in its body [m].
      active, shadow: shines; casts shadows.
    """

    KIND = "light"

    body: str = of_field("light_bodyid")
    type: str = of_field("light_type")
    mode: str = of_field("light_mode")
    target: str | None = of_field("light_targetbodyid")
    position: tuple[float, ...] = of_field("light_pos", is_detail=True)
    active: bool = of_field("light_active")
    shadow: bool = of_field("light_castshadow")
