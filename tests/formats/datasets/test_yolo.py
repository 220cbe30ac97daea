"""Labels of YOLO, against the boxes and masks that they describe."""

import numpy as np
import pytest
import yaml

from mjrun.formats.datasets import DatasetRecords
from mjrun.formats.datasets.yolo import files
from tests.formats.datasets.dataset_of_two import HEIGHT, IDS, WIDTH, dataset, image, mask


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


STAIRS: np.ndarray = np.full((HEIGHT, WIDTH), -1)  # a part with few pixels and many corners, and a larger one
STAIRS[[1, 1, 2, 2, 3, 3, 4], [0, 1, 1, 2, 2, 3, 3]], STAIRS[1:7, 6:11] = 0, 0


@pytest.mark.parametrize("ids", [IDS, STAIRS])
def test_segments_are_the_largest_part_of_each_mask(ids: np.ndarray) -> None:
    from matplotlib.path import Path as Outline
    from scipy import ndimage

    made = DatasetRecords({"train": [image(0, ids)]}, dataset().objects, yolo_task="segment")
    rows = dict(files(made))["labels/0.txt"].decode().splitlines()
    assert [row.split()[0] for row in rows] == [str(index) for index in np.unique(ids[ids >= 0])]
    for row in rows:
        category, *numbers = map(float, row.split())
        outline = np.array(numbers).reshape(-1, 2) * [WIDTH, HEIGHT]
        x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
        filled = Outline(outline).contains_points(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(HEIGHT, WIDTH)
        parts, _ = ndimage.label(ids == category)
        largest = 1 + np.argmax(np.bincount(parts.ravel())[1:])
        np.testing.assert_array_equal(filled, ndimage.binary_fill_holes(parts == largest))


def test_poses_have_the_same_number_of_keypoints() -> None:
    first, second = lines("pose")
    np.testing.assert_allclose(first[5:], [4.5 / WIDTH, 3.25 / HEIGHT, 2, 0, 0, 0], atol=1e-5)
    assert second[5:] == [0] * 6


def test_the_description_lists_images_and_names() -> None:
    written = dict(files(dataset(yolo_task="pose")))
    description = yaml.safe_load(written["data.yaml"])
    expected = {"train": "train.txt", "val": "val.txt", "names": {0: "thing", 1: "other"}, "kpt_shape": [2, 3]}
    assert description == expected
    assert written["train.txt"] == b"./images/0.png\n"
    alone = dict(files(DatasetRecords({"all": dataset().records["train"]}, dataset().objects)))
    assert yaml.safe_load(alone["data.yaml"])["val"] == "all.txt"


def test_yaml_reads_back_names_in_any_script() -> None:
    names = ["Würfel", "立方体", "🤖 arm", 'a "b": c\\', "\x7f\x85\u2028"]
    written = dict(files(DatasetRecords({"train": []}, [(name, name, ()) for name in names])))
    assert yaml.safe_load(written["data.yaml"])["names"] == dict(enumerate(names))
