"""Quantile functions of distributions, against closed forms and numpy."""

from statistics import NormalDist

import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.physics.random_distribution import LEAST, MOST, draw_numbers, draw_text, parse_distribution
from tests.cases import cases

FRACTIONS = np.array([0.001, 0.1, 0.25, 0.5, 0.75, 0.999])


def values(text: str) -> list[float]:
    distribution = parse_distribution(text, "vary x")
    assert distribution
    return [float(value) for value in distribution.values(FRACTIONS)]


def test_quantiles_are_those_of_the_closed_forms() -> None:
    assert values("uniform(2, 4)") == pytest.approx(2 + 2 * FRACTIONS)
    assert values("loguniform(1e-3, 10)") == pytest.approx(1e-3 * 1e4**FRACTIONS)
    assert values("normal(1, 2)") == pytest.approx([NormalDist(1, 2).inv_cdf(p) for p in FRACTIONS])


def test_a_truncated_normal_is_the_normal_within_its_limits() -> None:
    normal = NormalDist(1, 2)
    low, high = normal.cdf(0), normal.cdf(4)
    assert values("truncnormal(1, 2, 0, 4)") == pytest.approx(
        [normal.inv_cdf(low + p * (high - low)) for p in FRACTIONS]
    )


@pytest.mark.parametrize(
    "text", ["truncnormal(1.69, 1.04, -0.58, 0.48)", "truncnormal(5, 1e300, 0, 1)", "truncnormal(3e16, 1e16, 0, 1)"]
)
def test_no_value_is_beyond_the_limits_of_its_distribution(text: str) -> None:
    distribution = parse_distribution(text, "vary x")
    assert distribution
    made = distribution.quantiles(np.array([0, LEAST, 0.25, 0.5, 0.75, MOST]))
    low, high = distribution.numbers[-2:]
    assert ((made >= low) & (made <= high)).all()
    assert (np.diff(made) >= 0).all()


@pytest.mark.parametrize(("mean", "std"), [(0.5, 1e12), (0.5, 1e300), (3e16, 1e16), (-1e9, 1e12)])
def test_a_wide_normal_within_narrow_limits_is_uniform(mean: float, std: float) -> None:
    distribution = parse_distribution(f"truncnormal({mean}, {std}, 0, 1)", "vary x")
    assert distribution
    assert distribution.quantiles(FRACTIONS) == pytest.approx(FRACTIONS, abs=1e-8)


def test_integers_and_choices_are_equally_likely() -> None:
    fractions = (np.arange(6000) + 0.5) / 6000
    for text, expected in (("integers(-1, 1)", ["-1", "0", "1"]), ("choice(a, b c, 2)", ["a", "b c", "2"])):
        distribution = parse_distribution(text, "vary x")
        assert distribution
        drawn = distribution.values(fractions)
        assert {value: drawn.count(value) for value in expected} == dict.fromkeys(expected, 2000)
        assert distribution.values(np.array([1.0]))[0] == expected[-1]


@pytest.mark.parametrize("text", ["1,2", "0.1..1:10", "a", "", "(1)", "f(1"])
def test_what_is_not_written_like_a_distribution_is_none(text: str) -> None:
    assert parse_distribution(text, "vary x") is None


@cases("text, expected")
def test_what_cannot_be_is_refused(text: str, expected: str) -> None:
    with pytest.raises(UsageError, match=expected):
        parse_distribution(text, "vary x")


@pytest.mark.parametrize(
    ("text", "mean", "std"),
    [
        ("uniform(2, 4)", 3, 2 / 12**0.5),
        ("normal(1, 2)", 1, 2),
        ("integers(-1, 1)", 0, (2 / 3) ** 0.5),
        ("choice(1, 5)", 3, 2),
        ("truncnormal(0, 1, -1, 1)", 0, 0.539560),
        ("loguniform(1, 10)", 9 / np.log(10), (99 / 2 / np.log(10) - (9 / np.log(10)) ** 2) ** 0.5),
        ("0.5", 0.5, 0),
    ],
)
def test_what_is_drawn_has_the_moments_of_the_closed_forms(text: str, mean: float, std: float) -> None:
    drawn = draw_numbers(text, np.random.default_rng(1), 20_000)
    assert drawn.mean() == pytest.approx(mean, abs=0.05)
    assert drawn.std() == pytest.approx(std, abs=0.05)
    assert float(draw_text(text, np.random.default_rng(1))) == drawn[0]


def test_a_text_that_is_no_distribution_is_drawn_as_it_is() -> None:
    assert draw_text("elliptic", np.random.default_rng(0)) == "elliptic"
    assert draw_text("choice(a, a)", np.random.default_rng(0)) == "a"


def test_quantiles_at_both_ends_are_values_of_the_distribution() -> None:
    ends = np.array([0.0, 1.0])
    integers, normal = (parse_distribution(text, "vary x") for text in ("integers(1, 6)", "normal(0, 1)"))
    assert integers
    assert normal
    assert integers.values(ends) == ["1", "6"]
    assert np.isfinite(normal.quantiles(ends)).all()
