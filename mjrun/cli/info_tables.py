"""What `mjrun info` shows of each section that is a list: columns of text."""

import os.path
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjrun.cli.info_actuators_sensors_cameras import DEVICES
from mjrun.cli.info_formatting import (
    Column,
    common,
    names,
    number,
    numbers,
    ranges,
    reference,
    resisting,
    size,
    slots,
    texts,
    vector,
    vectors,
)
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.model.description.model_description import (
        Asset,
        Body,
        Equality,
        Geom,
        Keyframe,
        NonDefaultSetting,
        Tendon,
    )

# The unit of what a joint or a tendon resists with, by the unit of its position.
STIFFNESS = {"rad": "N·m/rad", "m": "N/m"}
DAMPING = {"rad": "N·m·s/rad", "m": "N·s/m"}
ARMATURE = {"rad": "kg·m²", "m": "kg"}
FORCE = {"rad": "N·m", "m": "N"}


def bodies(rows: Sequence["Body"]) -> list[Column]:
    lines, below = _tree(rows)
    return [
        Column("body", lines, below=below),
        Column("joints", [_grouped(row.joints, row.joint_types) for row in rows]),
        Column("", ["mocap" if row.mocap else "" for row in rows]),
        numbers("mass", rows, "mass", "kg"),
        numbers("subtree", rows, "subtree_mass", "kg", extra=True),
        Column("geoms", [_tally(row.geom_types) for row in rows], extra=True),
        numbers("gravcomp", rows, "gravity_compensation", extra=True),
    ]


def _tree(rows: Sequence["Body"]) -> tuple[list[str], list[str]]:
    """The names, each under its parent's, and what goes on below them."""
    last = {row.parent: row.id for row in rows}
    lines, stems = [], {-1: ""}
    for row in rows:
        stem, ends, root = stems[row.parent], last[row.parent] == row.id, row.parent < 0
        lines.append(clean(row.name) if root else f"{stem}{'└─' if ends else '├─'} {clean(row.name)}")
        stems[row.id] = "" if root else stem + ("   " if ends else "│  ")
    return lines, [stems[row.id] + ("│" if row.id in last else "") for row in rows]


def _grouped(objects: Sequence[str], types: Sequence[str]) -> str:
    """Names with their types: `hip_x, hip_y (hinge)`."""
    groups: list[tuple[str, list[str]]] = []
    for name, kind in zip(objects, types, strict=True):
        if not groups or groups[-1][0] != kind:
            groups.append((kind, []))
        groups[-1][1].append(clean(name))
    return ", ".join(f"{', '.join(group)} ({kind})" for kind, group in groups)


def _tally(types: Sequence[str]) -> str:
    counts = {kind: types.count(kind) for kind in dict.fromkeys(types)}
    return ", ".join(kind if count == 1 else f"{count} {kind}" for kind, count in counts.items())


def joints(rows: Sequence[Any]) -> list[Column]:
    return [
        names(rows),
        texts("type", rows, "type"),
        ranges("range", rows, "range"),
        Column("qpos", [slots(row.qpos, row.qpos_size) for row in rows], right=True),
        Column("qvel", [slots(row.dof, row.dof_size) for row in rows], right=True),
        resisting("stiffness", rows, STIFFNESS, extra=True),
        resisting("damping", rows, DAMPING, extra=True),
        resisting("armature", rows, ARMATURE, extra=True),
        resisting("frictionloss", rows, FORCE, extra=True),
        texts("body", rows, "body", extra=True),
        vectors("axis", rows, "axis", extra=True),
    ]


def geoms(rows: Sequence["Geom"]) -> list[Column]:
    return [
        names(rows),
        texts("type", rows, "type"),
        texts("body", rows, "body"),
        vectors("size", rows, "size", "m"),
        texts("asset", rows, "asset"),
        numbers("condim", rows, "condim", usual=3),
        vectors("friction", rows, "friction", extra=True),
        Column("contact bits", _bits(rows), extra=True),
        numbers("margin", rows, "margin", "m", extra=True),
        numbers("gap", rows, "gap", "m", extra=True),
        numbers("group", rows, "group", extra=True),
        texts("material", rows, "material", extra=True),
    ]


def _bits(rows: Sequence["Geom"]) -> list[str]:
    """contype and conaffinity, if any geom has others than 1 and 1."""
    bits = [f"{row.contype} {row.conaffinity}" for row in rows]
    return bits if set(bits) != {"1 1"} else []


def sites(rows: Sequence[Any]) -> list[Column]:
    return [
        names(rows),
        texts("type", rows, "type"),
        texts("body", rows, "body"),
        vectors("size", rows, "size", "m"),
        vectors("position", rows, "position", "m", extra=True),
        numbers("group", rows, "group", extra=True),
    ]


def keyframes(rows: Sequence["Keyframe"]) -> list[Column]:
    return [
        names(rows),
        numbers("time", rows, "time", "s", usual=-1),
        Column("", ["" if row.finite else "not finite" for row in rows]),
        Column("outside its range", [", ".join(map(clean, row.outside)) for row in rows]),
    ]


def tendons(rows: Sequence["Tendon"]) -> list[Column]:
    return [
        names(rows),
        texts("type", rows, "type"),
        Column("path", [", ".join(map(_point, row.path)) for row in rows]),
        numbers("length", rows, "length0", common(row.unit for row in rows if row.unit).replace(", ", "\n")),
        ranges("range", rows, "range"),
        resisting("stiffness", rows, STIFFNESS, extra=True),
        resisting("damping", rows, DAMPING, extra=True),
        resisting("armature", rows, ARMATURE, extra=True),
        resisting("frictionloss", rows, FORCE, extra=True),
    ]


def _point(point: Any) -> str:
    if point.kind == "pulley":
        return f"pulley /{number(point.coefficient)}"
    name = clean(point.name or "")
    return name if point.coefficient is None else f"{number(point.coefficient)} {name}"


def equalities(rows: Sequence["Equality"]) -> list[Column]:
    return [
        names(rows),
        texts("type", rows, "type"),
        Column("of", [reference(row.object_kind, row.object1) for row in rows]),
        Column("and", [reference(row.object_kind, row.object2) for row in rows]),
        Column("", ["" if row.active else "off" for row in rows]),
        vectors("data", rows, "data", extra=True),
        vectors("solref", rows, "solref", extra=True),
    ]


def pairs(rows: Sequence[Any]) -> list[Column]:
    return [
        names(rows),
        texts("geom 1", rows, "geom1"),
        texts("geom 2", rows, "geom2"),
        numbers("condim", rows, "condim", usual=-1),
        vectors("friction", rows, "friction"),
        numbers("margin", rows, "margin", "m"),
        numbers("gap", rows, "gap", "m"),
        vectors("solref", rows, "solref", extra=True),
        vectors("solimp", rows, "solimp", extra=True),
    ]


def excludes(rows: Sequence[Any]) -> list[Column]:
    return [names(rows), texts("body 1", rows, "body1"), texts("body 2", rows, "body2")]


def flexes(rows: Sequence[Any]) -> list[Column]:
    return [
        names(rows),
        texts("elements are", rows, "elements_are"),
        *(numbers(field, rows, field) for field in ("elements", "vertices", "edges", "nodes")),
        numbers("radius", rows, "radius", "m"),
        Column("kept by", ["" if row.edge_equality == "none" else row.edge_equality for row in rows]),
        texts("self-collision", rows, "self_collision", extra=True),
        numbers("edge stiffness", rows, "edge_stiffness", extra=True),
        numbers("edge damping", rows, "edge_damping", extra=True),
        numbers("damping", rows, "damping", "s", extra=True),
    ]


def settings(rows: Sequence["NonDefaultSetting"]) -> list[Column]:
    return [
        texts("setting", rows, "path"),
        Column("value", [_value(row.value) for row in rows]),
        Column("default", [_value(row.default) for row in rows]),
        texts("unit", rows, "unit"),
    ]


def _value(value: Any) -> str:
    return vector(value) if isinstance(value, tuple) else value if isinstance(value, str) else number(value)


def assets(rows: Sequence["Asset"]) -> list[Column]:
    own = next((row.path for row in rows if row.kind == "model" and row.path), None)
    return [
        texts("kind", rows, "kind"),
        texts("name", rows, "name"),
        Column("size", ["" if row.path is None else size(row.bytes) for row in rows], right=True),
        Column("content", [_content(row) for row in rows]),
        Column("file" if own is None else "file, from the model's folder", [_beside(own, row.path) for row in rows]),
    ]


def _beside(own: str | None, path: str | None) -> str:
    """A path as seen from the folder of the model."""
    if path is None:
        return ""
    return clean(path if own is None else os.path.relpath(path, Path(own).parent))


def _content(row: "Asset") -> str:
    if "width" in row.content:
        return "x".join(map(str, row.content.values()))
    return ", ".join(f"{count} {what}" for what, count in row.content.items())


TABLES = {
    "bodies": bodies, "joints": joints, "geoms": geoms, "sites": sites, "keyframes": keyframes, "tendons": tendons,
    "equalities": equalities, "pairs": pairs, "excludes": excludes, "flexes": flexes, "options": settings,
    "visual": settings, "assets": assets, **DEVICES,
}  # fmt: skip
