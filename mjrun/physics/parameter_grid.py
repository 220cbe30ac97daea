"""A grid of settings: every combination of their values."""

import re
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal, localcontext
from fractions import Fraction
from itertools import product

from mjrun.errors import UsageError, clean, option
from mjrun.model.override import Override

SHORT = {"integrator": "opt.integrator", "timestep": "opt.timestep"}

SPAN = re.compile(r"(?P<log>log:)?(?P<first>\.?[^.].*?)\.\.(?P<last>.+):(?P<count>.+)")
MOST = 1_000_000  # values in a span

Point = Mapping[str, str]


def scan_values(path: str, text: str, name: str = "scan") -> list[str]:
    """Parses the values in `text`, separated by commas, or by semicolons where a value contains commas.

    A single value with commas ends in a semicolon.

    `0.1..1:10` is ten values from 0.1 to 1, evenly spaced; `log:1e-4..1:5` five in equal ratios.

    Args:
      name: of the option.

    Raises:
      UsageError: `text` has no values, or one twice.
    """
    place = f"{option(name)} {clean(path)}={clean(text)}"
    values: list[str] = []
    for part in text.removesuffix(";").split(";" if ";" in text else ","):
        span = SPAN.fullmatch(part.strip())
        values += _spaced(span, place) if span else [part.strip()]
    if not all(values) or len(set(values)) < len(values):
        raise UsageError(f"{place}: write values separated by commas, each once")
    return values


def _spaced(span: re.Match[str], place: str) -> list[str]:
    """Returns the values of `FIRST..LAST:COUNT`, both ends included; evenly spaced ones are exact in decimals."""
    try:
        first, last, count = Fraction(span["first"]), Fraction(span["last"]), int(span["count"])
    except ValueError:
        raise UsageError(f"{place}: write FIRST..LAST:COUNT, with numbers") from None
    if count < 2 or count > MOST or first == last:
        raise UsageError(f"{place}: write FIRST..LAST:COUNT, with two different ends and from 2 to {MOST} values")
    if span["log"] is None:
        return [_text(first + (last - first) * k / (count - 1)) for k in range(count)]
    if first <= 0 or last <= 0:
        raise UsageError(f"{place}: equal ratios need positive ends")
    with localcontext() as context:
        context.prec = 50  # far beyond a float, so that 1e-4..1e-1:4 includes 0.001
        ends = [Decimal(end.numerator) / end.denominator for end in (first, last)]
        inner = [ends[0] * (ends[1] / ends[0]) ** (Decimal(k) / (count - 1)) for k in range(1, count - 1)]
    return [_text(first), *(repr(float(value)) for value in inner), _text(last)]


def _text(value: Fraction) -> str:
    return str(value) if value.denominator == 1 else repr(float(value))


def points(scan: Mapping[str, Sequence[str]]) -> Iterator[Point]:
    """Yields every combination, the last setting changing fastest; a single empty one without settings."""
    for combination in product(*scan.values()):
        yield dict(zip(scan, combination, strict=True))


def settings(point: Point) -> tuple[Override, ...]:
    """Returns the overrides of a point of the grid."""
    return tuple(Override(SHORT.get(path, path), value) for path, value in point.items())
