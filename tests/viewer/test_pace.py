"""Steps fall on the wall clock, and what is too late is given up."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.viewer.pace import WATCHED, Pace


@given(st.integers(0, 1000), st.floats(0, 100), st.sampled_from([0.25, 1.0, 4.0]))
def test_the_step_that_is_due_is_the_last_whose_time_has_come(first: int, elapsed: float, speed: float) -> None:
    pace = Pace(Fraction(1, 64), speed)  # exact in floats
    pace.start(first, 1024.0)
    due = pace.due(1024.0 + elapsed) - first
    assert due / 64 <= (1024.0 + elapsed - 1024.0) * speed < (due + 1) / 64


def test_what_is_given_up_is_not_caught_up_with() -> None:
    pace = Pace(Fraction(1, 100), 1.0)
    pace.start(0, 10.0)
    assert pace.due(12.0) == 200
    pace.give_up(50, 12.0)
    assert pace.due(12.0) == 50
    assert pace.due(12.505) == 100


@pytest.mark.parametrize(("reached", "slow"), [(1000, False), (950, False), (400, True)])
def test_it_is_too_slow_when_a_good_share_was_given_up(reached: int, slow: bool) -> None:
    pace = Pace(Fraction(1, 100), 1.0)
    pace.start(0, 0.0)
    pace.give_up(reached, 10.0)
    assert pace.is_too_slow(10.0) == slow
    assert pace.achieved(reached, 10.0) == reached / 1000


def test_nothing_is_said_of_a_short_stall_at_the_beginning() -> None:
    pace = Pace(Fraction(1, 100), 1.0)
    pace.start(0, 0.0)
    pace.give_up(0, WATCHED / 2)
    assert not pace.is_too_slow(WATCHED / 2)
