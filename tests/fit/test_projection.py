"""Eliminating the states of chunks against the least squares of all unknowns together."""

from dataclasses import replace

import numpy as np

from mjrun.fit.projection import information, projected
from mjrun.fit.shooting_problem import STATE_SCALE
from tests.fit.problems import solved


def test_the_parameters_of_the_joint_problem_are_those_of_the_projected_one() -> None:
    solution, _ = solved()
    a, b = (np.asarray(each)[:, 0] for each in solution.sensitivities[0])
    r = np.random.default_rng(0).normal(size=len(a))
    rows = projected(replace(solution, residuals=[r[:, None]]))[0]
    short, *_ = np.linalg.lstsq(rows.slopes, rows.residuals, rcond=None)
    joint = np.block([[a, b], [np.zeros((b.shape[1], a.shape[1])), np.eye(b.shape[1]) / STATE_SCALE]])
    full, *_ = np.linalg.lstsq(joint, np.concatenate([r, np.zeros(b.shape[1])]), rcond=None)
    np.testing.assert_allclose(short, full[: a.shape[1]], rtol=1e-3)
    np.testing.assert_allclose(information([rows]), rows.slopes.T @ rows.slopes)


def test_missing_samples_have_no_rows() -> None:
    solution, _ = solved()
    residuals = solution.residuals[0].copy()
    residuals[5] = np.nan
    assert len(projected(replace(solution, residuals=[residuals]))[0].residuals) == len(residuals) - 1
