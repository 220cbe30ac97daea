"""The units of MuJoCo's model and data fields, where its dimensions determine them.

MuJoCo has no units except those that follow from metres, kilograms, seconds and radians, as its manual lists them:
https://mujoco.readthedocs.io/en/latest/XMLunits.html
"""

from collections.abc import Callable, Mapping
from fnmatch import fnmatchcase

import mujoco

from mjrun.model.names import BALL, FREE, KINDS, PREFIXES, enum_name, names

POSITIONS = {int(mujoco.mjtJoint.mjJNT_HINGE): "rad", BALL: "rad", int(mujoco.mjtJoint.mjJNT_SLIDE): "m"}
# The units of the resistance of joints and tendons, by the unit of their position.
STIFFNESS = {"rad": "N·m/rad", "m": "N/m"}
DAMPING = {"rad": "N·m·s/rad", "m": "N·s/m"}
ARMATURE = {"rad": "kg·m²", "m": "kg"}
FORCES = {"rad": "N·m", "m": "N"}

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
# Sensors whose user selects the reported quantities by bit: they have a unit if all selected quantities share it.
CHOSEN = {
    "rangefinder": {"dist": "m", "origin": "m", "point": "m", "depth": "m"},
    "contact": {"force": "N", "torque": "N·m", "dist": "m", "pos": "m", "linvel": "m/s", "angvel": "rad/s"},
}
FIELDS = {"rangefinder": mujoco.mjtRayDataField, "contact": mujoco.mjtConDataField}
# Settings that no field of the model has under this name, by the paths of `mjrun.model.override`.
SETTINGS = {
    "opt.timestep": "s", "opt.gravity": "m/s²", "opt.wind": "m/s", "opt.magnetic": "T", "opt.density": "kg/m³",
    "opt.viscosity": "Pa·s", "opt.o_margin": "m", "opt.ccd_tolerance": "m", "opt.sleep_tolerance": "m/s",
    "stat.center": "m", "stat.extent": "m", "stat.meansize": "m", "stat.meanmass": "kg",
}  # fmt: skip
OTHERS = {("geom", "mass"): "kg", ("geom", "density"): "kg/m³"}
IN_DEGREES = ("range", "margin")  # of joints, in the compiler's unit of angles
OF_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
ORTHOGRAPHIC = int(mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC)


def joint_unit(model: mujoco.MjModel, joint: int) -> str:
    """Returns the unit of a joint's position and range: `rad` or `m`; empty for a free joint, which has both."""
    return POSITIONS.get(int(model.jnt_type[joint]), "")


def tendon_unit(model: mujoco.MjModel, tendon: int) -> str:
    """Returns the unit of a tendon's length: `m`; for a fixed tendon that of its joints, empty if they differ."""
    start, count = model.tendon_adr[tendon], model.tendon_num[tendon]
    path = range(start, start + count)
    units = {joint_unit(model, model.wrap_objid[i]) if int(model.wrap_type[i]) == OF_JOINT else "m" for i in path}
    return units.pop() if len(units) == 1 else ""


def actuator_unit(model: mujoco.MjModel, actuator: int) -> str:
    """Returns the unit of an actuator's length, before its gear; empty if it has none or several."""
    transmission, target = enum_name(mujoco.mjtTrn, model.actuator_trntype[actuator]), model.actuator_trnid[actuator, 0]
    if transmission in ("joint", "jointinparent"):
        return joint_unit(model, target)
    if transmission == "tendon":
        return tendon_unit(model, target)
    return {"slidercrank": "m", "body": "m", "so3": "rad"}.get(transmission) or _site_unit(model, actuator)


def _site_unit(model: mujoco.MjModel, actuator: int) -> str:
    """Returns the unit along or about the axes of a site, depending on the gear; empty for both."""
    gear = model.actuator_gear[model.actuator_outadr[actuator]]
    if not gear[3:].any():
        return "m"
    return "" if gear[:3].any() else "rad"


def force_unit(unit: str) -> str:
    """Returns the unit of the force that does work on something whose unit is `unit`."""
    return FORCES.get(unit, "")


def actuator_force_unit(model: mujoco.MjModel, actuator: int) -> str:
    """Returns the unit of an actuator's force, before its gear; empty if its length has none or several."""
    pulls_on_body = enum_name(mujoco.mjtTrn, model.actuator_trntype[actuator]) == "body"
    return "N" if pulls_on_body else force_unit(actuator_unit(model, actuator))


def rate_unit(unit: str) -> str:
    """Returns the unit of the velocity of something whose unit is `unit`."""
    return f"{unit}/s" if unit else ""


def sensor_unit(model: mujoco.MjModel, sensor: int) -> str:
    """Returns the unit of a sensor's values; empty for pure numbers and for mixed units."""
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


def _dof_unit(model: mujoco.MjModel, dof: int) -> str:
    """Returns `m` for a translation, `rad` for a rotation."""
    joint = int(model.dof_jntid[dof])
    if int(model.jnt_type[joint]) == FREE:
        return "m" if dof - int(model.jnt_dofadr[joint]) < 3 else "rad"
    return joint_unit(model, joint)


def _position_unit(model: mujoco.MjModel, index: int) -> str:
    """Returns the unit of a number of qpos; empty within a quaternion."""
    joint = int((model.jnt_qposadr <= index).nonzero()[0][-1])
    kind = int(model.jnt_type[joint])
    if kind == FREE:
        return "m" if index - int(model.jnt_qposadr[joint]) < 3 else ""
    return "" if kind == BALL else joint_unit(model, joint)


def _output_unit(model: mujoco.MjModel, output: int) -> str:
    """Returns the unit of the length of an actuator, before its gear, by the index of its output."""
    return actuator_unit(model, int((model.actuator_outadr <= output).nonzero()[0][-1]))


Unit = Callable[[mujoco.MjModel, int], str]  # by the row of a field


def _resistance(position: Unit, units: Mapping[str, str]) -> Unit:
    """Returns the unit of a resistance to motion, given that of the position."""
    return lambda model, row: units.get(position(model, row), "")


# The fields of MjData whose unit is the same in every model.
DATA_UNITS = dict.fromkeys(("xpos", "xipos", "xanchor", "geom_xpos", "site_xpos", "cam_xpos", "light_xpos"), "m")
DATA_UNITS |= dict.fromkeys(("subtree_com", "wrap_xpos", "mocap_pos", "flexvert_xpos", "flexedge_length"), "m")
DATA_UNITS |= {"subtree_linvel": "m/s", "subtree_angmom": "kg·m²/s", "flexedge_velocity": "m/s"}
# The fields of MjModel and of MjData; their names do not overlap.
UNITS: dict[str, str | Unit] = {
    "body_pos": "m", "body_ipos": "m", "body_mass": "kg", "body_subtreemass": "kg", "body_inertia": "kg·m²",
    "body_margin": "m", "jnt_pos": "m",
    "geom_size": "m", "geom_pos": "m", "geom_margin": "m", "geom_gap": "m", "geom_aabb": "m", "geom_rbound": "m",
    "site_size": "m", "site_pos": "m",
    "cam_pos": "m", "cam_pos0": "m", "cam_poscom0": "m", "cam_ipd": "m", "cam_resolution": "px", "cam_sensorsize": "m",
    "cam_fovy": lambda model, camera: "m" if model.cam_projection[camera] == ORTHOGRAPHIC else "deg",
    "light_pos": "m", "light_pos0": "m", "light_poscom0": "m", "light_cutoff": "deg", "light_bulbradius": "m",
    "light_range": "m", "light_intensity": "cd",
    "flex_radius": "m", "flex_margin": "m", "flex_gap": "m", "flex_vert": "m", "flex_node": "m",
    "mesh_vert": "m", "mesh_pos": "m", "skin_vert": "m", "hfield_size": "m",
    "pair_margin": "m", "pair_gap": "m", "tendon_width": "m",
    "key_time": "s", "key_mpos": "m",
    "qpos0": _position_unit, "qpos_spring": _position_unit,
    "dof_armature": _resistance(_dof_unit, ARMATURE), "dof_M0": _resistance(_dof_unit, ARMATURE),
    "dof_damping": _resistance(_dof_unit, DAMPING), "dof_frictionloss": _resistance(_dof_unit, FORCES),
    "jnt_range": joint_unit, "jnt_margin": joint_unit,
    "jnt_stiffness": _resistance(joint_unit, STIFFNESS), "jnt_actfrcrange": _resistance(joint_unit, FORCES),
    "tendon_range": tendon_unit, "tendon_margin": tendon_unit,
    "tendon_length0": tendon_unit, "tendon_lengthspring": tendon_unit,
    "tendon_stiffness": _resistance(tendon_unit, STIFFNESS), "tendon_damping": _resistance(tendon_unit, DAMPING),
    "tendon_armature": _resistance(tendon_unit, ARMATURE), "tendon_frictionloss": _resistance(tendon_unit, FORCES),
    "tendon_actfrcrange": _resistance(tendon_unit, FORCES),
    "actuator_cranklength": "m", "actuator_delay": "s", "actuator_forcerange": actuator_force_unit,
    "actuator_lengthrange": _output_unit,
    "sensor_delay": "s", "sensor_interval": "s", "sensor_cutoff": sensor_unit, "sensor_noise": sensor_unit,
    **DATA_UNITS,
    "ten_length": tendon_unit, "ten_velocity": lambda model, tendon: rate_unit(tendon_unit(model, tendon)),
    "actuator_length": actuator_unit, "actuator_force": actuator_force_unit,
    "actuator_velocity": lambda model, actuator: rate_unit(actuator_unit(model, actuator)),
}  # fmt: skip

# Every unit of a column that a model has, except the degrees of cameras and lights.
SI_UNITS = frozenset(unit for unit in UNITS.values() if isinstance(unit, str)) - {"deg"}
SI_UNITS |= {"rad", "m", "rad/s", "m/s", "rad/s²", "m/s²", "kg·m/s", *SENSORS.values()}
SI_UNITS |= {*STIFFNESS.values(), *DAMPING.values(), *ARMATURE.values(), *FORCES.values()}


def field_unit(model: mujoco.MjModel, field: str, row: int) -> str:
    """Returns the unit of row `row` of a field; empty for pure numbers and unknown units."""
    unit = UNITS.get(field, "")
    return unit if isinstance(unit, str) else unit(model, row)


def setting_unit(model: mujoco.MjModel, path: str) -> str:
    """Returns the unit of the values of a setting, `opt.timestep` or `geom/ball.size[0]`; empty if it has none or is
    in a unit that the source chooses.
    """
    kind, slash, rest = path.partition("[")[0].removeprefix("add:").partition("/")
    if not slash:
        return SETTINGS.get(kind, "")
    pattern, _, field = rest.rpartition(".")
    if (kind, field) in OTHERS:
        return OTHERS[kind, field]
    if kind not in KINDS or (kind == "joint" and field in IN_DEGREES):
        return ""
    rows = [row for row, name in enumerate(names(model, kind)) if fnmatchcase(name, pattern)]
    if not rows:
        return ""
    row = rows[0]
    if kind == "joint" and field in ("damping", "armature", "frictionloss"):
        return field_unit(model, f"dof_{field}", int(model.jnt_dofadr[row]))
    return field_unit(model, f"{PREFIXES[kind]}_{field}", row)
