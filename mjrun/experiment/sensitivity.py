"""Sensitivity of metrics to parameters, from the points of `mjrun.experiment.samplers`.

Sources: A. Saltelli et al., Computer Physics Communications 181 (2010) 259, for the estimators of Sobol' indices; F.
Campolongo et al., Environmental Modelling & Software 22 (2007) 1509, for the mean magnitude μ* of elementary effects.

An index has an interval: of the bootstrap over samples, or Student's for means of elementary effects.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.experiment.results_table import ResultsTable
from mjrun.experiment.samplers import SAMPLES, STEP
from mjrun.experiment.statistics import (
    NO_INTERVAL,
    Interval,
    mean_interval,
    percentile_interval,
    resamples_of,
)
from mjrun.formats.study_reader import SENSITIVITY
from mjrun.model.table_column import Column

FEWEST = 2  # samples for an index
FILES = (SENSITIVITY, "sensitivity.csv")


@dataclass(frozen=True)
class SensitivityIndex:
    """A sensitivity index with its confidence interval.

    Attributes:
      value: index; None if it is undefined, as for a constant metric.
      interval: its confidence interval.
    """

    value: float | None
    interval: Interval


@dataclass(frozen=True)
class MetricSensitivity:
    """The sensitivity of a metric to a parameter.

    Attributes:
      metric, parameter: their names.
      samples: number of samples without a failed point.
      indices: estimates by name. `saltelli` gives `first`, the share of the variance that the parameter explains alone,
        and `total`, with its interactions; `morris` gives `mu_star`, the mean magnitude of elementary effects, and
        `sigma`, their standard deviation.
    """

    metric: str
    parameter: str
    samples: int
    indices: Mapping[str, SensitivityIndex]


def sobol_indices(values: np.ndarray, confidence: float) -> list[dict[str, SensitivityIndex]]:
    """Returns the Sobol' indices of each parameter.

    Args:
      values: a number of each point of `saltelli` `(samples, parameters + 2)`, all finite.
    """
    samples = len(values)
    generator = np.random.default_rng(0)
    drawn = [_first_and_total(values[generator.integers(samples, size=samples)]) for _ in range(resamples_of(samples))]
    first, total = (np.array(each) for each in zip(*drawn, strict=True))
    made = _first_and_total(values)
    return [
        {
            "first": _bootstrapped(made[0][index], first[:, index], confidence),
            "total": _bootstrapped(made[1][index], total[:, index], confidence),
        }
        for index in range(values.shape[1] - 2)
    ]


def elementary_effects(
    values: np.ndarray, fractions: np.ndarray, confidence: float
) -> list[dict[str, SensitivityIndex]]:
    """Returns the mean magnitude and the standard deviation of the elementary effects of each parameter.

    Args:
      values: a number of each point of `morris` `(trajectories, parameters + 1)`, all finite.
      fractions: the points `(trajectories, parameters + 1, parameters)`.
    """
    signs = np.sign(np.diff(fractions, axis=1))  # not zero for the one parameter that changes
    effects = np.einsum("ts,tsp->tp", np.diff(values, axis=1), signs) / STEP
    return [
        {
            "mu_star": SensitivityIndex(float(np.abs(each).mean()), mean_interval(np.abs(each), confidence)),
            "sigma": SensitivityIndex(float(each.std(ddof=1)), NO_INTERVAL),
        }
        for each in effects.T
    ]


def _first_and_total(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the first and total indices of parameters, `(parameters,)` each, NaN if all values are equal."""
    values = values - values[:, :2].mean()
    a, b, mixed = values[:, :1], values[:, 1:2], values[:, 2:]
    variance = float(values[:, :2].var())
    if variance == 0:
        nothing = np.full(mixed.shape[1], np.nan)
        return nothing, nothing
    return (b * (mixed - a)).mean(axis=0) / variance, 0.5 * ((a - mixed) ** 2).mean(axis=0) / variance


def _bootstrapped(value: float, drawn: np.ndarray, confidence: float) -> SensitivityIndex:
    if not np.isfinite(value):
        return SensitivityIndex(None, NO_INTERVAL)
    return SensitivityIndex(float(value), percentile_interval(drawn[np.isfinite(drawn)], confidence))


def sensitivities(
    sampler: str,
    parameters: Sequence[str],
    metrics: Mapping[str, np.ndarray | Sequence[float]],
    confidence: float,
    seed: int,
) -> list[MetricSensitivity]:
    """Returns the sensitivity of each metric to each parameter.

    Args:
      sampler: `saltelli` or `morris`.
      metrics: values of each metric `(n,)`, by name; a sample with a value that is not finite is left out.
      seed: seed of the design.
    """
    draw, more = SAMPLES[sampler]
    size, made = len(parameters) + more, list[MetricSensitivity]()
    for name, numbers in metrics.items():
        values = np.asarray(numbers, float).reshape(-1, size)
        usable = np.isfinite(values).all(axis=1)
        count = int(np.count_nonzero(usable))
        if count < FEWEST:
            continue
        if sampler == "saltelli":
            indices = sobol_indices(values[usable], confidence)
        else:
            fractions = draw(len(values), len(parameters), np.random.default_rng(seed))
            indices = elementary_effects(values[usable], fractions.reshape(-1, size, size - 1)[usable], confidence)
        made += [
            MetricSensitivity(name, parameter, count, each) for parameter, each in zip(parameters, indices, strict=True)
        ]
    return made


def sensitivity_table(made: Sequence[MetricSensitivity]) -> ResultsTable:
    """Returns a table with a row for each metric and parameter."""
    table = ResultsTable()
    table.add_texts("metric", [each.metric for each in made])
    table.add_texts("parameter", [each.parameter for each in made])
    table.add(
        Column("samples", meaning="samples without a failed point", integer=True), [each.samples for each in made]
    )
    for name in made[0].indices:
        estimates = [each.indices[name] for each in made]
        columns = {
            name: [each.value for each in estimates],
            f"{name}_low": [each.interval.low for each in estimates],
            f"{name}_high": [each.interval.high for each in estimates],
        }
        for column, values in columns.items():
            if any(value is not None for value in values):
                table.add(Column(column), [np.nan if value is None else value for value in values])
    return table
