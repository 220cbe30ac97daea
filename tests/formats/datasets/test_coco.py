"""COCO documents, read by pycocotools; outlines of masks, against filling them again."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjrun.formats.datasets.coco import files, mask_of, polygons
from mjrun.formats.segmentation_labels import regions
from tests.formats.datasets.dataset_of_two import dataset, mask


def read(tmp_path: Path, content: bytes) -> Any:
    from pycocotools.coco import COCO

    path = tmp_path / "instances.json"
    path.write_bytes(content)
    return COCO(str(path))


@pytest.mark.filterwarnings("ignore:__array__:DeprecationWarning")  # in pycocotools
@pytest.mark.parametrize("polygons", [False, True], ids=["run lengths", "polygons"])
def test_pycocotools_reads_the_masks(tmp_path: Path, polygons: bool) -> None:
    written: Sequence[tuple[str, bytes]] = files(dataset(polygons=polygons))
    assert [path for path, _ in written] == ["annotations/instances_train.json", "annotations/instances_val.json"]
    coco = read(tmp_path, written[0][1])
    assert [each["name"] for each in coco.loadCats(coco.getCatIds())] == ["thing", "other"]
    for annotation, index in zip(coco.loadAnns(coco.getAnnIds(imgIds=[0])), (0, 1), strict=True):
        expected = mask(index)
        if polygons and index == 0:
            expected[3, 5] = True  # holes are filled
        np.testing.assert_array_equal(coco.annToMask(annotation).astype(bool), expected)
        assert annotation["area"] == mask(index).sum()
        rows, columns = np.nonzero(mask(index))
        low, high = (columns.min(), rows.min()), (columns.max() + 1, rows.max() + 1)
        assert annotation["bbox"] == [*low, high[0] - low[0], high[1] - low[1]]


def test_keypoints_belong_to_their_category(tmp_path: Path) -> None:
    coco = read(tmp_path, files(dataset())[1][1])
    (annotation,) = coco.loadAnns(coco.getAnnIds())
    assert coco.loadCats([1])[0]["keypoints"] == ["tip", "end"]
    assert annotation["keypoints"] == [4.5, 3.25, 2, 0, 0, 0]
    assert annotation["num_keypoints"] == 1
    assert annotation["image_id"] == 5


@pytest.mark.parametrize("seed", range(5))
def test_filling_the_outlines_gives_the_mask_without_holes(seed: int) -> None:
    from matplotlib.path import Path as Outline
    from scipy.ndimage import binary_fill_holes

    mask = np.random.default_rng(seed).random((15, 20)) < 0.55
    x, y = np.meshgrid(np.arange(20) + 0.5, np.arange(15) + 0.5)
    centers = np.stack([x.ravel(), y.ravel()], axis=1)
    filled = np.zeros(mask.size, bool)
    for outline in polygons(mask):
        filled |= Outline(outline).contains_points(centers)
    np.testing.assert_array_equal(filled.reshape(mask.shape), binary_fill_holes(mask, np.ones((3, 3))))


def test_run_lengths_give_the_mask() -> None:
    mask = np.random.default_rng(1).random((7, 11)) < 0.5
    (region,) = regions(np.where(mask, 0, -1))
    np.testing.assert_array_equal(mask_of(region.counts, (11, 7)), mask)


def test_a_rectangle_has_an_outline_along_its_borders() -> None:
    mask = np.zeros((8, 10), bool)
    mask[2:5, 3:7] = True
    (outline,) = polygons(mask)
    assert len(outline) == 8  # its corners are cut by a quarter of a pixel
    np.testing.assert_array_equal([outline.min(axis=0), outline.max(axis=0)], [[3, 2], [7, 5]])
