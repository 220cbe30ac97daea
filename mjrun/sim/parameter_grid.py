"""A grid of settings: every combination of the values that each of them takes."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

from mjrun.errors import UsageError, clean, option
from mjrun.model.override import Override

SHORT = {"integrator": "opt.integrator", "timestep": "opt.timestep"}

Point = Mapping[str, str]


def scan_values(path: str, text: str) -> list[str]:
    """The values in `text`: separated by commas, or by semicolons where one has commas; then a lone one ends in one.

    Raises:
      UsageError: there are none, or one twice.
    """
    values = [value.strip() for value in text.removesuffix(";").split(";" if ";" in text else ",")]
    if not all(values) or len(set(values)) < len(values):
        raise UsageError(f"{option('scan')} {clean(path)}={clean(text)}: write values separated by commas, each once")
    return values


def points(scan: Mapping[str, Sequence[str]]) -> Iterator[Point]:
    """Every combination, the last setting changing fastest; a single empty one without a scan."""
    for combination in product(*scan.values()):
        yield dict(zip(scan, combination, strict=True))


def settings(point: Point) -> tuple[Override, ...]:
    """The overrides that a point of the grid stands for."""
    return tuple(Override(SHORT.get(path, path), value) for path, value in point.items())
