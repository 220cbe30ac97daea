"""Tolerances, beside numpy.isclose and the bits of numbers."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.diff.tolerances import Tolerance, Tolerances, matches, require_matches
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
