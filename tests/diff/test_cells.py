"""Cells that are no float64 are compared exactly."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.diff.cells import as_numbers, cell_text, compare_cells
from mjrun.diff.tolerances import Tolerance

EXACT = Tolerance()
numbers = st.integers(-(2**70), 2**70) | st.floats(-1e30, 1e30)


def column(*cells: object) -> np.ndarray:
    made = np.empty(len(cells), object)
    made[:] = cells
    return made


@given(numbers, numbers, st.sampled_from([0.0, 0.5, 1e20]), st.sampled_from([0.0, 1e-3]))
def test_numbers_agree_as_rationals_do(x: float, y: float, atol: float, rtol: float) -> None:
    (agree,), (difference,) = compare_cells(column(x), column(y), Tolerance(atol, rtol))
    exact = Fraction(y) - Fraction(x)
    assert difference == float(exact)
    if atol or rtol or exact:
        assert agree == (abs(exact) <= Fraction(atol) + Fraction(rtol) * abs(Fraction(y)))
    else:
        assert agree == (math.copysign(1, x) == math.copysign(1, y))


@pytest.mark.parametrize(
    ("x", "y", "agree"),
    [
        ("ok", "ok", True),
        ("ok", "Ok", False),
        ("a\nb", r"a\nb", True),  # cleaned, as .csv holds it
        ("12", 12.0, True),
        ("9007199254740993", 9007199254740993, True),
        ("9007199254740993", 9007199254740992.0, False),
        ("ok", 1.0, False),
        ("ok", math.nan, False),
        (math.nan, math.nan, True),
        (math.nan, 2**60 + 1, False),
        (math.inf, math.inf, True),
        (10**400, 10**400 + 1, False),
        (10**400, 1.0, False),
    ],
)
def test_texts_and_gaps_agree_with_themselves(x: object, y: object, agree: bool) -> None:
    for pair in ((x, y), (y, x)):
        found, difference = compare_cells(column(pair[0]), column(pair[1]), EXACT)
        assert found.tolist() == [agree]
        assert (difference[0] == 0) == agree


def test_a_column_is_float64_if_that_holds_all_of_it() -> None:
    assert as_numbers(np.array([1.0, 2.0])) is not None
    plain = as_numbers(column(1.0, math.nan))
    assert plain is not None
    assert plain.dtype == np.float64
    assert as_numbers(column(1.0, 2**60)) is as_numbers(column("a", 1.0)) is None
    assert [cell_text(cell) for cell in (0.1, 2**60 + 1, "a b")] == ["0.1", "1152921504606846977", "a b"]
