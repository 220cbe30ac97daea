"""The picture of the worst frame."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mjrun.diff.pictures import WorstFrames
from mjrun.diff.result import FrameDifference
from mjrun.errors import UnknownNameError
from mjrun.outputs.worst_frame import BACKGROUND, GAP, worst_frame, write_worst_frame

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
    picture = worst_frame(WorstFrames(a, b), NAMES, FOUND)
    one, other, difference = panels(picture, 300, 400)
    assert np.array_equal(one, a)
    assert np.array_equal(other, b)
    assert np.array_equal(difference, (b - a) * 8)  # 20 times 8 is the most that 255 holds
    label = picture[: picture.shape[0] - 300 - GAP]
    assert all((part != BACKGROUND).any() for part in np.array_split(label, 3, axis=1))


def test_small_frames_are_enlarged_by_whole_pixels() -> None:
    a = np.zeros((10, 12, 3), np.uint8)
    one, _, _ = panels(worst_frame(WorstFrames(a + 7, a), NAMES, FOUND), 240, 288)
    assert (one == 7).all()


def test_numbers_share_one_scale_and_what_is_not_finite_is_grey() -> None:
    a = np.array([[0.0, 1.0, np.inf]], np.float32).repeat(2, 0)
    b = np.array([[0.0, 2.0, np.inf]], np.float32).repeat(2, 0)
    one, other, difference = panels(worst_frame(WorstFrames(a, b), NAMES, FOUND), 240, 360)
    assert np.array_equal(one[0, 0], other[0, 0])
    assert not np.array_equal(one[0, 180], other[0, 180])
    assert np.array_equal(one[0, -1], other[0, -1])
    assert np.array_equal(difference[0, 0], difference[0, -1])
    worst_frame(WorstFrames(np.zeros((9, 9)), np.zeros((9, 9))), NAMES, None)


def test_it_is_published_as_an_image(tmp_path: Path) -> None:
    frames = WorstFrames(np.zeros((50, 60, 3), np.uint8), np.ones((50, 60, 3), np.uint8))
    write_worst_frame(str(tmp_path / "worst.png"), frames, NAMES, FOUND)
    with Image.open(tmp_path / "worst.png") as image:
        assert np.array_equal(np.array(image), worst_frame(frames, NAMES, FOUND))
    with pytest.raises(UnknownNameError):
        write_worst_frame(str(tmp_path / "worst.txt"), frames, NAMES, FOUND)
