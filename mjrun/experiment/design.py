"""The points of an experiment: which values they have, and in which order."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from itertools import product
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import FileError, UnknownNameError, UsageError, clean, concerning, option, quoted
from mjrun.formats.input_file import opened
from mjrun.model.names import names
from mjrun.options.kinds import AnyKind, Optional
from mjrun.options.number_kinds import Integer
from mjrun.options.option import options_of
from mjrun.options.simulation import SimulationOptions
from mjrun.options.sweep import MOST_POINTS, VariationOptions
from mjrun.physics.distribution import Distribution, parse_distribution
from mjrun.physics.parameter_grid import scan_values
from mjrun.probe.row_expression import Condition, parse_condition
from mjrun.probe.scanner import Vocabulary

EACH = "each:"
COMBINATIONS = {"grid": product, "zip": zip}

Values = tuple[str, ...]


@dataclass(frozen=True)
class Design:
    """The points of a study or an evaluation.

    Attributes:
      names: what varies, as it is written: `geom/floor.friction[0]`, `seed`.
      points: the values of each point as texts, in the order of `names`.
    """

    names: tuple[str, ...]
    points: Sequence[Values]

    def values(self, index: int) -> dict[str, str]:
        """What a point has, by what varies."""
        return dict(zip(self.names, self.points[index], strict=True))


def design(options: VariationOptions, model: mujoco.MjModel, seed: int) -> Design:
    """The points that `options` describe.

    Args:
      model: whose objects wildcards stand for.
      seed: of random values, and the first of repeats.

    Raises:
      UsageError: values that cannot be, or points without end.
    """
    lists, distributions = dict[str, Sequence[str]](), dict[str, Distribution]()
    for path, text in options.vary:
        with concerning("vary", path):
            for name in _expanded(path, model):
                if name in {*lists, *distributions}:
                    raise UsageError(f"{option('vary')} {clean(name)} is given twice; give all its values at once")
                distribution = parse_distribution(text, f"{option('vary')} {clean(path)}")
                if distribution is None:
                    lists[name] = scan_values(name, text, "vary")
                else:
                    distributions[name] = distribution

    parts = [_listed(lists, options.design)]
    if options.points is not None:
        with concerning("points"):
            parts.insert(0, read_points(options.points))
    if distributions:
        parts.append(_sampled(distributions, options.samples, options.sampler, seed))
    if options.repeats > 1:
        parts.append(_repeats(options.repeats, seed))
    whole = _product([part for part in parts if part.names])
    return _chosen(whole, options.where)


def _expanded(path: str, model: mujoco.MjModel) -> list[str]:
    """The paths that `each:KIND/WILDCARD.FIELD` stands for; any other path stands for itself."""
    if not path.startswith(EACH):
        return [path]
    prefix, kind, rest = _split(path.removeprefix(EACH))
    try:
        named = names(model, kind)
    except KeyError:
        named = []
    pattern, dot, field = rest.rpartition(".")
    matches = [name for name in named if fnmatchcase(name, pattern)] if dot else []
    if not matches:
        raise UnknownNameError(kind or "object", pattern or rest, named)
    return [f"{prefix}{kind}/{name}.{field}" for name in matches]


def _split(path: str) -> tuple[str, str, str]:
    """`scale:`, `geom` and `leg*.density` of `scale:geom/leg*.density`."""
    prefix = next((text for text in ("scale:", "add:") if path.startswith(text)), "")
    kind, _, rest = path.removeprefix(prefix).partition("/")
    return prefix, kind, rest


def _listed(lists: Mapping[str, Sequence[str]], how: str) -> Design:
    """Lists of values, all with all, or side by side."""
    if how == "zip" and len({len(values) for values in lists.values()}) > 1:
        lengths = ", ".join(f"{len(values)} of {clean(name)}" for name, values in lists.items())
        raise UsageError(f"{option('design')} zip: lists of one length belong side by side, not {lengths}")
    combine = COMBINATIONS[how]
    count = int(np.prod([float(len(values)) for values in lists.values()])) if how == "grid" else 0
    _require_possible(count)
    return Design(tuple(lists), list(combine(*lists.values())))


def _sampled(distributions: Mapping[str, Distribution], count: int, sampler: str, seed: int) -> Design:
    """Points drawn from distributions, which are independent of each other."""
    _require_possible(count)
    fractions = SAMPLERS[sampler](count, len(distributions), np.random.default_rng(seed))
    columns = [each.values(column) for each, column in zip(distributions.values(), fractions.T, strict=True)]
    return Design(tuple(distributions), list(zip(*columns, strict=True)))


def _sobol(count: int, dimensions: int, generator: np.random.Generator) -> np.ndarray:
    from scipy.stats import qmc

    # All of a power of two, of which the first are taken: points stay when there are more.
    exponent = max(0, (count - 1).bit_length())
    return qmc.Sobol(dimensions, rng=generator).random_base2(exponent)[:count]


def _latin_hypercube(count: int, dimensions: int, generator: np.random.Generator) -> np.ndarray:
    from scipy.stats import qmc

    return qmc.LatinHypercube(dimensions, rng=generator).random(count)


def _independent(count: int, dimensions: int, generator: np.random.Generator) -> np.ndarray:
    return generator.random((count, dimensions))


# Sampler → what draws `count` points `(count, dimensions)` between 0 and 1.
SAMPLERS: Mapping[str, Callable[[int, int, np.random.Generator], np.ndarray]] = {
    "sobol": _sobol,
    "lhs": _latin_hypercube,
    "random": _independent,
}


def _repeats(count: int, seed: int) -> Design:
    _require_possible(count)
    return Design(("seed",), [(str(seed + k),) for k in range(count)])


def _product(parts: Sequence[Design]) -> Design:
    """All points of each part with all of the others, those of the last changing fastest."""
    all_names = [name for part in parts for name in part.names]
    if twice := next((name for name in all_names if all_names.count(name) > 1), None):
        raise UsageError(f"{clean(twice)} varies twice: {option('vary')}, {option('points')} or {option('repeats')}")
    _require_possible(int(np.prod([float(len(part.points)) for part in parts])))
    points = [tuple(value for values in each for value in values) for each in product(*(p.points for p in parts))]
    return Design(tuple(all_names), points)


def _require_possible(count: int) -> None:
    if count > MOST_POINTS:
        raise UsageError(f"{count:,} points; a study has {MOST_POINTS:,} at most")


def read_points(path: str) -> Design:
    """The points of a CSV table: a column for each thing that varies, a row for each point.

    Raises:
      FileError: it cannot be read, or is no table.
    """
    import csv
    import io

    with opened(Path(path), "table of points", [".csv"]) as file:
        text = io.TextIOWrapper(file, encoding="utf-8-sig", errors="replace", newline="")
        try:
            rows = [[cell.strip() for cell in row] for row in csv.reader(text, skipinitialspace=True) if row]
        except csv.Error as error:  # of a cell that is longer than any number or name
            raise FileError(path, f"cannot be read as a table: {clean(str(error))}") from None
    if len(rows) < 2 or len(set(rows[0])) < len(rows[0]) or not all(rows[0]):
        reason = "a table of points has a header with what varies, each once, and a row for each point"
        raise FileError(path, reason)
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(rows[0]) or not all(row):
            raise FileError(path, f"row {number} has not one value for each of the {len(rows[0])} columns")
    return Design(tuple(rows[0]), [tuple(row) for row in rows[1:]])


# --- conditions on points ----------------------------------------------------------------------------


def parameter_names(paths: Sequence[str]) -> dict[str, str]:
    """Returns what varies by its path or, where that is clear, by the last part of it: `mass` of `body/box.mass`."""
    short = [path.rpartition(".")[2].rpartition("/")[2] for path in paths]
    own = dict(zip(paths, paths, strict=True))
    return {name: path for name, path in zip(short, paths, strict=True) if short.count(name) == 1} | own


def _chosen(whole: Design, conditions: Sequence[str]) -> Design:
    """The points for which all conditions hold."""
    if not conditions:
        return whole
    keep = np.ones(len(whole.points), bool)
    for index, text in enumerate(conditions):
        with concerning("where", index):
            keep &= _holds(parse_condition(text, Vocabulary(parameter_names(whole.names)), option("where")), whole)
    if not keep.any():
        raise UsageError(f"{option('where')}: no point is left of {len(whole.points)}")
    return Design(whole.names, [point for point, kept in zip(whole.points, keep, strict=True) if kept])


def _holds(condition: Condition, whole: Design) -> np.ndarray:
    columns = {name: numbers([point[i] for point in whole.points]) for i, name in enumerate(whole.names)}
    usable = {name: values for name, values in columns.items() if values is not None}
    try:
        return np.broadcast_to(condition.holds(usable), len(whole.points))
    except KeyError as error:
        raise UsageError(f"{quoted(str(error.args[0]))} has values that are not numbers") from None


def numbers(texts: Sequence[str]) -> np.ndarray | None:
    """The values of something that varies as numbers `(n,)`; None if they are not."""
    try:
        return np.array([float(text) for text in texts])
    except ValueError:
        return None


def is_whole(name: str) -> bool:
    """Whether what varies takes whole numbers, such as `seed`."""
    kind = simulation_kinds().get(name)
    kind = kind.each if isinstance(kind, Optional) else kind
    return isinstance(kind, Integer)


@cache
def simulation_kinds() -> Mapping[str, AnyKind]:
    """The kinds of the options of a simulation, by name."""
    return {each.name: each.kind for each in options_of(SimulationOptions)}
