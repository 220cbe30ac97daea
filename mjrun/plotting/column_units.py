"""Units of columns in tables that hold none, such as CSV: of those whose names alone tell them."""

from collections.abc import Mapping, Sequence

from mjrun.model.names import FREE, QPOS_COMPONENTS, QVEL_COMPONENTS
from mjrun.model.units import DATA_UNITS
from mjrun.plotting.curve_text import split_unit
from mjrun.probe.fields import DOF_UNITS

_GROUPS = DATA_UNITS | {
    "energy": "J",
    "xpos": "m",
    "speed": "m/s",
    "com": "m",
    "contact_force": "N",
    "penetration": "m",
}
_POSITIONS = {name: "m" for name in QPOS_COMPONENTS[FREE] if not name.startswith("q")}


def with_units(names: Sequence[str], units: Mapping[str, str]) -> dict[str, str]:
    """The unit of every column: that of the table, the one in brackets after the name, or that of mjrun's columns.

    A column of mjrun's has its unit by its name where that is so for every model: `energy/total` is in joules,
    `qpos/knee` may be in radians or metres. The time is in seconds in a table that has columns of groups.
    """
    grouped = any("/" in name for name in names)
    return {name: units.get(name) or split_unit(name)[1] or _usual(name, grouped) for name in names}


def _usual(name: str, grouped: bool) -> str:
    if name == "time":
        return "s" if grouped else ""
    group, _, rest = name.partition("/")
    component = rest.rpartition("/")[2] if "/" in rest else ""
    if group == "qpos":
        return _POSITIONS.get(component, "")
    if group in DOF_UNITS and component in QVEL_COMPONENTS[FREE]:
        return DOF_UNITS[group][component.startswith("w")]
    return _GROUPS.get(group, "")
