"""Descriptions of bodies and of the objects attached to them: joints, geoms, sites, cameras and lights."""

from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model.description.declaration import (
    ModelObject,
    Pair,
    computed,
    of_field,
    within_limits,
    without_trailing_zeros,
)
from mjrun.model.fields import floats
from mjrun.model.names import QPOS_COMPONENTS, QVEL_COMPONENTS, SCALAR_JOINTS, enum_members, enum_name, object_names
from mjrun.model.units import ORTHOGRAPHIC, joint_unit

# The number of sizes that a type of geom has, if not three.
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2}


def _depth(model: mujoco.MjModel, body: int) -> int:
    depth = 0
    while body:
        body, depth = model.body_parentid[body], depth + 1
    return depth


def _held(kind: str, prefix: str) -> Any:
    """Returns an attribute with the names of the joints or geoms of a body."""
    return computed(lambda model, body: tuple(object_names(model, kind, _ids(model, body, prefix))))


def _held_types(enum: Any, prefix: str) -> Any:
    """Returns an attribute with the types of the joints or geoms of a body."""

    def types(model: mujoco.MjModel, body: int) -> tuple[str, ...]:
        values = getattr(model, f"{prefix}_type")
        return tuple(enum_name(enum, values[i]) for i in _ids(model, body, prefix))

    return computed(types)


def _ids(model: mujoco.MjModel, body: int, prefix: str) -> range:
    start = int(getattr(model, f"body_{prefix}adr")[body])
    return range(start, start + int(getattr(model, f"body_{prefix}num")[body]))


@dataclass(frozen=True)
class Body(ModelObject):
    """A body and the objects attached to it.

    Attributes:
      parent: the id of its parent body; −1 for the world.
      depth: the number of bodies between it and the world, plus one; 0 for the world.
      joints, geoms, sites: the names of its joints, geoms and sites, in order.
      joint_types, geom_types: the types of its joints and geoms, in the same order.
      mass, subtree_mass: the mass of the body alone, and with all descendants [kg].
      position: the position in its parent [m].
      centre_of_mass: the position of the centre of mass in the body [m].
      inertia: the moments of inertia about its principal axes [kg·m²].
      gravity_compensation: the share of its weight that is compensated.
      mocap: true if mocap data move it.
    """

    KIND = "body"

    parent: int = computed(lambda model, i: int(model.body_parentid[i]) if i else -1)
    depth: int = computed(_depth)
    joints: tuple[str, ...] = _held("joint", "jnt")
    joint_types: tuple[str, ...] = _held_types(mujoco.mjtJoint, "jnt")
    geoms: tuple[str, ...] = _held("geom", "geom")
    geom_types: tuple[str, ...] = _held_types(mujoco.mjtGeom, "geom")
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
    return floats(model.jnt_axis[joint]) if int(model.jnt_type[joint]) in SCALAR_JOINTS else None


def _spring_reference(model: mujoco.MjModel, joint: int) -> float | None:
    return float(model.qpos_spring[model.jnt_qposadr[joint]]) if int(model.jnt_type[joint]) in SCALAR_JOINTS else None


@dataclass(frozen=True)
class Joint(ModelObject):
    """A joint. Its `unit` is `rad` for hinge and ball, `m` for slide, and empty for free, which has both.

    Attributes:
      body: the body that it moves.
      type: `free`, `ball`, `slide` or `hinge`.
      unit: the unit of its position.
      axis: the axis in the body; None for ball and free.
      anchor: the anchor in the body [m].
      range: the range of its position [unit], of its angle for a ball; None if unlimited.
      qpos, qpos_size: the address and the size of its position in `qpos`.
      dof, dof_size: the address and the size of its velocity in `qvel`.
      qpos0: its position in the initial configuration of the model.
      spring_reference: the rest position of its spring [unit]; None for ball and free.
      stiffness, damping: [force/unit], [force·s/unit]; a force is N, or N·m for rad.
      stiffness_polynomial, damping_polynomial: the coefficients of the higher orders.
      armature, frictionloss: [kg or kg·m²], [force].
      actuator_force_range: the range of the total actuator force [force]; None if unlimited.
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
    """Returns an attribute with the sizes of geoms or sites, as many as their types have."""

    def sizes(model: mujoco.MjModel, index: int) -> tuple[float, ...]:
        shape = enum_name(mujoco.mjtGeom, getattr(model, f"{kind}_type")[index])
        return floats(getattr(model, f"{kind}_size")[index][: SIZES.get(shape, 3)])

    return computed(sizes, unit="m")


@dataclass(frozen=True)
class Geom(ModelObject):
    """A geom.

    Attributes:
      body: the body of the geom.
      type: `box`, `capsule`, `mesh` …
      asset: the mesh or height field that it shows; None for a primitive.
      size: the half lengths and radii of its type [m]; for a mesh half the size of its bounding box.
      position: the position in the body [m].
      contype, conaffinity: two geoms can touch if a bit of one matches a bit of the other.
      condim, friction: the dimension of its contacts and their friction: sliding, torsional [m], rolling [m].
      margin, gap: [m].
      group: the group by which it is shown or hidden.
      material: the name of its material, or None.
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
    """A site.

    Attributes:
      body: the body that it is attached to.
      type: its shape.
      size: its size [m].
      position: its position in the body [m].
      group: the group by which it is shown.
    """

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
    """Returns an attribute of the cameras that have a sensor size, and therefore no angle of view."""

    def read(model: mujoco.MjModel, camera: int) -> tuple[float, ...] | None:
        return floats(getattr(model, field)[camera][part]) if _has_lens(model, camera) else None

    return computed(read, unit="m", is_detail=is_detail)


def _outputs(bits: int) -> tuple[str, ...]:
    return tuple(name for name, bit in enum_members(mujoco.mjtCamOutBit).items() if bits & bit)


@dataclass(frozen=True)
class Camera(ModelObject):
    """A camera.

    Attributes:
      body: the body that it is fixed to.
      mode: `fixed`, `track`, `trackcom`, `targetbody` or `targetbodycom`.
      target: the body that it turns to, or None.
      projection: `perspective` or `orthographic`.
      fovy: the vertical angle of view [°]; None for a camera that is orthographic or has a sensor size.
      height: the vertical extent of the view of an orthographic camera [m]; None for other cameras.
      sensor_size, focal_length, principal_point: [m]; the principal point is where the optical axis meets the image,
        relative to its centre. None for a camera that fovy describes.
      resolution: the intended width and height [px]; (1, 1) if not set. Images do not follow it.
      outputs: the intended kinds of images: `rgb`, `depth` …
      position: the position in its body [m].
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
      body: the body that it is fixed to.
      type: `spot`, `directional`, `point` or `image`.
      mode, target: as for a camera.
      position: the position in its body [m].
      active, shadow: true if it shines, and if it casts shadows.
    """

    KIND = "light"

    body: str = of_field("light_bodyid")
    type: str = of_field("light_type")
    mode: str = of_field("light_mode")
    target: str | None = of_field("light_targetbodyid")
    position: tuple[float, ...] = of_field("light_pos", is_detail=True)
    active: bool = of_field("light_active")
    shadow: bool = of_field("light_castshadow")
