"""Theorems about camera calibrations: projection is that of the pinhole matrix, and unprojection undoes it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.model.camera_images import CameraCalibration

TURN = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])  # forward along the world's x
POSE = np.block([[TURN, np.array([[1.0], [2], [3]])], [np.zeros((1, 3)), np.ones((1, 1))]])


def camera(perspective: bool = True) -> CameraCalibration:
    return CameraCalibration((8, 6), 5, 7, 4, 3, POSE, 0.1, 10, perspective)


@given(st.tuples(st.floats(2, 9), st.floats(-3, 3), st.floats(-3, 3)))
def test_a_point_appears_where_the_matrices_say(point: tuple[float, float, float]) -> None:
    local = (np.linalg.inv(POSE) @ [*point, 1])[:3]
    u, v, w = camera().matrix @ local
    assert camera().project(np.array([point]))[0] == pytest.approx([u / w, v / w, local[2]])
    flat = camera(perspective=False).project(np.array([point]))[0]
    assert flat == pytest.approx([5 * local[0] + 4, 7 * local[1] + 3, local[2]])


@pytest.mark.parametrize("perspective", [True, False])
def test_the_centre_of_each_pixel_comes_back_from_the_world(perspective: bool) -> None:
    depth = np.linspace(1, 4, 48).reshape(6, 8)
    points = camera(perspective).unproject(depth).reshape(-1, 3)
    v, u = np.mgrid[:6, :8] + 0.5
    expected = np.stack([u.ravel(), v.ravel(), depth.ravel()], axis=1)
    assert camera(perspective).project(points) == pytest.approx(expected)


def test_what_is_behind_the_camera_has_negative_depth() -> None:
    assert camera().project(np.array([[0.0, 2, 3]]))[0, 2] == pytest.approx(-1)
