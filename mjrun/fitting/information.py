"""Information of measurements about parameters: which are identifiable, and confidence intervals.

The unknown states of chunks are eliminated first, by projection. If residuals are white noise, intervals are those of
linear least squares, and if they are correlated noise, they are those of simulated noise whose residuals are as
correlated. Otherwise the fit is linearized around its solution and repeated with blocks of rows drawn with replacement:
consecutive rows share what the model does not explain (H. R. Künsch, "The jackknife and the bootstrap for general
stationary observations", 1989).
"""

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from mjrun.dataclass import dataclass
from mjrun.errors import clean, listing
from mjrun.fitting.correlated_noise import (
    DOUBT,
    are_white,
    correlations,
    lag_products,
    noise_scatter,
    samples_by_signal,
    with_correlation,
)
from mjrun.fitting.free_parameter import FreeParameter, values_at
from mjrun.fitting.measurements import least_noise
from mjrun.fitting.shooting_problem import STATE_SCALE, Floats, Solution, with_noise

# Least change of the data from one bound to the other, in standard deviations of their noise: a standard error of half
# the range determines nothing.
LEAST = 2.0
SHARE = 0.01  # least effect, or component, relative to the largest, of a parameter in an undetermined combination
BLOCKS = 20  # fewest blocks
DRAWS = 4000
UNIFORM = 12.0  # inverse variance of a coordinate that may have any value from 0 to 1
AT_BOUND = 1e-3  # distance from a bound, as a share of the range
TRIED = np.append(np.arange(20) / 20, (0.97, 0.98, 0.99))  # correlations of consecutive samples
LOGS, NUMBERS = (2, 40), 2**22  # simulated logs of noise for each of them, and their numbers if the log is long
MOST_LEVERAGE = 0.9  # of a block: a parameter that one block alone determines leaves no residuals


@dataclass(frozen=True, eq=False)
class _ProjectedRows:
    """Rows of a linear least-squares problem in the coordinates of the parameters alone.

    Attributes:
      jacobians: derivatives of the residuals, orthogonal to those of the states, `(n, p)`.
      residuals: residuals, projected likewise, `(n,)`.
      times: position of each row in its chunk, from 0 to 1, `(n,)`.
      states: orthonormal basis of the derivatives with respect to the states, `(n, size)`.
      signals: index of the signal of each row, `(n,)`.
    """

    jacobians: Floats
    residuals: Floats
    times: Floats
    states: Floats
    signals: NDArray[np.int64]


def projected(solution: Solution) -> list[_ProjectedRows]:
    """Returns the rows of each chunk of a solution, with the weights of its loss.

    Projection on the complement of their derivatives B eliminates the states of a chunk: with a QR factorization of B,
    A − Q Qᵀ A (G. H. Golub, V. Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems
    whose variables separate", 1973).
    """
    return [
        _projected(residuals, *jacobians, np.sqrt(weights))
        for residuals, jacobians, weights in zip(
            solution.residuals, solution.sensitivities, solution.weights, strict=True
        )
    ]


def _projected(residuals: Floats, of_coordinates: Floats, of_states: Floats, weights: Floats) -> _ProjectedRows:
    known = np.isfinite(residuals)
    rows = np.broadcast_to(np.linspace(0, 1, len(residuals))[:, None], residuals.shape)[known]
    w = weights[known]
    a, b, r = w[:, None] * of_coordinates[known], w[:, None] * of_states[known], w * residuals[known]
    size, count = b.shape[1], len(r)
    q, _ = np.linalg.qr(np.concatenate([b, np.eye(size) / STATE_SCALE]))
    a = np.concatenate([a, np.zeros((size, a.shape[1]))])
    r = np.concatenate([r, np.zeros(size)])
    signals = np.nonzero(known)[1]
    return _ProjectedRows((a - q @ (q.T @ a))[:count], (r - q @ (q.T @ r))[:count], rows, q[:count], signals)


def information(parts: Sequence[_ProjectedRows]) -> Floats:
    """Returns the information matrix of the coordinates, `(p, p)`."""
    return np.sum([part.jacobians.T @ part.jacobians for part in parts], axis=0)


def all_information(solution: Solution, parameters: Sequence[FreeParameter]) -> Floats:
    """Returns the information matrix of the coordinates, including priors, `(p, p)`."""
    if solution.estimate:
        spread = np.cov(solution.estimate.draws, rowvar=False).reshape(len(parameters), -1)
        values, vectors = np.linalg.eigh(spread)
        return (vectors * np.maximum(1 / np.maximum(values, 1e-300) - UNIFORM, 0)) @ vectors.T
    jacobians = [each.prior_slope(c) for each, c in zip(parameters, solution.coordinates, strict=True)]
    return information(projected(solution)) + np.diag(np.square(jacobians))


def _certain_information(solution: Solution, parameters: Sequence[FreeParameter]) -> Floats:
    """Returns the information of measurements whose noise is at least the rounding of simulations, `(p, p)`.

    Where the residuals of an exact log are smaller, derivatives that are only rounding would seem to be effects.
    """
    values = np.concatenate([chunk.values for chunk in solution.chunks])
    return all_information(with_noise(solution, np.maximum(solution.noise, least_noise(values, ()))), parameters)


def _undetermined(solution: Solution, parameters: Sequence[FreeParameter]) -> Floats:
    """Returns directions in which the measurements determine no coordinates, orthonormal, `(directions, p)`."""
    values, vectors = np.linalg.eigh(_certain_information(solution, parameters))
    return np.asarray(vectors.T[values < LEAST**2], np.float64)


def _spread(draws: Floats, directions: Floats, generator: np.random.Generator) -> Floats:
    """Moves coordinates from 0 to 1 in undetermined directions to either bound, as the measurements permit it."""
    for along in directions:
        moving = np.flatnonzero(np.abs(along) >= SHARE * np.abs(along).max())
        ends: Floats = np.stack([-draws[:, moving], 1 - draws[:, moving]]) / along[moving]
        farthest: Floats = np.stack([ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)])
        chosen = farthest[generator.integers(2, size=len(draws)), np.arange(len(draws))]
        draws = draws.copy()
        draws[:, moving] = np.clip(draws[:, moving] + chosen[:, None] * along[moving], 0, 1)
    return draws


@dataclass(frozen=True)
class UnidentifiableParameters:
    """Parameters that the data do not determine: a single one, or several that compensate for each other."""

    paths: tuple[str, ...]

    @property
    def message(self) -> str:
        """A sentence that names them."""
        if len(self.paths) == 1:
            return f"the measurements do not determine {clean(self.paths[0])}"
        return f"the measurements do not distinguish {listing(self.paths)}: they determine only a combination of them"


@dataclass(frozen=True)
class Sensitivity:
    """Sensitivity of measurements to parameters.

    Attributes:
      effects: change of all data from one bound of a parameter to the other, the others being known, in standard
        deviations of the noise.
      condition: ratio of the largest to the smallest singular value of the scaled derivatives.
      unidentifiable: parameters that are not determined.
    """

    effects: tuple[float, ...]
    condition: float
    unidentifiable: tuple[UnidentifiableParameters, ...]


def sensitivity(solutions: Sequence[Solution], parameters: Sequence[FreeParameter]) -> Sensitivity:
    """Returns the sensitivity at the best of several solutions, as derivatives depend on the parameters."""
    each = [_of(_certain_information(solution, parameters), parameters) for solution in solutions]
    return min(each, key=lambda one: (sum(len(u.paths) for u in one.unidentifiable), one.condition))


def _of(matrix: Floats, parameters: Sequence[FreeParameter]) -> Sensitivity:
    effects = np.sqrt(np.diag(matrix))
    paths = [each.path for each in parameters]
    silent = [i for i, effect in enumerate(effects) if effect < LEAST]
    problems = [UnidentifiableParameters((paths[i],)) for i in silent]

    audible = [i for i in range(len(paths)) if i not in silent]
    condition = np.inf if silent else 1.0
    if audible:
        values, vectors = np.linalg.eigh(matrix[np.ix_(audible, audible)])
        singular = np.sqrt(np.maximum(values, 0))
        condition = max(condition, float(singular[-1] / max(singular[0], 1e-300)))
        for value, vector in zip(singular, vectors.T, strict=True):
            if value < LEAST:
                # Effects cancel in this direction: every parameter that has one there is part of the combination.
                shown = effects[audible] * np.abs(vector)
                mixed = [paths[audible[i]] for i in np.flatnonzero(shown > max(LEAST, SHARE * shown.max()))]
                problems.append(UnidentifiableParameters(tuple(mixed)))
    return Sensitivity(tuple(map(float, effects)), float(condition), tuple(problems))


@dataclass(frozen=True, eq=False)
class ParameterIntervals:
    """Confidence intervals of parameters.

    Attributes:
      low, high: ends of the interval of each parameter.
      correlation: correlations between the parameters, `(p, p)`.
      parameters: parameters of the fit.
      draws: coordinates whose quantiles are the ends of intervals, `(draws, p)`.
      confidence: confidence level.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    correlation: Floats
    parameters: Sequence[FreeParameter]
    draws: Floats
    confidence: float

    def of(self, function: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
        """Returns the ends of the intervals of a function of the parameters."""
        level = (1 - self.confidence) / 2
        values = [np.array(values_at(self.parameters, draw)) for draw in self.draws]
        low, high = np.quantile([function(each) for each in values], [level, 1 - level], axis=0)
        return low, high


def intervals(
    solution: Solution, parameters: Sequence[FreeParameter], confidence: float, seed: int
) -> ParameterIntervals:
    """Estimates confidence intervals of a solution whose noise is that of its residuals.

    As blocks are few, percentiles are widened as Student's t widens a normal distribution. In directions that the
    measurements do not determine, intervals extend as far as the bounds permit.
    """
    level = (1 - confidence) / 2
    directions, generator = _undetermined(solution, parameters), np.random.default_rng(seed)
    if solution.estimate:
        draws = _spread(solution.estimate.draws, directions, generator)
        return _quantiles(solution, parameters, draws, draws - draws.mean(axis=0), confidence)
    from scipy import special

    parts = projected(solution)
    blocks = [rows for part in parts for rows in _blocks(part, -(-BLOCKS // len(parts)))]
    informations = np.array([a.T @ a for a, _ in blocks])
    scores = np.array([a.T @ r for a, r in blocks])
    whole = all_information(solution, parameters)
    if solution.loss == "linear" and is_white(solution, informations, scores, whole):
        moves, widened = scattered(solution, whole, generator), 1.0
    elif solution.loss == "linear" and correlations(solution.residuals).any():
        moves, widened = _scattered_by_correlated_noise(parts, whole, generator), 1.0
    else:
        moves = _bootstrapped(informations, scores, whole, generator)
        freedom = _degrees_of_freedom(informations, whole)
        widened = (
            special.stdtrit(freedom, 1 - level) / special.ndtri(1 - level) * np.sqrt(len(blocks) / (len(blocks) - 1))
        )
    moves = widened * moves
    draws = np.clip(solution.coordinates + moves, 0, 1)
    if len(directions):
        draws = np.clip(solution.coordinates + moves - moves @ directions.T @ directions, 0, 1)
        draws = _spread(draws, directions, generator)
        moves = draws - draws.mean(axis=0)
    return _quantiles(solution, parameters, draws, moves, confidence)


def _quantiles(
    solution: Solution, parameters: Sequence[FreeParameter], draws: Floats, moves: Floats, confidence: float
) -> ParameterIntervals:
    """Returns intervals between quantiles of draws, extended to the solution.

    Args:
      draws: coordinates within bounds, `(draws, p)`.
      moves: deviations that correlations are computed from, `(draws, p)`.
    """
    level = (1 - confidence) / 2
    low, high = np.quantile(draws, [level, 1 - level], axis=0)
    low, high = np.minimum(low, solution.coordinates), np.maximum(high, solution.coordinates)
    spread = np.cov(moves, rowvar=False).reshape(len(parameters), -1)
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    lowest, highest = values_at(parameters, low), values_at(parameters, high)
    return ParameterIntervals(lowest, highest, spread / scale / scale[:, None], parameters, draws, confidence)


def is_white(solution: Solution, informations: Floats, scores: Floats, whole: Floats) -> bool:
    """Tests whether residuals are independent of each other.

    Two tests: correlations between rows, and whether the gradients of blocks are as small in every direction as those
    of white noise.

    Args:
      informations: information matrices of blocks of rows, `(blocks, p, p)`.
      scores: gradients of these blocks, `(blocks, p)`.
      whole: information of all blocks and the priors, `(p, p)`.
    """
    from scipy import special

    if not are_white(samples_by_signal(solution.residuals)):
        return False

    root = _inverse_root(whole)
    shares = np.einsum("ji,bjk,ki->bi", root, informations, root)
    expected = (shares * (1 - shares)).sum(axis=0)
    freedom = np.maximum(shares.sum(axis=0) ** 2 / np.maximum((shares**2).sum(axis=0), 1e-300) - 1, 1.0)
    observed = np.square(scores @ root).sum(axis=0) / np.maximum(expected, 1e-300)
    return bool((observed * freedom < special.chdtri(freedom, DOUBT)).all())


def scattered(solution: Solution, whole: Floats, generator: np.random.Generator) -> Floats:
    """Draws deviations of coordinates from the truth by Student's t, `(DRAWS, p)`, if the noise is white.

    Args:
      whole: information of the solution, `(p, p)`.
    """
    numbers = sum(int(np.isfinite(each).sum()) for each in solution.residuals)
    freedom = max(numbers - solution.unknowns, 1)
    root = _inverse_root(whole)
    draws = generator.normal(size=(DRAWS // 2, len(root)))
    draws = np.concatenate([draws, -draws]) * solution.cost * np.sqrt(numbers / freedom)
    return draws / np.sqrt(generator.chisquare(freedom, (DRAWS, 1)) / freedom) @ root.T


def _scattered_by_correlated_noise(
    parts: Sequence[_ProjectedRows], whole: Floats, generator: np.random.Generator
) -> Floats:
    """Draws deviations of coordinates from the truth, `(DRAWS, p)`, if the noise is correlated from sample to sample.

    A fit takes a part of slow noise for motion, so that residuals are smaller and less correlated than the noise. Noise
    of several correlations is simulated to find that of which residuals are as correlated as the real ones.

    Args:
      whole: information of all parts and the priors, `(p, p)`.
    """
    root = _inverse_root(whole)
    inverse = root @ root.T
    measured = np.unique(np.concatenate([part.signals for part in parts]))
    rows = [[np.flatnonzero(part.signals == signal) for part in parts] for signal in measured]
    observed, totals = _correlation_of_signals([part.residuals for part in parts], rows)
    found = np.empty((2, len(TRIED), len(rows)))
    count = int(np.clip(NUMBERS // sum(len(part.residuals) for part in parts), *LOGS))
    for trial, correlation in enumerate(TRIED):
        noise = [np.empty((count, len(part.residuals))) for part in parts]
        for places in rows:
            for log, own in zip(noise, places, strict=True):
                log[:, own] = with_correlation(generator.normal(size=(count, len(own))), correlation)
        moves = -np.sum([log @ part.jacobians for log, part in zip(noise, parts, strict=True)], axis=0) @ inverse
        left = [
            log - log @ part.states @ part.states.T + moves @ part.jacobians.T
            for log, part in zip(noise, parts, strict=True)
        ]
        shown, sizes = _correlation_of_signals(left, rows)
        found[:, trial] = np.median(shown, axis=1), np.mean(sizes, axis=1)

    scatter = np.zeros_like(whole)
    for i, places in enumerate(rows):
        correlation = cast("float", np.interp(observed[i], np.maximum.accumulate(found[0, :, i]), TRIED))
        variance = totals[i] / np.interp(correlation, TRIED, found[1, :, i])
        for part, own in zip(parts, places, strict=True):
            scatter += variance * noise_scatter(part.jacobians[own].T, correlation)
    values, vectors = np.linalg.eigh(inverse @ scatter @ inverse)
    draws = generator.normal(size=(DRAWS // 2, len(whole))) * np.sqrt(np.maximum(values, 0.0))
    return np.concatenate([draws, -draws]) @ vectors.T


def _correlation_of_signals(
    residuals: Sequence[Floats], rows: Sequence[Sequence[NDArray[np.int64]]]
) -> tuple[Floats, Floats]:
    """Returns the correlation of consecutive samples of each signal, and the sum of squares, `(signals, ...)` each.

    Args:
      residuals: residuals of each chunk, `(..., n)`.
      rows: places of each signal in each chunk.
    """
    signals = [[each[..., own] for each, own in zip(residuals, places, strict=True)] for places in rows]
    totals = np.array([lag_products(samples, 0) for samples in signals])
    return np.array([lag_products(samples, 1) for samples in signals]) / np.maximum(totals, 1e-300), totals


def _bootstrapped(informations: Floats, scores: Floats, whole: Floats, generator: np.random.Generator) -> Floats:
    """Returns the changes of the coordinates in refits of blocks drawn with replacement, `(DRAWS, p)`."""
    count = len(informations)
    weights = generator.multinomial(count, np.full(count, 1 / count), DRAWS)
    matrices = np.einsum("wb,bij->wij", weights, informations) + (whole - informations.sum(axis=0))
    matrices += 1e-12 * np.trace(informations.sum(axis=0)) * np.eye(len(whole))
    scores = _unfitted(scores, informations, whole)
    centred = scores - scores.mean(axis=0)  # at a bound their sum is not zero
    return cast("Floats", -np.linalg.solve(matrices, (weights @ centred)[..., None])[..., 0])


def _unfitted(scores: Floats, informations: Floats, whole: Floats) -> Floats:
    """Returns the gradients of blocks after fits without these blocks, `(blocks, p)`.

    A block with much information on a parameter pulls the fit towards itself, so its residuals are too small. Source:
    R. M. Bell, D. F. McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples"
    (2002), the jackknife.
    """
    root = _inverse_root(whole)
    leverages, directions = np.linalg.eigh(root.T @ informations @ root)
    in_directions = np.einsum("bij,bi->bj", directions, scores @ root)
    grown = in_directions / (1 - np.minimum(leverages, MOST_LEVERAGE))
    return np.einsum("bij,bj->bi", directions, grown) @ np.linalg.pinv(root)


def _inverse_root(whole: Floats) -> Floats:
    """Returns a root R of the inverse of an information, R Rᵀ."""
    values, vectors = np.linalg.eigh(whole)
    return vectors / np.sqrt(np.maximum(values, 1e-12 * max(values.max(), 1.0)))


def _degrees_of_freedom(informations: Floats, whole: Floats) -> Floats:
    """Estimates the effective number of blocks that determine each parameter, `(p,)`.

    Source: F. E. Satterthwaite, "An approximate distribution of estimates of variance components" (1946).
    """
    inverse = np.linalg.pinv(whole, hermitian=True)
    variances = np.einsum("ij,bjk,ki->bi", inverse, informations, inverse)
    return np.maximum(variances.sum(axis=0) ** 2 / np.maximum((variances**2).sum(axis=0), 1e-300), 2.0)


def _blocks(part: _ProjectedRows, count: int) -> list[tuple[Floats, Floats]]:
    """Divides the rows of a chunk into `count` blocks of time."""
    places = np.minimum((part.times * count).astype(int), count - 1)
    return [(part.jacobians[places == i], part.residuals[places == i]) for i in range(count) if (places == i).any()]


def bound_reached(coordinate: float) -> str:
    """Returns `low` or `high` if a fitted coordinate is at this bound, otherwise an empty text."""
    return "low" if coordinate < AT_BOUND else "high" if coordinate > 1 - AT_BOUND else ""
