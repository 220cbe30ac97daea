"""How well fitted parameters are known: by the scatter of white residuals, or else a bootstrap over blocks of time.

Where residuals are white noise, least squares says exactly how parameters scatter. Where they are not, the fit is
linearized around its solution, and refitted with blocks of rows drawn with replacement. Rows that are near
in time share what the model does not explain, so that blocks are drawn, not rows (H. R. Künsch, "The jackknife and
the bootstrap for general stationary observations", 1989).

Contacts can make a motion rough: states that measurements cannot distinguish lead to others, and searches end at many
places. No block tells of it, so that draws are moved by how far from each other several searches have ended.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjrun.fit.free_parameter import FreeParameter, values_at
from mjrun.fit.projection import ProjectedRows, all_information, projected
from mjrun.fit.solution import Solution

BLOCKS = 20  # at least
DRAWS = 4000
LAGS = 8  # rows apart, of which correlations are tested
DOUBT = 0.005  # probability with which white residuals are taken for others
AT_BOUND = 1e-3  # of the range
MOST_LEVERAGE = 0.9  # of a block: what one block alone tells has no residuals to judge it by

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Intervals:
    """Confidence intervals.

    Attributes:
      low, high: of each parameter.
      correlation: between the parameters, `(p, p)`.
      parameters: of the fit.
      draws: coordinates of which a quantile is an end of an interval, `(draws, p)`.
      confidence: of the intervals.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    correlation: Floats
    parameters: Sequence[FreeParameter]
    draws: Floats
    confidence: float

    def of(self, function: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
        """The ends of the intervals of what follows from the parameters: of each number that `function` makes of a
        draw."""
        level = (1 - self.confidence) / 2
        values = [np.array(values_at(self.parameters, draw)) for draw in self.draws]
        low, high = np.quantile([function(each) for each in values], [level, 1 - level], axis=0)
        return low, high


def intervals(solution: Solution, parameters: Sequence[FreeParameter], confidence: float, seed: int) -> Intervals:
    """Confidence intervals of a solution whose noise is that of its residuals.

    Percentiles are widened as Student's t widens a normal distribution: there are few blocks.
    """
    from scipy import special

    parts = projected(solution)
    blocks = [rows for part in parts for rows in _blocks(part, -(-BLOCKS // len(parts)))]
    informations = np.array([a.T @ a for a, _ in blocks])
    scores = np.array([a.T @ r for a, r in blocks])
    whole = all_information(solution, parameters)
    level = (1 - confidence) / 2
    generator = np.random.default_rng(seed)
    if solution.loss == "linear" and not solution.ends and is_white(solution, informations, scores, whole):
        moves, widened = _scattered(solution, whole, generator), 1.0
    else:
        moves = _bootstrapped(informations, scores, whole, generator)
        freedom = _degrees_of_freedom(informations, whole)
        widened = (
            special.stdtrit(freedom, 1 - level) / special.ndtri(1 - level) * np.sqrt(len(blocks) / (len(blocks) - 1))
        )
    moves = widened * moves
    if solution.ends:
        moves += _ended(solution, generator)

    coordinates = np.clip(solution.coordinates + moves, 0, 1)
    low, high = np.quantile(coordinates, [level, 1 - level], axis=0)
    spread = np.cov(moves, rowvar=False).reshape(len(parameters), -1)
    scale = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    lowest, highest = values_at(parameters, low), values_at(parameters, high)
    return Intervals(lowest, highest, spread / scale / scale[:, None], parameters, coordinates, confidence)


def is_white(solution: Solution, informations: Floats, scores: Floats, whole: Floats) -> bool:
    """Whether residuals are as independent of each other as white noise is.

    Two tests: their correlations from row to row (G. M. Ljung, G. E. P. Box, "On a measure of lack of fit in time
    series models", 1978), and whether the gradients of blocks are as large as white noise makes them, in every
    direction.

    Args:
      informations: of blocks of rows, `(blocks, p, p)`.
      scores: gradients of these blocks, `(blocks, p)`.
      whole: the information of all blocks and the priors, `(p, p)`.
    """
    from scipy import special

    statistic, tested = 0.0, 0
    for residuals in np.concatenate([np.nan_to_num(each) for each in solution.residuals]).T:
        total = float(residuals @ residuals)
        lags = [float(residuals[lag:] @ residuals[:-lag]) / max(total, 1e-300) for lag in range(1, LAGS + 1)]
        statistic += len(residuals) * float(np.square(lags).sum())
        tested += LAGS
    if statistic > special.chdtri(tested, DOUBT):
        return False

    values, vectors = np.linalg.eigh(whole)
    root = vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))
    shares = np.einsum("ji,bjk,ki->bi", root, informations, root)
    expected = (shares * (1 - shares)).sum(axis=0)
    freedom = np.maximum(shares.sum(axis=0) ** 2 / np.maximum((shares**2).sum(axis=0), 1e-300) - 1, 1.0)
    observed = np.square(scores @ root).sum(axis=0) / np.maximum(expected, 1e-300)
    return bool((observed * freedom < special.chdtri(freedom, DOUBT)).all())


def _scattered(solution: Solution, whole: Floats, generator: np.random.Generator) -> Floats:
    """Draws of how far the coordinates are from the truth, `(DRAWS, p)`, by Student's t."""
    numbers = sum(int(np.isfinite(each).sum()) for each in solution.residuals)
    freedom = max(numbers - solution.unknowns, 1)
    values, vectors = np.linalg.eigh(whole)
    root = vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))
    draws = generator.normal(size=(DRAWS // 2, len(values)))
    draws = np.concatenate([draws, -draws]) * solution.cost * np.sqrt(numbers / freedom)
    return draws / np.sqrt(generator.chisquare(freedom, (DRAWS, 1)) / freedom) @ root.T


def _bootstrapped(informations: Floats, scores: Floats, whole: Floats, generator: np.random.Generator) -> Floats:
    """How far refits of blocks drawn with replacement move the coordinates, `(DRAWS, p)`."""
    count = len(informations)
    weights = generator.multinomial(count, np.full(count, 1 / count), DRAWS)
    matrices = np.einsum("wb,bij->wij", weights, informations) + (whole - informations.sum(axis=0))
    matrices += 1e-12 * np.trace(informations.sum(axis=0)) * np.eye(len(whole))
    scores = _unfitted(scores, informations, whole)
    centred = scores - scores.mean(axis=0)  # at a bound they do not add up to nothing
    return -np.linalg.solve(matrices, (weights @ centred)[..., None])[..., 0]


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


def _ended(solution: Solution, generator: np.random.Generator) -> Floats:
    """How far from each other searches of a rough sum of squares end, `(DRAWS, p)`: by Student's t."""
    beside = np.array(solution.ends) - solution.coordinates
    count = len(beside)
    draws = generator.normal(size=(DRAWS, count)) @ beside / np.sqrt(count)
    return draws / np.sqrt(generator.chisquare(count, (DRAWS, 1)) / count)


def bound_reached(coordinate: float) -> str:
    """`low`, `high`, or nothing where a fitted coordinate is inside its bounds."""
    return "low" if coordinate < AT_BOUND else "high" if coordinate > 1 - AT_BOUND else ""
