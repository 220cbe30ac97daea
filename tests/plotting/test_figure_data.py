"""The ranges of axes hold everything, and never have no extent."""

from dataclasses import replace

import numpy as np
import pytest

from mjrun.plotting.curve_syntax import ReferenceLine
from mjrun.plotting.envelope import Points
from mjrun.plotting.figure_data import Drawing, DrawnCurve, DrawnPanel, Scale


def panel(*values: float, log: bool = False, marks: tuple[float, ...] = ()) -> DrawnPanel:
    points = Points(np.arange(float(len(values))), np.array(values, float))
    return DrawnPanel("a", [DrawnCurve("a", points, 0)], log, [ReferenceLine("m", value) for value in marks])


def y_range(panel: DrawnPanel) -> tuple[float, float]:
    return panel.y.low, panel.y.high


@pytest.mark.parametrize("values", [(1, 2), (-5, 5), (0.3, 0.300001), (1e-30, 2e-30), (1e200, -1e200), (0, np.nan, 1)])
def test_a_range_is_that_of_the_values_and_a_little_more(values: tuple[float, ...]) -> None:
    low, high = y_range(panel(*values))
    least, most = np.nanmin(values), np.nanmax(values)
    assert low < least
    assert high > most
    assert high - low < 1.2 * (most - least)


@pytest.mark.parametrize("value", [0.0, 87.356, -1e-9, 1e300])
@pytest.mark.parametrize("log", [False, True])
def test_a_constant_is_in_the_middle(value: float, log: bool) -> None:
    if log and value <= 0:
        return
    low, high = y_range(panel(value, value * (1 + 1e-15), log=log))
    assert low < value < high
    middle = np.sqrt(low) * np.sqrt(high) if log else low / 2 + high / 2
    assert np.isclose(middle, value)


def test_marks_are_within_the_range() -> None:
    low, high = y_range(panel(1, 2, marks=(10,)))
    assert low < 1 < 10 < high
    assert panel(1, 2, log=True, marks=(-10,)).y == panel(1, 2, log=True).y


def test_x_is_from_the_first_to_the_last_sample() -> None:
    drawing = Drawing("", "t", False, [panel(1, 2, 3), panel(1, 2, 3, 4)], [ReferenceLine("m", 99, vertical=True)])
    wide = replace(drawing, x_margin=0.1).x
    assert drawing.x == Scale("t", 0, 3)
    assert (wide.low, wide.high) == pytest.approx((-0.3, 3.3))
    assert Drawing("", "t", False, [panel(1)], []).x == Scale("t", -0.5, 0.5)
    assert Drawing("", "t", True, [panel()], []).x == Scale("t", 0.1, 1, True)
    assert Drawing("", "t", False, [panel()], []).x == Scale("t", 0, 1)


def test_counts_are_whole_and_nothing_else_is() -> None:
    assert panel(0, 3, np.nan).is_whole()
    assert not panel(0, 0.5).is_whole()
