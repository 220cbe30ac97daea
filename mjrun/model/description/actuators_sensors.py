"""Descriptions of actuators, with their targets and force laws, of sensors, and of plugin instances."""

import ctypes
from contextlib import suppress
from functools import cache
from operator import itemgetter
from pathlib import Path
from typing import Any

import mujoco

from mjrun.dataclass import dataclass
from mjrun.model.description.declaration import (
    ModelObject,
    Pair,
    computed,
    limited_ranges,
    of_field,
    referred_kind,
    within_limits,
    without_trailing_zeros,
)
from mjrun.model.names import PREFIXES, enum_name, names
from mjrun.model.units import actuator_force_unit, actuator_unit, sensor_unit

# MJCF elements that the type of the gain alone determines.
BY_GAIN = {"so3": "orientation", "pid": "pid", "dcmotor": "dcmotor", "muscle": "muscle"}
POSITION_FILTERS = ("none", "filter", "filterexact")
USERS = ("body", "geom", "actuator", "sensor")  # kinds of objects that a plugin can implement


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
        return "position" if dynamics in POSITION_FILTERS else "general"
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
