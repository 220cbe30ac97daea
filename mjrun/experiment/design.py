"""Points of an experiment: the values that each of them has, and their order."""

import re
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal, localcontext
from fnmatch import fnmatchcase
from fractions import Fraction
from functools import cache
from math import lcm, prod
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import FileError, UnknownNameError, UsageError, clean, concerning, listing, option
from mjrun.experiment.design_points import (
    LARGEST_INTEGER,
    Design,
    GridPoints,
    NumberTexts,
    chosen,
    numbers,
    parameter_names,
    with_conditional,
)
from mjrun.experiment.samplers import SAMPLERS, SAMPLES, correlated, rank_correlations
from mjrun.formats.input_file import decoding, opened
from mjrun.model.names import names
from mjrun.options.kinds import AnyKind
from mjrun.options.number_kinds import IntegerKind
from mjrun.options.option import options_of
from mjrun.options.simulation import SimulationOptions
from mjrun.options.sweep import MOST_POINTS, VariationOptions
from mjrun.physics.random_distribution import Distribution, parse_distribution

EACH = "each:"
SHORT_PATHS = {"integrator": "opt.integrator", "timestep": "opt.timestep"}  # options that are paths of the model, too

RANGE = re.compile(r"(-?[\d.]*\d(?:e-?\d+)?)\.\.(-?[\d.]*\d(?:e-?\d+)?)")  # without a count
SPAN = re.compile(r"(?P<log>log:)?(?P<first>\.?[^.].*?)\.\.(?P<last>.+):(?P<count>.+)")
MOST_IN_SPAN = 1_000_000
DRAWN = 2**16  # samples whose values are computed at once
DIGITS = 50  # far more than a float has, so that 1e-4..1e-1:4 contains 0.001


def design(options: VariationOptions, model: mujoco.MjModel, seed: int) -> Design:
    """Returns the points that `options` describe.

    Args:
      model: model whose objects wildcards match.
      seed: seed of random values, and the first seed of repeats.

    Raises:
      UsageError: a value is invalid, or there are too many points.
    """
    lists, distributions = dict[str, Sequence[str]](), dict[str, Distribution]()
    for path, text in options.vary:
        with concerning("vary", path):
            for name in _expanded(path, model):
                if name in {*lists, *distributions}:
                    raise UsageError(f"{option('vary')} {clean(name)} is given twice; give all its values at once")
                distribution = parse_distribution(text, f"{option('vary')} {clean(path)}")
                if distribution is None:
                    lists[name] = value_list(name, text, "vary")
                else:
                    distributions[name] = distribution

    parts = [_listed(lists, options.design)]
    if options.points is not None:
        with concerning("points"):
            parts.insert(0, read_points(options.points))
    if options.sampler in SAMPLES:
        _require_alone(options, lists)
    correlations = None
    if options.correlate:
        known = parameter_names([name for part in [*parts, Design(tuple(distributions), ())] for name in part.names])
        correlations = rank_correlations(options.correlate, distributions, known)
    if distributions:
        parts.append(_sampled(distributions, options.samples, options.sampler, seed, correlations))
    if options.repeats > 1:
        _require_possible([options.repeats])
        seeds = NumberTexts(np.arange(seed, seed + options.repeats, dtype=float), has_integers=True)
        parts.append(_beside(("seed",), [seeds]))
    whole = with_conditional(_product([part for part in parts if part.names]), options.when)
    return chosen(whole, options.where)


def _expanded(path: str, model: mujoco.MjModel) -> list[str]:
    """Expands `each:KIND/WILDCARD.FIELD` to one path for each matching object; returns any other path unchanged."""
    if not path.startswith(EACH):
        return [path]
    path = path.removeprefix(EACH)
    prefix = next((text for text in ("scale:", "add:") if path.startswith(text)), "")
    kind, _, rest = path.removeprefix(prefix).partition("/")
    try:
        known_names = names(model, kind)
    except KeyError:
        known_names = []
    pattern, dot, field = rest.rpartition(".")
    matches = [name for name in known_names if fnmatchcase(name, pattern)] if dot else []
    if not matches:
        raise UnknownNameError(kind or "object", pattern or rest, known_names)
    return [f"{prefix}{kind}/{name}.{field}" for name in matches]


def _listed(lists: Mapping[str, Sequence[str]], how: str) -> Design:
    """Combines lists of values as a grid, or element by element."""
    if how == "grid":
        return _product([_beside((name,), [values]) for name, values in lists.items()])
    if len({len(values) for values in lists.values()}) > 1:
        lengths = ", ".join(f"{len(values)} of {clean(name)}" for name, values in lists.items())
        raise UsageError(f"{option('design')} zip: the lists must have the same length, not {lengths}")
    return _beside(tuple(lists), [*lists.values()])


def _beside(names: tuple[str, ...], columns: Sequence[Sequence[str]]) -> Design:
    """Returns points that combine columns of one length element by element."""
    count = len(columns[0]) if columns else 1
    return Design(names, GridPoints([(texts, 1) for texts in columns], count))


def _sampled(
    distributions: Mapping[str, Distribution],
    count: int,
    sampler: str,
    seed: int,
    correlations: np.ndarray | None = None,
) -> Design:
    """Draws points from distributions with these rank correlations `(n, n)`, or from independent ones."""
    in_sample = len(distributions) + SAMPLES[sampler][1] if sampler in SAMPLES else 1
    _require_possible([count, in_sample])
    fractions = SAMPLERS[sampler](count, len(distributions), np.random.default_rng(seed))
    if correlations is not None:
        fractions = correlated(fractions, correlations)
    columns = [_drawn(each, column) for each, column in zip(distributions.values(), fractions.T, strict=True)]
    return _beside(tuple(distributions), columns)


def _require_alone(options: VariationOptions, lists: Mapping[str, Sequence[str]]) -> None:
    """Refuses a design for sensitivities whose points are not complete samples of distributions."""
    sampler = f"{option('sampler')} {options.sampler}"
    others = [name for name in ("points", "where", "when") if getattr(options, name)]
    others += ["repeats"] if options.repeats > 1 else []
    if options.correlate:
        reason = "sensitivities are shares of the effects of independent parameters"
        raise UsageError(f"{option('correlate')} excludes {sampler}: {reason}", ("correlate",))
    if others or lists:
        wrong = option(others[0]) if others else f"the list of {option('vary')} {clean(next(iter(lists)))}"
        raise UsageError(f"{sampler} varies distributions only, without {wrong}")


def _drawn(distribution: Distribution, fractions: np.ndarray) -> Sequence[str]:
    if distribution.name == "choice":
        return distribution.values(fractions)
    values = np.empty(len(fractions))
    for start in range(0, len(values), DRAWN):  # quantile functions need several times the memory of their values
        values[start : start + DRAWN] = distribution.quantiles(fractions[start : start + DRAWN])
    return NumberTexts(values, has_integers=distribution.name == "integers")


def _product(parts: Sequence[Design]) -> Design:
    """Combines every point of each part with every point of the others; those of the last part change fastest."""
    all_names = [name for part in parts for name in part.names]
    if twice := next((name for name in all_names if all_names.count(name) > 1), None):
        raise UsageError(f"{clean(twice)} varies twice: {option('vary')}, {option('points')} or {option('repeats')}")
    _require_possible(len(part.points) for part in parts)
    columns, count = list[tuple[Sequence[str], int]](), prod(len(part.points) for part in parts)
    repeat = count
    for part in parts:
        assert isinstance(part.points, GridPoints)
        repeat //= len(part.points)
        columns += [(texts, own * repeat) for texts, own in part.points.columns]
    return Design(tuple(all_names), GridPoints(columns, count))


def _require_possible(counts: Iterable[int]) -> None:
    """Refuses more than `MOST_POINTS` combinations."""
    count = int(np.prod([float(count) for count in counts]))
    if count > MOST_POINTS:
        raise UsageError(f"{count:,} points; a study has {MOST_POINTS:,} at most")


def read_points(path: str) -> Design:
    """Reads points from a CSV table that has a column for each parameter and a row for each point.

    Raises:
      FileError: the file cannot be read, or is not such a table.
    """
    import csv
    import io

    with opened(Path(path), "table of points", [".csv"]) as file:
        text = io.TextIOWrapper(file, encoding="utf-8-sig", newline="")
        with decoding(Path(path), "cannot be read as CSV text in UTF-8"):  # whose cells may be too long
            rows = [[cell.strip() for cell in row] for row in csv.reader(text, skipinitialspace=True) if row]
    if len(rows) < 2 or len(set(rows[0])) < len(rows[0]) or not all(rows[0]):
        reason = "a table of points has a header that names each parameter once, and a row for each point"
        raise FileError(path, reason)
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(rows[0]):
            raise FileError(path, f"row {number} does not have one value for each of the {len(rows[0])} columns")
        if not all(row):
            lacking = listing([clean(name) for name, cell in zip(rows[0], row, strict=True) if not cell])
            raise FileError(path, f"row {number} has no value of {lacking}", "each column is a parameter")
    return _beside(tuple(rows[0]), [*zip(*rows[1:], strict=True)])


# --- lists of values ---------------------------------------------------------------------------------


def value_list(path: str, text: str, name: str) -> Sequence[str]:
    """Splits a list of values at commas, or at semicolons where values contain commas; a single one ends in one.

    `0.1..1:10` means ten evenly spaced values from 0.1 to 1, `log:1e-4..1:5` for five in equal ratios.

    Args:
      path: what varies, for messages.
      name: option of the list, for messages.

    Raises:
      UsageError: the list is empty or contains a value twice, or a span is invalid.
    """
    place = f"{option(name)} {clean(path)}={clean(text)}"
    if (span := SPAN.fullmatch(text.strip())) and not {*text} & {*",;"}:
        values = _spaced(span, place)
        distinct = numbers(values)
        if distinct is not None and len(set(distinct.tolist())) == len(values):
            return values
    values = list[str]()
    for part in text.removesuffix(";").split(";" if ";" in text else ","):
        if ends := RANGE.fullmatch(part.strip()):
            first, last = ends.groups()
            meant = f"{first}..{last}:10 for ten values, or uniform({first},{last}) for random ones"
            raise UsageError(f"{place}: a range needs a count: {meant}")
        span = SPAN.fullmatch(part.strip())
        values += _spaced(span, place) if span else [part.strip()]
    if not all(values) or len(set(values)) < len(values):
        raise UsageError(f"{place}: write values separated by commas, each once")
    return values


def _spaced(span: re.Match[str], place: str) -> Sequence[str]:
    """Returns the values of `FIRST..LAST:COUNT`, including both ends; evenly spaced ones are exact in decimals."""
    try:
        first, last, count = Fraction(span["first"]), Fraction(span["last"]), int(span["count"])
    except ValueError:
        raise UsageError(f"{place}: write FIRST..LAST:COUNT, with numbers") from None
    if not 2 <= count <= MOST_IN_SPAN or first == last:
        reason = f"write FIRST..LAST:COUNT, with two different ends and from 2 to {MOST_IN_SPAN} values"
        raise UsageError(f"{place}: {reason}")
    if span["log"] is None:
        step = (last - first) / (count - 1)
        unit = lcm(first.denominator, step.denominator)
        if max(abs(first * unit), abs(last * unit), unit) < LARGEST_INTEGER:  # their ratios are rounded correctly
            multiples = int(first * unit) + int(step * unit) * np.arange(count)
            return NumberTexts(multiples / unit, has_integers=True)
        return [_decimal(first + step * k) for k in range(count)]
    if first <= 0 or last <= 0:
        raise UsageError(f"{place}: values in equal ratios require positive bounds")
    with localcontext(prec=DIGITS):
        ends = [Decimal(end.numerator) / end.denominator for end in (first, last)]
        inner = [ends[0] * (ends[1] / ends[0]) ** (Decimal(k) / (count - 1)) for k in range(1, count - 1)]
    return [_decimal(first), *(repr(float(value)) for value in inner), _decimal(last)]


def _decimal(value: Fraction) -> str:
    return str(value) if value.denominator == 1 else repr(float(value))


# --- options of simulations ---------------------------------------------------------------------------


def is_whole(name: str) -> bool:
    """Returns whether a parameter takes whole numbers, such as `seed`."""
    return isinstance(simulation_kinds().get(name), IntegerKind)


@cache
def simulation_kinds() -> Mapping[str, AnyKind]:
    """Returns the kinds of the options of a simulation, by name."""
    return {each.name: each.kind for each in options_of(SimulationOptions)}
