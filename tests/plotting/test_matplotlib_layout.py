"""The look of figures: text that fits, ticks, themes, and the grid of panels."""

import math
import os
import re
import subprocess
import sys
from functools import cache

import matplotlib
import pytest

from mjrun.errors import BadValueError
from mjrun.options.plot import STYLES
from mjrun.plotting.figure_data import PanelGrid, panel_grid
from mjrun.plotting.matplotlib_layout import LONGEST, MatplotlibFigure, settings
from mjrun.plotting.theme import PATTERNS, THEMES, Theme, adaptive, theme_style
from mjrun.plotting.tick_labels import (
    cell_labels,
    labels_of,
    linear_ticks,
    log_label,
    log_ticks,
    tick_labels,
    value_labels,
)

LIGHT, GRID = THEMES["light"], PanelGrid((400, 200), 1, 1, 12.0)


@cache
def canvas() -> MatplotlibFigure:
    return MatplotlibFigure(GRID, LIGHT)


def test_no_advice_about_the_cache_of_fonts_reaches_the_terminal() -> None:
    command = [sys.executable, "-c", "import mjrun.plotting.matplotlib_layout"]
    done = subprocess.run(command, env={**os.environ, "MPLCONFIGDIR": f"{os.devnull}/x"}, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("text", ["short", "contact_force/normal/z", "ω" * 100, "一" * 40])
@pytest.mark.parametrize("room", [30, 100, 250])
def test_a_fitted_text_has_no_more_than_its_room(text: str, room: float) -> None:
    shown = canvas().fitted(text, room, 12)
    assert canvas().measure(shown, 12) <= room
    if "…" in shown:
        head, tail = shown.split("…")
        whole = canvas().shown(text)
        assert whole.startswith(head)
        assert whole.endswith(tail)
        length = len(head + tail) + 1
        longer = f"{whole[: length // 3]}…{whole[length // 3 - length :]}"
        assert length > min(len(whole), LONGEST) or canvas().measure(longer, 12) > room
    else:
        assert shown in (canvas().shown(text), text[:1])


def test_a_long_text_is_measured_a_few_times_until_it_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    measured: list[str] = []
    measure = MatplotlibFigure.measure

    def counted(self: MatplotlibFigure, text: str, size: float, *, bold: bool = False) -> float:
        measured.append(text)
        return measure(self, text, size, bold=bold)

    monkeypatch.setattr(MatplotlibFigure, "measure", counted)
    assert len(canvas().fitted("contact_force/" * 20, 100, 12)) < 30
    assert len(measured) < 10


def test_bold_text_is_wider_and_larger_text_too() -> None:
    assert canvas().measure("text", 12) < canvas().measure("text", 12, bold=True)
    assert canvas().measure("text", 24) == pytest.approx(2 * canvas().measure("text", 12), rel=0.1)


def test_letters_without_a_shape_are_left_to_who_shows_them_if_asked() -> None:
    assert canvas().shown("位\n") == "\\u4f4d\\n"
    assert MatplotlibFigure(GRID, LIGHT, any_letter=True).shown("位\n") == "位\\n"


def test_settings_are_ours_and_the_user_s_come_back() -> None:
    with matplotlib.rc_context({"font.size": 31}):
        with settings(LIGHT, 12.0):
            assert matplotlib.rcParams["font.size"] == 10
            assert matplotlib.rcParams["text.parse_math"] is False
        assert matplotlib.rcParams["font.size"] == 31


RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")


def number(label: str) -> float:
    factor, _, power = label.partition("×10") if "×" in label else (label, "", "")
    if label.startswith("10") and power == "" and any(c in "⁻⁰¹²³⁴⁵⁶⁷⁸⁹" for c in label):
        return 10.0 ** int(label[2:].translate(RAISED))
    return float(factor.translate(RAISED)) * 10.0 ** int(power.translate(RAISED) or 0)


@pytest.mark.parametrize(
    "values",
    [[-0.5, 0, 0.5], [0.30001, 0.30002, 0.30003], [1e-7, 2e-7], [-2.5e9, 0, 2.5e9], [1e6 + 1, 1e6 + 2], [0.25, 0.5]],
)
def test_labels_are_the_numbers_and_all_different(values: list[float]) -> None:
    labels = tick_labels(values)
    assert len(set(labels)) == len(values)
    for label, value in zip(labels, values, strict=True):
        assert math.isclose(number(label), value, rel_tol=1e-12, abs_tol=1e-12 * max(map(abs, values)))


def test_labels_have_the_digits_that_they_need() -> None:
    assert tick_labels([-0.5, 0.0, 0.5]) == ["−0.5", "0", "0.5"]
    assert tick_labels([100.0, 200.0]) == ["100", "200"]
    assert tick_labels([2e-6, 4e-6]) == ["2×10⁻⁶", "4×10⁻⁶"]
    assert tick_labels([1.7e12, 1.7e12 + 500]) == ["1700000000000", "1700000000500"]
    assert tick_labels([1.7e9, 1.7e9 + 0.25]) == ["1700000000.00", "1700000000.25"]
    assert tick_labels([1.7e12, 1.7e12 + 1e7]) == ["1.70000×10¹²", "1.70001×10¹²"]
    assert tick_labels([1.25e6, 2.5e6]) == ["1.25×10⁶", "2.50×10⁶"]
    assert tick_labels([0.0]) == ["0"]
    assert tick_labels([]) == []


@pytest.mark.parametrize("is_plain", [False, True])
@pytest.mark.parametrize("value", [1e-9, 2e-5, 0.001, 0.5, 1, 20, 1000, 1e5, 3e12])
def test_a_logarithmic_label_is_the_number(value: float, is_plain: bool) -> None:
    assert math.isclose(number(log_label(value, is_plain=is_plain)), value)


def test_all_labels_of_a_logarithmic_axis_have_one_style() -> None:
    assert labels_of([1e-2, 1, 100], 1e-2, 100, log=True) == ["0.01", "1", "100"]
    assert labels_of([1e-6, 1e-2, 100], 1e-6, 100, log=True) == ["10⁻⁶", "10⁻²", "10²"]


@pytest.mark.parametrize("most", [1, 3, 8])
@pytest.mark.parametrize(("low", "high"), [(0, 1), (-3e-7, 2e-7), (0.3, 0.30001), (1e9, 1e9 + 5), (-2.5, 97)])
def test_ticks_are_within_the_range_and_not_too_many(low: float, high: float, most: int) -> None:
    ticks = linear_ticks(low, high, most)
    assert 1 <= len(ticks) <= most + 2
    assert all(low <= value <= high for value in ticks)
    assert len(set(labels_of(ticks, low, high, log=False))) == len(ticks)


def test_counts_have_ticks_at_whole_numbers() -> None:
    assert linear_ticks(-0.1, 2.1, 8, whole=True) == [0, 1, 2]


@pytest.mark.parametrize(("low", "high"), [(1e-6, 1e6), (0.5, 30), (2, 2.2), (87, 88), (1e-30, 1e30)])
@pytest.mark.parametrize("most", [2, 8])
def test_a_logarithmic_axis_has_ticks_whatever_its_range(low: float, high: float, most: int) -> None:
    ticks = log_ticks(low, high, most)
    assert 1 <= len(ticks) <= 12
    assert all(low <= value <= high for value in ticks)
    assert len(set(labels_of(ticks, low, high, log=True))) == len(ticks)


def test_labels_of_values_have_the_digits_that_tell_them_apart() -> None:
    assert value_labels([0.001, 0.5, -2]) == ["0.001", "0.5", "−2"]
    assert value_labels([1.0001, 1.0002]) == ["1.0001", "1.0002"]
    assert value_labels([1e-6, 2e9]) == ["10⁻⁶", "2×10⁹"]
    assert value_labels([]) == []


@pytest.mark.parametrize(
    ("values", "log", "labels"),
    [
        ([2.9379, 2.18], False, ["2.938", "2.180"]),
        ([1, 3, 12], False, ["1", "3", "12"]),
        ([0.5, 1, -0.25, 0], False, ["0.50", "1.00", "−0.25", "0"]),
        ([2e-6, 2.5e-6], False, ["2.0×10⁻⁶", "2.5×10⁻⁶"]),
        ([1234.5, 12.3], False, ["1234", "12"]),
        ([1234.0, 0.25], False, ["1234", "0.2500"]),
        ([0.001, 0.0316228, 1], True, ["0.001000", "0.03162", "1.000"]),
        ([0.001, 0.1, 10], True, ["0.001", "0.1", "10"]),
        ([0, 0], False, ["0", "0"]),
    ],
)
def test_all_labels_of_cells_have_as_many_digits(values: list[float], log: bool, labels: list[str]) -> None:
    assert cell_labels(values, 4, log=log) == labels


def test_every_style_has_a_theme() -> None:
    assert tuple(THEMES) == STYLES


@pytest.mark.parametrize("style", STYLES)
def test_curves_differ_in_colour_or_pattern(style: str) -> None:
    theme = THEMES[style]
    count = len(theme.curves) * len(PATTERNS)
    looks = {(theme.colour(index), theme.pattern(index)) for index in range(count)}
    assert len(looks) == count


def test_on_paper_neighbours_differ_without_colour_too() -> None:
    theme = THEMES["print"]
    assert len({theme.pattern(index) for index in range(6)}) == 6


def test_a_second_column_of_a_table_has_another_pattern() -> None:
    assert THEMES["light"].pattern(0, 1) != THEMES["light"].pattern(0)


def shown(svg: str, declarations: str) -> str:
    """What a browser shows: variables are what was declared last."""
    values = dict(re.findall(r"(--[\w-]+): (#\w+);", declarations))
    return re.sub(r"var\((--[\w-]+)\)", lambda found: values[found[1]], svg)


def colours(theme: Theme) -> list[str]:
    every = [theme.ground, theme.ink, theme.grey, theme.grid, theme.zero, *theme.curves]
    return ["#{:02x}{:02x}{:02x}".format(*colour) for colour in every]


def test_a_light_figure_is_itself_on_light_ground_and_the_dark_one_on_dark() -> None:
    light, dark = ("; ".join(colours(THEMES[style])) for style in ("light", "dark"))
    figure, style = adaptive(light), theme_style()
    assert "#" not in figure
    assert shown(figure, style.partition("@media")[0]) == light
    assert shown(figure, style) == dark


def test_other_colours_stay() -> None:
    assert adaptive("fill: #123456; d: #ffffffff") == "fill: #123456; d: #ffffffff"


@pytest.mark.parametrize("panels", [1, 2, 4, 5, 6, 16, 48])
def test_a_figure_grows_with_its_panels(panels: int) -> None:
    grid = panel_grid(panels, 3, False, None, None)
    assert grid.rows * grid.columns >= panels > (grid.rows - 1) * grid.columns
    assert grid.size[1] / grid.rows >= 12 * grid.em
    assert 10 < grid.em < 20


def test_a_larger_legend_makes_higher_panels_up_to_a_bound() -> None:
    heights = [panel_grid(8, names, False, None, None).size[1] for names in (2, 12, 300)]
    assert heights[0] < heights[1] <= heights[2] < 3000


def test_what_is_asked_for_is_kept() -> None:
    grid = panel_grid(6, 3, True, (640, 480), 3)
    assert (grid.size, grid.columns, grid.rows) == ((640, 480), 3, 2)
    assert panel_grid(2, 3, True, None, 8).columns == 2


def test_panels_without_room_are_refused() -> None:
    with pytest.raises(BadValueError, match=r"size: '640x200' is not at least 140x320 for 5 panels"):
        panel_grid(5, 1, False, (640, 200), None)
    with pytest.raises(BadValueError, match=r"at least 420x96 for 3 panels"):
        panel_grid(3, 1, False, (300, 300), 3)


@pytest.mark.parametrize("size", [(100_000, 1000), (20_000, 20_000)])
def test_more_pixels_than_memory_may_hold_are_refused(size: tuple[int, int]) -> None:
    with pytest.raises(BadValueError, match=r"is not at most 65535 a side and 100 megapixels"):
        panel_grid(1, 1, False, size, None)
