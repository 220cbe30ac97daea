"""The result of a fit, as its report has it."""

from collections.abc import Mapping, Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.fitting.free_parameter import BodyInertia, FreeParameter
from mjrun.fitting.information import ParameterIntervals
from mjrun.fitting.measurements import Floats
from mjrun.model.table_column import with_unit
from mjrun.plotting.html_page import PageFactTable, facts_table

SCHEMA = "mjrun-fit-1"
MOMENTS = {f"center/{axis}": "m" for axis in "xyz"} | {f"moment/{i}": "kg·m²" for i in (1, 2, 3)}
QUANTITIES = {"mass": "kg", **MOMENTS}  # of an inertia, with their units


@dataclass(frozen=True)
class FittedParameter:
    """A fitted parameter, with its confidence interval.

    Attributes:
      path: path in the model, or the delay of a signal.
      start: value in the original model.
      value: fitted value.
      low, high: ends of its confidence interval.
      effect: change of the measurements between its bounds, in standard deviations of their noise.
      bound: `low` or `high` if the value is at this bound; otherwise empty.
      unit: unit of the values; empty if they have none, or if it is unknown.
    """

    path: str
    start: float
    value: float
    low: float
    high: float
    effect: float
    bound: str
    unit: str = ""

    @property
    def label(self) -> str:
        """The path with its unit: `joint/hinge.damping [N·m·s/rad]`."""
        return with_unit(self.path, self.unit)


@dataclass(frozen=True)
class FittedSignal:
    """Prediction errors of a signal: root mean squares over its standard deviation.

    With a robust loss, errors and spread are estimated by medians, so that outliers do not count. The four numbers of a
    rotation share their errors.

    Attributes:
      name: name of the column.
      unit: its unit.
      noise: standard deviation of the residuals of the fit, in this unit.
      misfit: ratio of this to the noise of the log; about 1 if the model explains all but noise.
      nominal, fitted: errors in the fitted part, before and after; None of a partial fit.
      holdout_nominal, holdout_fitted: errors in held-out data, or None.
    """

    name: str
    unit: str
    noise: float
    misfit: float
    nominal: float | None
    fitted: float | None
    holdout_nominal: float | None
    holdout_fitted: float | None


@dataclass(frozen=True)
class InertiaQuantity:
    """A quantity of the inertia of a body, such as its mass.

    Attributes:
      name: `mass`, `center/x` to `center/z` in the frame of the body, or `moment/1` to `moment/3` of inertia about the
        principal axes through the centre, largest first.
      unit: its unit.
      start: value in the original model.
      value: fitted value.
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
    """The fitted inertia of a body.

    Attributes:
      body: name of the body.
      quantities: mass, centre and moments.
    """

    body: str
    quantities: Sequence[InertiaQuantity]


@dataclass(frozen=True)
class FitResult:
    """The result of a fit.

    Attributes:
      parameters: fitted parameters.
      inertias: inertias with fitted numbers.
      signals: measured signals.
      reduced_chi2: squared residuals over the noise of the log, per degree of freedom; about 1 if the model explains
        all but noise.
      correlation: correlations between the parameters, in their order.
      confidence: confidence level of the intervals.
      condition: ratio of singular values; large if parameters are hard to distinguish.
      rows, segments: size of the fitted data.
      rollouts: number of simulated chunks.
      changes: changes of the model's text, in words.
      remarks: remarks on the measurements and the fit.
      ways: search methods, in the order in which they were tried.
      files: written files.
      wall: wall time [s].
      loss: loss function of the residuals.
      partial: whether the fit was interrupted, so that parameters and intervals are preliminary.
      schema: schema of this document.
    """

    parameters: Sequence[FittedParameter]
    inertias: Sequence[FittedInertia]
    signals: Sequence[FittedSignal]
    reduced_chi2: float
    correlation: Sequence[Sequence[float]]
    confidence: float
    condition: float
    rows: int
    segments: int
    rollouts: int
    changes: Sequence[str]
    remarks: Sequence[str]
    ways: Sequence[str]
    files: Sequence[str]
    wall: float
    loss: str = "linear"
    partial: bool = False
    schema: str = SCHEMA

    def _repr_html_(self) -> str:
        """Returns the parameters with their intervals for a notebook."""
        heads = ("parameter", "start", "fitted", "from", "to")
        rows = [
            [each.label, *(f"{value:.4g}" for value in (each.start, each.value, each.low, each.high))]
            for each in self.parameters
        ]
        caption = f"Parameters with their intervals at a confidence of {100 * self.confidence:g} %"
        return facts_table(PageFactTable("Parameters", caption, heads, rows, range(1, len(heads))))


def fitted_inertias(
    parameters: Sequence[FreeParameter], values: Sequence[float], known: ParameterIntervals
) -> list[FittedInertia]:
    """Returns the inertias of which `parameters` are numbers, with the fitted `values`."""

    def quantities(draw: Sequence[float] | Floats, inertia: BodyInertia) -> Floats:
        return _quantities(
            inertia, {p.name: float(v) for p, v in zip(parameters, draw, strict=True) if p.inertia is inertia}
        )

    inertias: list[FittedInertia] = []
    for inertia in dict.fromkeys(each.inertia for each in parameters if each.inertia is not None):
        low, high = known.of(lambda draw, inertia=inertia: quantities(draw, inertia))
        columns = (_quantities(inertia, {}), quantities(values, inertia), low, high)
        rows = zip(QUANTITIES.items(), *(column.tolist() for column in columns), strict=True)
        inertias.append(FittedInertia(inertia.body, [InertiaQuantity(*name, *numbers) for name, *numbers in rows]))
    return inertias


def _quantities(inertia: BodyInertia, values: Mapping[str, float]) -> Floats:
    """Returns the numbers of `QUANTITIES`, `(7,)`."""
    mass, center, _ = inertia.at(values)
    return np.array([mass, *center, *inertia.principal_moments(values)])
