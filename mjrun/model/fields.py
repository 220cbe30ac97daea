"""The fields of a compiled model: their dimensions, the objects that their ids refer to, and their values.

Names, extents and meanings come from MuJoCo's description of mjModel. Each field is of one of three sorts:

- *Layout*: addresses and counts, which follow from the order and number of objects; names and paths; the bounding
  volumes and sparsity patterns of the engine.
- *Computed*: fields that the compiler derives from others, such as `dof_M0` and `body_subtreemass`.
- All others, which define the model. A field added by a later MuJoCo belongs here until it is listed.

Units are in `mjrun.model.units`.
"""

import copy
import math
import re
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.model.names import KIND_OF, KIND_OF_COUNT, KINDS, enum_name, object_name

Obj = mujoco.mjtObj
Value = str | int | float | bool
SINGLE: type = np.float32
# Dimensions along which each object of a kind has several rows, by the field with the addresses of these.
STRETCHES = {
    "nmeshvert": "mesh_vertadr", "nmeshnormal": "mesh_normaladr", "nmeshtexcoord": "mesh_texcoordadr",
    "nmeshface": "mesh_faceadr", "nhfielddata": "hfield_adr", "ntexdata": "tex_adr",
    "nflexvert": "flex_vertadr", "nflexnode": "flex_nodeadr", "nflexelem": "flex_elemadr",
    "nflexelemdata": "flex_elemdataadr", "nflextexcoord": "flex_texcoordadr", "nflexstiffness": "flex_stiffnessadr",
    "nflexbending": "flex_bendingadr", "nskinvert": "skin_vertadr", "nskintexvert": "skin_texcoordadr",
    "nskinface": "skin_faceadr", "nskinbone": "skin_boneadr",
    "nskinbonevert": "skin_bonevertadr", "nwrap": "tendon_adr",
    "nnumericdata": "numeric_adr",
    "ntextdata": "text_adr", "ntupledata": "tuple_adr", "npluginattr": "plugin_attradr",
}  # fmt: skip

LAYOUT_ENDS = ("adr", "num")
LAYOUT_BEGINNINGS = ("name_", "bvh_", "oct_", "B_", "M_", "D_", "map", "ten_J_", "flexedge_J_", "efm0_", "efmC_")
LAYOUT = {
    *("buffer", "names", "names_map", "paths", "signature", "pair_signature", "numeric_size", "text_size"),
    *("tuple_size", "body_treeid", "dof_bodyid", "dof_jntid", "dof_parentid", "dof_treeid", "tendon_treeid"),
}
COMPARED_COUNTS = {"flex_cellnum", "actuator_ctrlnum", "actuator_actnum"}  # counts that the user chooses

COMPUTED = {
    *("body_rootid", "body_weldid", "body_simple", "body_sameframe", "body_subtreemass", "body_invweight0"),
    *("body_margin", "body_contype", "body_conaffinity", "jnt_actuatorid", "tendon_actuatorid"),
    *("dof_invweight0", "dof_M0", "dof_length", "geom_sameframe", "geom_aabb", "geom_rbound", "site_sameframe"),
    *("cam_poscom0", "cam_pos0", "cam_mat0", "light_poscom0", "light_pos0", "light_dir0"),
    *("flex_edge", "flex_edgeflap", "flex_elemedge", "flex_elemlayer", "flex_shell", "flex_vertcell", "flex_vert0"),
    *("flex_node0", "flexedge_length0", "flexedge_invweight0", "flexedge_rigid", "flex_rigid", "flex_centered"),
    *("flex_size", "mesh_pos", "mesh_quat", "mesh_extrema", "mesh_graph", "mesh_polynormal", "mesh_polyvert"),
    *("mesh_polymap", "tendon_length0", "tendon_invweight0", "actuator_acc0", "actuator_length0"),
    *("sensor_datatype", "sensor_needstage", "sensor_dim"),
}
# Numbers of the whole model that define it. Other counts follow from its objects.
SIZES = ("nuserdata", "njmax", "nconmax")
# The kind of object that the ids in a field refer to, or the field that determines the kind.
REFERENCES = {
    "body_parentid": "body", "body_rootid": "body", "body_weldid": "body", "body_plugin": "plugin",
    "jnt_bodyid": "body", "jnt_actuatorid": "actuator",
    "geom_bodyid": "body", "geom_dataid": "geom_type", "geom_matid": "material", "geom_plugin": "plugin",
    "site_bodyid": "body", "site_dataid": "mesh", "site_matid": "material",
    "cam_bodyid": "body", "cam_targetbodyid": "body",
    "light_bodyid": "body", "light_targetbodyid": "body", "light_texid": "texture",
    "flex_matid": "material", "flex_nodebodyid": "body", "flex_vertbodyid": "body",
    "skin_matid": "material", "skin_bonebodyid": "body",
    "mat_texid": "texture", "pair_geom1": "geom", "pair_geom2": "geom",
    "eq_obj1id": "eq_objtype", "eq_obj2id": "eq_objtype",
    "tendon_matid": "material", "tendon_actuatorid": "actuator", "wrap_objid": "wrap_type", "wrap_prm": "wrap_type",
    "actuator_trnid": "actuator_trntype", "actuator_plugin": "plugin",
    "sensor_objid": "sensor_objtype", "sensor_refid": "sensor_reftype", "sensor_plugin": "plugin",
    "tuple_objid": "tuple_objtype", "exclude_signature": "body",
}  # fmt: skip

_Geom, _Wrap, _Transmission = mujoco.mjtGeom, mujoco.mjtWrap, mujoco.mjtTrn
_WRAPS = (_Wrap.mjWRAP_SPHERE, _Wrap.mjWRAP_CYLINDER)
# The type of object at each type of point in the path of a tendon.
WRAPPED = {
    int(_Wrap.mjWRAP_JOINT): Obj.mjOBJ_JOINT,
    int(_Wrap.mjWRAP_SITE): Obj.mjOBJ_SITE,
    **{int(wrap): Obj.mjOBJ_GEOM for wrap in _WRAPS},
}
# The type of object that the ids in a field refer to, by the value of the determining field; by default that mjtObj.
_REFERRED: dict[str, dict[int, mujoco.mjtObj]] = {
    "geom_dataid": {
        int(_Geom.mjGEOM_MESH): Obj.mjOBJ_MESH,
        int(_Geom.mjGEOM_SDF): Obj.mjOBJ_MESH,
        int(_Geom.mjGEOM_HFIELD): Obj.mjOBJ_HFIELD,
    },
    "wrap_objid": WRAPPED,
    "wrap_prm": {int(wrap): Obj.mjOBJ_SITE for wrap in _WRAPS},  # the side site; else a coefficient
    "actuator_trnid": {
        int(_Transmission.mjTRN_JOINT): Obj.mjOBJ_JOINT,
        int(_Transmission.mjTRN_JOINTINPARENT): Obj.mjOBJ_JOINT,
        int(_Transmission.mjTRN_SLIDERCRANK): Obj.mjOBJ_SITE,
        int(_Transmission.mjTRN_TENDON): Obj.mjOBJ_TENDON,
        int(_Transmission.mjTRN_SITE): Obj.mjOBJ_SITE,
        int(_Transmission.mjTRN_SO3): Obj.mjOBJ_SITE,
        int(_Transmission.mjTRN_BODY): Obj.mjOBJ_BODY,
    },
}
_EQUALITIES = {
    int(mujoco.mjtEq.mjEQ_JOINT): Obj.mjOBJ_JOINT,
    int(mujoco.mjtEq.mjEQ_TENDON): Obj.mjOBJ_TENDON,
    **{int(value): Obj.mjOBJ_FLEX for name, value in mujoco.mjtEq.__members__.items() if name.startswith("mjEQ_FLEX")},
}
_ENUM = re.compile(r"\((mjt\w+)\)")
_ENUMS = {"tuple_objtype": Obj}  # of fields whose description names none


@dataclass(frozen=True)
class ModelField:
    """An array of a compiled model.

    Attributes:
      name: MuJoCo's name, such as `body_mass`.
      extents: the extents of the array: the count of its rows, `nbody`, then numbers and names of numbers.
      enum: the enum of its values; None for numbers.
      boolean: true if its values are booleans.
    """

    name: str
    extents: tuple[str | int, ...]
    enum: Any | None = None
    boolean: bool = False

    @property
    def computed(self) -> bool:
        """True if the compiler derives it from other fields."""
        return self.name in COMPUTED

    @property
    def rows(self) -> str:
        """The name of the count of its rows."""
        return str(self.extents[0])

    def plain(self, value: Any) -> Value:
        """Converts one of its numbers to a plain value: a number, a boolean, or MuJoCo's name."""
        if self.enum is not None:
            return enum_name(self.enum, value)
        if self.boolean:
            return bool(value)
        return decimal_float(value) if np.issubdtype(value.dtype, np.floating) else int(value)


@cache
def arrays() -> dict[str, ModelField]:
    """Returns the arrays of a compiled model by name, in MuJoCo's order."""
    from mujoco.introspect import structs

    described: Any = structs.STRUCTS["mjModel"].fields
    return {each.name: _field(each) for each in described if each.array_extent}


@cache
def model_fields() -> tuple[ModelField, ...]:
    """Returns the arrays of a compiled model that do not follow from the order and number of objects alone."""
    return tuple(field for field in arrays().values() if not is_layout(field.name))


def is_layout(name: str) -> bool:
    """Returns whether a field follows from the order and number of objects alone."""
    if name in COMPARED_COUNTS:
        return False
    tree = name.startswith("tree_") and name != "tree_sleep_policy"
    return tree or name in LAYOUT or name.endswith(LAYOUT_ENDS) or name.startswith(LAYOUT_BEGINNINGS)


def _field(described: Any) -> ModelField:
    named = _ENUM.search(described.doc)
    enum = getattr(mujoco, named[1], None) if named and "flags" not in described.doc else None
    enum = _ENUMS.get(described.name, enum)
    boolean = "mjtBool" in str(described.type) or described.name == "body_mocapid"
    return ModelField(described.name, tuple(described.array_extent), enum, boolean)


def user_sizes() -> list[str]:
    """Returns the names of the widths of the user data, `nuser_body` …"""
    from mujoco.introspect import structs

    described: Any = structs.STRUCTS["mjModel"].fields
    return [each.name for each in described if each.name.startswith("nuser_")]


def array(model: mujoco.MjModel, name: str) -> np.ndarray:
    """Returns a field of `model`: texts as bytes, signatures of excludes as two bodies, mocap ids as booleans."""
    value = getattr(model, name)
    if isinstance(value, bytes):
        return np.frombuffer(value, np.uint8)
    if name == "exclude_signature":
        return np.stack([value >> 16, value & 0xFFFF], axis=1)
    return value >= 0 if name == "body_mocapid" else np.asarray(value)


def plain_values(model: mujoco.MjModel, name: str) -> list[Any]:
    """Returns the rows of a field as plain values, or tuples of these; ids as object names, None without an object."""
    field, values, kinds = arrays()[name], array(model, name), referred_kinds(model, name)
    rows = as_rows(values)
    if kinds is None and field.enum is None and rows.dtype != SINGLE:
        plain = [tuple(row) for row in (rows.astype(bool) if field.boolean else rows).tolist()]
    elif kinds is None:
        plain = [tuple(map(field.plain, row)) for row in rows]
    else:
        pairs = (zip(*row, strict=True) for row in zip(as_rows(kinds), rows, strict=True))
        plain = [tuple(object_name(model, kind, index) if kind else None for kind, index in row) for row in pairs]
    return plain if values.ndim > 1 else [value for (value,) in plain]


def decimal_float(value: Any) -> float:
    """Converts a number to a float; in single precision to the shortest decimal: 0.1 instead of 0.10000000149."""
    return float(str(value)) if isinstance(value, SINGLE) else float(value)


def floats(values: Iterable[Any]) -> tuple[float, ...]:
    """Converts numbers to floats."""
    return tuple(map(decimal_float, values))


def as_rows(values: np.ndarray) -> np.ndarray:
    """Returns a field as `(n, m)`, whatever the shape of its rows."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


def referred_kinds(model: mujoco.MjModel, name: str) -> np.ndarray | None:
    """Returns the mjtObj whose id each number in a field is, 0 if it is not an id; None if the field has no ids."""
    if name not in REFERENCES:
        return None
    values, target = array(model, name), REFERENCES[name]
    if target in KINDS:
        return np.full(values.shape, int(KINDS[target]))
    kinds = array(model, target).astype(int)
    if table := _REFERRED.get(name):
        kinds = _looked_up(kinds, table)
    if name == "actuator_trnid":  # an orientation acts on a ball joint, or on a site relative to another
        turns_joint = (model.actuator_trntype == int(_Transmission.mjTRN_SO3)) & (values[:, 1] < 0)
        kinds[turns_joint] = int(Obj.mjOBJ_JOINT)
    if target == "eq_objtype":  # which is set for connect and weld only
        kinds = np.where(kinds, kinds, _looked_up(model.eq_type, _EQUALITIES))
    kinds = np.where(kinds == int(Obj.mjOBJ_XBODY), int(Obj.mjOBJ_BODY), kinds)
    kinds = np.where(np.isin(kinds, list(KIND_OF)), kinds, 0)
    return np.broadcast_to(kinds.reshape(-1, *[1] * (values.ndim - 1)), values.shape)


def _looked_up(kinds: np.ndarray, table: Mapping[int, mujoco.mjtObj]) -> np.ndarray:
    return np.array([int(table.get(int(kind), Obj.mjOBJ_UNKNOWN)) for kind in kinds], int)


def stretch(model: mujoco.MjModel, dimension: str, index: int) -> slice:
    """Returns the rows along one of `STRETCHES` that belong to the object `index`; none if its address is −1."""
    starts = array(model, STRETCHES[dimension])
    if dimension == "nskinbonevert":  # addresses are by bone; the bones of a skin are adjacent
        starts = starts[model.skin_boneadr]
    start = int(starts[index])
    if start < 0:
        return slice(0, 0)
    later = starts[index + 1 :]  # one without rows begins where the next one does
    later = later[later >= start]
    return slice(start, int(later.min()) if later.size else int(getattr(model, dimension)))


def stretch_kind(dimension: str) -> str:
    """Returns the kind of object whose rows lie along a dimension."""
    return KIND_OF_COUNT[f"n{STRETCHES[dimension].partition('_')[0]}"]


@dataclass(frozen=True)
class VariedModel:
    """A model of which each simulation has different numbers in some arrays.

    Attributes:
      model: the model.
      arrays: these arrays, `(simulations, rows, size)`, by name.
    """

    model: mujoco.MjModel
    arrays: Mapping[str, np.ndarray]

    def at(self, simulation: int) -> mujoco.MjModel:
        """Returns a copy of the model with the numbers of one simulation."""
        model = copy.copy(self.model)
        for name, values in self.arrays.items():
            write_array(model, name, values[simulation])
        return model


# Arrays by name: those of MjModel; options and statistics are `opt.NAME` and `stat.NAME`, arrays of one row.


def read_array(model: mujoco.MjModel, array: str) -> np.ndarray:
    """Returns a copy of an array, `(rows, size)`; of `opt.NAME` or `stat.NAME` as one row."""
    group, dot, field = array.rpartition(".")
    if dot:
        return np.array(getattr(getattr(model, group), field), float).reshape(1, -1)
    return getattr(model, field).copy()


def write_array(model: mujoco.MjModel, array: str, values: np.ndarray) -> None:
    """Writes an array, the reverse of `read_array`."""
    group, dot, field = array.rpartition(".")
    if dot:
        setattr(getattr(model, group), field, values[0] if values.shape[1] > 1 else float(values[0, 0]))
    else:
        getattr(model, field)[...] = values


def restore_array(model: mujoco.MjModel, array: str, source: mujoco.MjModel) -> None:
    """Writes an array of another model."""
    if "." in array:
        write_array(model, array, read_array(source, array))
    else:
        getattr(model, array)[...] = getattr(source, array)


def carriers(model: mujoco.MjModel, flex: int) -> np.ndarray:
    """Returns the bodies of the vertices of a flex, or of the nodes that its vertices are interpolated between."""
    vertices, nodes = model.flex_vertadr[flex], model.flex_nodeadr[flex]
    rows = (
        model.flex_vertbodyid[vertices : vertices + model.flex_vertnum[flex]],
        model.flex_nodebodyid[nodes : nodes + model.flex_nodenum[flex]],
    )
    return np.concatenate([bodies[bodies >= 0] for bodies in rows])


def flex_owners(model: mujoco.MjModel) -> np.ndarray:
    """Returns the body that each flex belongs to `(nflex,)`: the first that carries it, except the world, if possible.

    The world carries vertices that are pinned.
    """
    return np.array([next(filter(None, carriers(model, flex)), 0) for flex in range(model.nflex)], int)


def skin_owners(model: mujoco.MjModel) -> np.ndarray:
    """Returns the body that each skin belongs to `(nskin,)`, that of its first bone; −1 for none."""
    bones = zip(model.skin_boneadr.tolist(), model.skin_bonenum.tolist(), strict=True)
    return np.array([model.skin_bonebodyid[first] if count else -1 for first, count in bones], int)
