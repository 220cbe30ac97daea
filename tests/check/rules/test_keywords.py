"""Theorems about keywords."""

import re
from pathlib import Path

import mujoco

from mjrun.check.rules import keywords, mjcf_schema
from mjrun.model.xml_source import Element
from tests.check.models import lint, mjcf


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
    known = set[tuple[str, str, tuple[str, ...]]]()  # keywords that MuJoCo reads in another home
    for parent, tag, node in homes:
        if parent in ("worldbody", "frame", "replicate"):  # which hold what a body holds
            continue
        path = [*chain(parent), tag]
        for attribute in node.attributes:
            choices = keywords.valid_keywords(Element(tag, {}, Path(), 1), attribute)
            refused = re.search(r"invalid keyword: '(zzz|\(null\))'", mujocos_word_on(path, attribute, "zzz"))
            assert bool(choices) == bool(refused), (path, attribute)
            if (keywords_there := (tag, attribute, tuple(choices))) in known:
                continue
            known.add(keywords_there)
            for choice in choices:
                sentence = f"invalid keyword: '{choice}'"
                assert sentence not in mujocos_word_on(path, attribute, choice), (path, attribute)
