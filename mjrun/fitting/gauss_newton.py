"""Damped Gauss-Newton steps for multiple shooting: parameters within bounds, and the state of every chunk.

The state of a chunk affects its own rows alone, so the normal equations are reduced to the parameters chunk by chunk.
Derivatives with respect to the states, most of the cost, are updated by secants from step to step, and computed again
only where a step gains less than expected. D. W. Marquardt, "An algorithm for least-squares estimation of nonlinear
parameters" (1963); C. G. Broyden, "A class of methods for solving nonlinear simultaneous equations" (1965).
"""

from collections.abc import Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.fitting.shooting_problem import (
    STATE_SCALE,
    Advanced,
    Floats,
    ShootingProblem,
    Simulating,
    Solution,
    Unknowns,
    loss_weights,
)

ROUNDING = 1e-14  # eigenvalues of normal equations below this share of the largest are ignored
EVALUATIONS = 120  # limit of evaluations of the residuals
TOLERANCE = 1e-6  # relative change of the cost at which a search ends
STAGE_EVALUATIONS = 40  # the same for stages that are followed by others
ROUGH_TOLERANCE = 1e-4  # the same for stages that are followed by others
EXPLAINED = 1.25  # reduced χ² at which a log counts as explained
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-9, 1e8
STRONG = 1e-5  # damping above which a search continues despite little gain: some direction may hardly show
DAMPINGS = (10.0, 100.0, 1000.0)  # factors of the damping after a failed step, all tried at once
SLOW = 0.01  # relative gain of a slow step
STALLED = 3  # consecutive slow steps that end a stage, or a search that is far from the noise
LEAST_GAIN = 0.05  # gain of a step that matters where the model explains the log: 0.5 is one standard error
LONG_STALLED = 10  # consecutive steps without such a gain that end a search which explains the log
FAR = 100.0  # mean square of residuals above which a search is far from the noise
GOOD = 0.5  # share of the expected decrease above which derivatives are kept
WIDER = 1000.0  # factor of the steps of finite differences across jumps of the motion
MISLEADING = 4.0  # ratio of the information by small and by wide differences above which motions are rough


@dataclass(frozen=True, eq=False)
class _Jacobians:
    """Derivatives of the residuals of each chunk.

    Attributes:
      of_coordinates: derivatives with respect to the coordinates, `(n, signals, p)`.
      of_states: derivatives with respect to the state of the chunk, `(n, signals, size)`.
      is_fresh: whether both are differences at the point itself.
    """

    of_coordinates: Sequence[Floats]
    of_states: Sequence[Floats]
    is_fresh: bool = True


@dataclass(frozen=True, eq=False)
class _NormalEquations:
    """Normal equations of the coordinates alone, from which steps of the states follow.

    Attributes:
      matrix, gradient: equations of the coordinates, `(p, p)` and `(p,)`.
      of_states: matrices of the state of each chunk alone, `(chunks, size, size)`.
      state_steps: negative steps of the states with constant coordinates, `(chunks, size)`.
      state_jacobians: negative derivatives of the states with respect to the coordinates, `(chunks, size, p)`.
    """

    matrix: Floats
    gradient: Floats
    of_states: Floats
    state_steps: Floats
    state_jacobians: Floats

    def step(self, coordinates: Floats) -> tuple[Floats, Floats]:
        """Returns the steps of the coordinates, `(p,)`, which stop at the bounds 0 and 1, and of the states."""
        turn = _within(self.matrix, self.gradient, coordinates)
        return turn, -self.state_steps - self.state_jacobians @ turn


def _normal_equations(
    problem: ShootingProblem,
    point: Unknowns,
    residuals: Sequence[Floats],
    jacobians: _Jacobians,
    weights: Sequence[Floats],
    damping: float = 0.0,
) -> _NormalEquations:
    """Returns the normal equations at a point.

    Args:
      weights: weights of the squared residuals, in their shapes.
      damping: relative increase of the diagonal.
    """
    count, size = len(problem.parts), problem.size
    priors, prior_slopes = problem.priors(point.coordinates)
    matrix, gradient, diagonal = np.diag(prior_slopes**2), prior_slopes * priors, prior_slopes**2
    of_states = np.zeros((count, size, size))
    state_steps, state_jacobians = np.zeros((count, size)), np.zeros((count, size, problem.free))

    for i, known in enumerate(problem.known):
        roots = np.sqrt(weights[i][known])
        r = roots * residuals[i][known]
        a, b = (roots[:, None] * each[i][known] for each in (jacobians.of_coordinates, jacobians.of_states))
        own = b.T @ b + np.eye(size) / STATE_SCALE**2
        own += damping * np.diag(np.diag(own))
        right = np.column_stack([b.T @ a, b.T @ r + point.deviations[i] / STATE_SCALE**2])
        solved = solve_normal(own, right)
        of_states[i], state_jacobians[i], state_steps[i] = own, solved[:, :-1], solved[:, -1]
        matrix += a.T @ a - right[:, :-1].T @ solved[:, :-1]
        gradient += a.T @ r - right[:, :-1].T @ solved[:, -1]
        diagonal += (a**2).sum(axis=0)
    matrix += np.diag(damping * diagonal + 1e-12 * max(float(diagonal.max(initial=0.0)), 1e-12))
    return _NormalEquations(matrix, gradient, of_states, state_steps, state_jacobians)


def solve_normal(matrix: Floats, right: Floats) -> Floats:
    """Solves normal equations, which may be singular to rounding: large derivatives hide terms that bound a state."""
    scale = np.sqrt(np.diag(matrix))
    return np.linalg.lstsq(matrix / scale / scale[:, None], right / scale[:, None], rcond=ROUNDING)[0] / scale[:, None]


def _within(matrix: Floats, gradient: Floats, coordinates: Floats) -> Floats:
    """Solves the normal equations for a step, `(p,)`; coordinates that would leave 0 to 1 stop at the bound."""
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


@dataclass(frozen=True, eq=False)
class _Place:
    """A point with the residuals of each chunk, `(n, signals)`, and half the sum of squares."""

    point: Unknowns
    residuals: list[Floats]
    cost: float


class GaussNewton:
    """A search for the least sum of squares of a problem by Gauss-Newton steps.

    Args:
      advanced: called with every solution that is better than the one before, without derivatives.
    """

    def __init__(self, problem: ShootingProblem, advanced: Advanced | None = None) -> None:
        self._problem, self._advanced = problem, advanced

    def minimize(self, evaluations: int = EVALUATIONS, tolerance: float = TOLERANCE) -> Simulating[Solution]:
        """Searches from the start of the problem.

        Args:
          evaluations: limit of evaluations of the residuals.
          tolerance: relative change of the cost at which the search ends.
        """
        place, jacobians = yield from self._descended(evaluations, tolerance)
        if self._problem.free:  # otherwise only the states are used
            if not jacobians.is_fresh:
                jacobians = yield from self._jacobians(place)
            jacobians = yield from self._sound(place, jacobians)
        return self._solution(place, jacobians)

    def approach(self) -> Simulating[Solution]:
        """Searches for a point from which longer stretches continue, and ends where the model explains the log.

        Derivatives of the solution are approximate.
        """
        return self._solution(*(yield from self._descended(STAGE_EVALUATIONS, ROUGH_TOLERANCE, EXPLAINED)))

    def look(self) -> Simulating[Solution]:
        """Returns the start of the problem, with derivatives."""
        return self._solution(*(yield from self._descended(evaluations=0, tolerance=0.0)))

    def _places(self, points: Sequence[Unknowns]) -> Simulating[list[_Place]]:
        all_residuals = yield from self._problem.residuals(points)
        return [_Place(p, r, self._problem.cost(p, r)) for p, r in zip(points, all_residuals, strict=True)]

    def _jacobians(self, place: _Place) -> Simulating[_Jacobians]:
        pair = yield from self._problem.jacobians(place.point, place.residuals)
        return _Jacobians(*pair)

    def _sound(self, place: _Place, jacobians: _Jacobians) -> Simulating[_Jacobians]:
        """Returns the smaller of forward and backward differences, as one of them may cross a jump of the motion."""
        backwards = yield from self._problem.jacobians(place.point, place.residuals, wider=-1.0)
        of_coordinates, of_states = (
            [np.where(np.abs(a) < np.abs(b), a, b) for a, b in zip(one, other, strict=True)]
            for one, other in zip((jacobians.of_coordinates, jacobians.of_states), backwards, strict=True)
        )
        return _Jacobians(of_coordinates, of_states)

    def _descended(
        self, evaluations: int, tolerance: float, enough: float = 0.0
    ) -> Simulating[tuple[_Place, _Jacobians]]:
        """Descends until steps gain nothing more.

        Args:
          enough: reduced χ² at which the search ends.
        """
        (place,) = yield from self._places([self._problem.start])
        jacobians = yield from self._jacobians(place)
        damping, used, slow, idle, has_failed = FIRST_DAMPING, 0, 0, 0, False
        numbers = sum(int(known.sum()) for known in self._problem.known)
        unknowns = self._problem.free + len(self._problem.parts) * self._problem.size
        far, explained = 0.5 * FAR * numbers, 0.5 * EXPLAINED * numbers
        near = 0.5 * enough * max(numbers - unknowns, 0)
        while used < evaluations and place.cost > near:
            is_lost = slow >= STALLED and (place.cost > far or enough > 0)
            if is_lost or (idle >= LONG_STALLED and place.cost < explained):
                break
            trials = [damping * factor for factor in (DAMPINGS if has_failed else (1.0,))]
            steps = [self._step(place, jacobians, trial) for trial in trials]
            points = [point for point, _ in steps]
            places = yield from self._places(points)
            used += len(points)
            best = min(range(len(places)), key=lambda index: places[index].cost)
            gain, promise = place.cost - places[best].cost, steps[best][1]
            had_failed, has_failed = has_failed, gain <= 0
            slow = slow + 1 if gain <= SLOW * place.cost else 0
            idle = idle + 1 if gain <= min(SLOW * place.cost, LEAST_GAIN) else 0
            is_end = max(gain, promise) <= tolerance * place.cost and trials[best] <= STRONG
            if gain > 0:
                before, place = place, places[best]
                if self._advanced:
                    self._advanced(self._solution(place, jacobians))
                if is_end and jacobians.is_fresh:
                    return place, jacobians
                is_good = gain > GOOD * promise and not is_end
                jacobians = yield from self._renewed(before, place, jacobians, is_good)
                is_easier = gain > GOOD * promise and not had_failed
                damping = max(trials[best] / (10.0 if is_easier else 1.0), LEAST_DAMPING)
            elif not jacobians.is_fresh:
                jacobians = yield from self._jacobians(place)
            elif is_end or trials[-1] >= MOST_DAMPING:
                break
            else:
                damping = trials[-1]
        return place, jacobians

    def _renewed(self, before: _Place, place: _Place, jacobians: _Jacobians, is_good: bool) -> Simulating[_Jacobians]:
        """Returns the derivatives at `place`: by differences, and for states by secants if these were good."""
        if not is_good:
            return (yield from self._jacobians(place))
        of_coordinates, _ = yield from self._problem.jacobians(place.point, place.residuals, of_states=False)
        moves = place.point.deviations - before.point.deviations
        turned = place.point.coordinates[: self._problem.free] - before.point.coordinates[: self._problem.free]
        of_states: list[Floats] = []
        for i, (slope, move) in enumerate(zip(jacobians.of_states, moves, strict=True)):
            lengths_of_chunk = np.sqrt((slope**2).sum(axis=(0, 1)))
            scaled = move * np.maximum(lengths_of_chunk, 1e-9) ** 2  # numbers of all units count alike
            change = place.residuals[i] - before.residuals[i] - jacobians.of_coordinates[i] @ turned - slope @ move
            size = float(move @ scaled)
            of_states.append(slope + change[..., None] * scaled / size if size > 0 else slope)
        return _Jacobians(of_coordinates, of_states, is_fresh=False)

    def _step(self, place: _Place, jacobians: _Jacobians, damping: float) -> tuple[Unknowns, float]:
        """Returns a damped step within bounds and the decrease of the cost that it promises."""
        problem, free = self._problem, self._problem.free
        weights = [loss_weights(problem.loss, r) for r in place.residuals]
        normal = _normal_equations(problem, place.point, place.residuals, jacobians, weights, damping)
        turn, moves = normal.step(place.point.coordinates[:free])
        coordinates = place.point.coordinates.copy()
        coordinates[:free] = np.clip(coordinates[:free] + turn, 0, 1)
        point = Unknowns(coordinates, place.point.deviations + moves)
        expected = [
            r + a @ turn + b @ move
            for r, a, b, move in zip(place.residuals, jacobians.of_coordinates, jacobians.of_states, moves, strict=True)
        ]
        return point, place.cost - problem.cost(point, expected)

    def _solution(self, place: _Place, jacobians: _Jacobians) -> Solution:
        pairs = zip(jacobians.of_coordinates, jacobians.of_states, strict=True)
        return self._problem.solution(place.point, place.residuals, list(pairs))


def state_spread(problem: ShootingProblem) -> Simulating[Floats]:
    """Estimates standard errors of the states at the start of a problem, by wide differences across jumps.

    Returns matrices that turn independent normal numbers into deviations, `(chunks, size, size)`.
    """
    normal = yield from _wide(problem)
    return np.stack([_inverse_root(each) for each in normal.of_states])


def is_rough(problem: ShootingProblem, sensitivities: Sequence[tuple[Floats, Floats]]) -> Simulating[bool]:
    """Returns whether derivatives at the start of a problem mislead because the motion jumps.

    Where it does, small and wide differences promise different information about the coordinates.
    """
    (residuals,) = yield from problem.residuals([problem.start])
    weights = [np.ones_like(each) for each in residuals]
    of_coordinates, of_states = zip(*sensitivities, strict=True)
    small = _normal_equations(problem, problem.start, residuals, _Jacobians(of_coordinates, of_states), weights)
    root = _inverse_root((yield from _wide(problem)).matrix)
    ratios = np.linalg.eigvalsh(root.T @ small.matrix @ root)
    return bool(ratios.max() > MISLEADING or ratios.min() < 1 / MISLEADING)


def _wide(problem: ShootingProblem) -> Simulating[_NormalEquations]:
    (residuals,) = yield from problem.residuals([problem.start])
    jacobians = _Jacobians(*(yield from problem.jacobians(problem.start, residuals, wider=WIDER)))
    weights = [np.ones_like(each) for each in residuals]
    return _normal_equations(problem, problem.start, residuals, jacobians, weights)


def _inverse_root(matrix: Floats) -> Floats:
    """Returns orthogonal columns of unit length in the metric `matrix`: standard errors in all directions."""
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix * scale * scale[:, None])
    return scale[:, None] * vectors / np.sqrt(np.maximum(values, 1e-12 * max(float(values.max(initial=0.0)), 1e-300)))
