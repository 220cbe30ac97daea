"""Normal equations of multiple shooting, from which the states of chunks are eliminated.

The state of a chunk shows in its own rows alone, so that states are eliminated chunk by chunk, and only a matrix of the
size of the parameters is left.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjrun.fit.shooting_problem import STATE_SCALE, Point, ShootingProblem
from mjrun.fit.solution import Floats

ROUNDING = 1e-14  # smallest share of the largest eigenvalue of normal equations that counts


@dataclass(frozen=True, eq=False)
class Slopes:
    """Slopes of the residuals of each chunk.

    Attributes:
      of_coordinates: `(n, signals, p)`.
      of_states: `(n, signals, size)`.
      is_fresh: whether both are differences at the point itself.
    """

    of_coordinates: Sequence[Floats]
    of_states: Sequence[Floats]
    is_fresh: bool = True


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of the coordinates alone, and how states follow.

    Attributes:
      matrix, gradient: of the coordinates, `(p, p)` and `(p,)`.
      of_states: matrices of the state of each chunk alone, `(chunks, size, size)`.
      state_steps: of the state of each chunk where the coordinates stay, `(chunks, size)`.
      state_slopes: how far states follow the coordinates, `(chunks, size, p)`, downwards.
    """

    matrix: Floats
    gradient: Floats
    of_states: Floats
    state_steps: Floats
    state_slopes: Floats

    def step(self, coordinates: Floats) -> tuple[Floats, Floats]:
        """The steps of the coordinates, `(p,)`, and of the states; coordinates stop at the bounds 0 and 1."""
        turn = _within(self.matrix, self.gradient, coordinates)
        return turn, -self.state_steps - self.state_slopes @ turn


def normal_equations(
    problem: ShootingProblem,
    point: Point,
    residuals: Sequence[Floats],
    slopes: Slopes,
    weights: Sequence[Floats],
    damping: float = 0.0,
) -> NormalEquations:
    """The normal equations at a point.

    Args:
      weights: of the squares of the residuals, as these.
      damping: of D. W. Marquardt: share by which the diagonal grows.
    """
    count, size = len(problem.parts), problem.size
    priors, prior_slopes = problem.priors(point.coordinates)
    matrix, gradient, diagonal = np.diag(prior_slopes**2), prior_slopes * priors, prior_slopes**2
    of_states = np.zeros((count, size, size))
    state_steps, state_slopes = np.zeros((count, size)), np.zeros((count, size, problem.free))

    for i, known in enumerate(problem.known):
        roots = np.sqrt(weights[i][known])
        r = roots * residuals[i][known]
        a, b = (roots[:, None] * each[i][known] for each in (slopes.of_coordinates, slopes.of_states))
        own = b.T @ b + np.eye(size) / STATE_SCALE**2
        own += damping * np.diag(np.diag(own))
        right = np.column_stack([b.T @ a, b.T @ r + point.deviations[i] / STATE_SCALE**2])
        solved = solve_normal(own, right)
        of_states[i], state_slopes[i], state_steps[i] = own, solved[:, :-1], solved[:, -1]
        matrix += a.T @ a - right[:, :-1].T @ solved[:, :-1]
        gradient += a.T @ r - right[:, :-1].T @ solved[:, -1]
        diagonal += (a**2).sum(axis=0)
    matrix += np.diag(damping * diagonal + 1e-12 * max(float(diagonal.max(initial=0.0)), 1e-12))
    return NormalEquations(matrix, gradient, of_states, state_steps, state_slopes)


def solve_normal(matrix: Floats, right: Floats) -> Floats:
    """The solution of normal equations; steep slopes can hide what holds a state in place, beyond rounding."""
    scale = np.sqrt(np.diag(matrix))
    return np.linalg.lstsq(matrix / scale / scale[:, None], right / scale[:, None], rcond=ROUNDING)[0] / scale[:, None]


def _within(matrix: Floats, gradient: Floats, coordinates: Floats) -> Floats:
    """The step that solves the normal equations, `(p,)`; coordinates that would leave 0 to 1 stop at the bound."""
    step, is_free = np.zeros(len(gradient)), np.ones(len(gradient), bool)
    while is_free.any():
        inner = np.ix_(is_free, is_free)
        right = gradient[is_free] + matrix[np.ix_(is_free, ~is_free)] @ step[~is_free]
        step[is_free] = -np.linalg.lstsq(matrix[inner], right, rcond=None)[0]
        beyond = is_free & ((coordinates + step < 0) | (coordinates + step > 1))
        if not beyond.any():
            break
        step[beyond] = np.where(step[beyond] < 0, 0.0, 1.0) - coordinates[beyond]
        is_free &= ~beyond
    return step
