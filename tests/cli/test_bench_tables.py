"""Numbers in the tables of a benchmark's report."""

import pytest

from mjrun.cli.bench_tables import digits, duration


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (None, "-"),
        (2.5, "2.500 s"),
        (0.01234, "12.34 ms"),
        (1.5e-5, "15.00 µs"),
        (2e-9, "2.000 ns"),
        (1e-12, "0.001 ns"),
    ],
)
def test_a_duration_is_in_the_unit_that_suits_it(seconds: float | None, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("value", "text"), [(1.23456, "1.235"), (123456.0, "123,456"), (12.3, "12.30"), (0.5, "0.500"), (2.5e9, "2.5e+09")]
)
def test_a_number_has_its_significant_digits(value: float, text: str) -> None:
    assert digits(value) == text
