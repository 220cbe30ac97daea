"""Cameras of the model, against where MuJoCo has them."""

import mujoco
import numpy as np
import pytest

from mjrun.camera.rigs.model import ModelRig
from tests.camera.rigs.posed_model import CAMERAS, CAMERAS_OF_MODEL, MODEL, moved, posed, same, updated


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_of_the_model_is_where_mujoco_has_it(name: str) -> None:
    data, camera = moved(40), mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, MODEL.camera(name).id
    found = posed(ModelRig(name), data=data)
    assert same(found, updated(camera, data))
    assert found.position == pytest.approx(data.cam(name).xpos)
    assert found.rotation == pytest.approx(data.cam(name).xmat.reshape(3, 3), abs=1e-6)
    assert found.frustum.orthographic == (name == "flat")


def test_a_camera_of_the_model_looks_as_far_as_the_point_of_its_axis_nearest_to_the_centre() -> None:
    pose = posed(ModelRig("fixed"), data=CAMERAS_OF_MODEL.data)
    toward = np.array([0, 0, 1]) - pose.position
    assert pose.distance == pytest.approx(max(toward @ pose.forward, 0.4), rel=1e-6)
    near = np.linalg.norm([0, 0, 1] - pose.lookat)
    assert all(near <= np.linalg.norm([0, 0, 1] - pose.position - d * pose.forward) for d in (0.4, 1, 3, 9))
