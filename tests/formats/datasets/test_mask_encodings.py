"""Outlines of masks, against filling them again."""

import numpy as np
import pytest

from mjrun.formats.datasets.coco import mask_of, polygons
from mjrun.formats.segmentation_labels import regions


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
