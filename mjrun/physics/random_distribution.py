"""Distributions of random values: their text form, drawing, and quantile functions."""

import math
import re
from collections.abc import Callable, Collection, Sequence
from functools import cache, cached_property

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean
from mjrun.options.setting_kinds import CALL, DISTRIBUTIONS
from mjrun.timeline import EXACT

LEAST, MOST = 2.0**-53, 1 - 2.0**-53  # fractions whose quantiles are finite
UNIFORM = 1e-8  # relative change of the density of a normal within its limits, below which it is uniform
Quantiles = Callable[[np.ndarray], np.ndarray]
# The condition on the numbers of a distribution, in words and as a function.
CONDITIONS: dict[str, tuple[str, Callable[[Sequence[float]], bool]]] = {
    "uniform": (
        "LOW below HIGH, at a finite distance",
        lambda numbers: numbers[0] < numbers[1] and math.isfinite(numbers[1] - numbers[0]),
    ),
    "loguniform": ("0 < LOW < HIGH", lambda numbers: 0 < numbers[0] < numbers[1]),
    "normal": ("STD above 0", lambda numbers: numbers[1] > 0),
    "truncnormal": (
        "STD above 0 and LOW below HIGH",
        lambda numbers: numbers[1] > 0 and numbers[2] < numbers[3],
    ),
    "integers": (
        "whole numbers of at most 2^53, FIRST not above LAST",
        lambda numbers: (
            numbers[0] <= numbers[1] and all(number == int(number) and abs(number) <= EXACT for number in numbers)
        ),
    ),
}


@dataclass(frozen=True)
class Distribution:
    """A distribution of values.

    Attributes:
      text: its text form: `uniform(0.3, 1)`.
      name: `uniform`.
      arguments: the texts in its parentheses, numbers without their unit.
      unit: unit of all numbers, as in `uniform(10deg, 30deg)`; usually empty.
    """

    text: str
    name: str
    arguments: tuple[str, ...]
    unit: str = ""

    def values(self, fractions: np.ndarray) -> list[str]:
        """Returns the quantiles of the distribution at these fractions `(n,)` from 0 to 1, as texts."""
        if self.name == "choice":
            count = len(self.arguments)
            return [self.arguments[min(int(fraction * count), count - 1)] for fraction in fractions]
        values = self.quantiles(fractions).tolist()
        return [f"{int(value) if self.name == 'integers' else repr(value)}{self.unit}" for value in values]

    def quantiles(self, fractions: np.ndarray) -> np.ndarray:
        """Returns the quantiles of a distribution of numbers at these fractions `(n,)` from 0 to 1."""
        return np.asarray(_quantiles(self.name, self.numbers)(fractions), float)

    @cached_property
    def numbers(self) -> list[float]:
        """The arguments as numbers; a ValueError if they are not."""
        return [float(argument) for argument in self.arguments]


def parse_distribution(text: str, place: str, units: Collection[str] = ()) -> Distribution | None:
    """Returns the distribution that `text` specifies; None if `text` is not a call.

    Args:
      place: its name in messages: `vary geom/floor.friction[0]`.
      units: units, one of which all numbers may have.

    Raises:
      UsageError: the distribution does not exist, or its numbers are invalid.
    """
    call = re.fullmatch(CALL, text)
    if call is None:
        return None
    name, arguments = call[1], tuple(part.strip() for part in call[2].split(","))
    if name not in DISTRIBUTIONS:
        raise UsageError(f"{place}: no distribution {clean(name)}\ndistributions: {', '.join(DISTRIBUTIONS.values())}")
    if name == "choice":
        if not all(arguments):
            raise UsageError(f"{place}: {clean(text)}: write {DISTRIBUTIONS[name]}")
        return Distribution(text.strip(), name, arguments)
    condition, is_valid = CONDITIONS[name]
    longest_first = sorted(units, key=len, reverse=True)
    written = [next((unit for unit in longest_first if each.endswith(unit)), "") for each in arguments]
    unit = next(filter(None, written), "")
    if any(each != unit for each in written):
        raise UsageError(f"{place}: {clean(text)}: write all numbers in {unit}, or all without a unit")
    arguments = tuple(each.removesuffix(unit).rstrip() for each in arguments)
    try:
        numbers = [float(argument) for argument in arguments]
    except ValueError:
        numbers = []
    has_all = len(numbers) == DISTRIBUTIONS[name].count(",") + 1 and np.isfinite(numbers).all()
    if not has_all or not is_valid(numbers):
        raise UsageError(f"{place}: {clean(text)}: write {DISTRIBUTIONS[name]}, {condition}")
    return Distribution(text.strip(), name, arguments, unit)


@cache
def _parsed(text: str) -> Distribution | None:
    return parse_distribution(text, text)


def draw_numbers(text: str, generator: "np.random.Generator", count: int) -> np.ndarray:
    """Draws `count` numbers `(count,)` from the distribution `text`, or repeats the number `text`."""
    distribution = _parsed(text)
    if distribution is None:
        return np.full(count, float(text))
    numbers = distribution.numbers
    match distribution.name, numbers:
        case "uniform", (low, high):
            return generator.uniform(low, high, count)
        case "loguniform", (low, high):
            return np.exp(generator.uniform(np.log(low), np.log(high), count))
        case "normal", (mean, std):
            return generator.normal(mean, std, count)
        case "integers", (first, last):
            return generator.integers(int(first), int(last) + 1, count).astype(float)
        case "choice", _:
            return np.array(numbers)[generator.integers(len(numbers), size=count)]
        case name, _:
            return _quantiles(name, numbers)(generator.random(count))


def highest_texts(text: str) -> tuple[str, ...]:
    """Returns the values, as texts, one of which is the highest that `draw_text` returns; empty if it has no limit."""
    distribution = _parsed(text)
    if distribution is None:
        return (text,)
    if distribution.name == "normal":
        return ()
    return distribution.arguments if distribution.name == "choice" else distribution.arguments[-1:]


def draw_text(text: str, generator: "np.random.Generator") -> str:
    """Draws one value from the distribution `text`, as text; returns any other `text` unchanged."""
    distribution = _parsed(text)
    if distribution is None:
        return text
    if distribution.name == "choice":
        return distribution.arguments[int(generator.integers(len(distribution.arguments)))]
    number = float(draw_numbers(text, generator, 1)[0])
    return str(int(number)) if distribution.name == "integers" else repr(number)


def _quantiles(name: str, numbers: Sequence[float]) -> Quantiles:
    if name == "uniform":  # without the import of scipy.stats, which takes a second and 60 MB
        low, high = numbers
        return lambda fractions: fractions * (high - low) + low

    from scipy import stats

    match name, numbers:
        case "loguniform", (low, high):
            return stats.loguniform(low, high).ppf
        case "normal", (mean, std):
            return lambda fractions: stats.norm(mean, std).ppf(np.clip(fractions, LEAST, MOST))
        case "truncnormal", (mean, std, low, high):
            ends = (low - mean) / std, (high - mean) / std
            if (high - low) / std * max(1.0, *map(abs, ends)) < UNIFORM:
                return _quantiles("uniform", [low, high])
            return lambda fractions: np.clip(stats.truncnorm(*ends, mean, std).ppf(fractions), low, high)
        case "integers", (first, last):
            return lambda fractions: stats.randint(int(first), int(last) + 1).ppf(np.clip(fractions, LEAST, 1))
        case _:
            raise ValueError(name)
