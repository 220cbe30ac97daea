"""The panels of a figure and their curves, before any numbers are read."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby, takewhile

from mjrun.dataclass import dataclass
from mjrun.errors import concerning
from mjrun.model.names import FREE, QPOS_COMPONENTS, QVEL_COMPONENTS
from mjrun.model.table_column import split_unit, with_unit
from mjrun.model.units import DATA_UNITS
from mjrun.plotting.curve_syntax import CurveSpec, PanelSpec, parse_curves, parse_panel
from mjrun.probe.fields import DOF_UNITS

CURVES = 12  # maximum number of curves in a panel that the user did not choose
_TIMES = ("time", "t")  # names of the x axis
_GROUPS = DATA_UNITS | {
    "energy": "J",
    "xpos": "m",
    "speed": "m/s",
    "com": "m",
    "contact_force": "N",
    "penetration": "m",
}
_POSITIONS = {name: "m" for name in QPOS_COMPONENTS[FREE] if not name.startswith("q")}


@dataclass(frozen=True)
class PanelCurve:
    """A curve of a panel: its name in the legend, its unit, and its expression over the columns."""

    name: str
    unit: str
    text: CurveSpec


@dataclass(frozen=True)
class Panel:
    """A panel: the quantity on its y axis, its unit, and its curves."""

    title: str
    unit: str
    curves: tuple[PanelCurve, ...]

    @property
    def label(self) -> str:
        """The label of the y axis."""
        return with_unit(self.title, self.unit)


def time_column(names: Iterable[str]) -> str | None:
    """Returns the column that holds the time, if any."""
    known = list(names)
    if "time" in known:
        return "time"
    return next((name for name in known if split_unit(name)[0].strip().casefold() in _TIMES), None)


def chosen_panels(texts: Sequence[str], units: Mapping[str, str], x: str | None = None) -> list[Panel]:
    """Parses the panels in the option y, over columns with `units`; wildcards omit the column x."""
    panels: list[Panel] = []
    for index, text in enumerate(texts):
        with concerning("y", index):
            panels.append(_chosen(parse_panel(text, list(units), x), units))
    return panels


def panels_by_unit(names: Sequence[str], units: Mapping[str, str], *, apart: bool = False) -> list[Panel]:
    """Groups the columns `names` into a panel for each group and unit.

    Args:
      apart: whether every column has a separate panel.
    """
    panels: list[Panel] = []
    for group, members in _by_group(names):
        by_unit: dict[str, list[str]] = {}
        for name in members:
            by_unit.setdefault(units[name], []).append(name)
        for unit, same in by_unit.items():
            parts = [[name] for name in same] if apart else _parts(same)
            panels += _numbered([_panel(group, unit, [_curve(name, units) for name in part]) for part in parts])
    return panels


def _numbered(panels: Sequence[Panel]) -> Iterator[Panel]:
    """Yields the panels, numbered if several have one title: `qpos 1/2`."""
    counts, seen = Counter(panel.title for panel in panels), Counter[str]()
    for panel in panels:
        seen[panel.title] += 1
        several = counts[panel.title] > 1
        number = f"{panel.title or 'columns'} {seen[panel.title]}/{counts[panel.title]}"
        yield replace(panel, title=number) if several else panel


def _by_group(names: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(name.partition("/")[0] if "/" in name else "", []).append(name)
    yield from groups.items()


def _parts(names: list[str]) -> list[list[str]]:
    """Splits names into few lists of similar length, at most `CURVES` each; components of an object stay together."""
    objects = [list(same) for _, same in groupby(names, key=lambda name: name.rpartition("/")[0])]
    objects = [[name] for name in names] if len(objects) == 1 else objects
    count = -(-len(names) // CURVES)
    parts: list[list[str]] = [[]]
    for same in objects:
        if parts[-1] and len(parts[-1]) + len(same) > min(CURVES, -(-len(names) // count) + len(same) // 2):
            parts.append([])
        parts[-1] += same
    return [part[start : start + CURVES] for part in parts for start in range(0, len(part), CURVES)]


def _curve(name: str, units: Mapping[str, str]) -> PanelCurve:
    (text,) = parse_curves(name, [name], "")
    return PanelCurve(name, units[name], text)


def _chosen(panel: PanelSpec, units: Mapping[str, str]) -> Panel:
    curves = [PanelCurve(text.name, _unit(text, panel, units), text) for text in panel.curves]
    kinds = {curve.unit for curve in curves}
    return _panel(panel.title or "", kinds.pop() if len(kinds) == 1 else "", curves, titled=panel.title is not None)


def _unit(text: CurveSpec, panel: PanelSpec, units: Mapping[str, str]) -> str:
    if text.unit is not None:
        return text.unit
    if panel.unit is not None:
        return panel.unit
    return units[text.column] if text.column is not None else ""


def _panel(title: str, unit: str, curves: Sequence[PanelCurve], *, titled: bool = False) -> Panel:
    """Creates a panel whose title holds the common prefix of the names, which the legend then omits."""
    names = [split_unit(curve.name)[0] if curve.text.column else curve.name for curve in curves]
    if len(names) == 1 and not titled:
        return Panel(names[0], unit, tuple(curves))
    prefix = _common(names) if all(curve.text.column == curve.name for curve in curves) else ""
    short = [name.removeprefix(prefix) for name in names]
    # If units differ, each curve shows its own.
    units = [f" [{curve.unit}]" if curve.unit and curve.unit != unit else "" for curve in curves]
    shown = [replace(c, name=name + u) for c, name, u in zip(curves, short, units, strict=True)]
    return Panel(title if titled else prefix.rstrip("/") or title, unit, tuple(shown))


def _common(names: Sequence[str]) -> str:
    """Returns the common prefix of all names, up to a slash."""
    parents = zip(*(name.split("/")[:-1] for name in names), strict=False)
    return "".join(f"{parts[0]}/" for parts in takewhile(lambda parts: len(set(parts)) == 1, parents))


def with_units(names: Sequence[str], units: Mapping[str, str]) -> dict[str, str]:
    """Returns the unit of every column: the table's, the one in brackets after the name, or mjrun's for its columns.

    An mjrun column has a unit by its name if that is the same for every model: `energy/total` is in joules,
    `qpos/knee` may be in radians or metres. Time is in seconds in a table that has grouped columns.
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
