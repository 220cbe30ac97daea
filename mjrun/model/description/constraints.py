"""Descriptions of tendons, equality constraints, contact pairs, contact excludes, and flexes."""

from operator import itemgetter

import mujoco

from mjrun.dataclass import dataclass
from mjrun.model.description.declaration import (
    ModelObject,
    Pair,
    computed,
    of_field,
    referred_kind,
    within_limits,
    without_trailing_zeros,
)
from mjrun.model.fields import WRAPPED
from mjrun.model.names import enum_name, object_name
from mjrun.model.units import tendon_unit

COEFFICIENTS = (int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_PULLEY))
DIMENSIONS = {1: "lines", 2: "triangles", 3: "tetrahedra"}
EQUALITIES = {0: "none", 1: "edges", 3: "strain"}


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
