"""The inertias of bodies that a fit has changed, in the quantities that people compare."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjrun.fit.body_inertia import BodyInertia
from mjrun.fit.free_parameter import FreeParameter
from mjrun.fit.intervals import Intervals


@dataclass(frozen=True)
class FittedQuantity:
    """A quantity of a body.

    Attributes:
      name: `mass`, `center/x` to `center/z` in the frame of the body, or `moment/1` to `moment/3` of inertia about the
        principal axes through the centre, largest first.
      unit: of it.
      start: what the model had.
      value: what was found.
      low, high: ends of its confidence interval.
    """

    name: str
    unit: str
    start: float
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class FittedInertia:
    """The inertia of a body.

    Attributes:
      body: its name.
      quantities: mass, centre and moments.
    """

    body: str
    quantities: Sequence[FittedQuantity]


NAMES = ("mass", "center/x", "center/y", "center/z", "moment/1", "moment/2", "moment/3")
UNITS = ("kg", "m", "m", "m", "kg m²", "kg m²", "kg m²")


def fitted_inertias(
    parameters: Sequence[FreeParameter], values: Sequence[float], known: Intervals
) -> list[FittedInertia]:
    """The inertias of which `parameters` are numbers, fitted to be `values`."""

    def numbers(draw: Sequence[float] | NDArray[np.float64], inertia: BodyInertia) -> dict[str, float]:
        return {p.name: float(v) for p, v in zip(parameters, draw, strict=True) if p.inertia is inertia}

    inertias: list[FittedInertia] = []
    for inertia in dict.fromkeys(each.inertia for each in parameters if each.inertia is not None):
        low, high = known.of(lambda draw, inertia=inertia: _quantities(inertia, numbers(draw, inertia)))
        columns = (_quantities(inertia, {}), _quantities(inertia, numbers(values, inertia)), low, high)
        rows = zip(NAMES, UNITS, *(column.tolist() for column in columns), strict=True)
        inertias.append(FittedInertia(inertia.body, [FittedQuantity(*row) for row in rows]))
    return inertias


def _quantities(inertia: BodyInertia, values: Mapping[str, float]) -> NDArray[np.float64]:
    """In the order of NAMES: `(7,)`."""
    mass, center, _ = inertia.at(values)
    return np.array([mass, *center, *inertia.principal_moments(values)])
