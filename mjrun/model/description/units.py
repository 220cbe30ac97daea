"""The units of what a model's joints, tendons, actuators and sensors hold, where MuJoCo's own dimensions tell.

MuJoCo has no units but those that follow from metres, kilograms, seconds and radians, as its manual lists them:
https://mujoco.readthedocs.io/en/latest/XMLunits.html
"""

import mujoco

from mjrun.model.description.plain_values import enum_name
from mjrun.model.description.resistance_units import FORCE as FORCES

FREE, BALL = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL
SLIDE, HINGE = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
POSITIONS = {int(HINGE): "rad", int(BALL): "rad", int(SLIDE): "m"}

SENSORS = {
    "touch": "N", "accelerometer": "m/s²", "velocimeter": "m/s", "gyro": "rad/s", "force": "N", "torque": "N·m",
    "magnetometer": "T", "camprojection": "px", "ballangvel": "rad/s",
    "framepos": "m", "framelinvel": "m/s", "frameangvel": "rad/s", "framelinacc": "m/s²", "frameangacc": "rad/s²",
    "subtreecom": "m", "subtreelinvel": "m/s", "subtreeangmom": "kg·m²/s", "geomdist": "m", "geomfromto": "m",
    "e_potential": "J", "e_kinetic": "J", "clock": "s",
}  # fmt: skip
# Sensors that report a position, velocity or force of a joint, tendon or actuator.
POSITION = ("jointpos", "tendonpos", "actuatorpos", "jointlimitpos", "tendonlimitpos")
VELOCITY = ("jointvel", "tendonvel", "actuatorvel", "jointlimitvel", "tendonlimitvel")
FORCE = ("actuatorfrc", "jointactfrc", "tendonactfrc", "jointlimitfrc", "tendonlimitfrc")
# Sensors whose user chooses what they report, by bit: the unit holds where all that was chosen share it.
CHOSEN = {
    "rangefinder": {"dist": "m", "origin": "m", "point": "m", "depth": "m"},
    "contact": {"force": "N", "torque": "N·m", "dist": "m", "pos": "m", "linvel": "m/s", "angvel": "rad/s"},
}
FIELDS = {"rangefinder": mujoco.mjtRayDataField, "contact": mujoco.mjtConDataField}
OF_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)


def joint_unit(model: mujoco.MjModel, joint: int) -> str:
    """The unit of a joint's position and range: `rad` or `m`; empty for a free joint, which has both."""
    return POSITIONS.get(int(model.jnt_type[joint]), "")


def tendon_unit(model: mujoco.MjModel, tendon: int) -> str:
    """The unit of a tendon's length: `m`; for a fixed one that of its joints, empty where they differ."""
    start, count = model.tendon_adr[tendon], model.tendon_num[tendon]
    path = range(start, start + count)
    units = {joint_unit(model, model.wrap_objid[i]) if int(model.wrap_type[i]) == OF_JOINT else "m" for i in path}
    return units.pop() if len(units) == 1 else ""


def actuator_unit(model: mujoco.MjModel, actuator: int) -> str:
    """The unit of an actuator's length, before its gear; empty where it has none or several."""
    transmission, target = enum_name(mujoco.mjtTrn, model.actuator_trntype[actuator]), model.actuator_trnid[actuator, 0]
    if transmission in ("joint", "jointinparent"):
        return joint_unit(model, target)
    if transmission == "tendon":
        return tendon_unit(model, target)
    return {"slidercrank": "m", "body": "m", "so3": "rad"}.get(transmission) or _site_unit(model, actuator)


def _site_unit(model: mujoco.MjModel, actuator: int) -> str:
    """Along or about axes of a site, as the gear says; a force on a body it has none of its own."""
    gear = model.actuator_gear[model.actuator_outadr[actuator]]
    if not gear[3:].any():
        return "m"
    return "" if gear[:3].any() else "rad"


def force_unit(unit: str) -> str:
    """The unit of the force that does work on something whose unit is `unit`."""
    return FORCES.get(unit, "")


def actuator_force_unit(model: mujoco.MjModel, actuator: int) -> str:
    """The unit of an actuator's force, before its gear; empty where its length has none or several."""
    pulls_on_body = enum_name(mujoco.mjtTrn, model.actuator_trntype[actuator]) == "body"
    return "N" if pulls_on_body else force_unit(actuator_unit(model, actuator))


def rate_unit(unit: str) -> str:
    """The unit of the velocity of something whose unit is `unit`."""
    return f"{unit}/s" if unit else ""


def sensor_unit(model: mujoco.MjModel, sensor: int) -> str:
    """The unit of a sensor's values; empty for pure numbers, and where a sensor reports several things."""
    kind = enum_name(mujoco.mjtSensor, model.sensor_type[sensor])
    if kind in CHOSEN:
        return _chosen(kind, int(model.sensor_intprm[sensor, 0]))
    if kind in (*POSITION, *VELOCITY, *FORCE):
        unit = _followed(model, int(model.sensor_objtype[sensor]), int(model.sensor_objid[sensor]))
        return force_unit(unit) if kind in FORCE else rate_unit(unit) if kind in VELOCITY else unit
    return SENSORS.get(kind, "")


def _followed(model: mujoco.MjModel, kind: int, index: int) -> str:
    units = {
        int(mujoco.mjtObj.mjOBJ_JOINT): joint_unit,
        int(mujoco.mjtObj.mjOBJ_TENDON): tendon_unit,
        int(mujoco.mjtObj.mjOBJ_ACTUATOR): actuator_unit,
    }
    return units[kind](model, index) if kind in units else ""


def _chosen(kind: str, bits: int) -> str:
    fields = [enum_name(FIELDS[kind], bit) for bit in range(bits.bit_length()) if bits >> bit & 1]
    units = {CHOSEN[kind].get(field, "") for field in fields}
    return units.pop() if len(units) == 1 else ""
