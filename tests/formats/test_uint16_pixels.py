"""Whole numbers for depth and ids, against exact rationals."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mjrun.errors import UsageError
from mjrun.formats.uint16_pixels import clipped_share, depth_millimetres, segment_numbers

depths = st.floats(0, 2e5, width=32)


@given(depths)
@example(0.0)
@example(float(np.float32(1e-30)))
@example(65.535)
@example(65.5355)
def test_a_millimetre_is_the_nearest_one_within_reach(metres: float) -> None:
    value = np.float32(metres)
    found = int(depth_millimetres(np.array([[value]]))[0, 0])
    exact = Fraction(float(value)) * 1000
    nearest = [k for k in (int(exact), int(exact) + 1) if abs(k - exact) <= Fraction(1, 2)]
    assert found in [min(max(k, 1), 65535) for k in nearest]


def test_nothing_is_zero_and_what_touches_the_lens_is_not_nothing() -> None:
    depth = np.array([[np.inf, 0, 0.0004, -1, np.nan]], np.float32)
    assert depth_millimetres(depth).tolist() == [[0, 1, 1, 1, 0]]


@given(st.lists(depths | st.just(float("inf")), min_size=1, max_size=20))
def test_the_clipped_share_counts_what_is_seen_and_would_need_more_than_16_bits(metres: list[float]) -> None:
    depth = np.array([metres], np.float32)
    seen = [Fraction(float(d)) for d in depth[0] if np.isfinite(d)]
    beyond = sum(d * 1000 > Fraction(131071, 2) for d in seen)
    assert clipped_share(depth) == (beyond / len(seen) if seen else 0)


@given(st.lists(st.integers(-1, 65534), min_size=1, max_size=20))
def test_ids_are_moved_up_by_one(ids: list[int]) -> None:
    stored = segment_numbers(np.array([ids], np.int32), 65535)
    assert stored.dtype == np.uint16
    assert stored.tolist() == [[k + 1 for k in ids]]


def test_more_things_than_16_bits_are_refused() -> None:
    with pytest.raises(UsageError, match="a segmentation of 65536 objects does not fit an image that can hold 65535"):
        segment_numbers(np.zeros((1, 1), np.int32), 65536)
