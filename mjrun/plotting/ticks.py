"""Tick labels that can be read by themselves: no offset above the axis, no factor beside it."""

import math
from collections.abc import Sequence
from itertools import pairwise

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PLAIN = (1e-4, 1e6)  # of the largest tick; beyond, powers of ten are shown
_DIGITS = 15  # that a float has


def tick_labels(values: Sequence[float]) -> list[str]:
    """Labels of ticks at equal distances, with the digits that tell them apart: `−0.5`, `2.5×10⁻⁶`."""
    if not values:
        return []
    largest = max(map(abs, values))
    step = min((b - a for a, b in pairwise(values) if b > a), default=largest)
    if not largest or not step:
        return ["0" for _ in values]
    power = 0 if _PLAIN[0] <= largest < _PLAIN[1] else math.floor(math.log10(largest))
    decimals = _decimals(step / 10.0**power)
    return [_label(value, power, decimals) for value in values]


def log_label(value: float) -> str:
    """The label of a tick on a logarithmic axis: `0.01`, `200`, `10⁻⁶`, `2×10⁷`."""
    power = math.floor(math.log10(value) + 1e-9)
    if -4 < power < 5:
        return f"{value:.{max(0, -power)}f}"
    factor = round(value / 10.0**power)
    return ("" if factor == 1 else f"{factor}×") + f"10{_raised(power)}"


def _decimals(step: float) -> int:
    """The fewest decimals that show multiples of `step`."""
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
