"""Colours: of depth, invertible; of things, distinguishable and lasting."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.model.camera_images import SegmentedObject
from mjrun.rendering.colormaps import (
    UNSEEN,
    colormap_table,
    colors_of,
    colour_bar,
    depth_colors,
    depth_range,
    figures,
    in_view,
    legend,
    oklab,
    seg_colors,
    segmentation_palette,
    ticks,
)
from mjrun.rendering.text import crisp, text_size
from tests.cases import cases

THINGS = [SegmentedObject("geom", i, f"part_{i}", "robot") for i in range(200)]
finite = st.floats(-1e9, 1e9)


def packed(colors: np.ndarray) -> np.ndarray:
    """Each colour as one number."""
    return colors.astype(int) @ [1, 256, 65536]


def nearest(colors: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The distance in OKLab of each of `colors` from the nearest of `others` that is not itself."""
    distance = np.linalg.norm(oklab(colors)[:, None] - oklab(others)[None], axis=-1)
    return np.where(distance < 1e-9, np.inf, distance).min(axis=1)


@pytest.mark.parametrize("name", ["turbo", "inferno"])
def test_a_colour_map_is_the_published_one(name: str) -> None:
    published = pytest.importorskip("matplotlib").colormaps[name](np.arange(256))[:, :3] * 255
    assert np.abs(colormap_table(name) - published).max() < 2.5


def test_lightness_rises_with_the_difference() -> None:
    lightness = oklab(colormap_table("inferno"))[:, 0]
    assert np.diff(lightness[::4]).min() > 0


def test_the_map_runs_from_near_to_far_and_stops_there() -> None:
    table = colormap_table()
    colors = depth_colors(np.array([[1.0, 3.0, 0.2, 9.0, -1.0]], np.float32), 1, 3)[0]
    assert np.array_equal(colors, table[[0, 255, 0, 255, 0]])
    assert len(np.unique(table, axis=0)) > 190


def test_the_background_looks_like_no_depth() -> None:
    depth = np.array([[np.inf, np.nan, -np.inf, 1.0]], np.float32)
    colors = depth_colors(depth, 0.5, 2)[0]
    assert np.array_equal(colors[:3], [UNSEEN] * 3)
    assert max(UNSEEN) - min(UNSEEN) < 8
    assert all(nearest(np.array([UNSEEN]), colormap_table(name)) > 0.07 for name in ("turbo", "inferno"))


@given(st.floats(0.01, 50), st.floats(0.01, 500), st.integers(1, 40))
@settings(deadline=None)
def test_depth_can_be_read_back_from_its_colour(near: float, span: float, rows: int) -> None:
    depth = np.random.default_rng(rows).uniform(near, near + span, (rows, 7)).astype(np.float32)
    table = colormap_table().astype(int)
    colors = depth_colors(depth, near, near + span)
    assert colors.shape == (rows, 7, 3)
    shades = ((colors[:, :, None].astype(int) - table) ** 2).sum(axis=-1).argmin(axis=-1)
    # Neighbouring shades may be equal, hence a step of tolerance beside the half that rounding takes.
    assert np.abs(near + shades / 255 * span - depth).max() <= 1.6 * span / 255 + 1e-6 * (near + span)


def test_a_range_covers_what_is_seen_without_the_odd_pixel() -> None:
    rng = np.random.default_rng(0)
    depth = rng.uniform(2, 5, (100, 100)).astype(np.float32)
    depth[:30] = np.inf
    depth[40, :5], depth[41, :5] = 0.01, 900.0
    near, far = depth_range([depth, depth + 1])
    assert near == pytest.approx(2, abs=0.1)
    assert far == pytest.approx(6, abs=0.1)


def test_a_floor_to_the_horizon_does_not_take_the_range() -> None:
    rows = (np.arange(1, 1001) - 0.5) / 1000  # a camera 1 m above a plane, looking level: depth is 1 / row
    depth = np.repeat(1 / rows[:, None], 8, axis=1).astype(np.float32)
    near, far = depth_range([depth])
    assert near == pytest.approx(1, abs=0.02)
    assert 8 <= far <= 14  # not 2,000
    assert (depth > far).mean() <= 0.1


def test_a_wall_behind_things_stays_in_the_range() -> None:
    depth = np.full((100, 100), 2.0, np.float32)
    depth[:15] = 7
    assert depth_range([depth])[1] == pytest.approx(7)


@pytest.mark.parametrize(
    ("depths", "expected"),
    [
        ([], (0, 1)),
        ([np.full((4, 4), np.inf, np.float32)], (0, 1)),
        ([np.full((4, 4), 2.0, np.float32)], (1.9, 2.1)),
    ],
)
def test_a_range_is_never_empty(depths: list[np.ndarray], expected: tuple[float, float]) -> None:
    assert depth_range(depths) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("rgb", "expected"),  # of the author's own tables
    [
        ((255, 255, 255), (1.0, 0.0, 0.0)),
        ((0, 0, 0), (0.0, 0.0, 0.0)),
        ((255, 0, 0), (0.62796, 0.22486, 0.12585)),
        ((0, 255, 0), (0.86644, -0.23389, 0.17950)),
        ((0, 0, 255), (0.45201, -0.03246, -0.31153)),
    ],
)
def test_oklab_is_as_published(rgb: tuple[int, int, int], expected: tuple[float, float, float]) -> None:
    assert oklab(np.array(rgb)) == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize(("count", "apart"), [(8, 0.15), (16, 0.12), (64, 0.07), (200, 0.04), (1024, 0.02)])
def test_colours_of_the_palette_are_apart_and_the_fewer_the_more(count: int, apart: float) -> None:
    palette = segmentation_palette(count)
    assert palette.shape == (count, 3)
    assert palette.dtype == np.uint8
    assert nearest(palette, palette).min() > apart
    assert len(np.unique(palette, axis=0)) == count
    assert nearest(palette, np.array([UNSEEN])).min() > 0.2
    assert np.array_equal(palette, segmentation_palette(3000)[:count])


@pytest.mark.parametrize(("count", "apart"), [(5, 0.12), (16, 0.09), (60, 0.055), (200, 0.035)])
def test_things_of_one_legend_can_be_told_apart(count: int, apart: float) -> None:
    colors = colors_of(THINGS[:count])
    assert len(np.unique(colors, axis=0)) == count
    assert nearest(colors, colors).min() > apart


@given(st.lists(st.text(min_size=1), unique=True, max_size=60), st.integers(0, 60))
@settings(max_examples=30, deadline=None)
def test_what_is_added_after_a_thing_leaves_its_colour(names: list[str], kept: int) -> None:
    things = [SegmentedObject("body", i, name) for i, name in enumerate(names)]
    assert np.array_equal(colors_of(things)[:kept], colors_of(things[:kept]))


def test_what_is_added_before_a_thing_mostly_leaves_its_colour() -> None:
    added = [SegmentedObject("geom", 0, "newcomer"), *THINGS[:60]]
    same = (colors_of(added)[1:] == colors_of(THINGS[:60])).all(axis=1)
    assert same.mean() > 0.6


def test_a_colour_depends_on_type_and_name_only() -> None:
    renumbered = [SegmentedObject(t.type, t.id + 7, t.name, "another") for t in THINGS]
    assert np.array_equal(colors_of(renumbered), colors_of(THINGS))
    sites = [SegmentedObject("site", t.id, t.name) for t in THINGS]
    assert not np.array_equal(colors_of(sites), colors_of(THINGS))


def test_colours_last_from_release_to_release() -> None:
    legend = [
        SegmentedObject("geom", 0, "floor"),
        SegmentedObject("geom", 1, "torso"),
        SegmentedObject("site", 0, "tip"),
        SegmentedObject("geom", 2, "geom:2"),
    ]
    assert colors_of(legend).tolist() == [[90, 120, 0], [165, 255, 150], [225, 225, 225], [255, 150, 165]]


def test_a_thousand_things_have_each_a_colour_and_more_repeat_them() -> None:
    things = [SegmentedObject("geom", i, f"geom:{i}") for i in range(1500)]
    colors = colors_of(things)
    assert len(np.unique(colors[:1024], axis=0)) == 1024
    assert colors.shape == (1500, 3)
    assert colors_of([]).shape == (0, 3)


def test_a_picture_of_ids_takes_its_colours_from_the_rows() -> None:
    rng = np.random.default_rng(0)
    ids = rng.integers(-1, 20, (13, 17)).astype(np.int32)
    colors = segmentation_palette(20)
    expected = np.array([[colors[i] if i >= 0 else np.array(UNSEEN) for i in row] for row in ids])
    found = seg_colors(ids, colors)
    assert found.dtype == np.uint8
    assert np.array_equal(found, expected)
    assert np.array_equal(seg_colors(np.full((2, 2), -1), colors_of([])), np.full((2, 2, 3), UNSEEN))


def test_in_view_is_what_covers_pixels() -> None:
    ids = np.array([[-1, 4, 4], [0, 4, 9], [0, -1, 4]], np.int32)
    assert in_view(ids).tolist() == [0, 4, 9]
    assert in_view(np.full((2, 2), -1, np.int32)).tolist() == []


@given(finite, st.floats(1e-6, 1e9), st.floats(1e-3, 1))
def test_ticks_are_all_the_round_numbers_there_are(low: float, span: float, share: float) -> None:
    span = max(span, abs(low) * 1e-6)
    marks, step = ticks(low, low + span, share * span)
    mantissa = step / 10 ** math.floor(math.log10(step) + 1e-9)
    assert round(mantissa, 6) in (1, 2, 5)
    assert share * span * (1 - 1e-6) <= step <= 2.5 * share * span * (1 + 1e-6)
    assert all(low - 1e-6 * step <= m <= low + span + 1e-6 * step for m in marks)
    assert all(b - a == pytest.approx(step, rel=1e-4) for a, b in pairwise(marks))
    assert abs(len(marks) - span / step) <= 1 + 1e-6
    for mark, text in zip(marks, figures(marks, step), strict=True):
        assert float(text) == pytest.approx(mark, abs=0.01 * step)


@cases("values, step, expected")
def test_figures_go_to_the_place_of_the_step(values: list[float], step: float, expected: list[str]) -> None:
    assert figures(values, step) == expected


@pytest.mark.parametrize(
    ("width", "height", "depths"),
    [(160, 120, (4, 2)), (320, 240, (4, 3, 2, 1)), (1920, 1080, (4, 3.5, 3, 2.5, 2, 1.5, 1, 0.5))],
)
def test_the_bar_shows_the_map_and_marks_round_depths(width: int, height: int, depths: tuple[float, ...]) -> None:
    image = np.full((height, width, 3), 128, np.uint8)
    colour_bar(image, 0.4, 4.2)
    table = colormap_table("turbo")
    assert (image[:, : width // 2] == 128).all()
    hits = np.isin(packed(image), packed(table))
    columns = np.flatnonzero(hits.sum(axis=0) > 0.4 * height)
    rows = np.flatnonzero(hits[:, columns[0]])
    bar = image[rows[0] : rows[-1] + 1, columns[0]]
    assert len(bar) == round(0.5 * height)
    assert np.array_equal(bar[[0, -1]], table[[255, 0]])
    outline = max(1, round(crisp(0.9 * text_size(height)) / 12))
    bright = image[:, columns[-1] + 1 + outline].min(axis=1) > 180
    edges = np.flatnonzero(np.diff(bright))
    marks = (edges[::2] + 1 + edges[1::2]) / 2
    expected = [rows[0] + (4.2 - m) / 3.8 * (len(bar) - 1) for m in depths]
    assert np.abs(marks - expected).max() <= 1


def test_a_picture_too_small_for_a_bar_stays_as_it_is() -> None:
    image = np.full((12, 16, 3), 128, np.uint8)
    colour_bar(image, 0, 1)
    assert (image == 128).all()


@pytest.mark.parametrize(("width", "height"), [(160, 120), (320, 240), (1920, 1080)])
def test_a_legend_shows_the_colour_of_what_it_names_as_far_as_it_fits(width: int, height: int) -> None:
    colors = colors_of(THINGS)
    image = np.full((height, width, 3), 128, np.uint8)
    legend(image, THINGS, colors)
    changed = (image != 128).any(axis=2)
    rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
    assert rows[0] >= 0.4 * height - 1
    assert columns[-1] < 0.45 * width
    assert columns[0] == height - 1 - rows[-1] > 0
    shown = np.isin(packed(colors), packed(image))
    count = shown.sum()
    assert 3 <= count <= 30
    assert shown[:count].all()


def test_a_small_legend_shows_the_whole_number_of_what_it_omits(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = list[str]()
    monkeypatch.setattr("mjrun.rendering.text.write", lambda _, line, *__: lines.append(line))
    legend(np.full((120, 160, 3), 128, np.uint8), THINGS, colors_of(THINGS))
    assert lines[-1] in (f"… {len(THINGS) - len(lines) + 1}{end}" for end in ("", " more"))


def test_a_short_legend_is_complete() -> None:
    image = np.full((240, 320, 3), 128, np.uint8)
    colors = colors_of(THINGS[:3])
    legend(image, THINGS[:3], colors)
    assert all((image == color).all(axis=2).sum() > 30 for color in colors)
    untouched = np.full((240, 320, 3), 128, np.uint8)
    legend(untouched, [], colors)
    assert (untouched == 128).all()
