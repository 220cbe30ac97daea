"""Tolerances, beside numpy.isclose and the bits of numbers."""

import math
import struct
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.diff.tolerances import Tolerance, Tolerances, as_numbers, cell_text, compare_cells, matches, require_matches
from mjrun.errors import UnknownNameError

SPECIAL = [0.0, -0.0, 5e-324, 1.0, 1 + 2**-52, -1.0, 1e308, -1e308, float("inf"), float("-inf"), float("nan")]
numbers = st.floats() | st.sampled_from(SPECIAL)
tolerances = st.sampled_from([1e-300, 1e-9, 0.5, 1e300])


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=9), tolerances, st.sampled_from([0.0, 1e-9, 0.5]))
def test_within_a_tolerance_is_what_numpy_says(pairs: list[tuple[float, float]], atol: float, rtol: float) -> None:
    a, b = np.array(pairs).T.copy()
    with np.errstate(all="ignore"):
        close = np.isclose(a, b, rtol=rtol, atol=atol, equal_nan=True)
    assert np.array_equal(Tolerance(atol, rtol).agree(a, b), close)


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=9))
def test_without_a_tolerance_the_bits_are_the_same_and_nan_is_nan(pairs: list[tuple[float, float]]) -> None:
    a, b = np.array(pairs).T.copy()
    expected = [struct.pack("d", x) == struct.pack("d", y) or (x != x and y != y) for x, y in zip(a, b, strict=True)]
    assert Tolerance().agree(a, b).tolist() == expected


def test_the_last_pattern_that_matches_a_column_counts() -> None:
    made = Tolerances(Tolerance(1), {"qvel/*": [2, 3], "qvel/knee": [4.0]})
    assert made.of("qpos/knee") == Tolerance(1)
    assert made.of("qvel/hip") == Tolerance(2, 3)
    assert made.of("qvel/knee") == Tolerance(4)
    assert made.of_key("time") == Tolerance()
    assert Tolerances(Tolerance(1), {"ti*": [2]}).of_key("time") == Tolerance(2)


def test_a_pattern_without_a_column_is_refused() -> None:
    assert matches("qpos/[a]", "qpos/[a]")
    with pytest.raises(UnknownNameError, match="no column 'qvle/\\*'") as error:
        Tolerances(Tolerance(), {"q*": [1], "qvle/*": [1]}).require(["qvel/a"])
    assert error.value.path == ("tol",)
    require_matches("columns", ["q*"], ["qvel/a"])


EXACT = Tolerance()
numbers_of_cells = st.integers(-(2**70), 2**70) | st.floats(-1e30, 1e30)


def column(*cells: object) -> np.ndarray:
    made = np.empty(len(cells), object)
    made[:] = cells
    return made


@given(numbers_of_cells, numbers_of_cells, st.sampled_from([0.0, 0.5, 1e20]), st.sampled_from([0.0, 1e-3]))
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
        ("1_0", 10, False),
        ("1_0", 10.0, False),
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
