"""The fields of a compiled model as a comparison sees them: what counts their rows, what their numbers refer to.

Names, extents and meanings are MuJoCo's own, from its description of mjModel. A field is of one of three sorts:

- *Layout*, which is not compared: addresses and counts, which follow from the order and number of objects; names and
  paths, by which objects are matched; the bounding volumes and sparsity patterns of the engine.
- *Computed*: what the compiler works out from other fields, such as `dof_M0` and `body_subtreemass`.
- All others, which say what the model is. A field that a later MuJoCo adds is one of these until it is listed here.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np
from mujoco.introspect import structs

from mjrun.model.names import COUNTS, KINDS

Obj = mujoco.mjtObj
# What counts the rows of a field → the kind of object that they belong to.
OBJECTS: dict[str, tuple[str, mujoco.mjtObj]] = {COUNTS[kind]: (kind, KINDS[kind]) for kind in KINDS}
OBJECTS |= {
    "nmesh": ("mesh", Obj.mjOBJ_MESH),
    "nhfield": ("hfield", Obj.mjOBJ_HFIELD),
    "ntex": ("texture", Obj.mjOBJ_TEXTURE),
    "nmat": ("material", Obj.mjOBJ_MATERIAL),
    "npair": ("pair", Obj.mjOBJ_PAIR),
    "nexclude": ("exclude", Obj.mjOBJ_EXCLUDE),
    "nnumeric": ("numeric", Obj.mjOBJ_NUMERIC),
    "ntext": ("text", Obj.mjOBJ_TEXT),
    "ntuple": ("tuple", Obj.mjOBJ_TUPLE),
    "nplugin": ("plugin", Obj.mjOBJ_PLUGIN),
}
COUNT_OF = {kind: count for count, (kind, _) in OBJECTS.items()}
KIND_OF = {int(obj): kind for kind, obj in OBJECTS.values()} | {int(Obj.mjOBJ_XBODY): "body"}

# Dimensions along which each object of a kind has a stretch of its own, by the field with the addresses of these.
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
COMPARED_COUNTS = {"flex_cellnum", "actuator_ctrlnum"}  # which the user chooses

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
# Numbers of the whole model that say what it is. Other counts follow from its objects.
SIZES = ("nuserdata", "njmax", "nconmax")

# Fields that hold ids, by what these are the ids of: a kind of object, or the field that says which kind.
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
# What the ids in a field refer to, by the value of the field that says so; by itself, that is one of mjtObj.
_REFERRED: dict[str, dict[int, mujoco.mjtObj]] = {
    "geom_dataid": {
        int(_Geom.mjGEOM_MESH): Obj.mjOBJ_MESH,
        int(_Geom.mjGEOM_SDF): Obj.mjOBJ_MESH,
        int(_Geom.mjGEOM_HFIELD): Obj.mjOBJ_HFIELD,
    },
    "wrap_objid": {
        int(_Wrap.mjWRAP_JOINT): Obj.mjOBJ_JOINT,
        int(_Wrap.mjWRAP_SITE): Obj.mjOBJ_SITE,
        **{int(wrap): Obj.mjOBJ_GEOM for wrap in _WRAPS},
    },
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


@dataclass(frozen=True)
class ModelField:
    """One array of a compiled model.

    Attributes:
      name: MuJoCo's, `body_mass`.
      extents: of the array: what counts its rows, `nbody`, then numbers and names of numbers.
      enum: what its values are members of; None if they are numbers.
      boolean: whether its values are true or false.
    """

    name: str
    extents: tuple[str | int, ...]
    enum: Any | None = None
    boolean: bool = False

    @property
    def computed(self) -> bool:
        """Whether the compiler works it out from other fields."""
        return self.name in COMPUTED

    @property
    def rows(self) -> str:
        """What counts its rows."""
        return str(self.extents[0])


@cache
def model_fields() -> tuple[ModelField, ...]:
    """Every array of a compiled model that is compared, in MuJoCo's order."""
    described: Any = structs.STRUCTS["mjModel"].fields
    return tuple(_field(each) for each in described if each.array_extent and not is_layout(each.name))


def is_layout(name: str) -> bool:
    """Whether a field follows from the order and number of objects alone."""
    if name in COMPARED_COUNTS:
        return False
    tree = name.startswith("tree_") and name != "tree_sleep_policy"
    return tree or name in LAYOUT or name.endswith(LAYOUT_ENDS) or name.startswith(LAYOUT_BEGINNINGS)


def _field(described: Any) -> ModelField:
    named = _ENUM.search(described.doc)
    enum = getattr(mujoco, named[1], None) if named and "flags" not in described.doc else None
    boolean = "mjtBool" in str(described.type) or described.name == "body_mocapid"
    return ModelField(described.name, tuple(described.array_extent), enum, boolean)


def user_sizes() -> list[str]:
    """The names of the widths of the user data, `nuser_body` …"""
    described: Any = structs.STRUCTS["mjModel"].fields
    return [each.name for each in described if each.name.startswith("nuser_")]


def array(model: mujoco.MjModel, name: str) -> np.ndarray:
    """A field of `model`; text as its bytes, the signature of an exclude as its two bodies, a mocap id as a boolean."""
    value = getattr(model, name)
    if isinstance(value, bytes):
        return np.frombuffer(value, np.uint8)
    if name == "exclude_signature":
        return np.stack([value >> 16, value & 0xFFFF], axis=1)
    return value >= 0 if name == "body_mocapid" else np.asarray(value)


def as_rows(values: np.ndarray) -> np.ndarray:
    """A field as `(n, m)`, whatever its rows are."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


def referred_kinds(model: mujoco.MjModel, name: str) -> np.ndarray | None:
    """For each number in a field the mjtObj that it is the id of, 0 where it is no id; None if the field has no ids."""
    if name not in REFERENCES:
        return None
    values, target = array(model, name), REFERENCES[name]
    if target in COUNT_OF:
        return np.full(values.shape, int(OBJECTS[COUNT_OF[target]][1]))
    kinds = array(model, target).astype(int)
    if table := _REFERRED.get(name):
        kinds = _looked_up(kinds, table)
    if target == "eq_objtype":  # which only connect and weld have
        kinds = np.where(kinds, kinds, _looked_up(model.eq_type, _EQUALITIES))
    kinds = np.where(kinds == int(Obj.mjOBJ_XBODY), int(Obj.mjOBJ_BODY), kinds)
    kinds = np.where(np.isin(kinds, list(KIND_OF)), kinds, 0)
    return np.broadcast_to(kinds.reshape(-1, *[1] * (values.ndim - 1)), values.shape)


def _looked_up(kinds: np.ndarray, table: Mapping[int, mujoco.mjtObj]) -> np.ndarray:
    return np.array([int(table.get(int(kind), Obj.mjOBJ_UNKNOWN)) for kind in kinds], int)


def stretch(model: mujoco.MjModel, dimension: str, index: int) -> slice:
    """The rows along one of `STRETCHES` that belong to the object `index`; none where its address is −1."""
    starts = array(model, STRETCHES[dimension])
    if dimension == "nskinbonevert":  # by bone; those of a skin lie together
        starts = starts[model.skin_boneadr]
    start = int(starts[index])
    if start < 0:
        return slice(0, 0)
    later = starts[starts > start]
    return slice(start, int(later.min()) if later.size else int(getattr(model, dimension)))


def stretch_kind(dimension: str) -> str:
    """The kind of object whose stretches lie along a dimension."""
    prefix = STRETCHES[dimension].partition("_")[0]
    return _STRETCH_KINDS.get(prefix, prefix)


_STRETCH_KINDS: Mapping[str, str] = {"tex": "texture"}
