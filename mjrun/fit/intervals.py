"""How well fitted parameters are known: a bootstrap over blocks of time.

The fit is linearized around its solution, and refitted with blocks of rows drawn with replacement. Rows that are near
in time share what the model does not explain, so that blocks are drawn, not rows (H. R. Künsch, "The jackknife and
the bootstrap for general stationary observations", 1989).

Contacts can make a motion rough: nudges far below what measurements tell lead to another one. No block tells of it, as
it lasts to the end; the draws are moved by what such nudges would have done to the fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjrun.fit.free_parameter import FreeParameter
from mjrun.fit.projection import ProjectedRows, projected
from mjrun.fit.solution import Solution

BLOCKS = 20  # at least
DRAWS = 2000
AT_BOUND = 1e-3  # of the range
MOST_LEVERAGE = 0.9  # of a block: what one block alone tells has no residuals to judge it by

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Intervals:
    """Confidence intervals.

    Attributes:
      low, high: of each parameter.
      correlation: between the parameters, `(p, p)`.
      draws: values of the parameters of which a quantile is an end of an interval, `(draws, p)`.
      confidence: of the intervals.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    correlation: Floats
    draws: Floats
    confidence: float

    def of(self, function: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
        """The ends of the intervals of what follows from the parameters: of each number that `function` makes of a
        draw."""
        level = (1 - self.confidence) / 2
        low, high = np.quantile([function(draw) for draw in self.draws], [level, 1 - level], axis=0)
        return low, high


def intervals(solution: Solution, parameters: Sequence[FreeParameter], confidence: float, seed: int) -> Intervals:
    """Confidence intervals of a solution whose noise is that of its residuals.

    Percentiles are widened as Student's t widens a normal distribution: there are few blocks.
    """
    from scipy import stats

    parts = projected(solution)
    blocks = [rows for part in parts for rows in _blocks(part, -(-BLOCKS // len(parts)))]
    count = len(blocks)
    informations = np.array([a.T @ a for a, _ in blocks])
    scores = np.array([a.T @ r for a, r in blocks])
    priors = np.diag(_prior_information(solution, parameters))

    generator = np.random.default_rng(seed)
    weights = generator.multinomial(count, np.full(count, 1 / count), DRAWS)
    matrices = np.einsum("wb,bij->wij", weights, informations) + priors
    matrices += 1e-12 * np.trace(informations.sum(axis=0)) * np.eye(len(parameters))
    scores = _unfitted(scores, informations, informations.sum(axis=0) + priors)
    centred = scores - scores.mean(axis=0)  # at a bound they do not add up to nothing
    moves = -np.linalg.solve(matrices, (weights @ centred)[..., None])[..., 0]
    if solution.jitters:
        pulls = _pulls_of_jitter(solution, parts, generator)
        moves -= np.linalg.solve(informations.sum(axis=0) + priors, pulls.T).T

    level = (1 - confidence) / 2
    freedom = _degrees_of_freedom(informations, informations.sum(axis=0) + priors)
    widened = stats.t.ppf(1 - level, freedom) / stats.norm.ppf(1 - level) * np.sqrt(count / (count - 1))
    coordinates = np.clip(solution.coordinates + widened * moves, 0, 1)
    low, high = np.quantile(coordinates, [level, 1 - level], axis=0)
    spread = np.cov(moves, rowvar=False).reshape(len(parameters), -1)
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    lowest, highest = (tuple(p.value(c) for p, c in zip(parameters, end, strict=True)) for end in (low, high))
    draws = np.array([[p.value(c) for p, c in zip(parameters, draw, strict=True)] for draw in coordinates])
    return Intervals(lowest, highest, spread / scale / scale[:, None], draws, confidence)


def _unfitted(scores: Floats, informations: Floats, whole: Floats) -> Floats:
    """The gradients of blocks, `(blocks, p)`, as fits without these blocks would leave them.

    A block that tells much of a parameter bends the fit towards itself, so that its residuals are too small. Source:
    R. M. Bell and D. F. McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples"
    (2002), the jackknife.
    """
    values, vectors = np.linalg.eigh(whole)
    root = vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))  # of the inverse
    leverages, directions = np.linalg.eigh(root.T @ informations @ root)
    in_directions = np.einsum("bij,bi->bj", directions, scores @ root)
    grown = in_directions / (1 - np.minimum(leverages, MOST_LEVERAGE))
    return np.einsum("bij,bj->bi", directions, grown) @ np.linalg.pinv(root)


def _degrees_of_freedom(informations: Floats, whole: Floats) -> Floats:
    """How many blocks tell of each parameter, `(p,)`: all of them if they tell alike. Source: F. E. Satterthwaite,
    "An approximate distribution of estimates of variance components" (1946)."""
    inverse = np.linalg.pinv(whole, hermitian=True)
    variances = np.einsum("ij,bjk,ki->bi", inverse, informations, inverse)
    return np.maximum(variances.sum(axis=0) ** 2 / np.maximum((variances**2).sum(axis=0), 1e-300), 2.0)


def _blocks(part: ProjectedRows, count: int) -> list[tuple[Floats, Floats]]:
    """The rows of a chunk in `count` blocks of time."""
    places = np.minimum((part.times * count).astype(int), count - 1)
    return [(part.slopes[places == i], part.residuals[places == i]) for i in range(count) if (places == i).any()]


def _pulls_of_jitter(solution: Solution, parts: Sequence[ProjectedRows], generator: np.random.Generator) -> Floats:
    """What rough motions add to the gradient of the cost, `(DRAWS, p)`: normal, as large as the nudges show."""
    total = np.zeros((DRAWS, parts[0].slopes.shape[1]))
    for part, residuals, weights, jitter in zip(
        parts, solution.residuals, solution.weights, solution.jitters, strict=True
    ):
        known = np.isfinite(residuals)
        pulls = jitter[known].T @ (np.sqrt(weights[known])[:, None] * part.slopes)
        total += generator.normal(size=(DRAWS, len(pulls))) @ pulls / np.sqrt(len(pulls))
    return total


def _prior_information(solution: Solution, parameters: Sequence[FreeParameter]) -> Floats:
    widths = [
        p.value(min(1.0, c + 0.01)) - p.value(min(1.0, c + 0.01) - 0.01)
        for p, c in zip(parameters, solution.coordinates, strict=True)
    ]
    return np.array([(w / 0.01 / p.prior[1]) ** 2 if p.prior else 0.0 for p, w in zip(parameters, widths, strict=True)])


def bound_reached(coordinate: float) -> str:
    """`low`, `high`, or nothing where a fitted coordinate is inside its bounds."""
    return "low" if coordinate < AT_BOUND else "high" if coordinate > 1 - AT_BOUND else ""
