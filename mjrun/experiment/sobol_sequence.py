"""Scrambled Sobol' sequences: those of `scipy.stats.qmc`, whose import takes a second and 60 MB.

Sources: S. Joe and F. Y. Kuo, SIAM Journal on Scientific Computing 30 (2008) 2635, for the direction numbers;
J. Matoušek, Journal of Complexity 14 (1998) 527, for the scrambling by random linear matrices and a digital shift.
"""

import importlib.util
from pathlib import Path

import numpy as np

BITS = 30  # of each coordinate
NUMBERS = "stats/_sobol_direction_numbers.npz"  # a file of SciPy: primitive polynomials, and the numbers that begin


def sobol_points(exponent: int, dimensions: int, generator: "np.random.Generator") -> np.ndarray:
    """Draws the first `2**exponent` points of a scrambled sequence, `(2**exponent, dimensions)` between 0 and 1."""
    directions = _direction_numbers(dimensions)
    if directions is None:
        from scipy.stats import qmc  # pyright: ignore[reportMissingTypeStubs]

        return qmc.Sobol(dimensions, rng=generator).random_base2(exponent)

    (own,) = generator.spawn(1)
    powers = 2 ** np.arange(BITS, dtype=np.uint32)
    shift = own.integers(2, size=(dimensions, BITS), dtype=np.uint32) @ powers
    lower = np.tril(own.integers(2, size=(dimensions, BITS, BITS), dtype=np.uint32))
    lower[:, np.arange(BITS), np.arange(BITS)] = 1
    digits = directions[:, None] >> np.arange(BITS, dtype=np.uint32)[::-1, None] & 1  # from the highest
    scrambled = powers[::-1] @ (lower @ digits & 1)

    points = shift[None]
    for place in range(exponent):  # in the order of the Gray code
        points = np.concatenate([points, points[::-1] ^ scrambled[:, place]])
    return points * 2.0**-BITS


def _direction_numbers(dimensions: int) -> np.ndarray | None:
    """Returns the direction numbers of each dimension, `(dimensions, BITS)`; None where they are not found."""
    spec = importlib.util.find_spec("scipy")
    places = (spec and spec.submodule_search_locations) or ()
    files = [path for place in places if (path := Path(place) / NUMBERS).is_file()]
    if not files:
        return None
    with np.load(files[0]) as numbers:
        polynomials, first = numbers["poly"][:dimensions].tolist(), numbers["vinit"][:dimensions]
    if len(polynomials) < dimensions:
        return None
    table = np.ones((dimensions, BITS), np.uint32)
    for row, polynomial, start in zip(table[1:], polynomials[1:], first[1:], strict=True):
        degree = polynomial.bit_length() - 1
        row[:degree] = start[:degree]
        for place in range(degree, BITS):
            row[place] = row[place - degree]
            for back in range(1, degree + 1):
                if polynomial >> degree - back & 1:
                    row[place] ^= row[place - back] << back
    return table << np.arange(BITS, dtype=np.uint32)[::-1]
