"""Cells of a table that are not all float64: texts, and integers that float64 does not hold."""

import math
from fractions import Fraction

import numpy as np

from mjrun.diff.tolerances import Tolerance
from mjrun.errors import clean

Cell = float | int | str


def as_numbers(column: np.ndarray) -> np.ndarray | None:
    """A column as float64; None if that does not hold all of its cells."""
    if column.dtype == np.float64:
        return column
    return column.astype(np.float64) if all(type(cell) is float for cell in column) else None


def compare_cells(a: np.ndarray, b: np.ndarray, tolerance: Tolerance) -> tuple[np.ndarray, np.ndarray]:
    """Where the cells of two columns agree, and the differences b − a, which are infinite where a text differs."""
    pairs = [_compare(x, y, tolerance) for x, y in zip(a.tolist(), b.tolist(), strict=True)]
    agree, difference = zip(*pairs, strict=True)
    return np.array(agree, bool), np.array(difference, float)


def cell_text(cell: Cell) -> str:
    """A cell as a text that reads back as the same."""
    return cell if isinstance(cell, str) else repr(cell)


def _compare(x: Cell, y: Cell, tolerance: Tolerance) -> tuple[bool, float]:
    if isinstance(x, str) and isinstance(y, str):
        agree = clean(x) == clean(y)  # .csv holds cleaned texts
        return agree, 0.0 if agree else math.inf
    if isinstance(x, str) or isinstance(y, str):
        try:
            return _compare(_number(x), _number(y), tolerance)  # .csv has no quotes around a text that is a number
        except ValueError:
            return False, math.inf
    if not all(isinstance(each, int) or math.isfinite(each) for each in (x, y)):
        agree = x == y or (x != x and y != y)
        return agree, 0.0 if agree else math.inf

    difference = Fraction(y) - Fraction(x)
    if tolerance.is_exact:
        signs = {math.copysign(1, each) for each in (x, y) if each == 0}
        return difference == 0 and len(signs) < 2, _float(difference)
    if math.isinf(tolerance.atol) or math.isinf(tolerance.rtol):
        return True, _float(difference)
    limit = Fraction(tolerance.atol) + Fraction(tolerance.rtol) * abs(Fraction(y))
    return abs(difference) <= limit, _float(difference)


def _number(cell: Cell) -> float | int:
    if not isinstance(cell, str):
        return cell
    try:
        return int(cell)
    except ValueError:
        return float(cell)


def _float(value: Fraction) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
