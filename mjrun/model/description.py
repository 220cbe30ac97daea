"""Descriptions of the objects of compiled models as typed plain values.

Each attribute of a dataclass declares the MuJoCo field that it holds, and its column in tables. The values of a field
come from `mjrun.model.fields`, their unit from `mjrun.model.units`. By default the column has the name of the
attribute.
"""

import ctypes
import dataclasses
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from operator import itemgetter
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model.fields import WRAPPED, as_rows, floats, plain_values, referred_kinds
from mjrun.model.names import (
    COUNTS,
    PREFIXES,
    QPOS_COMPONENTS,
    QVEL_COMPONENTS,
    SCALAR_JOINTS,
    enum_members,
    enum_name,
    names,
    object_name,
    object_names,
)
from mjrun.model.units import (
    ORTHOGRAPHIC,
    Unit,
    actuator_force_unit,
    actuator_unit,
    field_unit,
    joint_unit,
    sensor_unit,
    tendon_unit,
)

COEFFICIENTS = (int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_PULLEY))
DIMENSIONS = {1: "lines", 2: "triangles", 3: "tetrahedra"}
EQUALITIES = {0: "none", 1: "edges", 3: "strain"}
BY_GAIN = {"so3": "orientation", "pid": "pid", "dcmotor": "dcmotor", "muscle": "muscle"}
USERS = ("body", "geom", "actuator", "sensor")  # kinds of objects that a plugin can implement
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2}

Pair = tuple[float, float]
T = TypeVar("T", bound="ModelObject")


@dataclass(frozen=True)
class DescribedAttribute:
    """The origin of an attribute, and its column in tables.

    Attributes:
      read: the function that returns the values of all objects in order of id, given a model and their kind.
      heading: the heading of the column.
      unit: the function that returns the unit, given a model and an id.
      usual: an uninformative value: the column is blank if every object has it.
      is_detail: true if the column is omitted where space is short.
      is_range: true if each value is a range.
    """

    read: Callable[[mujoco.MjModel, str], Sequence[Any]]
    heading: str = ""
    unit: Unit = lambda model, index: ""
    usual: float = 0
    is_detail: bool = False
    is_range: bool = False


@dataclass(frozen=True)
class ModelObject:
    """An object of a model.

    Attributes:
      id, name: its id and name; `geom:3` if it has no name.
    """

    KIND: ClassVar[str]

    id: int
    name: str

    @classmethod
    def facts(cls) -> dict[str, DescribedAttribute]:
        """Returns the declaration of each attribute, by name."""
        declared = {field.name: field.metadata.get("fact") for field in dataclasses.fields(cls)}
        return {name: fact for name, fact in declared.items() if fact}


def objects(kind: type[T], model: mujoco.MjModel) -> tuple[T, ...]:
    """Returns the descriptions of all objects of a kind, in order of id."""
    columns = [fact.read(model, kind.KIND) for fact in kind.facts().values()]
    own_names = names(model, kind.KIND)
    return tuple(map(kind, range(len(own_names)), own_names, *columns))


def of_field(
    name: str,
    *,
    at: str = "",
    then: Callable[[Any], Any] | None = None,
    heading: str = "",
    unit: str | None = None,
    usual: float = 0,
    is_detail: bool = False,
) -> Any:
    """Declares an attribute that holds the values of the field `name` of MjModel.

    Args:
      at: the field with the row of each object; by default the row is its id.
      then: a function applied to each value.
      heading: the heading of the column; by default the name of the attribute.
      unit: the unit of the values; by default that of the field.
    """

    def read(model: mujoco.MjModel, kind: str) -> Sequence[Any]:
        values = plain_values(model, name)
        if at:
            values = [values[row] for row in getattr(model, at)]
        return [then(value) for value in values] if then else values

    def own_unit(model: mujoco.MjModel, index: int) -> str:
        return field_unit(model, name, getattr(model, at)[index] if at else index)

    return _attribute(
        DescribedAttribute(read, heading, own_unit if unit is None else lambda model, index: unit, usual, is_detail)
    )


def within_limits(limited: str, limits: str, *, is_detail: bool = False) -> Any:
    """Declares an attribute that holds the range in the field `limits`; None unless the field `limited` enforces it."""

    def read(model: mujoco.MjModel, kind: str) -> Sequence[Pair | None]:
        return limited_ranges(getattr(model, limited), getattr(model, limits))

    def unit(model: mujoco.MjModel, index: int) -> str:
        return field_unit(model, limits, index)

    return _attribute(DescribedAttribute(read, unit=unit, is_detail=is_detail, is_range=True))


def computed(
    compute: Callable[[mujoco.MjModel, int], Any],
    *,
    unit: str = "",
    is_detail: bool = False,
) -> Any:
    """Declares an attribute that is computed from a model and the id of the object."""

    def read(model: mujoco.MjModel, kind: str) -> Sequence[Any]:
        return [compute(model, i) for i in range(getattr(model, COUNTS[kind]))]

    return _attribute(DescribedAttribute(read, unit=lambda model, index: unit, is_detail=is_detail))


def referred_kind(field: str) -> Any:
    """Declares an attribute that holds the kind of object which the ids in a field refer to."""

    def read(model: mujoco.MjModel, kind: str) -> Sequence[str]:
        kinds = referred_kinds(model, field)
        assert kinds is not None, field
        return [enum_name(mujoco.mjtObj, row[0]) for row in as_rows(kinds)]

    return _attribute(DescribedAttribute(read))


def _attribute(fact: DescribedAttribute) -> Any:
    return dataclasses.field(metadata={"fact": fact})


def limited_ranges(limited: Sequence[Any], limits: Sequence[Any]) -> list[Pair | None]:
    """Returns each range, or None if it is not enforced."""
    return [(float(low), float(high)) if on else None for on, (low, high) in zip(limited, limits, strict=True)]


def without_trailing_zeros(values: Sequence[Any]) -> tuple[float, ...]:
    """Returns numbers as floats, without trailing zeros."""
    numbers = list(floats(values))
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


# The number of sizes that a type of geom has, if not three.


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
      rgba: its red, green, blue and opacity, from 0 to 1; a geom with MuJoCo's default, 0.5 0.5 0.5 1, has the colour
        of its material.
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
    rgba: tuple[float, ...] = of_field("geom_rgba", is_detail=True)


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


@dataclass(frozen=True)
class TendonPathElement:
    """An element of the path of a tendon.

    Attributes:
      kind: `joint`, `site`, `pulley`, or the shape of a geom: `sphere` or `cylinder`.
      name: the name of the joint, site or geom; None for a pulley.
      coefficient: the coefficient of a joint, or the divisor of a pulley; None for others.
    """

    kind: str
    name: str | None
    coefficient: float | None


def _path(model: mujoco.MjModel, tendon: int) -> tuple[TendonPathElement, ...]:
    start, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    return tuple(_point(model, i) for i in range(start, start + count))


def _point(model: mujoco.MjModel, i: int) -> TendonPathElement:
    kind = int(model.wrap_type[i])
    obj = WRAPPED.get(kind)
    name = None if obj is None else object_name(model, obj, model.wrap_objid[i])
    return TendonPathElement(
        enum_name(mujoco.mjtWrap, kind), name, float(model.wrap_prm[i]) if kind in COEFFICIENTS else None
    )


@dataclass(frozen=True)
class Tendon(ModelObject):
    """A tendon.

    Attributes:
      type: `fixed`, a weighted sum of joints, or `spatial`, along sites and around geoms.
      unit: the unit of its length: `m`, or `rad` for a sum of angles; empty for a sum of both.
      path: the elements of its path, in order.
      length0: the length in the initial configuration of the model [unit].
      range: the range of its length [unit]; None if unlimited.
      spring_length: the range of lengths in which its spring is slack [unit].
      stiffness, damping: [force/unit], [force·s/unit]; a force is N, or N·m for rad.
      stiffness_polynomial, damping_polynomial: the coefficients of the higher orders.
      armature, frictionloss: [kg or kg·m²], [force].
      actuator_force_range: the range of the total actuator force [force]; None if unlimited.
    """

    KIND = "tendon"

    type: str = of_field("tendon_type")
    unit: str = computed(tendon_unit)
    path: tuple[TendonPathElement, ...] = computed(_path)
    length0: float = of_field("tendon_length0")
    range: Pair | None = within_limits("tendon_limited", "tendon_range")
    spring_length: tuple[float, ...] = of_field("tendon_lengthspring")
    stiffness: float = of_field("tendon_stiffness", is_detail=True)
    stiffness_polynomial: tuple[float, ...] = of_field("tendon_stiffnesspoly", then=without_trailing_zeros)
    damping: float = of_field("tendon_damping", is_detail=True)
    damping_polynomial: tuple[float, ...] = of_field("tendon_dampingpoly", then=without_trailing_zeros)
    armature: float = of_field("tendon_armature", is_detail=True)
    frictionloss: float = of_field("tendon_frictionloss", is_detail=True)
    actuator_force_range: Pair | None = within_limits("tendon_actfrclimited", "tendon_actfrcrange")


@dataclass(frozen=True)
class EqualityConstraint(ModelObject):
    """An equality constraint.

    Attributes:
      type: `connect`, `weld`, `joint`, `tendon`, `flex` …
      object_kind, object1, object2: the bound objects; a binding to a constant or the world has no second one.
      active: true if it is active at the start.
      data: its numbers in MuJoCo's order, without trailing zeros: anchors, a relative pose or polynomial coefficients,
        depending on the type.
      solref, solimp: its solver parameters.
    """

    KIND = "equality"

    type: str = of_field("eq_type")
    object_kind: str = referred_kind("eq_obj1id")
    object1: str | None = of_field("eq_obj1id")
    object2: str | None = of_field("eq_obj2id")
    active: bool = of_field("eq_active0")
    data: tuple[float, ...] = of_field("eq_data", then=without_trailing_zeros, is_detail=True)
    solref: tuple[float, ...] = of_field("eq_solref", is_detail=True)
    solimp: tuple[float, ...] = of_field("eq_solimp")


@dataclass(frozen=True)
class ContactPair(ModelObject):
    """Two geoms with dedicated contact parameters.

    Attributes:
      geom1, geom2: the two geoms.
      condim, friction: the friction along two tangents, torsional [m], rolling about two [m].
      margin, gap: [m].
      solref, solimp: its solver parameters.
    """

    KIND = "pair"

    geom1: str | None = of_field("pair_geom1", heading="geom 1")
    geom2: str | None = of_field("pair_geom2", heading="geom 2")
    condim: int = of_field("pair_dim", usual=-1)
    friction: tuple[float, ...] = of_field("pair_friction")
    margin: float = of_field("pair_margin")
    gap: float = of_field("pair_gap")
    solref: tuple[float, ...] = of_field("pair_solref", is_detail=True)
    solimp: tuple[float, ...] = of_field("pair_solimp", is_detail=True)


@dataclass(frozen=True)
class ContactExclusion(ModelObject):
    """Two bodies whose geoms never touch.

    Attributes:
      body1, body2: the names of the bodies.
    """

    KIND = "exclude"

    body1: str = of_field("exclude_signature", then=itemgetter(0), heading="body 1")
    body2: str = of_field("exclude_signature", then=itemgetter(1), heading="body 2")


@dataclass(frozen=True)
class Flex(ModelObject):
    """A deformable object.

    Attributes:
      elements_are: `lines`, `triangles` or `tetrahedra`.
      vertices, edges, elements, nodes: their numbers.
      radius: the radius around its elements [m].
      half_size: half the size of its bounding box in the initial configuration of the model [m].
      rigid: true if all of it belongs to one body.
      interpolated: true if a few nodes move it instead of its vertices.
      edge_equality: the constraint of its edges: `none`, `edges` or `strain`; others as MuJoCo's number.
      edge_stiffness, edge_damping, damping: those of its edges, and the damping of its elements [s].
      self_collision: MuJoCo's name: `none`, `auto` …
      condim, friction: the parameters of its contacts.
      group: the group by which it is shown or hidden.
    """

    KIND = "flex"

    elements_are: str = of_field("flex_dim", then=lambda dimension: DIMENSIONS.get(dimension, str(dimension)))
    vertices: int = of_field("flex_vertnum")
    edges: int = of_field("flex_edgenum")
    elements: int = of_field("flex_elemnum")
    nodes: int = of_field("flex_nodenum")
    radius: float = of_field("flex_radius")
    half_size: tuple[float, ...] = of_field("flex_size")
    rigid: bool = of_field("flex_rigid")
    interpolated: bool = of_field("flex_interp", then=bool)
    edge_equality: str = of_field("flex_edgeequality", then=lambda law: EQUALITIES.get(law, str(law)))
    edge_stiffness: float = of_field("flex_edgestiffness", is_detail=True)
    edge_damping: float = of_field("flex_edgedamping", is_detail=True)
    damping: float = of_field("flex_damping", unit="s", is_detail=True)
    self_collision: str = of_field("flex_selfcollide", heading="self-collision", is_detail=True)
    condim: int = of_field("flex_condim")
    friction: tuple[float, ...] = of_field("flex_friction")
    group: int = of_field("flex_group")


# MJCF elements that the type of the gain alone determines.


def _kind(model: mujoco.MjModel, i: int) -> str:
    """Returns the MJCF element whose settings an actuator has, as MuJoCo's manual lists them:
    https://mujoco.readthedocs.io/en/latest/XMLreference.html#actuator
    """
    dynamics = enum_name(mujoco.mjtDyn, model.actuator_dyntype[i])
    gain = enum_name(mujoco.mjtGain, model.actuator_gaintype[i])
    bias = enum_name(mujoco.mjtBias, model.actuator_biastype[i])
    gains, biases = without_trailing_zeros(model.actuator_gainprm[i]), without_trailing_zeros(model.actuator_biasprm[i])
    if model.actuator_plugin[i] >= 0:
        return "plugin"
    if gain in BY_GAIN:
        return BY_GAIN[gain]
    if (gain, bias, dynamics) == ("affine", "none", "none") and len(gains) == 3 and gains[:2] == (0, 0):
        return "damper"
    if gain == "fixed" and bias == "affine":
        return _servo(dynamics, gains, biases)
    if (gain, bias, dynamics) == ("fixed", "none", "none"):
        if enum_name(mujoco.mjtTrn, model.actuator_trntype[i]) == "body":
            return "adhesion"
        return "motor" if gains == (1,) else "general"
    return "general"


def _servo(dynamics: str, gains: tuple[float, ...], biases: tuple[float, ...]) -> str:
    """Returns the element with a gain k and the bias 0, −k, −kv or 0, 0, −k; a cylinder has its area and any bias."""
    constant, position, velocity = (*biases, 0.0, 0.0, 0.0)[:3]
    gain = gains[0] if gains else 0.0
    if constant == 0 and gain and position == -gain:
        if dynamics == "integrator":
            return "intvelocity"
        return "position" if dynamics in ("none", "filter", "filterexact") else "general"
    if constant == 0 == position and gain and velocity == -gain and dynamics == "none":
        return "velocity"
    return "cylinder" if dynamics == "filter" else "general"


def _gear(model: mujoco.MjModel, actuator: int) -> tuple[tuple[float, ...], ...]:
    start, count = model.actuator_outadr[actuator], model.actuator_outnum[actuator]
    return tuple(map(without_trailing_zeros, model.actuator_gear[start : start + count]))


def _ctrl_range(model: mujoco.MjModel, actuator: int) -> tuple[Pair | None, ...]:
    start, count = model.actuator_ctrladr[actuator], model.actuator_ctrlnum[actuator]
    controls = slice(start, start + count)
    return tuple(limited_ranges(model.actuator_ctrllimited[controls], model.actuator_ctrlrange[controls]))


def _act(model: mujoco.MjModel, actuator: int) -> int | None:
    return int(model.actuator_actadr[actuator]) if model.actuator_actnum[actuator] else None


@dataclass(frozen=True)
class Actuator(ModelObject):
    """An actuator: its force is gain · (control or activation) + bias.

    Attributes:
      kind: the MJCF element that creates such an actuator: `motor`, `position` …; otherwise `general`.
      transmission: `joint`, `tendon`, `site` …
      target_kind, target: the object that it acts on.
      reference: the site of a slider, or the site that a site moves relative to, or None.
      gear: the gear of each output, without trailing zeros.
      unit, force_unit: the units of its length and of its force, before the gear; empty if unknown.
      dynamics, gain, bias: the types of its dynamics, gain and bias.
      dynamics_parameters, gain_parameters, bias_parameters: their parameters, without trailing zeros.
      ctrl, ctrl_size: the address and the number of its controls in `ctrl`.
      ctrl_range: the range of each control; None if unlimited.
      act, act_size: the address and the number of its activations in `act`; no address without any.
      act_range: the range of its activation; None if unlimited.
      force_range: the range of its force [force_unit]; None if unlimited.
      delay: the delay of its controls [s].
      damping, armature: the damping and armature that it adds to its target.
      group: the group by which it is shown or disabled.
      plugin: the plugin instance that computes its force, or None.
    """

    KIND = "actuator"

    kind: str = computed(_kind)
    transmission: str = of_field("actuator_trntype")
    target_kind: str = referred_kind("actuator_trnid")
    target: str | None = of_field("actuator_trnid", then=itemgetter(0))
    reference: str | None = of_field("actuator_trnid", then=itemgetter(1))
    gear: tuple[tuple[float, ...], ...] = computed(_gear)
    unit: str = computed(actuator_unit)
    force_unit: str = computed(actuator_force_unit)
    dynamics: str = of_field("actuator_dyntype")
    dynamics_parameters: tuple[float, ...] = of_field("actuator_dynprm", then=without_trailing_zeros)
    gain: str = of_field("actuator_gaintype")
    gain_parameters: tuple[float, ...] = of_field("actuator_gainprm", then=without_trailing_zeros)
    bias: str = of_field("actuator_biastype")
    bias_parameters: tuple[float, ...] = of_field("actuator_biasprm", then=without_trailing_zeros)
    ctrl: int = of_field("actuator_ctrladr")
    ctrl_size: int = of_field("actuator_ctrlnum")
    ctrl_range: tuple[Pair | None, ...] = computed(_ctrl_range)
    act: int | None = computed(_act)
    act_size: int = of_field("actuator_actnum")
    act_range: Pair | None = within_limits("actuator_actlimited", "actuator_actrange", is_detail=True)
    force_range: Pair | None = within_limits("actuator_forcelimited", "actuator_forcerange", is_detail=True)
    delay: float = of_field("actuator_delay", is_detail=True)
    damping: float = of_field("actuator_damping")
    armature: float = of_field("actuator_armature")
    group: int = of_field("actuator_group", is_detail=True)
    plugin: str | None = of_field("actuator_plugin")


def _object_kind(kind: str, index: str) -> Any:
    """Returns an attribute with the kind of the object that a sensor refers to, or None."""

    def object_kind(model: mujoco.MjModel, sensor: int) -> str | None:
        obj, refers = int(getattr(model, kind)[sensor]), getattr(model, index)[sensor] >= 0
        return enum_name(mujoco.mjtObj, obj) if refers and obj else None

    return computed(object_kind)


@dataclass(frozen=True)
class Sensor(ModelObject):
    """A sensor.

    Attributes:
      type: MuJoCo's name of the type: `framepos`, `touch` …
      object_kind, object: the measured object; None for the whole model. The kind `xbody` is a body by its frame,
        `body` a body by the frame of its inertia.
      reference_kind, reference: the object that the values are relative to, or the second object; None for the world.
      dim, address: the values are `sensordata[address : address + dim]`.
      unit: the unit of the values; empty for pure numbers and for mixed units.
      data_type: `real`, `positive`, `axis` or `quaternion`.
      needs: the stage of the state that it is computed from: `pos`, `vel` or `acc`.
      cutoff: the magnitude at which values are cut off [unit], or None.
      noise: the standard deviation that the model states [unit]; MuJoCo adds no noise.
      delay, period: the delay and the period of its values [s]; 0 for none.
      plugin: the plugin instance that computes it, or None.
    """

    KIND = "sensor"

    type: str = of_field("sensor_type")
    object_kind: str | None = _object_kind("sensor_objtype", "sensor_objid")
    object: str | None = of_field("sensor_objid")
    reference_kind: str | None = _object_kind("sensor_reftype", "sensor_refid")
    reference: str | None = of_field("sensor_refid")
    dim: int = of_field("sensor_dim")
    address: int = of_field("sensor_adr")
    unit: str = computed(sensor_unit)
    data_type: str = of_field("sensor_datatype")
    needs: str = of_field("sensor_needstage")
    cutoff: float | None = of_field("sensor_cutoff", then=lambda cutoff: cutoff or None, unit="", is_detail=True)
    noise: float = of_field("sensor_noise", unit="", is_detail=True)
    delay: float = of_field("sensor_delay", is_detail=True)
    period: float = of_field("sensor_interval", then=itemgetter(0), is_detail=True)
    plugin: str | None = of_field("sensor_plugin", is_detail=True)


class _Registered(ctypes.Structure):
    """The beginning of MuJoCo's mjpPlugin, in mjplugin.h."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("nattribute", ctypes.c_int),
        ("attributes", ctypes.POINTER(ctypes.c_char_p)),
    )


@cache
def _registered(slot: int) -> "_Registered | None":
    """Returns the plugin in a slot of MuJoCo's registry, which its Python bindings do not expose."""
    for library in sorted(Path(mujoco.__file__).parent.glob("libmujoco*")):
        with suppress(OSError, AttributeError):
            function = ctypes.CDLL(str(library)).mjp_getPluginAtSlot
            function.argtypes, function.restype = [ctypes.c_int], ctypes.POINTER(_Registered)
            plugin = function(slot)
            return plugin.contents if plugin else None
    return None


def _text(value: bytes) -> str:
    return value.decode("utf-8", "replace")


def _name(model: mujoco.MjModel, instance: int) -> str | None:
    registered = _registered(int(model.plugin[instance]))
    return None if registered is None else _text(registered.name)


def _settings(model: mujoco.MjModel, instance: int) -> dict[str, str]:
    registered = _registered(int(model.plugin[instance]))
    texts = bytes(model.plugin_attr[model.plugin_attradr[instance] :]).split(b"\0")
    keys = [] if registered is None else [registered.attributes[i] for i in range(registered.nattribute)]
    return {_text(key): _text(text) for key, text in zip(keys, texts, strict=False) if text}


def _users(model: mujoco.MjModel, instance: int) -> tuple[str, ...]:
    return tuple(
        f"{kind}/{name}"
        for kind in USERS
        for name, plugin in zip(names(model, kind), getattr(model, f"{PREFIXES[kind]}_plugin"), strict=True)
        if plugin == instance
    )


@dataclass(frozen=True)
class PluginInstance(ModelObject):
    """A plugin instance.

    Attributes:
      plugin: the name of the plugin, `mujoco.pid`; None if this MuJoCo does not report it.
      settings: the settings in the model.
      state: the number of its state variables.
      users: the objects that it implements: `sensor/touch`, `geom/torus`.
    """

    KIND = "plugin"

    plugin: str | None = computed(_name)
    settings: dict[str, str] = computed(_settings)
    state: int = of_field("plugin_statenum")
    users: tuple[str, ...] = computed(_users)
