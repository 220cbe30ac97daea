"""Theorems about fixes that change how a model moves."""

import mujoco
import numpy as np
import pytest

from tests.check.fixes import fixed
from tests.check.models import mjcf

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
