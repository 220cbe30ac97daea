"""Theorems about the fix of each rule: the text after it, the compiled model, and whether it changes how that moves."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.check.rules import mjcf_schema
from tests.cases import cases
from tests.check.fixes import fixed, fixing
from tests.check.models import hinged, keyed, mjcf

MOTOR = '<actuator><motor name="m" joint="j" {}/></actuator>'


@pytest.mark.parametrize(
    ("text", "wrong", "right"),
    [
        (hinged('range="90  -90"'), "90  -90", "-90  90"),
        (hinged('actuatorfrcrange="1 -1"'), "1 -1", "-1 1"),
        (hinged(after=MOTOR.format("ctrlrange='2\n1'")), "2\n1", "1\n2"),
        (hinged(after=MOTOR.format('forcerange="2 1"')), "2 1", "1 2"),
        (hinged(after='<actuator><pid joint="j" ctrllimited="false" ctrlrange="2 1"/></actuator>'), "2 1", "1 2"),
        (hinged(after='<tendon><fixed range="2 1"><joint joint="j" coef="1"/></fixed></tendon>'), "2 1", "1 2"),
    ],
)
def test_the_numbers_of_a_reversed_range_are_swapped(text: str, wrong: str, right: str) -> None:
    assert fixed(text) == text.replace(wrong, right)


@cases("before, after")
def test_removed_attributes_are_written_as_mujoco_reads_them_now(before: str, after: str) -> None:
    expected = mjcf(before=after) if after else mjcf().replace("\n", "", 1)  # an empty element loses its line, too
    assert fixed(mjcf(before=before)) == expected


def test_every_rewritten_attribute_is_one_that_was_removed_and_its_replacement_exists() -> None:
    nodes = {tag: [node for _, node in parents] for tag, parents in mjcf_schema.valid_parents().items()}
    rewritten = [(*key, {new: ""}) for key, new in mjcf_schema.RENAMED_ATTRIBUTES.items()]
    rewritten += [(tag, name, new) for (tag, name, _), new in mjcf_schema.REWRITTEN_VALUES.items()]
    for tag, name, new in rewritten:
        assert (tag, name) in mjcf_schema.REMOVED_ATTRIBUTES
        assert all(name not in node.attributes for node in nodes[tag])
        assert all(any(other in node.attributes for node in nodes[tag]) for other in new)


@pytest.mark.parametrize("quaternion", ["2 0 0 0", "0.7 0.7 0 0", "0 0 0 0"])
def test_a_quaternion_of_a_keyframe_becomes_the_one_that_mujoco_uses(quaternion: str) -> None:
    text = mjcf(
        '<body name="b"><freejoint name="f"/><geom size=".1"/></body>',
        f'<keyframe><key name="k" qpos="0 0 1\n  {quaternion}"/></keyframe>',
    )
    before, after = (mujoco.MjModel.from_xml_string(each) for each in (text, fixed(text)))
    np.testing.assert_allclose(after.key_qpos, before.key_qpos, atol=1e-15)
    assert 'qpos="0 0 1\n  ' in fixed(text)


def test_a_keyframe_that_is_right_stays() -> None:
    assert fixed(keyed('qpos="0.5"')) == keyed('qpos="0.5"')


def test_later_elements_of_one_name_are_numbered_and_references_keep_the_first() -> None:
    body = '<body name="{}"><joint name="{}"/><geom size=".1" name="g_2"/></body>'
    text = mjcf("\n".join(body.format(*names) for names in (("b", "j"), ("b", "k"), ("b", "j"))), MOTOR.format(""))
    model = mujoco.MjModel.from_xml_string(fixed(text))
    assert [model.body(i).name for i in range(1, 4)] == ["b", "b_2", "b_3"]
    assert [model.joint(i).name for i in range(3)] == ["j", "k", "j_2"]
    assert [model.geom(i).name for i in range(3)] == ["g_2", "g_2_2", "g_2_3"]
    assert model.actuator_trnid[0, 0] == 0


def test_inertia_is_inferred_where_a_model_prevents_it_and_gives_none() -> None:
    text = hinged(before='<compiler inertiafromgeom="false" angle="radian"/>')
    assert fixed(text) == text.replace("false", "auto")
    massless = hinged(geom='size=".1" mass="0"', before='<compiler inertiafromgeom="false"/>')
    assert fixed(massless) == massless


def test_an_angle_in_the_wrong_unit_is_converted_where_it_is_set() -> None:
    text = hinged(before='<default><joint range="-1.57 3.14159"/></default>')
    assert fixed(text, unsafe=True) == text.replace("-1.57 3.14159", "-90 180")


def test_a_range_in_the_wrong_unit_stays_where_a_slide_inherits_it_too() -> None:
    slide = '<body><joint type="slide"/><geom size=".1" pos="9 9 9"/></body>'
    text = hinged(before='<default><joint range="-1.57 1.57"/></default>', world=slide)
    assert fixed(text, unsafe=True) == text
    text = hinged('range="-90 90"', before='<compiler angle="radian"/>')
    model = mujoco.MjModel.from_xml_string(fixed(text, unsafe=True))
    np.testing.assert_allclose(model.jnt_range, [[-np.pi / 2, np.pi / 2]])
    assert fixed(text) == text


def test_keyframes_move_to_the_nearest_bounds() -> None:
    assert fixed(keyed('qpos="1.5" ctrl="-3"'), unsafe=True) == keyed('qpos="1" ctrl="-1"')


BALLS = '<body name="{}" pos="0 0 {}"><freejoint/><geom size=".1"/></body>'


@pytest.mark.parametrize("after", ["", '<contact>\n  <exclude body1="a" body2="c"/>\n</contact>'])
def test_moving_bodies_that_overlap_exclude_each_other(after: str) -> None:
    world = "".join(BALLS.format(*ball) for ball in (("a", 1), ("b", 1.1), ("c", 3), ("d", 3.05)))
    text = mjcf(world, after)
    corrected = fixed(text, unsafe=True)
    before, model = (mujoco.MjModel.from_xml_string(each) for each in (text, corrected))
    assert model.nexclude == before.nexclude + 2
    assert '\n  <exclude body1="a" body2="b"/>\n  <exclude body1="c" body2="d"/>\n</contact>' in corrected
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def test_a_body_inside_a_static_geom_is_left_alone() -> None:
    text = mjcf(f'<geom type="plane" size="1 1 1"/>{BALLS.format("a", 0)}')
    assert fixed(text, unsafe=True) == text


def test_a_keyframe_is_lifted_out_of_the_floor() -> None:
    world = f'<geom type="plane" size="1 1 1"/>{BALLS.format("a", 1)}'
    text = mjcf(world, '<keyframe><key qpos="5 0 -0.2  1 0 0 0"/></keyframe>')
    model = mujoco.MjModel.from_xml_string(fixed(text, unsafe=True))
    assert model.key_qpos[0, 2] == pytest.approx(0.1, abs=2e-6)
    assert 'qpos="5 0 0.1' in fixed(text, unsafe=True)


def test_a_keyframe_is_not_lifted_into_a_ceiling() -> None:
    world = f'<geom type="plane" size="1 1 1" pos="0 0 2" zaxis="0 0 -1"/>{BALLS.format("a", 1)}'
    text = mjcf(world, '<keyframe><key qpos="5 0 2.2  1 0 0 0"/></keyframe>')
    Path("model.xml").write_text(text)
    codes = [finding.code for finding in fixing("model.xml", unsafe=True).results[0].findings]  # type: ignore[attr-defined]
    assert (codes, Path("model.xml").read_text()) == (["MJ501"], text)


@pytest.mark.parametrize("orientation", ["", 'euler="0 0 90"', 'quat="0 1 0 0"'])
def test_an_impossible_inertia_becomes_that_of_the_geoms_with_the_given_mass(orientation: str) -> None:
    rod = '<body name="r"><joint/>{}<geom type="box" size=".1 .2 .3" pos="1 0 0" euler="0 0 30"/></body>'
    wrong = f'<inertial pos="0 0 0" {orientation} mass="2" diaginertia="5 5 5"/>'
    model = mujoco.MjModel.from_xml_string(fixed(mjcf(rod.format(wrong)), unsafe=True))
    whole = mujoco.MjModel.from_xml_string(mjcf(rod.format("").replace("<geom", '<geom mass="2"')))
    for name in ("body_mass", "body_ipos", "body_inertia"):
        np.testing.assert_allclose(getattr(model, name), getattr(whole, name), rtol=1e-6, atol=1e-12)
    data, other = mujoco.MjData(model), mujoco.MjData(whole)
    mujoco.mj_forward(model, data)
    mujoco.mj_forward(whole, other)
    np.testing.assert_allclose(data.M, other.M, rtol=1e-6)
