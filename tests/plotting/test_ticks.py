"""Tick labels are the numbers that they stand for."""

import math

import pytest

from mjrun.plotting.ticks import labels_of, linear_ticks, log_label, log_ticks, tick_labels, value_labels

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
    assert tick_labels([0.0]) == ["0"]
    assert tick_labels([]) == []


@pytest.mark.parametrize("value", [1e-9, 2e-5, 0.001, 0.5, 1, 20, 1000, 1e5, 3e12])
def test_a_logarithmic_label_is_the_number(value: float) -> None:
    assert math.isclose(number(log_label(value)), value)


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
