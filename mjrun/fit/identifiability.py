"""Whether measurements can tell parameters at all, and which of them they cannot tell apart."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjrun.errors import clean, listing
from mjrun.fit.free_parameter import FreeParameter
from mjrun.fit.projection import all_information
from mjrun.fit.solution import Solution

# From one bound to the other, the data must change by so many standard deviations of their noise: a standard error
# of half the range says nothing.
LEAST = 2.0
SHARE = 0.01  # of the largest, the least effect by which a parameter takes part in a direction that no data tell


@dataclass(frozen=True)
class Unidentifiable:
    """Parameters that the data say nothing of, one alone, or several that can stand in for each other."""

    paths: tuple[str, ...]

    @property
    def message(self) -> str:
        """The sentence."""
        if len(self.paths) == 1:
            return f"the measurements say nothing of {clean(self.paths[0])}"
        return f"the measurements cannot tell {listing(self.paths)} apart: only a combination of them shows"


@dataclass(frozen=True)
class Sensitivity:
    """How much measurements know of parameters.

    Attributes:
      effects: of each parameter, how many standard deviations of the noise all data change from one bound to the
        other, the others being known.
      condition: ratio of the largest to the smallest singular value of the scaled slopes.
      unidentifiable: what cannot be told.
    """

    effects: tuple[float, ...]
    condition: float
    unidentifiable: tuple[Unidentifiable, ...]


def sensitivity(solutions: Sequence[Solution], parameters: Sequence[FreeParameter]) -> Sensitivity:
    """What can be told at the best of several solutions: slopes depend on where the parameters are."""
    matrices = [all_information(solution, parameters) for solution in solutions]
    each = [_of(matrix, parameters) for matrix in matrices]
    return min(each, key=lambda one: (sum(len(u.paths) for u in one.unidentifiable), one.condition))


def _of(matrix: NDArray[np.float64], parameters: Sequence[FreeParameter]) -> Sensitivity:
    effects = np.sqrt(np.diag(matrix))
    paths = [each.path for each in parameters]
    silent = [i for i, effect in enumerate(effects) if effect < LEAST]
    problems = [Unidentifiable((paths[i],)) for i in silent]

    audible = [i for i in range(len(paths)) if i not in silent]
    condition = np.inf if silent else 1.0
    if audible:
        values, vectors = np.linalg.eigh(matrix[np.ix_(audible, audible)])
        singular = np.sqrt(np.maximum(values, 0))
        condition = max(condition, float(singular[-1] / max(singular[0], 1e-300)))
        for value, vector in zip(singular, vectors.T, strict=True):
            if value < LEAST:
                # Along it effects cancel: whatever has one takes part, however short its way between its bounds is.
                shown = effects[audible] * np.abs(vector)
                mixed = [paths[audible[i]] for i in np.flatnonzero(shown > max(LEAST, SHARE * shown.max()))]
                problems.append(Unidentifiable(tuple(mixed)))
    return Sensitivity(tuple(map(float, effects)), float(condition), tuple(problems))
