"""Samples have the rank correlations that are requested, as SciPy computes them, and the distributions as well."""

from typing import Any

import numpy as np
import pytest
import scipy

from mjrun.errors import UsageError
from mjrun.experiment.design import Design, design
from mjrun.options.sweep import VariationOptions
from tests.experiment.test_design import MODEL

VARY = {"a.mass": "uniform(1,3)", "b.x": "loguniform(1,100)", "c.y": "normal(2,0.5)", "d.n": "integers(0,99)"}


def points(**options: Any) -> Design:
    return design(VariationOptions(**{"vary": VARY, "samples": 4096, **options}), MODEL, seed=1)


def columns(made: Design) -> np.ndarray:
    """Returns the values of all points `(parameters, points)`."""
    return np.array([made.column(place).numbers for place in range(len(made.names))], float)


@pytest.mark.parametrize("sampler", ["random", "halton", "sobol", "lhs"])
def test_samples_have_these_rank_correlations_and_unchanged_distributions(sampler: str) -> None:
    wanted = {"mass,x": 0.8, "x, c.y": -0.5, "mass,y": -0.3, "y,n": 0.2}
    values = columns(points(sampler=sampler, correlate=wanted))
    found = scipy.stats.spearmanr(values.T)[0]
    expected = np.array([[1, 0.8, -0.3, 0], [0.8, 1, -0.5, 0], [-0.3, -0.5, 1, 0.2], [0, 0, 0.2, 1]])
    np.testing.assert_allclose(found, expected, atol=0.05 if sampler in ("random", "lhs") else 0.01)
    distributions = scipy.stats.uniform(1, 2), scipy.stats.loguniform(1, 100), scipy.stats.norm(2, 0.5)
    for column, own in zip(values, distributions, strict=False):
        assert scipy.stats.kstest(column, own.cdf).statistic < (0.03 if sampler in ("random", "lhs") else 0.005)
    assert set(values[3]) == set(range(100))


def test_more_samples_keep_their_points_and_so_do_parameters_without_correlations() -> None:
    few, many = (columns(points(samples=count, correlate={"mass,y": 0.7})) for count in (100, 70_000))
    np.testing.assert_array_equal(many[:, :100], few)
    independent = columns(points(samples=100))
    np.testing.assert_array_equal(independent[[0, 1, 3]], few[[0, 1, 3]])
    assert (independent[2] != few[2]).all()


def test_several_parameters_may_share_a_correlation() -> None:
    found = scipy.stats.spearmanr(columns(points(correlate={"mass,x,y": 0.6})).T)[0]
    np.testing.assert_allclose(found[:3, :3][np.triu_indices(3, 1)], 0.6, atol=0.01)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"correlate": {"mass,z": 0.5}}, "no parameter 'z'"),
        ({"correlate": {"mass,x": 1}}, "'1' is not a number above -1 and below 1"),
        ({"correlate": {"mass,a.mass": 0.5}}, "two parameters or more, each once"),
        ({"correlate": {"mass,x": 0.9, "x,y": 0.9, "mass,y": -0.9}}, "no samples have all of these correlations"),
        (
            {"correlate": {"mass,x": 0.5, "x,mass": 0.3}},
            "x,mass=0.3: mass,x=0.5 applies to the same pair, b.x and a.mass",
        ),
        ({"correlate": {"mass,x,y": 0.5, "y,c.y": 0.3}}, "two parameters or more, each once"),
        ({"correlate": {"mass,x,y": 0.5, "x,c.y": 0.3}}, "mass,x,y=0.5 applies to the same pair, b.x and c.y"),
        ({"correlate": {"mass,x": 0.5}, "sampler": "saltelli"}, "excludes --sampler saltelli: sensitivities"),
        ({"correlate": {"mass,x": 0.5}, "sampler": "morris"}, "excludes --sampler morris"),
        ({"correlate": {"mass,x": 0.5}, "vary": {"a.mass": "1,2", "b.x": "uniform(0,1)"}}, "mass has a list of values"),
        ({"correlate": {"mass,x": 0.5}, "vary": {"a.mass": "choice(1,2)", "b.x": "uniform(0,1)"}}, "mass is a choice"),
    ],
)
def test_correlations_that_no_samples_have_are_refused(options: dict[str, Any], expected: str) -> None:
    with pytest.raises(UsageError) as raised:
        points(**options)
    assert expected in raised.value.spelled(lambda name: f"--{name}")
