"""Scenes in which nothing collides, by a simulation of each."""

import itertools

import mujoco
import pytest

from tests.check.models import lint, mjcf

BALL = '<body name="ball" pos="0 0 0.5" {}><freejoint/><geom size="0.1" {}/></body>'
FLOOR = '<geom type="plane" size="1 1 1" {}/>'


def codes(text: str) -> list[str]:
    return [f.code for f in lint(text) if f.code in ("MJ504", "MJ508")]


def falls(text: str) -> bool:
    """Whether the ball is below the floor after a second."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, int(1 / model.opt.timestep))
    return bool(data.body("ball").xpos[2] < -1)


@pytest.mark.parametrize("bits", list(itertools.product((0, 1, 2), repeat=3)))
def test_a_scene_collides_if_bits_agree(bits: tuple[int, int, int]) -> None:
    contype, conaffinity, floor = bits
    ball = BALL.format("", f'contype="{contype}" conaffinity="{conaffinity}"')
    text = mjcf(ball + FLOOR.format(f'contype="{floor}" conaffinity="{floor}"'))
    assert codes(text) == ["MJ504"] * falls(text)


@pytest.mark.parametrize(
    "text",
    [
        mjcf(BALL.format("", 'name="g" contype="0"') + FLOOR.format('name="f" conaffinity="0" contype="0"'), "{pair}"),
        mjcf(BALL.format('gravcomp="1"', 'contype="0"') + FLOOR.format('conaffinity="0" contype="0"')),
        mjcf(BALL.format("", 'contype="0"') + FLOOR.format('contype="0"'), before='<option gravity="0 0 0"/>'),
        mjcf(BALL.format("", 'contype="0"'), before='<option><flag gravity="disable"/></option>'),
    ],
    ids=["declared contact", "gravity is compensated", "no gravity", "gravity is disabled"],
)
def test_scenes_without_a_fall(text: str) -> None:
    text = text.format(pair='<contact><pair geom1="g" geom2="f"/></contact>')
    assert codes(text) == []
    assert not falls(text)


def test_geoms_of_one_body_do_not_collide_with_each_other() -> None:
    two = BALL.format("", 'contype="2" conaffinity="2"').replace(
        "</body>", '<geom contype="2" conaffinity="2" size="1"/></body>'
    )
    assert codes(mjcf(two + FLOOR.format(""))) == ["MJ504"]
    assert codes(mjcf(two + two.replace("ball", "other") + FLOOR.format(""))) == []


def test_without_static_geoms_there_is_no_floor() -> None:
    assert codes(mjcf(BALL.format("", ""))) == ["MJ508"]
    assert falls(mjcf(BALL.format("", "")))
    assert codes(mjcf('<body><joint/><geom size="1"/></body>')) == []
