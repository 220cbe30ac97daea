"""A table of poses gives back what was put into it, bit for bit, in little memory."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from mjrun.camera.pose import Frustum, Pose, rotation
from mjrun.camera.pose_table import PoseTable

FRUSTUM = Frustum(0.01, 0.02, -0.005, 0.015, 0.02, 40.0)


def moving(count: int) -> list[Pose]:
    turns = [rotation(360 * k / count, -20, 10) for k in range(count)]
    return [Pose(np.array([1 / 3, k, 3]), turn, FRUSTUM, 2 + k) for k, turn in enumerate(turns)]


def still(count: int) -> list[Pose]:
    flat = replace(FRUSTUM, orthographic=True)
    return [Pose(np.array([0.1, 0.2, 0.3]), rotation(30, 0), flat) for _ in range(count)]


def same(one: Pose, other: Pose) -> bool:
    arrays = np.array_equal(one.position, other.position) and np.array_equal(one.rotation, other.rotation)
    return arrays and (one.frustum, one.distance) == (other.frustum, other.distance)


def test_each_frame_has_the_pose_of_each_camera() -> None:
    cameras = [moving(9), still(9), [*still(4), *moving(5)]]
    for table in (PoseTable(cameras), pickle.loads(pickle.dumps(PoseTable(cameras)))):
        assert len(table) == 9
        for index, poses in enumerate(table):
            assert all(same(pose, camera[index]) for pose, camera in zip(poses, cameras, strict=True))
        assert len(table[2:5]) == 3
        assert same(table[2:5][1][0], cameras[0][3])
        assert same(table[-1][2], cameras[2][-1])
    with pytest.raises(IndexError):
        PoseTable(cameras)[9]


def test_a_camera_that_stands_still_is_held_once() -> None:
    sizes = [len(pickle.dumps(PoseTable([poses(1000)]))) for poses in (still, moving)]
    assert sizes[0] < 10_000 < sizes[1] < 180_000
