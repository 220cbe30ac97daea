"""Tolerances, absolute and relative, within which two numbers or two cells of a table agree, by column."""

import math
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from fractions import Fraction

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, clean, concerning


@dataclass(frozen=True)
class Tolerance:
    """A tolerance: numbers agree if |a − b| ≤ atol + rtol·|b|, as in numpy.isclose.

    If both are 0, the bits must be equal. NaN agrees with NaN, and an infinite number only with itself.
    """

    atol: float = 0.0
    rtol: float = 0.0

    @property
    def is_exact(self) -> bool:
        return self.atol == self.rtol == 0

    def agree(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Returns where `a` and `b`, float64 of one shape, agree."""
        both_nan = np.isnan(a) & np.isnan(b)
        if self.is_exact:
            return (a.view(np.int64) == b.view(np.int64)) | both_nan
        with np.errstate(invalid="ignore", over="ignore"):
            near = np.abs(a - b) <= self.atol + self.rtol * np.abs(b)
        return (a == b) | both_nan | (near & np.isfinite(a) & np.isfinite(b))


class Tolerances:
    """The tolerance of each column.

    Args:
      default: the tolerance of columns that no pattern matches.
      patterns: names with wildcards, each with an absolute tolerance, or an absolute and a relative one; the last match
        counts.
    """

    def __init__(self, default: Tolerance, patterns: Mapping[str, Sequence[float]]) -> None:
        self._default = default
        self._patterns = [(pattern, Tolerance(*numbers)) for pattern, numbers in patterns.items()]

    @property
    def are_exact(self) -> bool:
        """True if no column has a tolerance."""
        return self._default.is_exact and all(tolerance.is_exact for _, tolerance in self._patterns)

    def of(self, name: str) -> Tolerance:
        """Returns the tolerance of the column `name`."""
        return self._last_match(name, self._default)

    def of_key(self, name: str) -> Tolerance:
        """Returns the tolerance of a column by which rows are aligned: zero, unless a pattern matches it."""
        return self._last_match(name, Tolerance())

    def require(self, names: Iterable[str], kind: str = "column") -> None:
        """Raises UnknownNameError if a pattern matches none of `names`, which are names of this kind."""
        require_matches("tol", [pattern for pattern, _ in self._patterns], names, kind)

    def _last_match(self, name: str, default: Tolerance) -> Tolerance:
        matching = [tolerance for pattern, tolerance in self._patterns if matches(name, pattern)]
        return matching[-1] if matching else default


def matches(name: str, pattern: str) -> bool:
    """Returns whether `pattern`, a name with the wildcards of a shell, matches `name`."""
    return name == pattern or fnmatchcase(name, pattern)


def require_matches(option_name: str, patterns: Iterable[str], names: Iterable[str], kind: str = "column") -> None:
    """Raises UnknownNameError if one of the `patterns` of an option matches none of `names`."""
    valid = list(names)
    for pattern in patterns:
        if not any(matches(name, pattern) for name in valid):
            with concerning(option_name):
                raise UnknownNameError(kind, pattern, valid)


Cell = float | int | str


def as_numbers(column: np.ndarray) -> np.ndarray | None:
    """Returns a column as float64; None if that cannot represent all of its cells."""
    if column.dtype == np.float64:
        return column
    return column.astype(np.float64) if all(type(cell) is float for cell in column) else None


def compare_cells(a: np.ndarray, b: np.ndarray, tolerance: Tolerance) -> tuple[np.ndarray, np.ndarray]:
    """Returns where the cells of two columns agree, and the differences b − a, infinite where a text differs."""
    pairs = [_compare(x, y, tolerance) for x, y in zip(a.tolist(), b.tolist(), strict=True)]
    agree, difference = zip(*pairs, strict=True)
    return np.array(agree, bool), np.array(difference, float)


def cell_text(cell: Cell) -> str:
    """Returns a cell as a text that reads back as the same."""
    return cell if isinstance(cell, str) else repr(cell)


def _compare(x: Cell, y: Cell, tolerance: Tolerance) -> tuple[bool, float]:
    if isinstance(x, str) and isinstance(y, str):
        agree = clean(x) == clean(y)  # .csv contains cleaned texts
        return agree, 0.0 if agree else math.inf
    if isinstance(x, str) or isinstance(y, str):
        try:
            return _compare(as_number(x), as_number(y), tolerance)  # .csv does not quote a text that is a number
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


def as_number(cell: Cell) -> float | int:
    """Returns a cell as a number; raises ValueError if it is another text."""
    if not isinstance(cell, str):
        return cell
    if "_" in cell:  # which Python reads as part of a number
        raise ValueError(cell)
    try:
        return int(cell)
    except ValueError:
        return float(cell)


def _float(value: Fraction) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def finite_or_none(value: float) -> float | None:
    """Returns a number for JSON; None if it is not finite."""
    return value if math.isfinite(value) else None
