"""Samplers: points between 0 and 1, and rank correlations between their parameters.

Those of Saltelli and Morris come in samples, for sensitivities of metrics. Correlations leave the distribution of each
parameter unchanged: a Gaussian copula with the correlation r has Spearman's rank correlation 6/π·asin(r/2).

Sources: A. Saltelli et al., Computer Physics Communications 181 (2010) 259; M. D. Morris, Technometrics 33 (1991) 161;
A. J. McNeil, R. Frey and P. Embrechts, Quantitative Risk Management (2005), theorem 5.36.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import numpy as np

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, concerning, listing, option
from mjrun.physics.random_distribution import LEAST, MOST, Distribution

LEVELS = 4  # of each parameter in a design of Morris
STEP = 0.5  # change of a fraction from one of its points to the next

Sampler = Callable[[int, int, "np.random.Generator"], np.ndarray]
BLOCK = 2**16  # rows that are transformed at once


def saltelli(count: int, dimensions: int, generator: "np.random.Generator") -> np.ndarray:
    """Draws `count` samples of `dimensions` + 2 points `(count · (dimensions + 2), dimensions)` between 0 and 1.

    The points of a sample are a, b, and for each dimension a with the value of b. More samples keep their points.
    """
    drawn = _sobol(count, 2 * dimensions, generator)
    a, b = drawn[:, :dimensions], drawn[:, dimensions:]
    points = np.repeat(a[:, None], dimensions + 2, axis=1)
    points[:, 1] = b
    places = np.arange(dimensions)
    points[:, places + 2, places] = b
    return points.reshape(-1, dimensions)


def morris(count: int, dimensions: int, generator: "np.random.Generator") -> np.ndarray:
    """Draws `count` trajectories of `dimensions` + 1 points `(count · (dimensions + 1), dimensions)` between 0 and 1.

    Each point changes one dimension of the point before it by ±`STEP`, in random order. The levels of a dimension lie
    in the middle of equal intervals, so that quantiles are finite. More trajectories keep their points.
    """
    points = np.empty((count, dimensions + 1, dimensions))
    for trajectory in points:
        trajectory[:] = (generator.integers(LEVELS, size=dimensions) + 0.5) / LEVELS
        for place, changed in enumerate(generator.permutation(dimensions), 1):
            value = trajectory[0, changed]
            trajectory[place:, changed] = value + STEP if value < STEP else value - STEP
    return points.reshape(-1, dimensions)


def _sobol(count: int, dimensions: int, generator: "np.random.Generator") -> np.ndarray:
    from scipy.stats import qmc

    # The first of a power of two: points stay the same when there are more of them.
    exponent = max(0, (count - 1).bit_length())
    return qmc.Sobol(dimensions, rng=generator).random_base2(exponent)[:count]


def _halton(count: int, dimensions: int, generator: "np.random.Generator") -> np.ndarray:
    from scipy.stats import qmc

    return qmc.Halton(dimensions, rng=generator).random(count)


def _latin_hypercube(count: int, dimensions: int, generator: "np.random.Generator") -> np.ndarray:
    from scipy.stats import qmc

    return qmc.LatinHypercube(dimensions, rng=generator).random(count)


# Functions that draw the points of samples, and the number of points in a sample in addition to the parameters.
SAMPLES: Mapping[str, tuple[Sampler, int]] = {"saltelli": (saltelli, 2), "morris": (morris, 1)}
# Functions that draw points between 0 and 1 `(count, dimensions)`, or as many samples of several points, by sampler.
SAMPLERS: Mapping[str, Sampler] = {
    "sobol": _sobol,
    "halton": _halton,
    "lhs": _latin_hypercube,
    "random": lambda count, dimensions, generator: generator.random((count, dimensions)),
    **{name: draw for name, (draw, _) in SAMPLES.items()},
}


def rank_correlations(
    texts: Sequence[tuple[str, str]], distributions: Mapping[str, Distribution], names: Mapping[str, str]
) -> np.ndarray:
    """Returns the rank correlations of sampled parameters `(n, n)`.

    Args:
      texts: parameters, separated by commas, and their correlation: `("mass, friction", "0.7")`.
      distributions: sampled parameters.
      names: paths of all parameters, by each of their names.

    Raises:
      UsageError: a parameter is not sampled, or a correlation is impossible.
    """
    places, matrix = {path: place for place, path in enumerate(distributions)}, np.eye(len(distributions))
    known = dict[frozenset[str], tuple[float, str]]()
    for written, text in texts:
        with concerning("correlate", written):
            correlated = [_sampled_path(name.strip(), distributions, names) for name in written.split(",")]
            if len({*correlated}) < 2 or len({*correlated}) < len(correlated):
                raise UsageError(f"{option('correlate')} {clean(written)}: name two parameters or more, each once")
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            if not -1 < value < 1:
                raise BadValueError(f"{option('correlate')} {clean(written)}", text, "a number above -1 and below 1")
            for pair in combinations(correlated, 2):
                earlier, source = known.setdefault(frozenset(pair), (value, written))
                if earlier != value:
                    reason = f"{clean(source)}={earlier:g} applies to the same pair, {' and '.join(map(clean, pair))}"
                    raise UsageError(f"{option('correlate')} {clean(written)}={value:g}: {reason}")
                one, other = (places[path] for path in pair)
                matrix[one, other] = matrix[other, one] = value
    if np.linalg.eigvalsh(_of_copula(matrix))[0] < 1e-9:
        pairs = listing([f"{clean(written)}={clean(text)}" for written, text in texts])
        raise UsageError(f"{option('correlate')}: no samples have all of these correlations: {pairs}", ("correlate",))
    return matrix


def correlated(fractions: np.ndarray, ranks: np.ndarray) -> np.ndarray:
    """Returns independent samples between 0 and 1 `(count, n)` with rank correlations `(n, n)`.

    A sample depends on no other. Parameters that are not correlated with any before them keep their samples.
    """
    from scipy import special

    factor = np.linalg.cholesky(_of_copula(ranks))
    changed = [place for place in range(len(ranks)) if factor[place, :place].any()]
    if not changed:
        return fractions
    result = fractions.copy()
    for start in range(0, len(fractions), BLOCK):
        block = slice(start, start + BLOCK)
        scores = special.ndtri(np.clip(fractions[block], LEAST, MOST))
        for place in changed:
            score = np.zeros(len(scores))
            for other in range(place + 1):  # in this order for each number of samples, unlike a product of matrices
                score += factor[place, other] * scores[:, other]
            result[block, place] = np.clip(special.ndtr(score), LEAST, MOST)
    return result


def _of_copula(ranks: np.ndarray) -> np.ndarray:
    """Returns the correlations of a Gaussian copula with these rank correlations."""
    return np.where(np.eye(len(ranks)) > 0, 1.0, 2 * np.sin(math.pi / 6 * ranks))


def _sampled_path(name: str, distributions: Mapping[str, Distribution], names: Mapping[str, str]) -> str:
    path = names.get(name)
    if path is None:
        raise UnknownNameError("parameter", name, [*names])
    if path not in distributions:
        reason = "only distributions such as uniform(0,1) can be correlated"
        raise UsageError(f"{option('correlate')}: {clean(name)} has a list of values; {reason}")
    if distributions[path].name == "choice":
        raise UsageError(f"{option('correlate')}: {clean(name)} is a choice, whose values have no order")
    return path
