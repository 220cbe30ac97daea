"""Descriptions of plugin instances."""

import ctypes
from contextlib import suppress
from functools import cache
from pathlib import Path

import mujoco

from mjrun.dataclass import dataclass
from mjrun.model.description.declaration import ModelObject, computed, of_field
from mjrun.model.names import PREFIXES, names

USERS = ("body", "geom", "actuator", "sensor")  # kinds of objects that a plugin can implement


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
class Plugin(ModelObject):
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
