"""A live plot: what is where, and when."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.options.video import PLOT_SIDES
from mjrun.palette import ON_DARK
from mjrun.rendering import live_plot
from mjrun.rendering.colormaps import oklab
from mjrun.rendering.live_plot import LivePlot, aligned, live_plot_size
from mjrun.rendering.text import BACKGROUND

SIZE = (480, 140)
TIMES = np.linspace(0, 4, 401)


def wave(size: tuple[int, int] = SIZE) -> LivePlot:
    return LivePlot(TIMES, np.sin(2 * TIMES)[:, None], ["qpos/knee"], ["rad"], size)


def like(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Where `image` has nearly this colour."""
    return np.abs(image.astype(int) - colour).max(axis=-1) < 24


def plot(graph: LivePlot, image: np.ndarray) -> np.ndarray:
    left, top, right, bottom = graph.axes.box
    return image[top:bottom, left:right]


@pytest.mark.parametrize("size", [(320, 80), (640, 160), (1920, 280), (160, 240)])
@pytest.mark.parametrize("time", [0.0, 0.8, 1.234, 3.99, 4.0])
def test_the_head_is_where_the_axes_say(size: tuple[int, int], time: float) -> None:
    graph = wave(size)
    x, y = float(graph.axes.x(time)), float(graph.axes.y(np.interp(time, TIMES, np.sin(2 * TIMES))))
    image = graph.draw(time)
    assert image.shape == (size[1], size[0], 3)
    assert tuple(image[math.floor(y), math.floor(x)]) == ON_DARK[0]


def test_the_head_is_centred_to_a_fraction_of_a_pixel() -> None:
    graph = LivePlot(np.array([0.0, 1, 2]), np.array([[np.nan], [0.3], [np.nan]]), ["a"], [""], (640, 160))
    graph._later[:] = graph._now[:] = BACKGROUND  # without the curve, a dot too
    left, top, right, bottom = graph.axes.box
    x, y = float(graph.axes.x(1)), float(graph.axes.y(0.3))
    share = (graph.draw(1)[top:bottom, left:right, 2].astype(float) - BACKGROUND[2]) / (ON_DARK[0][2] - BACKGROUND[2])
    share[:, np.abs(np.arange(left, right) + 0.5 - x) > 6] = 0
    share[np.abs(np.arange(top, bottom) + 0.5 - y) > 6] = 0
    v, u = np.mgrid[top:bottom, left:right] + 0.5
    assert (u * share).sum() / share.sum() == pytest.approx(x, abs=0.15)
    assert (v * share).sum() / share.sum() == pytest.approx(y, abs=0.15)


def test_the_corners_of_the_axes_are_the_first_and_last_instant_and_a_little_beyond_the_values() -> None:
    axes = wave().axes
    left, top, right, bottom = axes.box
    assert (float(axes.x(0)), float(axes.x(4))) == (left, right)
    assert (float(axes.x(-1)), float(axes.x(9))) == (left, right)
    assert float(axes.y(axes.values[0])) == bottom
    assert float(axes.y(axes.values[1])) == top
    assert axes.values[0] < -1 < 1 < axes.values[1] < 1.2


@pytest.mark.parametrize("time", [0.5, 1.9, 3.5])
def test_the_curve_is_bright_up_to_the_time_and_faint_after(time: float) -> None:
    graph = wave()
    image = graph.draw(time)
    for instant in (0.1, 0.3, 1.5, 1.7, 2.4, 3.1, 3.9):
        x, y = float(graph.axes.x(instant)), float(graph.axes.y(math.sin(2 * instant)))
        if abs(instant - time) < 0.15:
            continue
        around = image[round(y) - 2 : round(y) + 3, math.floor(x)].astype(int)
        most = np.abs(around - BACKGROUND).max()
        assert (most > 140) == (instant < time)
        assert most > 30


def test_only_the_curve_and_its_value_change_with_time() -> None:
    graph = wave()
    first, later = graph.draw(0.7), graph.draw(2.9)
    left, top, right, bottom = graph.axes.box
    reach = math.ceil(graph._em)
    changed = (first != later).any(axis=2)
    changed[top - reach : bottom + reach, left - reach : right + reach] = False
    rows, columns = np.nonzero(changed)
    assert len(rows)  # the value
    assert rows.max() < top
    assert columns.max() - columns.min() < 4 * graph._em


def test_the_value_stands_still_while_its_figures_run() -> None:
    graph = wave()
    drawn = [graph.draw(time)[: graph.axes.box[1] - 8] for time in np.linspace(0, 4, 9)]
    spread = np.ptp(drawn, axis=0).any(axis=(0, 2))
    unit = math.ceil(graph._entries[0].end)
    assert spread.any()
    assert not spread[unit:].any()


def test_between_samples_the_head_rides_on_the_line() -> None:
    graph = LivePlot(np.array([0.0, 1, 3]), np.array([[0.0], [2], [-2]]), ["a"], [""], SIZE)
    assert [graph.head(0, t) for t in (-1, 0, 0.25, 1, 2, 3, 9)] == [0, 0, 0.5, 2, 0, -2, -2]


def test_a_gap_is_empty_and_has_no_head() -> None:
    values = np.where((TIMES > 1) & (TIMES < 2), np.nan, 0.25 * TIMES)[:, None]
    graph = LivePlot(TIMES, values, ["a"], [""], SIZE)
    assert math.isnan(graph.head(0, 1.5))
    assert graph.head(0, 1.0) == 0.25
    left, _, _, _ = graph.axes.box
    ends = [round(float(graph.axes.x(t))) - left for t in (1, 2)]
    for time in (1.5, 3.0):
        panel = plot(graph, graph.draw(time))
        assert not like(panel, ON_DARK[0])[:, ends[0] + 4 : ends[1] - 4].any()
        assert like(panel, ON_DARK[0])[:, : ends[0] - 4].any()


def test_a_single_sample_between_gaps_is_seen() -> None:
    values = np.full((401, 1), np.nan)
    values[100], values[300] = 1, 2
    graph = LivePlot(TIMES, values, ["a"], [""], SIZE)
    panel = like(plot(graph, graph.draw(4.0)), ON_DARK[0])
    x = round(float(graph.axes.x(1.0))) - graph.axes.box[0]
    assert panel[:, x - 2 : x + 3].any()
    assert not panel[:, x + 5 : 2 * x].any()


def test_a_spike_of_one_sample_in_a_million_is_drawn() -> None:
    times = np.linspace(0, 10, 1_000_001)
    values = np.sin(times)[:, None]
    values[420_000] = 9.0
    graph = LivePlot(times, values, ["a"], [""], SIZE)
    image = graph.draw(10.0)
    x, y = math.floor(float(graph.axes.x(4.2))), float(graph.axes.y(9.0))
    column = np.abs(image[round(y) : round(float(graph.axes.y(2.0))), x - 1 : x + 2].astype(int) - BACKGROUND).max(
        axis=(1, 2)
    )
    assert column.min() > 60


def test_thinning_draws_the_same_line(monkeypatch: pytest.MonkeyPatch) -> None:
    times = np.linspace(0, 4, 30_000)
    values = (np.sin(3 * times) + 0.2 * np.sin(200 * times))[:, None]
    thinned = LivePlot(times, values, ["a"], [""], (160, 80)).draw(4.0)
    monkeypatch.setattr(live_plot, "_thinned", lambda x, y: np.column_stack([x, y]))
    whole = LivePlot(times, values, ["a"], [""], (160, 80)).draw(4.0)
    difference = np.abs(thinned.astype(int) - whole)
    assert difference.mean() < 1
    assert difference.max() < 80


def test_drawing_is_deterministic_and_does_not_depend_on_what_was_drawn_before() -> None:
    graph = wave()
    first = graph.draw(1.0)
    kept = first.copy()
    graph.draw(3.0)
    assert np.array_equal(graph.draw(1.0), kept)
    assert np.array_equal(wave().draw(1.0), kept)
    assert np.array_equal(first, kept)


def test_every_series_has_a_head_and_a_swatch_of_its_colour() -> None:
    values = np.stack([np.full(401, float(k)) for k in range(6)], axis=1)
    graph = LivePlot(TIMES, values, [f"value/{k}" for k in range(6)], ["m"] * 6, (960, 240))
    image = graph.draw(2.0)
    x = math.floor(float(graph.axes.x(2.0)))
    for series, colour in enumerate(ON_DARK):
        assert tuple(image[math.floor(float(graph.axes.y(series))), x]) == colour
        assert like(image[: graph.axes.box[1]], colour).sum() > 10
    assert [entry.name for entry in graph._entries] == [f"value/{k}" for k in range(6)]


def test_names_that_do_not_fit_lose_their_units_then_their_first_parts() -> None:
    names, units = ["qpos/left_knee", "sensor/imu/x", "speed[box]"], ["rad", "m/s²", "m/s"]
    values = np.stack([np.sin(TIMES + k) for k in range(3)], axis=1)

    def shown(width: int) -> list[tuple[str, str]]:
        return [(e.name, e.unit) for e in LivePlot(TIMES, values, names, units, (width, 80))._entries]

    assert shown(640) == [("qpos/left_knee", " rad"), ("sensor/imu/x", " m/s²"), ("speed[box]", " m/s")]
    assert shown(320) == [("left_knee", ""), ("imu/x", ""), ("speed[box]", "")]
    assert 1 <= len(shown(150)) < 3


def test_colours_of_series_can_be_told_apart_on_the_ground() -> None:
    colours = oklab(np.array([*ON_DARK, BACKGROUND]))
    assert min(np.linalg.norm(a - b) for a, b in combinations(colours, 2)) > 0.1
    assert min(np.linalg.norm(a - colours[-1]) for a in colours[:-1]) > 0.4


@pytest.mark.parametrize(
    "values",
    [
        np.zeros((5, 1)),
        np.full((5, 2), 1e6),
        np.full((5, 1), np.nan),
        np.array([[1.0], [np.inf], [-np.inf], [np.nan], [2.0]]),
        np.array([[1e308], [-1e308], [0.0], [1e199], [-1e199]]),
        np.array([[5e-324], [0.0], [-5e-324], [0.0], [1e-310]]),
        np.array([[1e-12], [3e-12], [0.0], [2e-12], [1e-12]]),
        1e9 + np.arange(5.0)[:, None] * 1e-6,
        np.random.default_rng(0).normal(size=(5, 20)),
        np.zeros((5, 0)),
    ],
    ids=["zero", "flat", "nan", "infinite", "huge", "denormal", "tiny", "offset", "many", "none"],
)
@pytest.mark.parametrize("time", [0.0, 1.5, 4.0])
def test_any_values_can_be_drawn(values: np.ndarray, time: float) -> None:
    count = values.shape[1]
    graph = LivePlot(np.arange(5.0), values, [f"a/{k}" for k in range(count)], ["N"] * count, SIZE)
    assert graph.draw(time).shape == (SIZE[1], SIZE[0], 3)
    assert graph.axes.values[0] < graph.axes.values[1]


def test_a_single_instant_can_be_drawn() -> None:
    graph = LivePlot(np.array([2.0]), np.array([[3.0]]), ["a"], ["m"], SIZE)
    image = graph.draw(2.0)
    x, y = float(graph.axes.x(2.0)), float(graph.axes.y(3.0))
    assert tuple(image[math.floor(y), math.floor(x)]) == ON_DARK[0]


@given(st.integers(2, 400), st.integers(2, 300), st.integers(1, 4))
@settings(max_examples=30, deadline=None)
def test_a_graph_of_any_size_can_be_drawn(width: int, height: int, count: int) -> None:
    values = np.stack([np.sin(TIMES + k) for k in range(count)], axis=1)
    graph = LivePlot(TIMES, values, ["a/long/name"] * count, ["m/s²"] * count, (width, height))
    assert graph.draw(1.0).shape == (height, width, 3)


@pytest.mark.parametrize("side", PLOT_SIDES)
@pytest.mark.parametrize("size", [(320, 240), (640, 480), (1920, 1080)])
def test_a_graph_shares_a_side_with_its_video_and_is_smaller(side: str, size: tuple[int, int]) -> None:
    width, height = live_plot_size(size, side)
    shared, other = ((width, height) if side == "under" else (height, width)), size if side == "under" else size[::-1]
    assert shared[0] == other[0]
    assert shared[1] <= other[1] / 2
    assert shared[1] % 2 == 0


@pytest.mark.parametrize("count", [2, 3, 4, 12, 29])
@pytest.mark.parametrize("width", [160, 320, 1280])
def test_series_without_room_for_their_names_are_counted(count: int, width: int) -> None:
    values = np.stack([np.sin(TIMES + k) for k in range(count)], axis=1)
    graph = LivePlot(TIMES, values, ["qpos/knee"] * count, ["rad"] * count, (width, 80))
    named = [entry for entry in graph._entries if entry.name]
    told = [entry.unit for entry in graph._entries if not entry.name]
    assert told == ([f"… {count - len(named)} more"] if len(named) < count else [])
    assert graph.draw(1.0).shape == (80, width, 3)


def test_names_that_would_end_alike_are_cut_in_their_middle() -> None:
    names = [f"{side}_shoulder_{axis}" for side in ("left", "right") for axis in ("pitch", "roll", "yaw")]
    values = np.stack([np.sin(TIMES + k) for k in range(6)], axis=1)
    graph = LivePlot(TIMES, values, [f"qpos/{name}" for name in names], ["rad"] * 6, (400, 100))
    shown = [entry.name for entry in graph._entries if entry.name]
    assert any("…" in name for name in shown)
    assert len({*shown}) == len(shown) == 6
    for name, cut in zip(names, shown, strict=True):
        begin, _, end = cut.rpartition("…")
        assert name.startswith(begin)
        assert name.endswith(end)


def test_graphs_under_each_other_have_one_left_edge_and_are_otherwise_as_before() -> None:
    small, large = (LivePlot(TIMES, (k * np.sin(TIMES))[:, None], ["a"], ["m"], SIZE) for k in (1.0, 123456.0))
    edges = [graph.axes.box[0] for graph in (small, large)]
    assert edges[0] < edges[1]  # the labels of one are wider
    first, second = aligned([small, large])
    assert [graph.axes.box[0] for graph in (first, second)] == [max(edges)] * 2
    assert first.axes.x(TIMES[3]) == second.axes.x(TIMES[3])  # one instant is in one column
    assert first.axes.box[1:] == small.axes.box[1:]
    assert first.axes.values == small.axes.values
    assert np.array_equal(second.draw(1.0), large.draw(1.0))
    assert aligned([small]) == [small]
