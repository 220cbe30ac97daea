"""Theorems about keywords."""

import re
from pathlib import Path

import mujoco
import pytest

from mjrun.check.rules import keywords, mjcf_schema
from mjrun.model.xml_source import Element
from tests.check.models import FINE, Case, hinged, lint, mjcf

CASES = [
    Case("MJ110", mjcf('<geom type="shere" size="1"/>'), 4, "type of <geom>: no such keyword: 'shere'", FINE),
    Case(
        "MJ110", hinged('limited="yes"'), 5, "limited of <joint>: no such keyword: 'yes' (did you mean 'true'?)", FINE
    ),
    Case("MJ110", mjcf('<geom pos="1 2" size="1"/>'), 4, "'pos' does not have enough data: '1 2'", FINE),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_rule_finds_what_it_is_for_at_its_line_and_nothing_in_a_correct_model(case: Case) -> None:
    case.check()


Expected = tuple[int | None, str, str]


KEYWORDS: list[tuple[str, list[Expected]]] = [
    (
        '<option integrator="rk4" solver="newton"/>',
        [
            (
                6,
                "integrator of <option>: no such keyword: 'rk4' (did you mean 'RK4'?)",
                'write integrator="RK4"; valid: Euler, RK4, implicit, implicitfast, discrete',
            ),
            (
                6,
                "solver of <option>: no such keyword: 'newton' (did you mean 'Newton'?)",
                'write solver="Newton"; valid: PGS, CG, Newton',
            ),
        ],
    ),
    (
        '<option solver="Newtons"/>\n<compiler angle="radians"/>',
        [
            (
                6,
                "solver of <option>: no such keyword: 'Newtons' (did you mean 'Newton'?)",
                'write solver="Newton"; valid: PGS, CG, Newton',
            ),
            (
                7,
                "angle of <compiler>: no such keyword: 'radians' (did you mean 'radian'?)",
                'write angle="radian"; valid: radian, degree',
            ),
        ],
    ),
    (
        '<option><flag contact="off"/></option>',
        [
            (
                6,
                "contact of <flag>: no such keyword: 'off' (did you mean 'disable'?)",
                'write contact="disable"; valid: enable, disable',
            )
        ],
    ),
    (
        '<asset><texture type="2D" builtin="xxx" width="2" height="2"/></asset>',
        [
            (
                6,
                "type of <texture>: no such keyword: '2D' (did you mean '2d'?)",
                'write type="2d"; valid: 2d, cube, skybox',
            ),
            (
                6,
                "builtin of <texture>: no such keyword: 'xxx'",
                "valid: none, gradient, checker, flat",
            ),
        ],
    ),
    (
        '<default><geom type="cube" pos="0 0 0"/>\n<camera output="rgb deep"/></default>',
        [
            (
                6,
                "type of <geom>: no such keyword: 'cube' (did you mean 'box'?)",
                'write type="box"; valid: plane, hfield, sphere, capsule, ellipsoid, cylinder, box, mesh, sdf',
            ),
            (
                7,
                "output of <camera>: no such keyword: 'deep' (did you mean 'depth'?)",
                'write output="depth"; valid: rgb, depth, distance, normal, segmentation',
            ),
        ],
    ),
]


@pytest.mark.parametrize(("text", "expected"), KEYWORDS, ids=lambda value: value if isinstance(value, str) else "")
def test_all_wrong_keywords_are_told_as_xml_spells_them(text: str, expected: list[Expected]) -> None:
    findings = lint(mjcf("", text))
    assert {(f.code, f.file) for f in findings} == {("MJ110", "model.xml")}
    assert [(f.line, f.message, f.remedy) for f in findings] == expected


def test_keywords_are_told_beside_what_else_the_xml_has_wrong() -> None:
    findings = lint(mjcf('<geom typ="box"/>\n<geom type="Box"/>'))
    assert [(f.line, f.code) for f in findings] == [(4, "MJ104"), (5, "MJ110")]


# MuJoCo would open the file of a <model>.
HOMES = {tag: places for tag, places in mjcf_schema.valid_parents().items() if tag != "model"}


NEEDED = {
    "flexcomp": {"type": "grid", "count": "3 3 3", "spacing": "1 1 1", "name": "f"},
    "connect": {"site1": "s", "site2": "s"},
    "weld": {"site1": "s", "site2": "s"},
    "rangefinder": {"site": "s"},
    **{tag: {"geom1": "g", "geom2": "g"} for tag in ("distance", "normal", "fromto")},
}


HOLDING = {"flex": {"body": "b", "dim": "1", "element": "0 1", "vertex": "0 0 0 1 1 1"}}  # that hold something else


def chain(parent: str) -> list[str]:
    """The tags from the root to `parent`, not through frames or defaults if there is another way."""
    if parent == "mujoco":
        return [parent]
    above = [home for home, _ in HOMES[parent] if home not in (parent, "frame", "replicate")]
    return [*chain("body" if "body" in above else above[0]), parent]


def mujocos_word_on(path: list[str], attribute: str, value: str) -> str:
    """What MuJoCo says of `value`, after all that the elements on `path` need is given."""
    given = [{**NEEDED.get(tag, {}), **HOLDING.get(tag, {})} for tag in path]
    given[-1] = {**NEEDED.get(path[-1], {}), attribute: value}
    if attribute == "reftype":
        given[-1] |= {"objtype": "site", "objname": "s", "refname": "s"}
    while True:
        attributes = [" ".join(f'{name}="{said}"' for name, said in each.items()) for each in given]
        text = "".join(f"<{tag} {said}>" for tag, said in zip(path, attributes, strict=True))
        try:
            mujoco.MjSpec.from_string(text + "".join(f"</{tag}>" for tag in reversed(path)))
        except ValueError as error:
            needed = re.search(r"required attribute missing: '(\w+)'", str(error))
            if not needed or needed[1] in given[-1]:
                return str(error)
            given[-1][needed[1]] = "1"
        else:
            return ""


def test_keywords_are_those_of_mujoco_wherever_it_takes_any() -> None:
    homes = [(parent, tag, node) for tag, places in HOMES.items() for parent, node in places]
    for parent, tag, node in homes:
        if parent in ("worldbody", "frame", "replicate"):  # which hold what a body holds
            continue
        path = [*chain(parent), tag]
        for attribute in node.attributes:
            choices = keywords.valid_keywords(Element(tag, {}, Path(), 1), attribute)
            refused = re.search(r"invalid keyword: '(zzz|\(null\))'", mujocos_word_on(path, attribute, "zzz"))
            assert bool(choices) == bool(refused), (path, attribute)
            for choice in choices:
                sentence = f"invalid keyword: '{choice}'"
                assert sentence not in mujocos_word_on(path, attribute, choice), (path, attribute)
