"""Labels of YOLO, against the boxes and masks that they describe."""

import numpy as np
import pytest
import yaml

from mjrun.errors import UsageError
from mjrun.formats.datasets import DatasetRecords
from mjrun.formats.datasets.yolo import files
from tests.formats.datasets.dataset_of_two import HEIGHT, WIDTH, dataset, mask


def lines(task: str, name: str = "labels/0.txt") -> list[list[float]]:
    text = dict(files(dataset(yolo_task=task)))[name].decode()
    return [[float(number) for number in line.split()] for line in text.splitlines()]


def test_boxes_are_relative_to_the_size_of_the_image() -> None:
    for index, (category, x, y, width, height) in enumerate(lines("detect")):
        rows, columns = np.nonzero(mask(index))
        assert category == index
        np.testing.assert_allclose((x - width / 2) * WIDTH, columns.min(), atol=1e-4)
        np.testing.assert_allclose((x + width / 2) * WIDTH, columns.max() + 1, atol=1e-4)
        np.testing.assert_allclose((y - height / 2) * HEIGHT, rows.min(), atol=1e-4)
        np.testing.assert_allclose((y + height / 2) * HEIGHT, rows.max() + 1, atol=1e-4)
    assert len(lines("detect", "labels/5.txt")) == 1


def test_segments_are_the_largest_part_of_each_mask() -> None:
    from matplotlib.path import Path as Outline

    category, *numbers = lines("segment")[0]
    outline = np.array(numbers).reshape(-1, 2) * [WIDTH, HEIGHT]
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    filled = Outline(outline).contains_points(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(HEIGHT, WIDTH)
    expected = mask(0)
    expected[3, 5] = True
    assert category == 0
    np.testing.assert_array_equal(filled, expected)


def test_poses_have_the_same_number_of_keypoints() -> None:
    first, second = lines("pose")
    np.testing.assert_allclose(first[5:], [4.5 / WIDTH, 3.25 / HEIGHT, 2, 0, 0, 0], atol=1e-5)
    assert second[5:] == [0] * 6
    with pytest.raises(UsageError, match="no object has"):
        files(DatasetRecords({"train": []}, [("a", "thing", ())], yolo_task="pose"))


def test_the_description_lists_images_and_names() -> None:
    written = dict(files(dataset(yolo_task="pose")))
    description = yaml.safe_load(written["data.yaml"])
    expected = {"train": "train.txt", "val": "val.txt", "names": {0: "thing", 1: "other"}, "kpt_shape": [2, 3]}
    assert description == expected
    assert written["train.txt"] == b"./images/0.png\n"
    alone = dict(files(DatasetRecords({"all": dataset().records["train"]}, dataset().objects)))
    assert yaml.safe_load(alone["data.yaml"])["val"] == "all.txt"
