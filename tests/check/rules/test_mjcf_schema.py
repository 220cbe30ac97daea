"""Theorems about violations of the schema."""

from pathlib import Path

import mujoco
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mjrun.check.rules import mjcf_schema
from mjrun.model.xml_source import read_xml
from tests.check.models import FINE, Case, mjcf

CASES = [
    Case("MJ102", mjcf("", "<solver/>"), 6, "<mujoco> has no element <solver>", mjcf("", '<option solver="CG"/>')),
    Case("MJ102", mjcf('<goem size="1"/>'), 4, "has no element <goem> (did you mean 'geom'?)", FINE),
    Case(
        "MJ103", mjcf("<actuator/>"), 4, "<actuator> is inside <worldbody>, but must be directly inside <mujoco>", FINE
    ),
    Case("MJ103", mjcf("", "<motor/>"), 6, "<motor> is inside <mujoco>, but must be directly inside <actuator>", FINE),
    Case("MJ104", mjcf('<geom siez="1"/>'), 4, "<geom> has no attribute 'siez' (did you mean 'size'?)", FINE),
    Case("MJ104", mjcf('<frame>\n<geom size="1" siez="1"/></frame>'), 5, "<geom> has no attribute 'siez'", FINE),
    Case("MJ105", mjcf('<composite type="cable"/>'), 4, "<composite> was removed in MuJoCo 4.0.0", FINE),
    Case("MJ105", mjcf("", '<equality><flexvert flex="f"/></equality>'), 6, "<flexvert> was removed", FINE),
    Case("MJ105", mjcf("", '<option apirate="1"/>'), 6, "the attribute 'apirate' of <option> was removed", FINE),
    Case(
        "MJ105",
        mjcf("", '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>'),
        6,
        "plugin='mujoco.elasticity.cable' of <plugin> was removed in MuJoCo 4.0.0",
        FINE,
    ),
    Case(
        "MJ106",
        mjcf("", "<contact>\n<friction>0.3</friction></contact>"),
        7,
        "<friction> is written as an element, but is an attribute of <pair>",
        mjcf('<geom name="g" size="1"/>', '<contact><pair geom1="g" geom2="g" friction="0.3"/></contact>'),
    ),
    Case("MJ106", mjcf("", "garbage"), 6, "text between the tags of <mujoco>: 'garbage'", FINE),
    Case("MJ106", mjcf('<geom size="1">0.3</geom>'), 4, "text between the tags of <geom>: '0.3'", FINE),
    Case("MJ111", mjcf("", "<option>\n<flag/>\n<flag/></option>"), 8, "<flag> occurs more than once in <option>", FINE),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_rule_finds_what_it_is_for_at_its_line_and_nothing_in_a_correct_model(case: Case) -> None:
    case.check()


NODES = {tag: node for tag, places in mjcf_schema.valid_parents().items() for _, node in places}


SPECIAL = ("mujoco", "worldbody", "body", "frame", "replicate", "include")


TAGS = sorted(set(NODES) - set(SPECIAL))


NAMES = sorted({name for node in NODES.values() for name in node.attributes})


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
    found = list(mjcf_schema.violations(read_xml(path)))
    assert bool(found) == ("Schema violation" in said), (found, said)
