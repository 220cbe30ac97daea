"""A scene that grows."""

import warnings

import mujoco
import numpy as np
import pytest

from mjrun.camera.argument import parse_camera
from mjrun.camera.motion import CameraMotion
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.state import save
from mjrun.rendering.scene import updated_scene

GEOMS = 10_500
BALLS = "".join(f"<geom size='.1' pos='{k % 100} {k // 100} 0'/>" for k in range(GEOMS))
MODEL = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{BALLS}</worldbody></mujoco>")


@pytest.mark.parametrize(("maxgeom", "room"), [(10_000, 0), (1, 0), (20_000, 15_000)])
def test_a_scene_grows_until_everything_is_in_it_and_nobody_is_told_to_increase_it(maxgeom: int, room: int) -> None:
    data = mujoco.MjData(MODEL)
    mujoco.mj_forward(MODEL, data)
    pose = CameraMotion(parse_camera("free", MODEL), MODEL, (64, 48)).pose(save(MODEL, data))
    scene = mujoco.MjvScene(MODEL, maxgeom)
    scene.flags[0] = 1 - scene.flags[0]
    with collected_warnings() as texts, warnings.catch_warnings():
        warnings.simplefilter("error")
        grown = updated_scene(MODEL, data, mujoco.MjvOption(), pose, scene, room)
    assert texts == []
    assert grown.maxgeom > GEOMS + room
    assert np.array_equal(grown.flags, scene.flags)
    assert {geom.objid for geom in grown.geoms[: grown.ngeom]} == set(range(GEOMS))
