"""Gauss-Newton steps by ensembles, for motions that contacts make rough.

A sliding box rattles, and states that no measurement distinguishes rattle differently: the sum of squares jumps between
neighbouring points. So slopes are fitted to the residuals at many points about one standard error away (as in M. A.
Iglesias, K. J. H. Law, A. M. Stuart, "Ensemble Kalman methods for inverse problems", 2013). The part of a residual that
these slopes do not explain is its roughness. It counts as noise, and many times over because it also perturbs the
slopes: rattling signals have little weight, and smooth ones decide.
"""

from dataclasses import replace

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.fitting.gauss_newton import NormalEquations, Slopes, normal_equations
from mjrun.fitting.shooting_problem import ShootingProblem, Simulating, Unknowns
from mjrun.fitting.solution import Floats, Solution, loss_weights

LEAST_ROUNDS, MOST_ROUNDS = 2, 8  # least, one more if no longer stretches follow, and most
POOLED = 3  # rounds whose points are regressed together
SPREAD = 1.5  # distance between points and their centre, in standard errors
FARTHEST = 0.3  # largest distance of a point from the centre in any unknown
REACH = 2.0  # largest step, in standard errors before it
SETTLED = 0.3  # step of the coordinates, in standard errors, at which rounds end
SPURIOUS = 10.0  # weight of roughness as noise, for each residual per point
WIDER = 1000.0  # factor of the steps of finite differences that estimate the first standard errors
POLISHED = 4  # final batches of states near the best one
NEAREST = 1e-3  # least distance of such states from the best one, in standard errors


@dataclass(frozen=True, eq=False)
class StandardErrors:
    """Standard errors of the unknowns: matrices that turn independent normal numbers into deviations.

    Attributes:
      coordinates: matrix of the coordinates, `(p, p)`.
      states: matrix of the state of each chunk with constant coordinates, `(chunks, size, size)`.
      state_slopes: slopes of the states to the coordinates, `(chunks, size, p)`.
    """

    coordinates: Floats
    states: Floats
    state_slopes: Floats

    def deviations(self, direction: Floats) -> tuple[Floats, Floats]:
        """Returns the deviations of the coordinates and of the state of every chunk in a direction `(p + size,)`."""
        free = len(self.coordinates)
        turn = np.clip(self.coordinates @ direction[:free], -FARTHEST, FARTHEST)
        return turn, np.clip(self.states @ direction[free:] + self.state_slopes @ turn, -FARTHEST, FARTHEST)

    def length(self, turn: Floats, moves: Floats) -> float:
        """Returns the root mean square of a step, in standard errors."""
        parts = [np.linalg.lstsq(self.coordinates, turn, rcond=None)[0]]
        for root, move, slopes in zip(self.states, moves, self.state_slopes, strict=True):
            parts.append(np.linalg.lstsq(root, move - slopes @ turn, rcond=None)[0])
        return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


class EnsembleSearch:
    """A search for the least sum of squares of a problem.

    Args:
      scatter: standard errors of the start; None for those of finite differences, which suit short stretches only.
    """

    def __init__(self, problem: ShootingProblem, seed: int, scatter: StandardErrors | None = None) -> None:
        self._problem, self._scatter = problem, scatter
        self._generator = np.random.default_rng(seed)
        self._rounds: list[tuple[list[Unknowns], list[list[Floats]]]] = []

    def minimize(self, *, is_last: bool) -> Simulating[tuple[Solution, StandardErrors]]:
        """Searches from the start of the problem; returns a solution and standard errors.

        Args:
          is_last: whether no longer stretches follow, so that states are searched for whose simulation is nearest to
            the log.
        """
        problem, middle = self._problem, self._problem.start
        scatter = self._scatter or (yield from self._first_scatter(middle))
        least, count = (LEAST_ROUNDS if problem.free else 1) + is_last, 0
        while True:
            count += 1
            yield from self._simulate(middle, scatter)
            residuals, slopes, variances = self._regressed(middle)
            weights = [loss_weights(problem.loss, r, v) for r, v in zip(residuals, variances, strict=True)]
            normal = normal_equations(problem, middle, residuals, slopes, weights)
            turn, moves = normal.step(middle.coordinates[: problem.free])
            shorter = min(1.0, REACH / max(scatter.length(turn, moves), 1e-300))
            middle = _moved(middle, shorter * turn, shorter * moves)
            scatter = _scatter(normal)
            is_settled = turn @ normal.matrix @ turn <= SETTLED**2 * len(turn)
            if count == MOST_ROUNDS or (count >= least and is_settled):
                break
        best, residuals = yield from self._nearest(middle, scatter, POLISHED if is_last else 0)
        pairs = zip(slopes.of_coordinates, slopes.of_states, strict=True)
        return replace(problem.solution(best, residuals, list(pairs)), variances=variances), scatter

    def _first_scatter(self, point: Unknowns) -> Simulating[StandardErrors]:
        (residuals,) = yield from self._problem.residuals([point])
        slopes = Slopes(*(yield from self._problem.slopes(point, residuals, wider=WIDER)))
        weights = [np.ones_like(each) for each in residuals]
        return _scatter(normal_equations(self._problem, point, residuals, slopes, weights))

    def _simulate(self, middle: Unknowns, scatter: StandardErrors) -> Simulating[None]:
        """Adds points around the centre, in opposite directions that are orthogonal in standard errors."""
        size = self._problem.free + self._problem.size
        turned, _ = np.linalg.qr(self._generator.normal(size=(size, size)))
        directions = SPREAD * np.concatenate([turned, -turned])
        points = [_moved(middle, *scatter.deviations(each)) for each in directions]
        residuals = yield from self._problem.residuals(points)
        self._rounds = [*self._rounds[1 - POOLED :], (points, residuals)]

    def _regressed(self, middle: Unknowns) -> tuple[list[Floats], Slopes, list[Floats]]:
        """Fits residuals at the centre, slopes, and variances of residuals to the points of the last rounds."""
        free = self._problem.free
        points = [each for points, _ in self._rounds for each in points]
        all_residuals = [each for _, residuals in self._rounds for each in residuals]
        numbers = sum(int(known.sum()) for known in self._problem.known)
        often = 1 + SPURIOUS * numbers / len(points)
        turns = np.stack([(each.coordinates - middle.coordinates)[:free] for each in points])
        at_middle, variances, of_coordinates, of_states = (list[Floats]() for _ in range(4))
        for i, part in enumerate(self._problem.parts):
            moves = np.stack([each.deviations[i] - middle.deviations[i] for each in points])
            unknowns = np.concatenate([turns, moves], axis=1)
            scales = np.maximum(np.sqrt((unknowns**2).mean(axis=0)), 1e-300)
            left = np.column_stack([np.ones(len(points)), unknowns / scales])
            right = np.stack([each[i].ravel() for each in all_residuals])
            fitted, _, rank, _ = np.linalg.lstsq(left, right, rcond=1e-9)
            rough = ((right - left @ fitted) ** 2).sum(axis=0) / max(len(points) - int(rank), 1)
            shape = part.values.shape
            of_unknowns = (fitted[1:] / scales[:, None]).T.reshape(*shape, -1)
            at_middle.append(fitted[0].reshape(shape))
            variances.append((1 + often * rough).reshape(shape))
            of_coordinates.append(of_unknowns[..., :free])
            of_states.append(of_unknowns[..., free:])
        return at_middle, Slopes(of_coordinates, of_states), variances

    def _nearest(
        self, middle: Unknowns, scatter: StandardErrors, batches: int
    ) -> Simulating[tuple[Unknowns, list[Floats]]]:
        """Searches states near a point for the simulation nearest to the log, with constant coordinates."""
        size, best = self._problem.size, middle
        (residuals,) = yield from self._problem.residuals([middle])
        for _ in range(batches):
            directions = self._generator.normal(size=(2 * size, size)) / np.sqrt(size)
            widths = NEAREST ** self._generator.random((2 * size, 1))
            moves = np.einsum("cij,bj->bci", scatter.states, SPREAD * widths * directions)
            points = [Unknowns(best.coordinates, best.deviations + move) for move in moves]
            all_residuals = yield from self._problem.residuals(points)
            candidates = [(best, residuals), *zip(points, all_residuals, strict=True)]
            best, residuals = min(candidates, key=lambda each: self._problem.cost(*each))
        return best, residuals


def _moved(point: Unknowns, turn: Floats, moves: Floats) -> Unknowns:
    coordinates = point.coordinates.copy()
    coordinates[: len(turn)] = np.clip(coordinates[: len(turn)] + turn, 0, 1)
    return Unknowns(coordinates, point.deviations + moves)


def _scatter(normal: NormalEquations) -> StandardErrors:
    states = np.stack([_inverse_root(each) for each in normal.of_states])
    return StandardErrors(_inverse_root(normal.matrix), states, -normal.state_slopes)


def _inverse_root(matrix: Floats) -> Floats:
    """Returns orthogonal columns of unit length in the metric `matrix`: standard errors in all directions."""
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix * scale * scale[:, None])
    return scale[:, None] * vectors / np.sqrt(np.maximum(values, 1e-12 * max(float(values.max(initial=0.0)), 1e-300)))
