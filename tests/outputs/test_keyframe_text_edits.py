"""A key goes into the text of a model, MuJoCo reads it back to the last bit, and every other byte stays."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.outputs.keyframe import key_names, with_key

BODIES = b'<worldbody><body mocap="true"><geom size=".1"/></body><body><joint/><geom size=".1"/></body></worldbody>'
OLD = b'<key name="old" qpos=".5"/>'
FIELDS = {
    "time": np.array([0.1 + 0.2]),
    "qpos": np.array([1 / 3]),
    "qvel": np.array([-1e-300]),
    "act": np.empty(0),
    "ctrl": np.empty(0),
    "mocap_pos": np.array([1.0, -0.0, 2e22]),
    "mocap_quat": np.array([1.0, 0.0, 0.0, 0.0]),
}
# Models, and where in them the key goes: what is before it, and what is after it.
LAYOUTS = {
    "with keys": (
        b"<mujoco>\n\t<keyframe>\n\t\t" + OLD + b"<!-- < & -->\n",
        b"\t</keyframe>\n\t" + BODIES + b"\n</mujoco>\n",
    ),
    "in one line": (b"<mujoco>" + BODIES, b"</mujoco>"),
    "a section without keys": (b"<mujoco>" + BODIES + b"\n <keyframe>", b"</keyframe></mujoco>"),
    "a section with a comment": (b"<mujoco>" + BODIES + b"<keyframe>\n <!-- <key/> -->", b"\n</keyframe></mujoco>"),
    "Latin-1 in a comment": (b'<?xml version="1.0"?><!-- \xe9 --><mujoco>\n    ' + BODIES, b"\n</mujoco><!-- \xff -->"),
    "dashes in a comment": (b"<mujoco>\n  <!-- a -- b <key/> ---->\n  " + BODIES, b"\n</mujoco>\n"),
    "text that resembles a comment": (
        b"<mujoco>\n  <custom><![CDATA[ <!-- ]]></custom>\n  " + BODIES + b"\n  <!-- a -- b -->",
        b"\n</mujoco>\n",
    ),
    "a byte order mark": (b"\xef\xbb\xbf<mujoco model='>'>\r\n  " + BODIES, b"\r\n</mujoco >\r\n"),
}


def loaded(xml: bytes) -> mujoco.MjModel:
    return mujoco.MjSpec.from_string(xml.decode("utf-8-sig", "replace")).compile()


def assert_holds(xml: bytes, name: str) -> None:
    key = loaded(xml).key(name)
    for field, read in {"qpos": key.qpos, "qvel": key.qvel, "mocap_pos": key.mpos, "mocap_quat": key.mquat}.items():
        assert np.ravel(read).tobytes() == FIELDS[field].tobytes(), field
    assert key.time[0] == FIELDS["time"][0]


def alike(one: bytes, other: bytes) -> int:
    """How many bytes are the same from the beginning."""
    return next((i for i, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_key_is_added_and_nothing_else_changes(layout: str) -> None:
    before, after = LAYOUTS[layout]
    xml = with_key(before + after, "new", FIELDS)
    assert_holds(xml, "new")
    assert key_names(xml) == [*key_names(before + after), "new"]

    old = before + after
    assert alike(xml, old) + alike(xml[::-1], old[::-1]) >= len(old)  # something is put in at one place
    if layout != "with keys":
        assert xml.startswith(before)
        assert xml.endswith(after)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_key_of_the_same_name_is_replaced_in_its_place(layout: str) -> None:
    before, after = LAYOUTS[layout]
    once = with_key(before + after, "new", FIELDS)
    other = with_key(once, "new", {**FIELDS, "qpos": np.array([7.0])})
    assert loaded(other).key("new").qpos == 7
    assert with_key(other, "new", FIELDS) == once


def test_a_section_and_a_root_that_are_empty_are_opened() -> None:
    model = b"<mujoco>" + BODIES + b"\n  <keyframe />\n</mujoco>"
    assert_holds(with_key(model, "new", FIELDS), "new")
    empty = {name: values if name == "time" else np.empty(0) for name, values in FIELDS.items()}
    assert with_key(b"<mujoco/>", "a", empty) == (
        b'<mujoco>\n  <keyframe>\n    <key name="a" time="0.30000000000000004"/>\n  </keyframe>\n</mujoco>'
    )


def test_a_key_looks_as_a_person_would_write_it() -> None:
    model = b'<mujoco>\n   <keyframe>\n      <key name="a"/>\n   </keyframe>\n   ' + BODIES + b"\n</mujoco>"
    fields = {**FIELDS, "qpos": np.array([0.1]), "qvel": np.array([2.0]), "mocap_pos": np.array([0.0, 0.5, 1.0])}
    assert with_key(model, "b", fields) == model.replace(
        b'<key name="a"/>\n',
        b'<key name="a"/>\n      <key name="b" time="0.30000000000000004"\n         qpos="0.1"\n         qvel="2"\n'
        b'         mpos="0 0.5 1"\n         mquat="1 0 0 0"/>\n',
    )


def test_line_ends_of_windows_stay() -> None:
    xml = with_key(b"<mujoco>\r\n  " + BODIES + b"\r\n</mujoco>\r\n", "new", FIELDS)
    assert xml.count(b"\n") == xml.count(b"\r\n") > 5


@given(
    st.text(st.characters(exclude_categories=("Cs", "Cc")), min_size=1).filter(lambda name: "\ufffe" not in name),
    st.lists(st.floats(-1e10, 1e10), min_size=3, max_size=3),
)
@settings(deadline=None, max_examples=30)
def test_any_name_and_any_number_come_back(name: str, numbers: list[float]) -> None:
    fields = {**FIELDS, "mocap_pos": np.array(numbers), "qpos": np.array(numbers[:1])}
    xml = with_key(b"<mujoco>" + BODIES + b"</mujoco>", name, fields)
    model = loaded(xml)
    assert mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_KEY, 0) == name
    assert model.key_mpos.tobytes() == fields["mocap_pos"].tobytes()
    assert model.key_qpos.tobytes() == fields["qpos"].tobytes()
    assert key_names(xml) == [name]


@pytest.mark.parametrize(
    ("xml", "reason"),
    [
        (b"<robot name='r'><link name='a'/></robot>", "it is not MJCF: its root element is <robot>"),
        (b"<mujoco><worldbody></mujoco>", "it is not well-formed XML: mismatched tag: line 1, column 21"),
        (b"", "it is not well-formed XML: no element found"),
    ],
)
def test_what_is_no_mjcf_takes_no_key(xml: bytes, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        with_key(xml, "a", FIELDS)


@pytest.mark.parametrize(
    "text", ["&#233;", "&#x20AC;", "\u00e9&#233;", "a &amp;eacute;", "a&#10;b", "a\nb", "a\r\nb", "a\tb"]
)
def test_names_of_keys_are_those_that_mujoco_reads(text: str) -> None:
    xml = f"<mujoco>{BODIES.decode()}<keyframe><key qpos='1' name=\"{text}\"/></keyframe></mujoco>".encode()
    name = loaded(xml).key(0).name
    assert key_names(xml) == [name]
    replaced = with_key(xml, name, FIELDS)
    assert loaded(replaced).nkey == 1
    assert_holds(replaced, name)
