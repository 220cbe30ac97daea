"""Theorems about exact time, against brute force in rational numbers."""

import itertools
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.timeline import Timeline, nanoseconds, nearest, rational, seconds

MILLI2 = Fraction(1, 500)  # [s], the usual timestep


def up_to(low: str, high: str, most: int = 1000) -> st.SearchStrategy[Fraction]:
    """The rationals from `low` to `high` with a denominator of at most `most`."""
    return st.fractions(Fraction(low), Fraction(high), max_denominator=most)


RUNS = st.builds(Timeline.lasting, up_to("1/1000", "1/10", 5000), up_to("1/1000", "2"))
FPS = st.one_of(
    st.sampled_from([Fraction(24), Fraction(25), Fraction(30), Fraction(60), Fraction(24000, 1001)]),
    up_to("1/2", "120"),
)
SPEEDS = st.one_of(st.just(Fraction(1)), up_to("1/4", "8", 50))
LAWS = settings(max_examples=30, deadline=None)


@pytest.mark.parametrize(
    ("value", "exact"),
    [
        (0.002, Fraction(1, 500)),
        (0.1, Fraction(1, 10)),
        (1 / 3, Fraction(3333333333333333, 10**16)),
        (1e-3, Fraction(1, 1000)),
        (5, Fraction(5)),
        ("30000/1001", Fraction(30000, 1001)),
        (" 0.5 ", Fraction(1, 2)),
        ("1e-3", Fraction(1, 1000)),
        ("-2", Fraction(-2)),
        (Fraction(2, 7), Fraction(2, 7)),
    ],
)
def test_a_number_stands_for_the_decimal_or_the_ratio_that_it_is_written_as(
    value: float | str | Fraction, exact: Fraction
) -> None:
    assert rational(value) == exact


@given(st.floats(allow_nan=False, allow_infinity=False))
@LAWS
def test_a_float_and_its_text_mean_the_same_number_which_rounds_back_to_the_float(value: float) -> None:
    assert rational(value) == rational(repr(value))
    assert float(rational(value)) == value


@pytest.mark.parametrize(
    "value",
    [
        "",
        " ",
        "x",
        "1,5",
        "1/0",
        "1/2/3",
        "0x10",
        "nan",
        "inf",
        "1e1000",
        "1e1_000",
        "-1E-1_0_0_0",
        *map(float, ("nan", "inf", "-inf")),
    ],
)
def test_what_is_not_a_finite_number_is_refused_and_shown(value: float | str) -> None:
    with pytest.raises(ValueError, match="not a finite number") as caught:
        rational(value)
    assert repr(value) in str(caught.value)


@pytest.mark.parametrize(
    ("value", "integer"),
    [("0", 0), ("1/2", 1), ("-1/2", 0), ("3/2", 2), ("5/2", 3), ("-3/2", -1), ("49/100", 0), ("51/100", 1)],
)
def test_halves_are_rounded_up(value: str, integer: int) -> None:
    assert nearest(Fraction(value)) == integer


@pytest.mark.parametrize("hundredths", range(1, 101))
def test_a_duration_in_hundredths_takes_five_steps_of_two_milliseconds_per_hundredth(hundredths: int) -> None:
    timeline = Timeline.lasting(rational(0.002), rational(hundredths / 100))
    assert timeline.steps == 5 * hundredths
    assert timeline.time(timeline.steps) == timeline.duration


@pytest.mark.parametrize(("duration", "steps"), [("0.0029", 1), ("0.003", 2), ("0.0031", 2), ("0.0009", 0)])
def test_a_duration_is_the_nearest_number_of_whole_steps_and_is_kept_as_asked(duration: str, steps: int) -> None:
    timeline = Timeline.lasting(MILLI2, rational(duration))
    assert (timeline.steps, timeline.duration) == (steps, Fraction(duration))


@given(up_to("1/1000", "1/10"), st.integers(1, 10**9))
@LAWS
def test_a_run_of_n_steps_has_n_steps_and_lasts_exactly_n_timesteps(timestep: Fraction, steps: int) -> None:
    timeline = Timeline.of_steps(timestep, steps)
    assert timeline.steps == steps
    assert timeline.duration == timeline.time(steps) == steps * timestep
    assert timeline == Timeline.lasting(timestep, timeline.duration)


@pytest.mark.parametrize(
    ("fps", "speed", "expected"),
    [
        ("50", "1", [0, 10, 20, 30]),
        ("200", "1", [0, 3, 5, 8, 10, 13, 15, 18, 20, 23, 25, 28, 30, 33, 35, 38]),
        ("50", "2", [0, 20]),
        ("50", "1/2", [0, 5, 10, 15, 20, 25, 30, 35]),
        ("500", "1/2", [k // 2 + k % 2 for k in range(80)]),
        ("1", "1", [0]),
    ],
)
def test_frames_of_eighty_milliseconds_fall_on_these_steps(fps: str, speed: str, expected: list[int]) -> None:
    assert Timeline.lasting(MILLI2, Fraction("0.08")).frame_steps(Fraction(fps), Fraction(speed)) == expected


@given(RUNS, FPS, SPEEDS)
@LAWS
def test_frame_k_shows_the_step_nearest_its_time_and_the_film_ends_before_the_duration(
    run: Timeline, fps: Fraction, speed: Fraction
) -> None:
    times = itertools.takewhile(lambda t: t < run.duration, (k * speed / fps for k in itertools.count()))
    assert run.frame_steps(fps, speed) == [(time / run.timestep + Fraction(1, 2)).__floor__() for time in times]


@given(st.integers(0, 500), st.integers(1, 60), up_to("1/1000", "1/10"))
@LAWS
def test_rows_are_a_range_and_the_last_step(steps: int, every: int, timestep: Fraction) -> None:
    rows = list(Timeline.of_steps(timestep, steps).rows(every))
    assert rows == sorted({*range(0, steps + 1, every), steps})


@given(st.integers(0, 500), st.integers(1, 60), up_to("1/1000", "1/10"))
@LAWS
def test_a_rate_that_divides_the_step_rate_is_every_nth_step(steps: int, every: int, timestep: Fraction) -> None:
    run = Timeline.of_steps(timestep, steps)
    assert list(run.rows(rate=1 / (every * timestep))) == list(run.rows(every))


def test_a_rate_beyond_all_measure_has_a_row_at_every_step_at_once() -> None:
    run = Timeline.of_steps(Fraction(1, 500), 10**9)
    assert run.rows(rate=Fraction(10) ** 300) == range(10**9 + 1)


@given(st.integers(0, 500), up_to("1/1000", "1/10"), up_to("1/50", "3"))
@LAWS
def test_rows_at_a_rate_are_nearest_their_times_and_no_step_is_shown_twice(
    steps: int, timestep: Fraction, share: Fraction
) -> None:
    run = Timeline.of_steps(timestep, steps)
    rate = share / timestep
    on_time = [k for k in range(3 * steps + 2) if k / rate <= run.duration]
    expected = [nearest(k / (rate * timestep)) for k in on_time]
    rows = list(run.rows(rate=rate))
    assert rows == sorted({*expected, steps})
    assert (rows[0], rows[-1]) == (0, steps)


@given(st.fractions(Fraction(1, 10**6), Fraction(1)), st.integers(0, 10**12), st.integers(1, 5))
def test_seconds_are_exact_and_rounded_once(timestep: Fraction, first: int, count: int) -> None:
    steps = np.arange(first, first + count)
    assert list(seconds(steps, timestep)) == [float(int(step) * timestep) for step in steps]


def test_seconds_of_a_timestep_with_many_digits_do_not_overflow() -> None:
    timestep = rational(1 / 240)
    assert list(seconds(np.array([0, 3000]), timestep)) == [0, float(3000 * timestep)]
    assert list(seconds(np.array([0]), Fraction(10**30))) == [0]


@given(st.integers(0, 10**9), st.fractions(Fraction(1, 10**6), Fraction(1)))
def test_nanoseconds_are_the_nearest_integers_to_exact_times(step: int, timestep: Fraction) -> None:
    assert abs(nanoseconds(step * timestep) - step * timestep * 10**9) <= Fraction(1, 2)
    assert nanoseconds(step * Fraction(1, 500)) == 2_000_000 * step
