"""The parameters of a study, and statistics of its points: medians with bands, ranks and their correlations."""

import math
from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.formats.study_reader import StudyResults
from mjrun.packages import require
from mjrun.plotting.figure_data import AxisScale, scale
from mjrun.plotting.study import figure_data
from mjrun.plotting.tick_labels import value_labels

SEED = "seed"  # its values are repetitions if any other parameter varies
QUANTILES = ((0.05, 0.95), (0.25, 0.75))  # ends of the bands
BINS = 10  # maximum number of bins of a variable, for mutual information
ABSENT = "none"  # label of points at which a parameter does not exist
DOTS = 40  # maximum number of values of x that are marked


@dataclass(frozen=True)
class Parameter:
    """A varying parameter of a study.

    Attributes:
      name: name in the study.
      values: values of the points `(n,)`, NaN where it does not exist; for texts, their index in `categories`.
      label: name with the unit, for axes.
      levels: the distinct values, ascending, NaN last.
    """

    name: str
    values: np.ndarray
    levels: np.ndarray
    categories: Sequence[str] = ()
    label: str = ""

    @property
    def places(self) -> np.ndarray:
        """The place of each value in `levels` `(n,)`."""
        return np.searchsorted(self.levels, self.values)

    @property
    def is_listed(self) -> bool:
        """True if points share its values, as on a grid, rather than having one each, as in random samples."""
        return bool(self.categories) or 2 * len(self.levels) <= len(self.values)

    @property
    def labels(self) -> list[str]:
        """Its levels as texts."""
        numbers = self.levels[~np.isnan(self.levels)].tolist()
        return list(self.categories) or [*value_labels(numbers), *[ABSENT] * (len(self.levels) - len(numbers))]

    @property
    def ordinal_name(self) -> str:
        """Its name; for two texts, with the one that counts as higher."""
        return f"{self.name}: {self.categories[1]}" if self.categories else self.name

    def scale(self, log: bool | None = None) -> AxisScale:
        """Returns its axis, logarithmic if `log`, or by default if the values have equal ratios."""
        is_log = log
        if is_log is None:
            is_log = (
                figure_data.is_geometric(self.levels) if self.is_listed else figure_data.is_even_in_ratios(self.values)
            )
        return scale(
            self.label or self.name, self.values, log=is_log, categories=self.categories, edge=figure_data.EDGE
        )

    def cells(self) -> AxisScale:
        """Returns its axis with a cell for each level."""
        return figure_data.cell_scale(self.label or self.name, self.levels, self.labels)


def parameter_of(results: StudyResults, name: str) -> Parameter:
    if name in results.numbers:
        values = results.numbers[name]
        return Parameter(name, values, np.unique(values), label=results.with_unit(name))
    texts = results.texts[name]
    used, first, codes = np.unique(texts.codes, return_index=True, return_inverse=True)
    order = np.argsort(first)
    categories = [texts.words[int(code)] or ABSENT for code in used[order]]
    values = np.argsort(order)[codes].astype(float)
    return Parameter(name, values, np.arange(len(categories), dtype=float), categories)


def is_grid(a: Parameter, b: Parameter) -> bool:
    """Returns whether at least half of all pairs of their values are points."""
    if not (a.is_listed and b.is_listed):
        return False
    pairs = len(a.levels) * len(b.levels)
    if pairs > 2 * len(a.values):
        return False
    return bool(2 * np.count_nonzero(np.bincount(a.places * len(b.levels) + b.places)) >= pairs)


def summary(name: str, x: Parameter, values: np.ndarray, chosen: np.ndarray, colour: int) -> figure_data.Series:
    """Returns the median at each value of x, with bands if several points share a value."""
    chosen = chosen & np.isfinite(values) & np.isfinite(x.values)
    places, groups = np.unique(x.values[chosen], return_inverse=True)
    shown = QUANTILES if len(groups) > len(places) else ()
    middle, *ends = quantiles(groups, values[chosen], len(places), [0.5, *chain(*shown)])
    bands = [figure_data.QuantileBand(low, high) for low, high in zip(ends[::2], ends[1::2], strict=True)]
    joined = not x.categories and x.name != SEED  # neither has an order
    return figure_data.Series(name, places, middle, bands, joined, len(places) <= DOTS, colour)


def quantiles(groups: np.ndarray, values: np.ndarray, count: int, shares: Sequence[float]) -> list[np.ndarray]:
    """Returns quantiles of the finite values of each group, `(count,)` for each share; NaN for groups without any.

    Args:
      groups: number of the group of each value `(n,)`.
      shares: the share of the values below each quantile, which is interpolated linearly between two of them.
    """
    is_finite = np.isfinite(values)
    if not is_finite.all():
        groups, values = groups[is_finite], values[is_finite]
    values = values[np.lexsort((values, groups))]
    sizes = np.bincount(groups, minlength=count)
    some = sizes > 0
    starts, steps = (np.cumsum(sizes) - sizes)[some], sizes[some] - 1

    def quantile(share: float) -> np.ndarray:
        place = steps * share
        low, high = (values[starts + end(place).astype(int)] for end in (np.floor, np.ceil))
        part, made = place % 1, np.full(count, np.nan)
        made[some] = low * (1 - part) + high * part
        return made

    return [quantile(share) for share in shares]


def ranks(values: np.ndarray) -> np.ndarray:
    """Returns the ranks of values, from 0 to 1; NaN for NaN."""
    present = ~np.isnan(values)
    made = np.full(len(values), np.nan)
    order = np.argsort(np.argsort(values[present], kind="stable"), kind="stable")
    made[present] = order / max(1, len(order) - 1)
    return made


def dependences(parameters: Sequence[np.ndarray], metric: np.ndarray) -> np.ndarray:
    """Returns how much the metric `(n,)` depends on each parameter `(n,)`, in a relation of any shape `(parameters,)`.

    The share is √(1 − e^(−2I)) of the mutual information I (Linfoot, 1957), which is 0 for independent values, and the
    magnitude of the correlation of normal values. I is that of equally frequent bins, less its bias of Miller and
    Madow. Few values or bins limit I, so the share is divided by that of the limit: it is 1 where one value determines
    the other.

    Points at which either is not finite are omitted. The result is NaN for constant values or fewer than three points.
    """
    return _of_each(parameters, metric, _dependence)


def _of_each(
    parameters: Sequence[np.ndarray], metric: np.ndarray, compute: Callable[[np.ndarray, np.ndarray], Any]
) -> np.ndarray:
    """Returns a number for each parameter and the metric: of the points at which both are finite."""
    made = np.full(len(parameters), np.nan)
    for index, values in enumerate(parameters):
        usable = np.isfinite(values) & np.isfinite(metric)
        a, b = values[usable], metric[usable]
        if len(a) >= 3 and np.ptp(a) > 0 and np.ptp(b) > 0:
            made[index] = compute(a, b)
    return made


def _dependence(a: np.ndarray, b: np.ndarray) -> float:
    bins = _binned(a), _binned(b)
    counts = np.zeros([each.max() + 1 for each in bins])
    np.add.at(counts, bins, 1)
    joint = counts / len(a)
    ends = [joint.sum(axis=1), joint.sum(axis=0)]
    limit = min(map(_entropy, ends))
    bias = (np.count_nonzero(joint) - np.count_nonzero(ends[0]) - np.count_nonzero(ends[1]) + 1) / (2 * len(a))
    information = sum(map(_entropy, ends)) - _entropy(joint) - max(0.0, bias)
    return math.sqrt(math.expm1(-2 * min(max(0.0, information), limit)) / math.expm1(-2 * limit))


def _entropy(shares: np.ndarray) -> float:
    """Returns the entropy of a variable with these probabilities [nat]."""
    some = shares[shares > 0]
    return -float((some * np.log(some)).sum())


def _binned(values: np.ndarray) -> np.ndarray:
    """Returns the bin of each value: bins are about equally frequent, and equal values share one."""
    levels, inverse = np.unique(values, return_inverse=True)
    most = max(2, min(BINS, round(len(values) ** 0.4)))
    if len(levels) <= most:
        return inverse
    below = np.searchsorted(np.sort(values), values)  # the number of smaller values
    _, bins = np.unique(below * most // len(values), return_inverse=True)
    return bins


def rank_correlations(parameters: Sequence[np.ndarray], metric: np.ndarray) -> np.ndarray:
    """Returns Spearman's rank correlation of each parameter `(n,)` with `metric` `(n,)`: from -1 to 1, `(parameters,)`.

    Points at which either is not finite are omitted. The result is NaN for constant values or fewer than three points.

    Raises:
      MissingExtraError: scipy is not installed.
    """
    require("rank correlations", "sweep", "scipy")
    from scipy.stats import spearmanr

    return _of_each(parameters, metric, lambda a, b: spearmanr(a, b)[0])
