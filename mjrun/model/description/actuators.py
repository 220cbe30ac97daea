"""Actuators: what they act on, and their force laws."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco

from mjrun.model.description.plain_values import (
    BODY,
    JOINT,
    SITE,
    TENDON,
    Pair,
    enum_name,
    limited_range,
    object_name,
    without_trailing_zeros,
)
from mjrun.model.description.units import actuator_force_unit, actuator_unit

ACTUATOR = mujoco.mjtObj.mjOBJ_ACTUATOR
TARGETS = {
    "joint": JOINT,
    "jointinparent": JOINT,
    "slidercrank": SITE,
    "tendon": TENDON,
    "site": SITE,
    "body": BODY,
}
# MJCF elements that follow from the type of gain alone.
BY_GAIN = {"so3": "orientation", "pid": "pid", "dcmotor": "dcmotor", "muscle": "muscle"}
POSITION_FILTERS = ("none", "filter", "filterexact")


@dataclass(frozen=True)
class Actuator:
    """An actuator: its force is gain · (control or activation) + bias.

    Attributes:
      id, name: of the actuator.
      kind: the MJCF element that writes such an actuator: `motor`, `position` …; `general` where it is none of them.
      transmission: `joint`, `tendon`, `site` …
      target_kind, target: what it acts on.
      reference: the site of a slider, or the site that a site is moved relative to; None without one.
      gear: of each of its forces, without the zeros at the end.
      unit, force_unit: of its length and of its force, before the gear; empty where MuJoCo does not tell.
      dynamics, gain, bias: their types; their parameters are without the zeros at the end.
      ctrl, ctrl_size: where its controls are in `ctrl`.
      ctrl_range: of each control; None without limits.
      act, act_size: where its activations are in `act`; None without any.
      act_range: None without limits.
      force_range: [force_unit]; None without limits.
      delay: of its controls [s].
      damping, armature: that it adds to its target.
      group: by which it is shown, or disabled.
      plugin: the plugin instance that computes its force; None without one.
    """

    id: int
    name: str
    kind: str
    transmission: str
    target_kind: str
    target: str | None
    reference: str | None
    gear: tuple[tuple[float, ...], ...]
    unit: str
    force_unit: str
    dynamics: str
    dynamics_parameters: tuple[float, ...]
    gain: str
    gain_parameters: tuple[float, ...]
    bias: str
    bias_parameters: tuple[float, ...]
    ctrl: int
    ctrl_size: int
    ctrl_range: tuple[Pair | None, ...]
    act: int | None
    act_size: int
    act_range: Pair | None
    force_range: Pair | None
    delay: float
    damping: float
    armature: float
    group: int
    plugin: str | None


def actuators(model: mujoco.MjModel) -> Iterator[Actuator]:
    """Every actuator, in order of id."""
    for i in range(model.nactuator):
        transmission, kind = enum_name(mujoco.mjtTrn, model.actuator_trntype[i]), _target_kind(model, i)
        unit, first, controls = actuator_unit(model, i), int(model.actuator_ctrladr[i]), int(model.actuator_ctrlnum[i])
        forces = range(model.actuator_outadr[i], model.actuator_outadr[i] + model.actuator_outnum[i])
        target, reference = model.actuator_trnid[i]
        yield Actuator(
            id=i,
            name=object_name(model, ACTUATOR, i) or "",
            kind=_kind(model, i),
            transmission=transmission,
            target_kind=enum_name(mujoco.mjtObj, kind),
            target=object_name(model, kind, target),
            reference=object_name(model, SITE, reference),
            gear=tuple(without_trailing_zeros(model.actuator_gear[k]) for k in forces),
            unit=unit,
            force_unit=actuator_force_unit(model, i),
            dynamics=enum_name(mujoco.mjtDyn, model.actuator_dyntype[i]),
            dynamics_parameters=without_trailing_zeros(model.actuator_dynprm[i]),
            gain=enum_name(mujoco.mjtGain, model.actuator_gaintype[i]),
            gain_parameters=without_trailing_zeros(model.actuator_gainprm[i]),
            bias=enum_name(mujoco.mjtBias, model.actuator_biastype[i]),
            bias_parameters=without_trailing_zeros(model.actuator_biasprm[i]),
            ctrl=first,
            ctrl_size=controls,
            ctrl_range=tuple(
                limited_range(model.actuator_ctrllimited[k], model.actuator_ctrlrange[k])
                for k in range(first, first + controls)
            ),
            act=int(model.actuator_actadr[i]) if model.actuator_actnum[i] else None,
            act_size=int(model.actuator_actnum[i]),
            act_range=limited_range(model.actuator_actlimited[i], model.actuator_actrange[i]),
            force_range=limited_range(model.actuator_forcelimited[i], model.actuator_forcerange[i]),
            delay=float(model.actuator_delay[i]),
            damping=float(model.actuator_damping[i]),
            armature=float(model.actuator_armature[i]),
            group=int(model.actuator_group[i]),
            plugin=object_name(model, mujoco.mjtObj.mjOBJ_PLUGIN, model.actuator_plugin[i]),
        )


def _target_kind(model: mujoco.MjModel, i: int) -> mujoco.mjtObj:
    transmission = enum_name(mujoco.mjtTrn, model.actuator_trntype[i])
    if transmission == "so3":  # a ball joint, or a site relative to another
        return JOINT if model.actuator_trnid[i, 1] < 0 else SITE
    return TARGETS.get(transmission, mujoco.mjtObj.mjOBJ_UNKNOWN)


def _kind(model: mujoco.MjModel, i: int) -> str:
    """The element that sets what this actuator has, as MuJoCo's manual lists for each of them:
    https://mujoco.readthedocs.io/en/latest/XMLreference.html#actuator
    """
    dynamics = enum_name(mujoco.mjtDyn, model.actuator_dyntype[i])
    gain, bias = (
        enum_name(mujoco.mjtGain, model.actuator_gaintype[i]),
        enum_name(mujoco.mjtBias, model.actuator_biastype[i]),
    )
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
    """What has a gain k and the bias 0, −k, −kv or 0, 0, −k; a cylinder has its area and any bias."""
    constant, position, velocity = (*biases, 0.0, 0.0, 0.0)[:3]
    gain = gains[0] if gains else 0.0
    if constant == 0 and gain and position == -gain:
        if dynamics == "integrator":
            return "intvelocity"
        return "position" if dynamics in POSITION_FILTERS else "general"
    if constant == 0 == position and gain and velocity == -gain and dynamics == "none":
        return "velocity"
    return "cylinder" if dynamics == "filter" else "general"
