"""Comparisons of results, and the worst frame of two videos."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mjrun
from mjrun.diff.images_and_videos import WorstFramePair
from mjrun.diff.result import FrameDifference
from mjrun.errors import ModelNotFoundError, UnknownNameError, UsageError
from mjrun.model.sources import parse_source
from mjrun.outputs.diff import (
    APPLICABLE,
    BACKGROUND,
    COMPARISONS,
    GAP,
    IMAGE,
    MODEL,
    RECORDING,
    TABLE,
    VIDEO,
    worst_frame,
    write_worst_frame,
)
from tests.diff.models import CRATE, spec, xml
from tests.formats.table_files import columns, write


def test_two_tables_agree_or_not(tmp_path: Path) -> None:
    names = columns("time", "x")
    a = write(tmp_path / "a.csv", [np.array([[0.0, 1], [1, 2]])], names)
    b = write(tmp_path / "b.npz", [np.array([[0.0, 1], [1, 2.5]])], names)
    result = mjrun.Diff(a, b).run()
    assert (result.kind, result.a, result.b, result.equal) == ("table", str(a), str(b), False)
    assert result.differences == ["x differs in row 1, time 1.0 s: 2.0, not 2.5"]
    assert result.table
    assert mjrun.Diff(a, b, atol=0.5).run().equal


def test_a_kind_of_files_is_reported_before_anything_is_read() -> None:
    assert set(COMPARISONS) <= {TABLE, RECORDING, VIDEO, IMAGE, MODEL}
    with pytest.raises(UsageError, match="only results of the same kind can be compared"):
        mjrun.Diff("a.csv", "b.mp4").run()


def test_two_models_agree_or_not(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(xml())
    (tmp_path / "b.xml").write_text(xml().replace("8.907", "8.908"))
    a, b = tmp_path / "a.xml", tmp_path / "b.xml"
    result = mjrun.Diff(a, b).run()
    assert (result.kind, result.a, result.b, result.equal) == ("model", str(a), str(b), False)
    assert result.differences == ["body_mass[torso] 8.907 → 8.908 kg"]
    assert result.model
    assert [place.line for place in (result.model.xml[0].place_a, result.model.xml[0].place_b) if place] == [15, 15]
    assert mjrun.Diff(a, b, tol={"body_mass": 0.01}, rtol=0.01).run().equal
    assert mjrun.Diff(a, str(a)).run().equal


def test_models_may_be_compiled_and_out_of_a_collection() -> None:
    assert mjrun.Diff("scene:pendulum", parse_source("scene:pendulum")).run().equal
    result = mjrun.Diff(spec().compile(), spec(CRATE).compile()).run()
    assert result.differences == ["only in a compiled model: body crate; joint crate; geom lid"]


def test_options_that_mean_nothing_for_models() -> None:
    with pytest.raises(UsageError, match="columns does not apply to models"):
        mjrun.Diff("scene:pendulum", "scene:car", columns=("qpos",)).run()
    with pytest.raises(UsageError, match="no field 'qpos'"):
        mjrun.Diff("scene:pendulum", "scene:car", tol={"qpos": 1}).run()
    with pytest.raises(UsageError, match=r"is a model and x\.csv is a table"):
        mjrun.Diff("scene:pendulum", "x.csv").run()
    with pytest.raises(ModelNotFoundError, match="no such scene"):
        mjrun.Diff("scene:pendulum", "scene:nothing").run()


def test_two_videos_agree_within_limits_and_their_worst_frame_is_drawn(tmp_path: Path) -> None:
    frames = np.zeros((4, 32, 48, 3), np.uint8)
    frames[2, 8:16] = 90
    mjrun.write_video(str(tmp_path / "a.mp4"), frames, 10)
    mjrun.write_video(str(tmp_path / "b.mp4"), frames[::-1], 10)
    pair = tmp_path / "a.mp4", tmp_path / "b.mp4"
    worst = tmp_path / "worst.png"
    result = mjrun.Diff(*pair, output=worst).run()
    assert (result.kind, result.equal) == ("video", False)
    assert result.differences[0] == "2 of 4 frames differ"
    assert worst.exists()
    assert mjrun.Diff(*pair, max_changed=0.5).run().equal


def test_two_images_and_two_recordings_are_compared(tmp_path: Path) -> None:
    Image.new("RGB", (9, 9)).save(tmp_path / "a.png")
    Image.new("RGB", (9, 9), (0, 0, 1)).save(tmp_path / "b.png")
    result = mjrun.Diff(tmp_path / "a.png", tmp_path / "b.png").run()
    assert (result.kind, len(result.differences)) == ("image", 1)
    assert mjrun.Diff(tmp_path / "a.png", tmp_path / "b.png", atol=1).run().equal

    simulation = mjrun.Simulation("scene:dominos", steps=3)
    mjrun.Recording(simulation, str(tmp_path / "a.npz")).run()
    result = mjrun.Diff(tmp_path / "a.npz", tmp_path / "a.npz", model="scene:dominos").run()
    assert (result.kind, result.equal) == ("recording", True)
    assert result.table
    assert "qpos/" in result.table.columns[0].name or result.table.rows == 4


def test_an_option_that_does_not_apply_is_refused(tmp_path: Path) -> None:
    assert set(COMPARISONS) <= set(APPLICABLE)
    with pytest.raises(UsageError, match=r"min_psnr does not apply to tables"):
        mjrun.Diff("a.csv", "b.csv", min_psnr=3).run()
    with pytest.raises(UsageError, match="columns does not apply to images"):
        mjrun.Diff("a.png", "b.png", columns="x").run()


FOUND = FrameDifference(17, 0.283, 0.031, 9.0, 31.2, 0.912)
NAMES = ("folder/a.mp4", "b\x1b.mp4")


def panels(picture: np.ndarray, height: int, width: int) -> list[np.ndarray]:
    """The images in a picture, from left to right."""
    top = picture.shape[0] - height - GAP
    return [picture[top : top + height, GAP + i * (width + GAP) :][:, :width] for i in range(3)]


def test_both_frames_and_their_difference_stand_side_by_side() -> None:
    a = np.full((300, 400, 3), 100, np.uint8)
    b = a.copy()
    b[50:60, 70:90, 1] += 20
    picture = worst_frame(WorstFramePair(a, b), NAMES, FOUND)
    one, other, difference = panels(picture, 300, 400)
    assert np.array_equal(one, a)
    assert np.array_equal(other, b)
    assert np.array_equal(difference, (b - a) * 8)  # 20 times 8 is the most that 255 holds
    label = picture[: picture.shape[0] - 300 - GAP]
    assert all((part != BACKGROUND).any() for part in np.array_split(label, 3, axis=1))


def test_small_frames_are_enlarged_by_whole_pixels() -> None:
    a = np.zeros((10, 12, 3), np.uint8)
    one, _, _ = panels(worst_frame(WorstFramePair(a + 7, a), NAMES, FOUND), 240, 288)
    assert (one == 7).all()


def test_numbers_share_one_scale_and_what_is_not_finite_is_grey() -> None:
    a = np.array([[0.0, 1.0, np.inf]], np.float32).repeat(2, 0)
    b = np.array([[0.0, 2.0, np.inf]], np.float32).repeat(2, 0)
    one, other, difference = panels(worst_frame(WorstFramePair(a, b), NAMES, FOUND), 240, 360)
    assert np.array_equal(one[0, 0], other[0, 0])
    assert not np.array_equal(one[0, 180], other[0, 180])
    assert np.array_equal(one[0, -1], other[0, -1])
    assert np.array_equal(difference[0, 0], difference[0, -1])
    worst_frame(WorstFramePair(np.zeros((9, 9)), np.zeros((9, 9))), NAMES, None)


def test_it_is_published_as_an_image(tmp_path: Path) -> None:
    frames = WorstFramePair(np.zeros((50, 60, 3), np.uint8), np.ones((50, 60, 3), np.uint8))
    write_worst_frame(str(tmp_path / "worst.png"), frames, NAMES, FOUND)
    with Image.open(tmp_path / "worst.png") as image:
        assert np.array_equal(np.array(image), worst_frame(frames, NAMES, FOUND))
    with pytest.raises(UnknownNameError):
        write_worst_frame(str(tmp_path / "worst.txt"), frames, NAMES, FOUND)
