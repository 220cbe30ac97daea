"""Tendons, equalities, contact pairs, excludes and flexes as `mjrun info` shows them: columns of text."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mjrun.cli.table_cells import (
    Column,
    number,
    numbers,
    ranges,
    reference,
    resistances,
    stacked,
    texts,
    vectors,
)
from mjrun.errors import clean
from mjrun.model.description.resistance_units import ARMATURE, DAMPING, FORCE, STIFFNESS

if TYPE_CHECKING:
    from mjrun.model.description.flexes_plugins import Flex
    from mjrun.model.description.tendons_constraints import ContactPair, Equality, Exclude, PathPoint, Tendon


def tendons(rows: Sequence["Tendon"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        texts("type", [row.type for row in rows]),
        Column("path", [", ".join(map(_point, row.path)) for row in rows]),
        numbers("length", [row.length0 for row in rows], stacked(row.unit for row in rows)),
        ranges("range", [row.range for row in rows], [row.unit for row in rows]),
        resistances("stiffness", [row.stiffness for row in rows], [row.unit for row in rows], STIFFNESS),
        resistances("damping", [row.damping for row in rows], [row.unit for row in rows], DAMPING),
        resistances("armature", [row.armature for row in rows], [row.unit for row in rows], ARMATURE),
        resistances("frictionloss", [row.frictionloss for row in rows], [row.unit for row in rows], FORCE),
    ]


def _point(point: "PathPoint") -> str:
    if point.kind == "pulley":
        return f"pulley /{number(point.coefficient)}"
    name = clean(point.name or "")
    return name if point.coefficient is None else f"{number(point.coefficient)} {name}"


def equalities(rows: Sequence["Equality"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        texts("type", [row.type for row in rows]),
        Column("of", [reference(row.object_kind, row.object1) for row in rows]),
        Column("and", [reference(row.object_kind, row.object2) for row in rows]),
        Column("", ["" if row.active else "off" for row in rows]),
        vectors("data", [row.data for row in rows], extra=True),
        vectors("solref", [row.solref for row in rows], extra=True),
    ]


def pairs(rows: Sequence["ContactPair"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        texts("geom 1", [row.geom1 for row in rows]),
        texts("geom 2", [row.geom2 for row in rows]),
        numbers("condim", [row.condim for row in rows], usual=-1),
        vectors("friction", [row.friction for row in rows]),
        numbers("margin", [row.margin for row in rows], "m"),
        numbers("gap", [row.gap for row in rows], "m"),
        vectors("solref", [row.solref for row in rows], extra=True),
        vectors("solimp", [row.solimp for row in rows], extra=True),
    ]


def excludes(rows: Sequence["Exclude"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        texts("body 1", [row.body1 for row in rows]),
        texts("body 2", [row.body2 for row in rows]),
    ]


def flexes(rows: Sequence["Flex"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        texts("elements are", [row.elements_are for row in rows]),
        numbers("elements", [row.elements for row in rows]),
        numbers("vertices", [row.vertices for row in rows]),
        numbers("edges", [row.edges for row in rows]),
        numbers("nodes", [row.nodes for row in rows]),
        numbers("radius", [row.radius for row in rows], "m"),
        Column("kept by", ["" if row.edge_equality == "none" else row.edge_equality for row in rows]),
        texts("self-collision", [row.self_collision for row in rows], extra=True),
        numbers("edge stiffness", [row.edge_stiffness for row in rows], extra=True),
        numbers("edge damping", [row.edge_damping for row in rows], extra=True),
        numbers("damping", [row.damping for row in rows], "s", extra=True),
    ]
