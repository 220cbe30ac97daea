"""The units of settings, by the paths of `mjrun.model.override`; none for those that the source chooses."""

from fnmatch import fnmatchcase

import mujoco

from mjrun.model.names import KINDS, PREFIXES, names
from mjrun.model.units import field_unit

OPTIONS = {"opt.timestep": "s", "opt.gravity": "m/s²", "opt.wind": "m/s", "opt.density": "kg/m³"}
OPTIONS |= {"opt.viscosity": "Pa·s", "opt.magnetic": "T", "opt.sleep_tolerance": "m/s"}
# Fields that the compiled model does not have under this name.
OTHERS = {("geom", "mass"): "kg", ("geom", "density"): "kg/m³"}
OF_DOFS = ("damping", "armature", "frictionloss")
IN_DEGREES = ("range", "margin")  # of joints, in the compiler's unit of angles


def setting_unit(model: mujoco.MjModel, path: str) -> str:
    """Returns the unit of the values of a setting, `opt.timestep` or `geom/ball.size[0]`; empty if it has none or is
    in a unit that the source chooses.
    """
    kind, slash, rest = path.partition("[")[0].removeprefix("add:").partition("/")
    if not slash:
        return OPTIONS.get(kind, "")
    pattern, _, field = rest.rpartition(".")
    if (kind, field) in OTHERS:
        return OTHERS[kind, field]
    if kind not in KINDS or (kind == "joint" and field in IN_DEGREES):
        return ""
    rows = [row for row, name in enumerate(names(model, kind)) if fnmatchcase(name, pattern)]
    if not rows:
        return ""
    row = rows[0]
    if kind == "joint" and field in OF_DOFS:
        return field_unit(model, f"dof_{field}", int(model.jnt_dofadr[row]))
    return field_unit(model, f"{PREFIXES[kind]}_{field}", row)
