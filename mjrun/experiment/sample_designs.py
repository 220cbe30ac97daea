"""Samplers: points between 0 and 1. Those of Saltelli and Morris come in samples, for sensitivities of metrics.

Sources: A. Saltelli et al., Computer Physics Communications 181 (2010) 259; M. D. Morris, Technometrics 33 (1991) 161.
"""

from collections.abc import Callable, Mapping

import numpy as np

LEVELS = 4  # of each parameter in a design of Morris
STEP = 0.5  # change of a fraction from one of its points to the next

Sampler = Callable[[int, int, "np.random.Generator"], np.ndarray]


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
    from scipy.stats import qmc  # pyright: ignore[reportMissingTypeStubs]

    # The first of a power of two: points stay the same when there are more of them.
    exponent = max(0, (count - 1).bit_length())
    return qmc.Sobol(dimensions, rng=generator).random_base2(exponent)[:count]


def _halton(count: int, dimensions: int, generator: "np.random.Generator") -> np.ndarray:
    from scipy.stats import qmc  # pyright: ignore[reportMissingTypeStubs]

    return qmc.Halton(dimensions, rng=generator).random(count)


def _latin_hypercube(count: int, dimensions: int, generator: "np.random.Generator") -> np.ndarray:
    from scipy.stats import qmc  # pyright: ignore[reportMissingTypeStubs]

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
