"""The units of the fields of a compiled model, where MuJoCo's own dimensions tell."""

from collections.abc import Callable

import mujoco

from mjrun.model.description.resistance_units import ARMATURE, DAMPING, STIFFNESS
from mjrun.model.description.units import (
    actuator_force_unit,
    actuator_unit,
    force_unit,
    joint_unit,
    sensor_unit,
    tendon_unit,
)

UNITS = {
    "body_pos": "m", "body_ipos": "m", "body_mass": "kg", "body_subtreemass": "kg", "body_inertia": "kg·m²",
    "body_margin": "m", "jnt_pos": "m",
    "geom_size": "m", "geom_pos": "m", "geom_margin": "m", "geom_gap": "m", "geom_aabb": "m", "geom_rbound": "m",
    "site_size": "m", "site_pos": "m",
    "cam_pos": "m", "cam_pos0": "m", "cam_poscom0": "m", "cam_ipd": "m", "cam_resolution": "px", "cam_sensorsize": "m",
    "light_pos": "m", "light_pos0": "m", "light_poscom0": "m", "light_cutoff": "deg", "light_bulbradius": "m",
    "light_range": "m", "light_intensity": "cd",
    "flex_radius": "m", "flex_margin": "m", "flex_gap": "m", "flex_vert": "m", "flex_node": "m",
    "mesh_vert": "m", "mesh_pos": "m", "skin_vert": "m", "hfield_size": "m",
    "pair_margin": "m", "pair_gap": "m", "tendon_width": "m",
    "actuator_cranklength": "m", "actuator_delay": "s", "sensor_delay": "s", "sensor_interval": "s",
    "key_time": "s", "key_mpos": "m",
}  # fmt: skip
# Fields by degree of freedom, whose units depend on whether it is a translation or a rotation.
_OF_DOF = {
    "dof_armature": ARMATURE.get,
    "dof_M0": ARMATURE.get,
    "dof_damping": DAMPING.get,
    "dof_frictionloss": force_unit,
}
# Fields by joint and tendon, whose units depend on that of its position.
_OF_POSITION: dict[str, Callable[[str], str | None]] = {
    "jnt_range": str, "jnt_margin": str, "jnt_stiffness": STIFFNESS.get, "jnt_actfrcrange": force_unit,
    "tendon_range": str, "tendon_margin": str, "tendon_length0": str, "tendon_lengthspring": str,
    "tendon_stiffness": STIFFNESS.get, "tendon_damping": DAMPING.get, "tendon_armature": ARMATURE.get,
    "tendon_frictionloss": force_unit, "tendon_actfrcrange": force_unit,
}  # fmt: skip
_OF_ACTUATOR = {"actuator_forcerange": actuator_force_unit}
_OF_SENSOR = ("sensor_cutoff", "sensor_noise")
_FREE, _BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)


def field_unit(model: mujoco.MjModel, field: str, row: int) -> str:
    """The unit of row `row` of a field; empty for pure numbers, and where MuJoCo does not tell."""
    if field in _OF_POSITION:
        unit = joint_unit(model, row) if field.startswith("jnt_") else tendon_unit(model, row)
        return _OF_POSITION[field](unit) or ""
    if field in _OF_DOF:
        return _OF_DOF[field](_dof_unit(model, row)) or ""
    if field in ("qpos0", "qpos_spring"):
        return _position_unit(model, row)
    if field in _OF_ACTUATOR:
        return _OF_ACTUATOR[field](model, row)
    if field == "actuator_lengthrange":
        return _output_unit(model, row)
    if field in _OF_SENSOR:
        return sensor_unit(model, row)
    if field == "cam_fovy":
        return "m" if model.cam_projection[row] == int(mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC) else "deg"
    return UNITS.get(field, "")


def _dof_unit(model: mujoco.MjModel, dof: int) -> str:
    """`m` of a translation, `rad` of a rotation."""
    joint = int(model.dof_jntid[dof])
    if int(model.jnt_type[joint]) == _FREE:
        return "m" if dof - int(model.jnt_dofadr[joint]) < 3 else "rad"
    return joint_unit(model, joint)


def _position_unit(model: mujoco.MjModel, index: int) -> str:
    """The unit of a number of qpos; none in a quaternion."""
    joint = int((model.jnt_qposadr <= index).nonzero()[0][-1])
    kind = int(model.jnt_type[joint])
    if kind == _FREE:
        return "m" if index - int(model.jnt_qposadr[joint]) < 3 else ""
    return "" if kind == _BALL else joint_unit(model, joint)


def _output_unit(model: mujoco.MjModel, output: int) -> str:
    """The unit of the length of an actuator, before its gear, by the index of its output."""
    return actuator_unit(model, int((model.actuator_outadr <= output).nonzero()[0][-1]))
