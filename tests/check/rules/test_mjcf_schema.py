"""Theorems about MuJoCo's schema, and about what MJCF no longer has: the installed MuJoCo does not have it either."""

import re
from pathlib import Path

import mujoco
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mjrun.check.rule import Finding
from mjrun.check.rules import mjcf_schema
from mjrun.check.rules.mjcf_schema import (
    FOREIGN_ELEMENTS,
    REMOVED_ATTRIBUTES,
    REMOVED_ELEMENTS,
    REMOVED_PLUGINS,
    REMOVED_VALUES,
    SEVERAL,
    SINGLE,
    SYNONYMS,
    invalid_keywords,
    valid_parents,
)
from mjrun.model.xml_source import Element, XmlSource, read_xml
from tests.check.models import lint, mjcf, write

NODES = {tag: node for tag, places in mjcf_schema.valid_parents().items() for _, node in places}


SPECIAL = ("mujoco", "worldbody", "body", "frame", "replicate", "include")


TAGS = sorted(set(NODES) - set(SPECIAL))


NAMES = sorted({name for node in NODES.values() for name in node.attributes})
KEYWORDS = {keyword for choices in (*SINGLE.values(), *SEVERAL.values()) for keyword in choices}
# The last words of the constants of each kind in MuJoCo, such as voltage of mjINPUT_VOLTAGE.
WORDS = [
    {name.rpartition("_")[2].lower() for name in kind.__members__}
    for kind in vars(mujoco).values()
    if hasattr(kind, "__members__")
]
COMMON_WORDS = {"none", "auto", "true", "false"}


@st.composite
def documents(draw: st.DrawFn, tag: str = "mujoco", depth: int = 3) -> str:
    """XML that mostly keeps to the schema; its values mean nothing."""
    node = mjcf_schema.schema().children["mujoco"] if tag == "mujoco" else NODES[tag]
    valid = sorted(set(node.children) - set(SPECIAL))
    child = st.sampled_from(valid * 200 + TAGS if valid else TAGS)
    tags = draw(st.lists(child, max_size=3 if valid else 0)) if depth else []
    name = st.sampled_from(sorted(node.attributes) * 100 + NAMES)
    attributes = " ".join(f'{n}="1"' for n in draw(st.sets(name, max_size=3)))
    inner = "".join(draw(documents(t, depth - 1)) for t in tags)
    return f"<{tag} {attributes}>{inner}</{tag}>"


def violations(source: XmlSource) -> list[Finding]:
    return list(mjcf_schema.violations(source, source.root))


@given(documents())
def test_the_schema_is_violated_exactly_where_mujoco_says_so(text: str) -> None:
    path = Path("drawn.xml")
    path.write_text(text)
    try:
        mujoco.MjSpec.from_string(text)
        said = ""
    except ValueError as error:
        said = str(error)
    assume("can be specified" not in said and "must be specified" not in said)  # combinations, which no schema lists
    found = violations(read_xml(path))
    assert bool(found) == ("Schema violation" in said), (found, said)


@pytest.mark.parametrize(
    ("comment", "found"),
    [
        ("", [("MJ106", "part.xml", 4), ("MJ104", "part.xml", 4)]),
        ("<!-- mjrun: ignore-file MJ104 -->", [("MJ106", "part.xml", 4)]),
    ],
)
def test_what_mujoco_ignores_in_an_attached_model_is_reported_unless_a_comment_there_suppresses_it(
    comment: str, found: list[tuple[str, str, int]]
) -> None:
    write("part.xml", mjcf(f'{comment}<body name="b"><frame sze="1"/><geom size="1"/>red</body>'))
    attach = '<attach model="part" body="b" prefix="p_"/>'
    findings = lint(mjcf(attach, before='<asset><model name="part" file="part.xml"/></asset>'))
    assert [(each.code, each.file, each.line) for each in findings] == found


def test_removed_elements_are_in_no_schema() -> None:
    for name in REMOVED_ELEMENTS:
        *parent, tag = name.split("/")
        homes = {home for home, _ in valid_parents().get(tag, [])}
        assert not (homes & set(parent) if parent else homes), name


def test_a_removed_constraint_is_not_mistaken_for_the_sensor_of_the_same_name() -> None:
    distance = '<equality><distance geom1="a" geom2="b" distance="0.1"/></equality>'
    path = Path(write("model.xml", mjcf('<geom name="a" size="1"/><body><geom name="b" size="1"/></body>', distance)))
    (found,) = (finding for finding in violations(read_xml(path)) if finding.code == "MJ105")
    assert found.message == "<distance> was removed in MuJoCo 2.2.2"


def test_removed_attributes_are_in_the_schema_of_none_of_their_elements() -> None:
    for tag, attribute in REMOVED_ATTRIBUTES:
        assert all(attribute not in node.attributes for _, node in valid_parents()[tag]), (tag, attribute)


@pytest.mark.parametrize("plugin", REMOVED_PLUGINS)
def test_removed_plugins_are_refused_by_mujoco(plugin: str) -> None:
    with pytest.raises(ValueError, match="not found"):
        mujoco.MjModel.from_xml_string(mjcf("", f'<extension><plugin plugin="{plugin}"/></extension>'))


@pytest.mark.parametrize(("tag", "attribute", "value"), REMOVED_VALUES)
def test_removed_values_are_reported_as_removed_and_not_as_unknown(tag: str, attribute: str, value: str) -> None:
    homes = [parent for parent, node in valid_parents()[tag] if attribute in node.attributes]
    assert homes
    text = f'<{tag} {attribute}="{value}"/>'
    text = mjcf("", text) if "mujoco" in homes else mjcf(f"<{homes[0]}>{text}</{homes[0]}>")
    source = read_xml(Path(write("model.xml", text)))
    assert [finding.code for finding in (*violations(source), *invalid_keywords(source))] == ["MJ105"]


def test_elements_of_other_formats_are_not_children_of_mujoco_or_of_bodies() -> None:
    parents = {tag: {parent for parent, _ in valid_parents().get(tag, [])} for tag in FOREIGN_ELEMENTS}
    assert all(not homes & {"body", "worldbody"} for homes in parents.values()), parents


def test_synonyms_stand_for_keywords_of_mjcf() -> None:
    assert set(SYNONYMS) <= KEYWORDS


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
            choices = mjcf_schema.valid_keywords(Element(tag, {}, Path(), 1), attribute)
            refused = re.search(r"invalid keyword: '(zzz|\(null\))'", mujocos_word_on(path, attribute, "zzz"))
            assert bool(choices) == bool(refused), (path, attribute)
            if (keywords_there := (tag, attribute, tuple(choices))) in known:
                continue
            known.add(keywords_there)
            rare = {*choices} - COMMON_WORDS
            for word in {*choices}.union(*(words for words in WORDS if words & rare)):
                refused = re.search(rf"invalid keyword: '({word}|\(null\))'", mujocos_word_on(path, attribute, word))
                assert bool(refused) == (word not in choices), (path, attribute, word)
