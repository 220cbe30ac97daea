"""What measurements say of the parameters once the unknown states of the chunks have taken their share."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjrun.fit.free_parameter import FreeParameter
from mjrun.fit.shooting_problem import STATE_SCALE
from mjrun.fit.solution import Solution

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ProjectedRows:
    """Rows of a linear least-squares problem in the coordinates of the parameters alone.

    Attributes:
      slopes: `(n, p)`, orthogonal to what the states can explain.
      residuals: `(n,)`.
      times: of each row, the place of its sample in its chunk from 0 to 1, `(n,)`.
    """

    slopes: Floats
    residuals: Floats
    times: Floats


def projected(solution: Solution) -> list[ProjectedRows]:
    """The rows of each chunk of a solution, weighted as its loss does.

    Eliminating the states of a chunk is projecting on the complement of their slopes B: with a QR factorization of B,
    A − Q Qᵀ A (G. H. Golub, V. Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems
    whose variables separate", 1973).
    """
    return [
        _projected(residuals, *slopes, np.sqrt(weights))
        for residuals, slopes, weights in zip(solution.residuals, solution.sensitivities, solution.weights, strict=True)
    ]


def _projected(residuals: Floats, of_coordinates: Floats, of_states: Floats, weights: Floats) -> ProjectedRows:
    known = np.isfinite(residuals)
    rows = np.broadcast_to(np.linspace(0, 1, len(residuals))[:, None], residuals.shape)[known]
    w = weights[known]
    a, b, r = w[:, None] * of_coordinates[known], w[:, None] * of_states[known], w * residuals[known]
    size, count = b.shape[1], len(r)
    q, _ = np.linalg.qr(np.concatenate([b, np.eye(size) / STATE_SCALE]))
    a = np.concatenate([a, np.zeros((size, a.shape[1]))])
    r = np.concatenate([r, np.zeros(size)])
    return ProjectedRows((a - q @ (q.T @ a))[:count], (r - q @ (q.T @ r))[:count], rows)


def information(parts: Sequence[ProjectedRows]) -> Floats:
    """The information matrix of the coordinates, `(p, p)`."""
    return np.sum([part.slopes.T @ part.slopes for part in parts], axis=0)


def all_information(solution: Solution, parameters: Sequence[FreeParameter]) -> Floats:
    """The information matrix of the coordinates of `parameters`, with what priors say: `(p, p)`."""
    slopes = [each.prior_slope(c) for each, c in zip(parameters, solution.coordinates, strict=True)]
    return information(projected(solution)) + np.diag(np.square(slopes))
