"""Flexes, and instances of plugins."""

import ctypes
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mujoco

from mjrun.model.description.plain_values import enum_name, floats, object_name

PLUGIN = mujoco.mjtObj.mjOBJ_PLUGIN
DIMENSIONS = {1: "lines", 2: "triangles", 3: "tetrahedra"}
EQUALITIES = {0: "none", 1: "edges", 3: "strain"}
# Fields that say which plugin instance computes an object, by the object's kind.
USERS = {
    "body": ("body_plugin", mujoco.mjtObj.mjOBJ_BODY),
    "geom": ("geom_plugin", mujoco.mjtObj.mjOBJ_GEOM),
    "actuator": ("actuator_plugin", mujoco.mjtObj.mjOBJ_ACTUATOR),
    "sensor": ("sensor_plugin", mujoco.mjtObj.mjOBJ_SENSOR),
}


@dataclass(frozen=True)
class Flex:
    """A deformable object.

    Attributes:
      id, name: of the flex.
      elements_are: `lines`, `triangles` or `tetrahedra`.
      vertices, edges, elements, nodes: how many.
      radius: around its elements [m].
      half_size: of the box around it in the model's own configuration [m].
      rigid: all of it belongs to one body.
      interpolated: it moves with a few nodes instead of its vertices.
      edge_equality: what keeps it together: `none`, `edges` or `strain`; other ways are numbers of MuJoCo's.
      edge_stiffness, edge_damping, damping: of its edges, and of its elements [s].
      self_collision: MuJoCo's word, `none`, `auto` …
      condim, friction: of its contacts.
      group: by which it is shown or hidden.
    """

    id: int
    name: str
    elements_are: str
    vertices: int
    edges: int
    elements: int
    nodes: int
    radius: float
    half_size: tuple[float, ...]
    rigid: bool
    interpolated: bool
    edge_equality: str
    edge_stiffness: float
    edge_damping: float
    damping: float
    self_collision: str
    condim: int
    friction: tuple[float, ...]
    group: int


def flexes(model: mujoco.MjModel) -> Iterator[Flex]:
    """Every flex, in order of id."""
    for i in range(model.nflex):
        equality = int(model.flex_edgeequality[i])
        yield Flex(
            id=i,
            name=object_name(model, mujoco.mjtObj.mjOBJ_FLEX, i) or "",
            elements_are=DIMENSIONS.get(int(model.flex_dim[i]), str(model.flex_dim[i])),
            vertices=int(model.flex_vertnum[i]),
            edges=int(model.flex_edgenum[i]),
            elements=int(model.flex_elemnum[i]),
            nodes=int(model.flex_nodenum[i]),
            radius=float(model.flex_radius[i]),
            half_size=floats(model.flex_size[i]),
            rigid=bool(model.flex_rigid[i]),
            interpolated=bool(model.flex_interp[i]),
            edge_equality=EQUALITIES.get(equality, str(equality)),
            edge_stiffness=float(model.flex_edgestiffness[i]),
            edge_damping=float(model.flex_edgedamping[i]),
            damping=float(model.flex_damping[i]),
            self_collision=enum_name(mujoco.mjtFlexSelf, model.flex_selfcollide[i]),
            condim=int(model.flex_condim[i]),
            friction=floats(model.flex_friction[i]),
            group=int(model.flex_group[i]),
        )


@dataclass(frozen=True)
class Plugin:
    """An instance of a plugin.

    Attributes:
      id, name: of the instance.
      plugin: the plugin's own name, `mujoco.pid`; None where this MuJoCo does not tell.
      settings: what the model sets of it.
      state: how many numbers of state it has.
      users: what it computes: `sensor/touch`, `geom/torus`.
    """

    id: int
    name: str
    plugin: str | None
    settings: dict[str, str]
    state: int
    users: tuple[str, ...]


def plugins(model: mujoco.MjModel) -> Iterator[Plugin]:
    """Every plugin instance, in order of id."""
    for i in range(model.nplugin):
        registered = _registered(int(model.plugin[i]))
        texts = bytes(model.plugin_attr[model.plugin_attradr[i] :]).split(b"\0")
        names = [] if registered is None else [registered.attributes[k] for k in range(registered.nattribute)]
        settings = {_text(name): _text(text) for name, text in zip(names, texts, strict=False) if text}
        own = None if registered is None else _text(registered.name)
        users = tuple(_users(model, i))
        yield Plugin(i, object_name(model, PLUGIN, i) or "", own, settings, int(model.plugin_statenum[i]), users)


def _users(model: mujoco.MjModel, instance: int) -> Iterator[str]:
    for kind, (field, code) in USERS.items():
        for i, plugin in enumerate(getattr(model, field)):
            if plugin == instance:
                yield f"{kind}/{object_name(model, code, i)}"


class _Registered(ctypes.Structure):
    """The beginning of MuJoCo's mjpPlugin, in mjplugin.h."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("nattribute", ctypes.c_int),
        ("attributes", ctypes.POINTER(ctypes.c_char_p)),
    )


@cache
def _registered(slot: int) -> "_Registered | None":
    """The plugin in a slot of MuJoCo's register, which its Python bindings do not show."""
    for library in sorted(Path(mujoco.__file__).parent.glob("libmujoco*")):
        with suppress(OSError, AttributeError):
            function = ctypes.CDLL(str(library)).mjp_getPluginAtSlot
            function.argtypes, function.restype = [ctypes.c_int], ctypes.POINTER(_Registered)
            plugin = function(slot)
            return plugin.contents if plugin else None
    return None


def _text(value: bytes) -> str:
    return value.decode("utf-8", "replace")
