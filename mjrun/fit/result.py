"""What has come of a fit, as its report has it."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjrun.fit.fitted_inertia import FittedInertia

SCHEMA = "mjrun-fit-1"


@dataclass(frozen=True)
class FittedParameter:
    """A parameter.

    Attributes:
      path: in the model, or the delay of a signal.
      start: what the model had.
      value: what was found.
      low, high: ends of its confidence interval.
      effect: how many standard deviations of their noise the measurements change between its bounds.
      bound: `low` or `high` if it lies at this bound; else empty.
    """

    path: str
    start: float
    value: float
    low: float
    high: float
    effect: float
    bound: str


@dataclass(frozen=True)
class FittedSignal:
    """How well a signal is predicted, as root mean square errors over its standard deviation.

    With a robust loss, both are medians of absolute values instead, over that of a normal distribution: outliers are no
    part of them. The four numbers of a rotation have theirs in common.

    Attributes:
      name: of the column.
      unit: of it.
      noise: standard deviation of what is left of it after the fit, in this unit.
      misfit: this over the noise of the log; about 1 where the model explains all but noise.
      nominal, fitted: errors where it was fitted, before and after; None of a partial fit.
      holdout_nominal, holdout_fitted: errors on what was held out; None without.
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
class FitResult:
    """What has come of a fit.

    Attributes:
      parameters: what was looked for.
      inertias: of bodies of which numbers were looked for.
      signals: what was measured.
      reduced_chi2: mean square of what is left over the noise of the log, for each degree of freedom: about 1 where the
        model explains all but noise.
      correlation: between the parameters, in their order.
      confidence: of the intervals.
      condition: how well they can be told apart: ratio of singular values.
      rows, segments: what was fitted.
      rollouts: how many chunks were simulated.
      changes: what was changed in the model's text, each in words.
      remarks: what to know of the measurements and of the fit.
      ways: how the parameters were searched for, in the order in which it was tried.
      files: what was written.
      wall: wall time [s].
      loss: how residuals counted.
      partial: whether the fit was interrupted: there is something better, and intervals are those of shorter stretches.
      schema: of this document.
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
