"""Self-contained tick labels: no offset above the axis, no factor beside it."""

import math
from collections.abc import Sequence
from itertools import pairwise

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PLAIN = (1e-4, 1e6)  # of the largest tick; beyond, powers of ten are shown
_LONG = 4  # decimals of a label, with a power of ten
_DIGITS = 15  # that a float has
_LEAST = -307  # power of ten, below which floats have fewer digits


def linear_ticks(low: float, high: float, most: float, whole: bool = False) -> list[float]:
    """Returns at most about `most` evenly spaced ticks between `low` and `high`, at whole numbers if `whole`."""
    from matplotlib.ticker import MaxNLocator

    locator = MaxNLocator(max(1, int(most)), steps=[1, 2, 2.5, 5, 10], integer=whole)
    return [float(value) for value in locator.tick_values(low, high) if low <= value <= high]


def log_ticks(low: float, high: float, most: float) -> list[float]:
    """Returns ticks at powers of ten, and at their multiples if those are few; evenly spaced within a decade."""
    if _is_narrow(low, high):
        return linear_ticks(low, high, min(5, most))
    first, last = max(_LEAST, math.ceil(math.log10(low) - 1e-9)), math.floor(math.log10(high) + 1e-9)
    stride = max(1, math.ceil((last - first + 1) / max(1, int(most))))
    factors = (1,) if last - first > 1 else (1, 2, 5)
    values = [factor * 10.0**power for power in range(first - 1, last + 1) if power % stride == 0 for factor in factors]
    return [value for value in values if low <= value <= high]


def labels_of(values: Sequence[float], low: float, high: float, *, log: bool) -> list[str]:
    """Returns the labels of ticks of an axis from `low` to `high`."""
    if not log or _is_narrow(low, high):
        return tick_labels(values)
    is_plain = all(-4 < _power(value) < 5 for value in values)  # all labels of an axis have one style
    return [log_label(value, is_plain=is_plain) for value in values]


def tick_labels(values: Sequence[float]) -> list[str]:
    """Returns labels of evenly spaced ticks, with the digits that distinguish them: `−0.5`, `2.5×10⁻⁶`."""
    if not values:
        return []
    largest = max(map(abs, values))
    step = min((b - a for a, b in pairwise(values) if b > a), default=largest)
    if not largest or not step:
        return ["0" for _ in values]
    power = 0 if _PLAIN[0] <= largest < _PLAIN[1] else math.floor(math.log10(largest))
    decimals = _decimals(step / 10.0**power)
    if decimals > _LONG and 0 < power < decimals + len("×10⁹"):  # as of epoch times: plain digits are shorter
        power, decimals = 0, _decimals(step)
    return [_label(value, power, decimals) for value in values]


def log_label(value: float, *, is_plain: bool) -> str:
    """Returns the label of a tick on a logarithmic axis: `0.01` and `200` if plain, else `10⁻²` and `2×10²`."""
    power = _power(value)
    if is_plain:
        return f"{value:.{max(0, -power)}f}"
    factor = round(value / 10.0**power)
    return ("" if factor == 1 else f"{factor}×") + f"10{_raised(power)}"


def _power(value: float) -> int:
    return math.floor(math.log10(value) + 1e-9)


def value_labels(values: Sequence[float]) -> list[str]:
    """Returns labels of any values, with the digits that distinguish them: `0.001`, `0.00316`, `10`."""
    labels: list[str] = []
    for digits in range(3, _DIGITS + 3):
        labels = [_short(value, digits) for value in values]
        if len(set(labels)) == len(set(values)):
            break
    return labels


def cell_labels(values: Sequence[float], digits: int, *, log: bool) -> list[str]:
    """Returns labels of values that are compared with one another, all with as many digits: `2.938`, `2.180`.

    Args:
      digits: maximum number of significant digits of the largest value.
      log: whether values differ by factors. Then they have equally many significant digits rather than decimals, as
        have values that would round to zero.
    """
    largest = max(map(abs, values), default=0.0)
    if not largest:
        return ["0" for _ in values]
    power = math.floor(math.log10(largest))
    shared = 0 if _PLAIN[0] <= largest < _PLAIN[1] else power
    most = max(0, digits - 1 - power + shared)
    scaled = [round(value / 10.0**shared, most) for value in values]
    if log or any(value and not rounded for value, rounded in zip(values, scaled, strict=True)):
        return _significant_labels([float(f"{value:.{digits}g}") for value in values], digits)
    decimals = next(each for each in range(most + 1) if [round(value, each) for value in scaled] == scaled)
    return [_label(value, shared, decimals) for value in values]


def _significant_labels(values: Sequence[float], most: int) -> list[str]:
    """Returns labels with equally many significant digits: the fewest that show values of `most` digits at most."""
    digits = next(each for each in range(1, most + 1) if all(float(f"{value:.{each}g}") == value for value in values))
    if all(not value or -5 < _power(abs(value)) < 6 for value in values):
        places = [digits - 1 - _power(abs(value)) if value else 0 for value in values]
        return [_signed(f"{value:.{max(0, place)}f}") for value, place in zip(values, places, strict=True)]
    return [_short(value, digits, is_even=True) for value in values]


def _is_narrow(low: float, high: float) -> bool:
    """Returns whether a logarithmic axis has a decade at most, over which evenly spaced ticks read better."""
    return high < 8 * low


def _decimals(step: float) -> int:
    """Returns the fewest decimals that show multiples of `step`."""
    for decimals in range(_DIGITS + 1):
        scaled = step * 10.0**decimals
        if abs(scaled - round(scaled)) < 1e-6 * scaled and round(scaled):
            return decimals
    return _DIGITS


def _label(value: float, power: int, decimals: int) -> str:
    text = f"{value / 10.0**power:.{decimals}f}"
    if not float(text):
        return "0"
    return _signed(text) + (f"×10{_raised(power)}" if power else "")


def _signed(text: str) -> str:
    return text.replace("-", "−")


def _raised(power: int) -> str:
    return str(power).translate(_RAISED)


def _short(value: float, digits: int, *, is_even: bool = False) -> str:
    """Returns a label of at most `digits` significant digits, or of exactly as many if `is_even`."""
    factor, e, power = f"{value:{'#' if is_even else ''}.{digits}g}".partition("e")
    factor = factor.removesuffix(".")
    if not e:
        return _signed(factor)
    return ("" if factor == "1" else f"{_signed(factor)}×") + f"10{_raised(int(power))}"
