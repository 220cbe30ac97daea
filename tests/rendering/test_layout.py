"""Pictures composed: each lands where the layout says, to the pixel."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import UnknownNameError
from mjrun.options.rendering import LAYOUTS
from mjrun.rendering.compositor import columns, compose_panels, gap, layout_size, places
from mjrun.rendering.text import BACKGROUND, stamp

layouts = st.sampled_from(LAYOUTS)
sizes = st.tuples(st.integers(1, 90), st.integers(1, 90))


def noise(count: int, width: int, height: int) -> list[np.ndarray]:
    rng = np.random.default_rng(count)
    return [rng.integers(60, 256, (height, width, 3), np.uint8) for _ in range(count)]


@given(st.integers(1, 9), sizes, layouts)
@settings(deadline=None)
def test_every_picture_is_in_its_place_and_nothing_else_is_there(
    count: int, size: tuple[int, int], layout: str
) -> None:
    pictures = noise(count, *size)
    whole = compose_panels(pictures, layout)
    assert whole.dtype == np.uint8
    assert whole.shape == (*layout_size(count, size, layout)[::-1], 3)
    for picture, (x, y) in zip(pictures, places(count, size, layout), strict=True):
        panel = whole[y : y + size[1], x : x + size[0]]
        assert np.array_equal(panel, picture)
        panel[:] = BACKGROUND
    assert (whole == BACKGROUND).all()


def test_rows_and_columns_are_what_they_are_called() -> None:
    assert layout_size(3, (320, 240), "row") == (3 * 320 + 2 * 2, 240)
    assert layout_size(3, (320, 240), "column") == (320, 3 * 240 + 2 * 2)
    assert layout_size(4, (1920, 1080), "grid") == (2 * 1920 + 8, 2 * 1080 + 8)
    assert places(3, (320, 240), "row") == [(0, 0), (322, 0), (644, 0)]
    assert places(4, (320, 240), "grid") == [(0, 0), (322, 0), (0, 242), (322, 242)]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_one_picture_is_itself(layout: str) -> None:
    (picture,) = noise(1, 40, 30)
    assert np.array_equal(compose_panels([picture], layout), picture)


@given(st.integers(1, 12), st.integers(1, 400), st.integers(1, 400), layouts)
def test_even_pictures_make_an_even_whole(count: int, half_width: int, half_height: int, layout: str) -> None:
    width, height = layout_size(count, (2 * half_width, 2 * half_height), layout)
    assert width % 2 == height % 2 == 0


def test_the_gap_grows_with_the_picture() -> None:
    assert [gap(height) for height in (64, 240, 480, 1080, 2160)] == [2, 2, 4, 8, 18]


@pytest.mark.parametrize(("count", "across"), [(1, 1), (2, 2), (4, 2), (6, 3), (9, 3), (12, 4), (16, 4)])
def test_a_grid_of_wide_pictures_is_as_wide(count: int, across: int) -> None:
    assert columns(count, (1920, 1080), "grid") == across


@given(st.integers(1, 30), sizes)
def test_no_other_full_grid_comes_nearer_to_16_by_9(count: int, size: tuple[int, int]) -> None:
    def off(across: int) -> float:
        down = math.ceil(count / across)
        between = gap(size[1])
        width, height = across * (size[0] + between) - between, down * (size[1] + between) - between
        return abs(math.log(width / height * 9 / 16))

    chosen = columns(count, size, "grid")
    assert 1 <= chosen <= count
    assert (math.ceil(count / chosen) - 1) * chosen < count  # no empty row
    assert all(off(chosen) <= off(across) + 0.011 for across in range(1, count + 1) if count % across == 0)


def test_labels_are_stamped_on_their_own_panel() -> None:
    pictures = noise(3, 160, 120)
    whole = compose_panels(pictures, "row", ["side · depth", "", "top · rgb"])
    for picture, label, (x, y) in zip(pictures, ("side · depth", "", "top · rgb"), places(3, (160, 120)), strict=True):
        expected = picture.copy()
        if label:
            stamp(expected, label)
        assert np.array_equal(whole[y : y + 120, x : x + 160], expected)


def test_the_pictures_stay_as_they_were() -> None:
    pictures = noise(2, 80, 60)
    compose_panels(pictures, "row", ["a", "b"])
    assert all(np.array_equal(*pair) for pair in zip(pictures, noise(2, 80, 60), strict=True))


def test_what_does_not_fit_together_is_refused() -> None:
    with pytest.raises(
        UnknownNameError, match=r"no layout 'gird' \(did you mean 'grid'\?\)\nlayouts: row, column, grid"
    ):
        compose_panels(noise(2, 8, 8), "gird")
    with pytest.raises(ValueError, match="images must have the same size"):
        compose_panels([*noise(1, 8, 8), *noise(1, 9, 8)])
    with pytest.raises(ValueError, match="zip"):
        compose_panels(noise(2, 8, 8), "row", ["one"])
