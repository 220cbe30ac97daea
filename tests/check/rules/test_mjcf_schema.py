"""Theorems about violations of the schema."""

from pathlib import Path

import mujoco
from hypothesis import assume, given
from hypothesis import strategies as st

from mjrun.check.rules import mjcf_schema
from mjrun.model.xml_source import read_xml

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
