"""Calibration files, read as each format says, against the lens that was written."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mjrun.errors import UsageError
from mjrun.formats.calibration_writer import CalibrationEntry, CalibrationWriter
from mjrun.model.camera_images import CameraCalibration

RANDOM = np.random.default_rng(7)
POINTS = RANDOM.uniform(-1, 1, (20, 3))


def a_lens(height: float = 3.0, focal: float = 411.7, perspective: bool = True) -> CameraCalibration:
    """A camera that looks down from somewhere at points near the origin, turned by an arbitrary angle."""
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, :3] = turn @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = [0.1, 1 / 3, height]
    return CameraCalibration((641, 479), focal, focal * 1.1, 300.1, 251 / 3, pose, 0.01, 50.0, perspective)


def film(count: int = 3, **settings: Any) -> list[CalibrationEntry]:
    """Pictures of a camera that rises."""
    return [
        CalibrationEntry("side", a_lens(3 + k / 7, **settings), k, k / 30, f"frames/{k:06d}.png", f"depth/{k:06d}.png")
        for k in range(count)
    ]


def written(folder: Path, format: str, entries: list[CalibrationEntry], name: str = "out") -> str:  # noqa: A002
    cameras = list(dict.fromkeys(entry.camera for entry in entries))
    with CalibrationWriter(str(folder / name), format, cameras) as writer:
        for entry in entries:
            writer.write(entry)
        assert writer.publish() == [folder / name]
    return (folder / name).read_text("utf-8")


def test_our_own_file_says_all_of_a_lens_to_the_last_bit(tmp_path: Path) -> None:
    exposures = [*film(2), CalibrationEntry("top view", a_lens(perspective=False), 1, 1 / 30)]
    document = json.loads(written(tmp_path, "mjrun", exposures))
    assert document["axes"] == "opencv"
    assert document["pixel_center"] == 0.5
    assert len(document["frames"]) == 3
    for entry, exposure in zip(document["frames"], exposures, strict=True):
        lens = exposure.lens
        (fx, _, cx), (_, fy, cy), _ = entry["K"]
        assert (entry["camera"], entry["frame"], entry["time"]) == (exposure.camera, exposure.frame, exposure.time)
        assert (*entry["size"], fx, fy, cx, cy) == (*lens.size, lens.fx, lens.fy, lens.cx, lens.cy)
        assert np.array_equal(entry["world_from_camera"], lens.pose)
        assert (entry["near"], entry["far"], entry["perspective"]) == (lens.near, lens.far, lens.perspective)
    assert document["frames"][0]["file"] == "frames/000000.png"
    assert "file" not in document["frames"][2]


def test_nerfstudio_s_cameras_look_along_minus_z_at_pixels_with_centres_at_a_half(tmp_path: Path) -> None:
    document = json.loads(written(tmp_path, "nerfstudio", film()))
    assert document["camera_model"] == "OPENCV"
    assert [document[name] for name in ("k1", "k2", "p1", "p2")] == [0, 0, 0, 0]
    assert "fl_x" not in document  # it would count for every frame
    for frame, exposure in zip(document["frames"], film(), strict=True):
        x, y, z, _ = np.linalg.inv(frame["transform_matrix"]) @ np.column_stack([POINTS, np.ones(20)]).T
        u, v = frame["fl_x"] * x / -z + frame["cx"], frame["cy"] - frame["fl_y"] * y / -z
        assert np.stack([u, v], axis=1) == pytest.approx(exposure.lens.project(POINTS)[:, :2])
        assert (frame["w"], frame["h"]) == (641, 479)
        assert (frame["file_path"], frame["depth_file_path"]) == (exposure.file, exposure.depth)
        assert np.linalg.det(frame["transform_matrix"]) == pytest.approx(1)


def test_bop_projects_millimetres_to_pixels_with_centres_at_whole_numbers(tmp_path: Path) -> None:
    document = json.loads(written(tmp_path, "bop", film()))
    assert list(document) == ["0", "1", "2"]
    for entry, exposure in zip(document.values(), film(), strict=True):
        rotation, shift = np.reshape(entry["cam_R_w2c"], (3, 3)), np.array(entry["cam_t_w2c"])
        u, v, s = np.reshape(entry["cam_K"], (3, 3)) @ (rotation @ (1000 * POINTS.T) + shift[:, None])
        u, v, depth = u / s + 0.5, v / s + 0.5, s * entry["depth_scale"] / 1000
        assert np.stack([u, v, depth], axis=1) == pytest.approx(exposure.lens.project(POINTS))


def test_ros_reads_one_lens_whose_pixels_have_centres_at_whole_numbers(tmp_path: Path) -> None:
    document = yaml.safe_load(written(tmp_path, "ros", film()))
    lens = a_lens()
    assert (document["image_width"], document["image_height"]) == lens.size
    assert (document["camera_name"], document["distortion_model"]) == ("side", "plumb_bob")
    matrices = {
        name: np.reshape(entry["data"], (entry["rows"], entry["cols"]))
        for name, entry in document.items()
        if isinstance(entry, dict)
    }
    assert matrices["camera_matrix"].tolist() == [
        [lens.fx, 0, lens.cx - 0.5],
        [0, lens.fy, lens.cy - 0.5],
        [0, 0, 1],
    ]
    assert matrices["projection_matrix"].tolist() == [[*row, 0] for row in matrices["camera_matrix"].tolist()]
    assert matrices["rectification_matrix"].tolist() == np.eye(3).tolist()
    assert matrices["distortion_coefficients"].tolist() == [[0] * 5]


@pytest.mark.parametrize("focal", [1e-7, 1e22, 411.0, 1 / 3])
def test_every_number_is_a_number_in_yaml_too(tmp_path: Path, focal: float) -> None:
    document = yaml.safe_load(written(tmp_path, "ros", film(1, focal=focal)))
    assert document["camera_matrix"]["data"][0] == focal
    assert all(type(number) is float for number in document["projection_matrix"]["data"])


@pytest.mark.parametrize("name", ["camera:3", 'a"b\n: [', "\x1b[31m", "no", "1", "кам"])
def test_any_name_of_a_camera_is_text(tmp_path: Path, name: str) -> None:
    exposure = CalibrationEntry(name, a_lens())
    ros = yaml.safe_load(written(tmp_path, "ros", [exposure]))["camera_name"]
    assert isinstance(ros, str)
    assert ros.replace("_", "a").isalnum()
    assert json.loads(written(tmp_path, "mjrun", [exposure], "ours"))["frames"][0]["camera"] == name


@pytest.mark.parametrize("format", ["nerfstudio", "bop", "ros"])
def test_an_orthographic_camera_is_refused_where_the_format_knows_none(tmp_path: Path, format: str) -> None:  # noqa: A002
    message = f"calibration_format {format}: it has no orthographic cameras, and top is one"
    with pytest.raises(UsageError, match=message):
        CalibrationWriter(str(tmp_path / "out"), format, ["top"], orthographic=["top"])
    with CalibrationWriter(str(tmp_path / "out"), format) as writer, pytest.raises(UsageError, match=message):
        writer.write(CalibrationEntry("top", a_lens(perspective=False)))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("format", ["bop", "ros"])
def test_several_cameras_are_refused_where_a_file_is_about_one(tmp_path: Path, format: str) -> None:  # noqa: A002
    with pytest.raises(UsageError, match=r"a file describes one camera, not 2: side, top\n.*mjrun can hold it"):
        CalibrationWriter(str(tmp_path / "out"), format, ["side", "top"])


def test_a_lens_that_changes_is_refused_where_a_file_is_about_one(tmp_path: Path) -> None:
    with CalibrationWriter(str(tmp_path / "out"), "ros") as writer:
        writer.write(film(1)[0])
        with pytest.raises(UsageError, match="describes one lens, and this one changes at frame 4"):
            writer.write(CalibrationEntry("side", a_lens(focal=100), 4))
    assert list(tmp_path.iterdir()) == []


def test_nerfstudio_needs_pictures_in_files(tmp_path: Path) -> None:
    message = "it names the file of each colour image: write a folder of PNGs"
    with pytest.raises(UsageError, match=message):
        CalibrationWriter(str(tmp_path / "out"), "nerfstudio", ["side"], image_files=False)
    with CalibrationWriter(str(tmp_path / "out"), "nerfstudio") as writer, pytest.raises(UsageError, match=message):
        writer.write(CalibrationEntry("side", a_lens()))


def test_an_unknown_format_is_refused_with_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no calibration format 'nerf'.*\n.*mjrun, nerfstudio, bop, ros"):
        CalibrationWriter(str(tmp_path / "out"), "nerf")
