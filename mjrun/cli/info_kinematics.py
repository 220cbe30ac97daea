"""Bodies, joints, geoms, sites and keyframes as `mjrun info` shows them: columns of text."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mjrun.cli.table_cells import (
    Column,
    numbers,
    ranges,
    resistances,
    slots,
    texts,
    vectors,
)
from mjrun.errors import clean
from mjrun.model.description.resistance_units import ARMATURE, DAMPING, FORCE, STIFFNESS

if TYPE_CHECKING:
    from mjrun.model.description.bodies import Body, Geom, Joint, Site
    from mjrun.model.description.keyframes import Keyframe


def bodies(rows: Sequence["Body"]) -> list[Column]:
    lines, below = _tree(rows)
    return [
        Column("body", lines, below=below),
        Column("joints", [_grouped(row.joints, row.joint_types) for row in rows]),
        Column("", ["mocap" if row.mocap else "" for row in rows]),
        numbers("mass", [row.mass for row in rows], "kg"),
        numbers("subtree", [row.subtree_mass for row in rows], "kg", extra=True),
        Column("geoms", [_tally(row.geom_types) for row in rows], extra=True),
        numbers("gravcomp", [row.gravity_compensation for row in rows], extra=True),
    ]


def _tree(rows: Sequence["Body"]) -> tuple[list[str], list[str]]:
    """The names, each under its parent's, and what goes on below them."""
    last = {row.parent: row.id for row in rows}
    lines: list[str] = []
    stems = {-1: ""}
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


def joints(rows: Sequence["Joint"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        texts("type", [row.type for row in rows]),
        ranges("range", [row.range for row in rows], [row.unit for row in rows]),
        Column("qpos", [slots(row.qpos, row.qpos_size) for row in rows], right=True),
        Column("qvel", [slots(row.dof, row.dof_size) for row in rows], right=True),
        resistances("stiffness", [row.stiffness for row in rows], [row.unit for row in rows], STIFFNESS),
        resistances("damping", [row.damping for row in rows], [row.unit for row in rows], DAMPING),
        resistances("armature", [row.armature for row in rows], [row.unit for row in rows], ARMATURE),
        resistances("frictionloss", [row.frictionloss for row in rows], [row.unit for row in rows], FORCE),
        texts("body", [row.body for row in rows], extra=True),
        vectors("axis", [row.axis for row in rows], extra=True),
    ]


def geoms(rows: Sequence["Geom"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        texts("type", [row.type for row in rows]),
        texts("body", [row.body for row in rows]),
        vectors("size", [row.size for row in rows], "m"),
        texts("asset", [row.asset for row in rows]),
        numbers("condim", [row.condim for row in rows], usual=3),
        vectors("friction", [row.friction for row in rows], extra=True),
        Column("contact bits", _bits(rows), extra=True),
        numbers("margin", [row.margin for row in rows], "m", extra=True),
        numbers("gap", [row.gap for row in rows], "m", extra=True),
        numbers("group", [row.group for row in rows], extra=True),
        texts("material", [row.material for row in rows], extra=True),
    ]


def _bits(rows: Sequence["Geom"]) -> list[str]:
    """contype and conaffinity, if any geom has others than 1 and 1."""
    bits = [f"{row.contype} {row.conaffinity}" for row in rows]
    return bits if set(bits) != {"1 1"} else []


def sites(rows: Sequence["Site"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        texts("type", [row.type for row in rows]),
        texts("body", [row.body for row in rows]),
        vectors("size", [row.size for row in rows], "m"),
        vectors("position", [row.position for row in rows], "m", extra=True),
        numbers("group", [row.group for row in rows], extra=True),
    ]


def keyframes(rows: Sequence["Keyframe"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        numbers("time", [row.time for row in rows], "s", usual=-1),
        Column("", ["" if row.finite else "not finite" for row in rows]),
        Column("outside its range", [", ".join(map(clean, row.outside)) for row in rows]),
    ]
