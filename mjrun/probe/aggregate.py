"""What an assertion keeps of the rows: picked values and exact sums, the same however the rows are split."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

PIECE = 512  # rows evaluated at once; sums of so many products of two 27-bit numbers fit 63 bits


@dataclass(frozen=True)
class Piece:
    """Some rows that follow each other: their columns, and the number of the first of them."""

    columns: dict[str, np.ndarray]
    first: int
    count: int

    def place(self, index: int) -> str:
        """Where the row at `index` is, as a message ends."""
        times = self.columns.get("time")
        return f", at row {self.first + index}" + ("" if times is None else f", time {shown(times[index])}")


def shown(value: float) -> str:
    """`value` as the shortest text that reads back as the same float."""
    return repr(float(value)).removesuffix(".0")


_UNIT = 1126  # every float is a whole number of 2⁻¹¹²⁶, as its 53 bits stand below 2⁻¹⁰⁷³ at the least
_LOW = 27
_POWERS = {"count": (), "sum": (1,), "mean": (1,), "rms": (2,), "std": (1, 2)}  # of which sums are needed


def _exact(values: np.ndarray, power: int) -> int:
    """The sum of at most `PIECE` finite values, or of their squares, in units of 2⁻¹¹²⁶ or its square: exact."""
    fractions, exponents = np.frexp(values)
    mantissas = np.ldexp(fractions, 53).astype(np.int64)
    units, groups = np.unique(exponents, return_inverse=True)
    high, low = np.abs(mantissas) >> _LOW, np.abs(mantissas) & ((1 << _LOW) - 1)
    terms = {0: mantissas} if power == 1 else {0: low * low, _LOW + 1: high * low, 2 * _LOW: high * high}
    total = 0
    for shift, term in terms.items():
        sums = np.zeros(len(units), np.int64)
        np.add.at(sums, groups, term)
        total += sum(s << shift + power * (e - 53 + _UNIT) for s, e in zip(sums.tolist(), units.tolist(), strict=True))
    return total


def _ratio(numerator: int, denominator: int) -> float:
    """The float nearest to a quotient; beyond all floats it is infinite."""
    try:
        return numerator / denominator
    except OverflowError:
        return math.inf if numerator > 0 else -math.inf


def _root(numerator: int, denominator: int) -> float:
    """The float nearest to the square root of a quotient: one root with bits to spare, the last of them sticky."""
    shift = (numerator.bit_length() - denominator.bit_length() - 109) // 2
    if shift < 0:
        numerator <<= -2 * shift
    else:
        denominator <<= 2 * shift
    root = math.isqrt(numerator // denominator)
    root |= root * root * denominator != numerator
    return _ratio(root << max(shift, 0), 1 << max(-shift, 0))


class Picked:
    """The value of one row: `find` names it in a piece, `better` says whether it replaces the one of earlier pieces."""

    def __init__(self, find: Callable[[np.ndarray], Any], better: Callable[[float, float], bool]) -> None:
        self._find, self._better, self._value, self.place = find, better, None, ""

    def add(self, values: np.ndarray, piece: Piece) -> None:
        """Takes one piece."""
        index = int(self._find(values))
        value = float(values[index])
        if self._value is None or self._better(value, self._value):
            self._value, self.place = value, piece.place(index)

    @property
    def value(self) -> float:
        """What was found, once there was a row."""
        return math.nan if self._value is None else self._value


class Summed:
    """Exact sums of the powers that `name` needs; `place` is the first row that is not finite, if there is one."""

    def __init__(self, name: str) -> None:
        self._name, self._count, self._totals, self.place = name, 0, {1: 0, 2: 0}, ""
        self._powers, self._infinite = _POWERS[name], {1: 0.0, 2: 0.0}

    def add(self, values: np.ndarray, piece: Piece) -> None:
        """Takes one piece."""
        self._count += len(values)
        if not self._powers:
            return
        finite = np.isfinite(values)
        if not finite.all():
            self.place = self.place or piece.place(int(np.argmin(finite)))
            for power in (1, 2):
                self._infinite[power] += float(np.sum(values[~finite] ** power))
            values = values[finite]
        for power in self._powers:
            self._totals[power] += _exact(values, power)

    @property
    def value(self) -> float:
        """The aggregate of all rows so far."""
        n, total, squares = self._count, self._totals[1], self._totals[2]
        if self.place:
            return {"rms": self._infinite[2], "std": math.nan}.get(self._name, self._infinite[1])
        match self._name:
            case "count":
                return float(n)
            case "sum":
                return _ratio(total, 1 << _UNIT)
            case "mean":
                return _ratio(total, n << _UNIT)
            case "rms":
                return _root(squares, n << 2 * _UNIT)
        return _root(n * squares - total * total, n * n << 2 * _UNIT)


def gatherer(name: str) -> Picked | Summed:
    match name:
        case "min":
            return Picked(np.argmin, lambda new, old: old == old and not new >= old)  # the first NaN wins for good
        case "max":
            return Picked(np.argmax, lambda new, old: old == old and not new <= old)
        case "first":
            return Picked(lambda values: 0, lambda new, old: False)
        case "last":
            return Picked(lambda values: len(values) - 1, lambda new, old: True)
    return Summed(name)
