"""Point clouds, read by a parser of their own, against the geometry that was drawn."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.camera.pose import lens, pose_of
from mjrun.errors import UsageError
from mjrun.formats.pointcloud import PointCloudWriter
from mjrun.model.camera_images import CameraCalibration, CameraImages, SegmentedObject
from tests.cases import mjcf

KINDS = {"float": "<f4", "uchar": "u1", "int": "<i4"}


def read(path: Path) -> tuple[list[str], np.ndarray]:
    """The header's lines and the points of a PLY file, as paulbourke.net/dataformats/ply says."""
    head, body = path.read_bytes().split(b"end_header\n", 1)
    lines = head.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    rest = [line.split() for line in lines[2:] if not line.startswith("comment ")]
    (element, vertex, count), *properties = rest
    assert (element, vertex) == ("element", "vertex")
    assert all(word == "property" for word, _, _ in properties)
    points = np.frombuffer(body, [(name, KINDS[kind]) for _, kind, name in properties])
    assert len(points) == int(count)
    return lines, points


def places(points: np.ndarray) -> np.ndarray:
    return np.stack([points[name] for name in "xyz"], axis=1)


SCENE = mjcf("table_and_cameras")
LEGEND = [SegmentedObject("geom", 0, "table", "world"), SegmentedObject("geom", 1, "cube", "world")]


def pictures(*cameras: str, size: tuple[int, int] = (80, 61)) -> list[CameraImages]:
    """The scene as MuJoCo's own renderer sees it."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = []
    with mujoco.Renderer(model, size[1], size[0]) as renderer:
        for camera in cameras:
            renderer.update_scene(data, camera)
            rgb = renderer.render()
            renderer.enable_segmentation_rendering()
            ids = renderer.render()[..., 0]
            renderer.enable_depth_rendering()
            depth = np.where(ids < 0, np.inf, renderer.render()).astype(np.float32)
            renderer.disable_depth_rendering()
            found.append(CameraImages(lens(pose_of(renderer.scene), size), rgb, depth, ids, LEGEND))
    return found


def cloud(folder: Path, *seen: CameraImages, legend: list[SegmentedObject] | None = None) -> np.ndarray:
    with PointCloudWriter(str(folder / "cloud.ply"), legend) as writer:
        for picture in seen:
            writer.write(picture)
        assert writer.publish() == [folder / "cloud.ply"]
    return read(folder / "cloud.ply")[1]


@pytest.mark.parametrize("cameras", [["left"], ["above"], ["left", "right", "above"]])
def test_points_lie_on_what_was_drawn(tmp_path: Path, cameras: list[str]) -> None:
    seen = pictures(*cameras)
    points = cloud(tmp_path, *seen, legend=LEGEND)
    assert len(points) == sum(np.isfinite(picture.depth).sum() for picture in seen if picture.depth is not None)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for geom in (0, 1):
        own = places(points[points["label"] == geom])
        assert len(own) > 50
        local = (own - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
        off = np.abs(local[:, 2]) if geom == 0 else np.abs(np.abs(local).max(axis=1) - 0.2)
        assert off.max() < 1e-4
        assert np.abs(local).max() < [1.0001, 0.2001][geom]


def test_points_have_the_colours_of_their_pixels(tmp_path: Path) -> None:
    (picture,) = pictures("left")
    points = cloud(tmp_path, picture)
    assert points.dtype.names == ("x", "y", "z", "red", "green", "blue")
    assert picture.rgb is not None
    assert picture.depth is not None
    colors = np.stack([points[name] for name in ("red", "green", "blue")], axis=1)
    assert np.array_equal(colors, picture.rgb[np.isfinite(picture.depth)])
    back = picture.calibration.project(places(points).astype(float))[:, :2]
    rows, columns = np.nonzero(np.isfinite(picture.depth))
    assert back == pytest.approx(np.stack([columns + 0.5, rows + 0.5], axis=1), abs=1e-2)


def a_picture(width: int, height: int) -> CameraImages:
    """A wall one metre away that fills the view."""
    through = CameraCalibration((width, height), 100, 100, width / 2, height / 2, np.eye(4), 0.01, 10)
    shape = (height, width)
    return CameraImages(through, np.zeros((*shape, 3), np.uint8), np.ones(shape, np.float32), np.zeros(shape, np.int32))


def test_what_labels_mean_stands_in_the_header_in_plain_ascii(tmp_path: Path) -> None:
    legend = [SegmentedObject("geom", 0, "floor"), SegmentedObject("site", 3, "ö\x1b[31m\nend_header")]
    cloud(tmp_path, a_picture(3, 2), legend=legend)
    lines, _ = read(tmp_path / "cloud.ply")
    assert "comment label 0: geom 'floor'" in lines
    assert r"comment label 1: site '\xf6\x1b[31m\nend_header'" in lines


@pytest.mark.parametrize("count", [0, 1, 12, 3000])
def test_the_count_in_the_header_is_that_of_the_points(tmp_path: Path, count: int) -> None:
    assert len(cloud(tmp_path, *[a_picture(1, 1)] * count)) == count


def test_a_picture_without_what_points_need_is_refused(tmp_path: Path) -> None:
    whole = a_picture(3, 2)
    with PointCloudWriter(str(tmp_path / "cloud.ply"), LEGEND) as writer:
        for missing in ("rgb", "depth", "ids"):
            with pytest.raises(ValueError, match="needs depth and rgb, and ids"):
                writer.write(replace(whole, **{missing: None}))


def test_only_ply_is_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"a point cloud is a PLY file; its name must end in \.ply"):
        PointCloudWriter(str(tmp_path / "cloud.pcd"))
