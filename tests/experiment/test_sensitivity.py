"""Sobol' indices against closed forms and scipy, elementary effects against linear functions, and their designs."""

import math

import numpy as np
import pytest
import scipy

from mjrun.experiment.samplers import LEVELS, SAMPLES, STEP, morris, saltelli
from mjrun.experiment.statistics import (
    SensitivityIndex,
    elementary_effects,
    sensitivities,
    sensitivity_table,
    sobol_indices,
)


def ishigami(fractions: np.ndarray) -> np.ndarray:
    """Ishigami's function of three parameters, uniform from −π to π."""
    x, y, z = (2 * math.pi * (fractions - 0.5)).T
    return np.sin(x) + 7 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)


def values_of(made: list[dict[str, SensitivityIndex]], name: str) -> np.ndarray:
    return np.array([each[name].value for each in made], float)


def generator(seed: int = 4) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_sobol_indices_of_ishigamis_function_are_the_exact_ones() -> None:
    values = ishigami(saltelli(2048, 3, generator())).reshape(-1, 5)
    made = sobol_indices(values, 0.95)
    np.testing.assert_allclose(values_of(made, "first"), [0.3139, 0.4424, 0], atol=0.02)
    np.testing.assert_allclose(values_of(made, "total"), [0.5576, 0.4424, 0.2437], atol=0.02)
    for each, exact in zip(made, (0.3139, 0.4424, 0), strict=True):
        assert (each["first"].interval.low or 0) <= exact <= (each["first"].interval.high or 0)


def test_sobol_indices_are_those_of_scipy() -> None:
    values = ishigami(saltelli(64, 3, generator())).reshape(-1, 5)
    parts = {"f_A": values[None, :, 0], "f_B": values[None, :, 1], "f_AB": values[:, 2:].T[:, None]}
    expected = scipy.stats.sobol_indices(func=parts, n=64)
    made = sobol_indices(values, 0.9)
    np.testing.assert_allclose(values_of(made, "first"), expected.first_order.ravel(), rtol=1e-9)
    np.testing.assert_allclose(values_of(made, "total"), expected.total_order.ravel(), rtol=1e-9)


def test_elementary_effects_of_a_linear_function_are_its_slopes() -> None:
    slopes = np.array([3.0, -0.5, 0.0, 8.0])
    points = morris(5, 4, generator())
    made = elementary_effects((points @ slopes).reshape(5, 5), points.reshape(5, 5, 4), 0.95)
    np.testing.assert_allclose(values_of(made, "mu_star"), np.abs(slopes), atol=1e-9)
    np.testing.assert_allclose(values_of(made, "sigma"), 0, atol=1e-9)


def test_effects_of_both_signs_have_a_mean_magnitude_and_spread() -> None:
    points = morris(200, 2, generator())
    product = (points[:, 0] - 0.5) * (points[:, 1] - 0.5)
    made = elementary_effects(product.reshape(200, 3), points.reshape(200, 3, 2), 0.95)
    magnitude = np.abs((np.arange(LEVELS) + 0.5) / LEVELS - 0.5)  # of the other parameter, which is the slope
    for each in made:
        assert each["mu_star"].value == pytest.approx(magnitude.mean(), rel=0.15)
        assert each["sigma"].value == pytest.approx(math.sqrt((magnitude**2).mean()), rel=0.15)


@pytest.mark.parametrize("sampler", SAMPLES)
def test_more_samples_keep_the_points_of_fewer(sampler: str) -> None:
    draw, more = SAMPLES[sampler]
    few, many = draw(3, 4, generator()), draw(11, 4, generator())
    assert len(few) == 3 * (4 + more)
    assert np.array_equal(many[: len(few)], few)


def test_each_point_of_a_trajectory_changes_one_parameter_by_a_step() -> None:
    points = morris(40, 3, generator()).reshape(40, 4, 3)
    changes = np.diff(points, axis=1)
    assert (np.count_nonzero(changes, axis=2) == 1).all()
    assert (np.count_nonzero(changes, axis=1) == 1).all()
    assert {*np.abs(changes[changes != 0])} == {STEP}
    assert set(points.ravel().tolist()) == {0.125, 0.375, 0.625, 0.875}


def test_samples_with_a_failed_point_are_left_out_and_constant_metrics_have_no_index() -> None:
    values = ishigami(saltelli(8, 3, generator()))
    broken = values.copy()
    broken[7] = np.nan  # in the second sample
    metrics = {"v": broken.tolist(), "w": [1.0] * 40, "x": [math.nan] * 40}
    made = sensitivities("saltelli", ["a", "b", "c"], metrics, 0.95, 4)
    assert [(each.metric, each.parameter, each.samples) for each in made] == [
        *(("v", name, 7) for name in "abc"),
        *(("w", name, 8) for name in "abc"),
    ]
    expected = sobol_indices(np.delete(values.reshape(8, 5), 1, axis=0), 0.95)
    assert [each.indices for each in made[:3]] == expected
    assert made[3].indices["first"].value is None
    table = sensitivity_table(made).numbers
    assert table["total"][:3].tolist() == [each["total"].value for each in expected]
    assert np.isnan(table["total"][3:]).all()
