"""Theorems about lights in physical units."""

import math

import mujoco
import pytest

from mjrun.scene_graph.graph import SceneLight
from mjrun.scene_graph.walk import light_of


def lights(*elements: str) -> list[SceneLight | None]:
    xml = f"<mujoco><worldbody><geom type='plane' size='9 9 1'/>{''.join(elements)}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return [light_of(model, data, index) for index in range(model.nlight)]


def test_a_spot_gives_the_floor_the_brightness_of_its_colour() -> None:
    (light,) = lights("<light pos='0 0 3' dir='0 0 -1' diffuse='.5 .25 0' cutoff='30'/>")
    assert light
    assert (light.kind, light.color) == ("spot", (1.0, 0.5, 0.0))
    assert light.intensity / 3**2 == pytest.approx(math.pi * 0.5)
    assert light.cutoff == pytest.approx(math.pi / 6)


def test_the_sun_is_the_same_everywhere() -> None:
    (light,) = lights("<light type='directional' pos='0 0 7' diffuse='1 1 1'/>")
    assert light == SceneLight("directional", (1.0, 1.0, 1.0), math.pi)


def test_lights_that_are_off_or_dark_are_left_out() -> None:
    assert lights("<light active='false'/>", "<light diffuse='0 0 0'/>") == [None, None]
