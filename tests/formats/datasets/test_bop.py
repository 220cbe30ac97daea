"""BOP documents, against projections in the pixels of OpenCV."""

import json
from dataclasses import replace

import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.formats.datasets import DatasetRecords
from mjrun.formats.datasets.bop import files
from mjrun.scene_graph.object_meshes import ObjectMesh
from tests.formats.datasets.dataset_of_two import POSE, dataset, image


def test_a_point_of_an_object_projects_to_the_same_pixel() -> None:
    written = {path: json.loads(content) for path, content in files(dataset())}
    camera = written["train/000000/scene_camera.json"]["0"]
    pose = written["train/000000/scene_gt.json"]["0"][0]
    point = np.array([0.1, 0.2, 0.3])
    seen = np.reshape(pose["cam_R_m2c"], (3, 3)) @ (1000 * point) + pose["cam_t_m2c"]
    pixel = np.reshape(camera["cam_K"], (3, 3)) @ (seen / seen[2])

    x, y, z = POSE[:3, :3] @ point + POSE[:3, 3]
    np.testing.assert_allclose(pixel[:2] + 0.5, [20 * x / z + 6, 21 * y / z + 4.5])
    world = np.reshape(camera["cam_R_w2c"], (3, 3)) @ (1000 * POSE[:3, 3]) + camera["cam_t_w2c"]
    np.testing.assert_allclose(world, 0, atol=1e-9)  # the camera itself
    assert pose["obj_id"] == 1


def test_objects_that_are_not_visible_have_no_box() -> None:
    info = json.loads(dict(files(dataset()))["val/000000/scene_gt_info.json"])["5"]
    assert info[0]["bbox_visib"] == [3, 2, 6, 4]
    assert info[0]["bbox_obj"] == [2, 2, 7, 5]
    assert info[1]["bbox_visib"] == [-1, -1, -1, -1]
    assert (info[0]["px_count_all"], info[0]["px_count_visib"], info[1]["visib_fract"]) == (30, 23, 0)
    assert [each["px_count_valid"] for each in info] == [30, 27]  # within the image


def test_models_of_objects_are_in_millimetres() -> None:
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0.3]])
    up = np.tile([0.0, 0.0, 1.0], (3, 1))
    mesh = ObjectMesh(corners, up, np.full((3, 3), 7, np.uint8), np.array([[0, 1, 2]]))
    written = dict(files(replace(dataset(), meshes=[None, mesh])))
    assert [path for path in written if "models" in path] == ["models/obj_000002.ply", "models/models_info.json"]
    sizes = {"min_x": 0, "min_y": 0, "min_z": 0, "size_x": 100, "size_y": 200, "size_z": 300}
    info = json.loads(written["models/models_info.json"])
    assert info == {"2": {"diameter": pytest.approx(1000 * np.sqrt(0.14)), **sizes}}
    header, _, binary = written["models/obj_000002.ply"].partition(b"end_header\n")
    assert b"element vertex 3\nproperty float x\n" in header
    assert header.endswith(b"element face 1\nproperty list uchar int vertex_indices\n")
    vertices = np.frombuffer(binary, "<f4, <f4, <f4, <f4, <f4, <f4, u1, u1, u1", 3)
    assert vertices[2].tolist() == (0, 200, 300, 0, 0, 1, 7, 7, 7)
    assert np.frombuffer(binary, "u1, (3,)<i4", 1, vertices.nbytes)[0][1].tolist() == [0, 1, 2]


def test_orthographic_cameras_are_refused() -> None:
    flat = {**image(0), "perspective": False}
    with pytest.raises(UsageError, match="bop has no orthographic cameras"):
        files(DatasetRecords({"train": [flat]}, dataset().objects))
