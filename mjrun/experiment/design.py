"""Points of an experiment: the values that each of them has, and their order.

Points are computed from their index: a design of millions of points needs little memory. Conditions on their parameters
choose points, and decide where a parameter exists.
"""

import hashlib
import json
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from decimal import Decimal, localcontext
from fnmatch import fnmatchcase
from fractions import Fraction
from functools import cache, cached_property
from math import lcm, prod
from pathlib import Path
from typing import overload

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FileError, UnknownNameError, UsageError, clean, concerning, listing, option, quoted, suggestion
from mjrun.experiment.samplers import SAMPLERS, SAMPLES, correlated, rank_correlations
from mjrun.formats.input_file import decoding, opened
from mjrun.model.names import names
from mjrun.model.override import QUANTITIES
from mjrun.options.kinds import AnyKind
from mjrun.options.number_kinds import IntegerKind
from mjrun.options.option import options_of
from mjrun.options.setting_kinds import UNITS
from mjrun.options.simulation import SimulationOptions
from mjrun.options.sweep import MOST_POINTS, VariationOptions
from mjrun.physics.random_distribution import Distribution, parse_distribution
from mjrun.probe.expression import TextMatch, walk
from mjrun.probe.row_expression import parse_condition
from mjrun.probe.scanner import Vocabulary
from mjrun.timeline import EXACT, rational

Values = tuple[str, ...]
ABSENT = ""  # in place of the value of a parameter that does not exist at a point; NaN among numbers
BLOCK = 4096  # points that are made at once
EACH = "each:"
SHORT_PATHS = {"integrator": "opt.integrator", "timestep": "opt.timestep"}  # options that are paths of the model, too

# The units that values may have, in SI units; those of angles are products of floats, others are rounded once.
ANGLES = {f"{unit}{rate}": UNITS[unit][1] for unit in ("deg", "rad") for rate in ("", "/s")}
FACTORS = {
    **{unit: factor for unit, (_, factor) in QUANTITIES.items()},
    **{f"{unit}/s": factor for unit, (_, factor) in UNITS.items()},
    **ANGLES,
}
QUANTITY = re.compile(rf"([-+.\deE]*[.\d])\s*({'|'.join(FACTORS)})")

RANGE = re.compile(r"(-?[\d.]*\d(?:e-?\d+)?[a-z/]*)\.\.(-?[\d.]*\d(?:e-?\d+)?[a-z/]*)")  # without a count
COLONS = re.compile(r"(-?\d*\.?\d+(?:e-?\d+)?(?::(?!$)|$)){2,3}")  # 0:1:3, a range in MATLAB or NumPy
SPAN = re.compile(r"(?P<log>log:)?(?P<first>\.?[^.].*?)\.\.(?P<last>.+):(?P<count>.+)")
MOST_IN_SPAN = 1_000_000
DRAWN = 2**16  # samples whose values are computed at once
DIGITS = 50  # far more than a float has, so that 1e-4..1e-1:4 contains 0.001


class LazyNumberTexts(Sequence[str]):
    """Numbers as texts, which are made on demand: `0.3`, and `2.0` or `2`.

    Args:
      numbers: float64 `(n,)`; NaN is `ABSENT`.
      has_integers: whole numbers are written as integers.
    """

    def __init__(self, numbers: np.ndarray, *, has_integers: bool = False) -> None:
        self.numbers, self.has_integers = numbers, has_integers

    def __len__(self) -> int:
        return len(self.numbers)

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: int | slice) -> str | list[str]:
        if isinstance(index, slice):
            return self.at(np.arange(len(self))[index])
        return self.at(np.array([index]))[0]

    def __iter__(self) -> Iterator[str]:
        for start in range(0, len(self), BLOCK):
            yield from self[start : start + BLOCK]

    def at(self, places: np.ndarray) -> list[str]:
        """Returns the texts at these places."""
        numbers = self.numbers[places].tolist()
        if not self.has_integers:
            texts = list(map(repr, numbers))
        else:
            texts = [str(int(number)) if number.is_integer() else repr(number) for number in numbers]
        return [ABSENT if text == "nan" else text for text in texts]

    def only(self, places: np.ndarray) -> "LazyNumberTexts":
        """Returns the numbers at these places."""
        return LazyNumberTexts(self.numbers[places], has_integers=self.has_integers)

    @property
    def content(self) -> bytes:
        """Bytes that determine the texts."""
        return bytes([self.has_integers]) + self.numbers.tobytes()


@dataclass(frozen=True)
class DesignColumn:
    """The values of a parameter: point k has `texts[places[k]]`.

    Attributes:
      texts: different values.
      places: whole numbers `(n,)`.
    """

    texts: Sequence[str]
    places: np.ndarray

    @classmethod
    def of(cls, texts: Sequence[str], places: np.ndarray) -> "DesignColumn":
        """Returns the column with these places in `texts`, of which several may be equal."""
        if isinstance(texts, LazyNumberTexts):
            bits = texts.numbers.view(np.int64)
            if (np.diff(np.sort(bits)) != 0).all():
                return cls(texts, places)
            _, first, code = np.unique(bits, return_index=True, return_inverse=True)
            return cls(texts.only(first), code[places])
        code_of = {text: code for code, text in enumerate(dict.fromkeys(texts))}
        if len(code_of) == len(texts):
            return cls(texts, places)
        return cls([*code_of], np.array([code_of[text] for text in texts], np.intp)[places])

    @cached_property
    def distinct(self) -> Sequence[str]:
        """The values of points, in the order of `texts`."""
        used = self._used
        if len(used) == len(self.texts):
            return self.texts
        return self.texts.only(used) if isinstance(self.texts, LazyNumberTexts) else texts_at(self.texts, used)

    @property
    def numbers(self) -> np.ndarray | None:
        """The value of each point `(n,)`; None if they are not numbers."""
        if isinstance(self.texts, LazyNumberTexts):
            return self.texts.numbers[self.places]
        used = self._used
        values = numbers(texts_at(self.texts, used))
        if values is None:
            return None
        spread = np.empty(len(self.texts))
        spread[used] = values
        return spread[self.places]

    @property
    def _used(self) -> np.ndarray:
        """The places of texts that a point has, ascending."""
        is_used = np.zeros(len(self.texts), bool)
        is_used[self.places] = True
        return np.flatnonzero(is_used)


class GridPoints(Sequence[Values]):
    """Points that combine columns of texts: point k has `texts[k // repeat % len(texts)]` of each column.

    Args:
      columns: texts and `repeat` of each parameter.
      count: number of points.
      chosen: indices of the points to include, ascending; None for all.
    """

    def __init__(
        self, columns: Sequence[tuple[Sequence[str], int]], count: int, chosen: np.ndarray | None = None
    ) -> None:
        self.columns, self._whole, self._chosen = tuple(columns), count, chosen

    def __len__(self) -> int:
        return self._whole if self._chosen is None else len(self._chosen)

    @overload
    def __getitem__(self, index: int) -> Values: ...
    @overload
    def __getitem__(self, index: slice) -> list[Values]: ...
    def __getitem__(self, index: int | slice) -> Values | list[Values]:
        if isinstance(index, slice):
            return self.at(range(*index.indices(len(self))))
        return self.at([range(len(self))[index]])[0]

    def __iter__(self) -> Iterator[Values]:
        for start in range(0, len(self), BLOCK):
            yield from self[start : start + BLOCK]

    def at(self, indices: Sequence[int] | np.ndarray) -> list[Values]:
        """Returns the values of these points."""
        if not self.columns:
            return [()] * len(indices)
        columns = [texts_at(*self._places(number, np.asarray(indices, np.intp))) for number in range(len(self.columns))]
        return list(zip(*columns, strict=True))

    def column(self, number: int) -> DesignColumn:
        """Returns the values of a parameter."""
        texts, repeat = self.columns[number]
        if self._chosen is not None:
            return DesignColumn.of(*self._places(number, np.arange(len(self))))
        cycle = np.repeat(np.arange(len(texts)), repeat)
        return DesignColumn.of(texts, cycle if len(cycle) == self._whole else np.resize(cycle, self._whole))

    def distinct(self, number: int) -> Sequence[str]:
        """Returns the different values of a parameter; those of a whole grid without its points."""
        texts, repeat = self.columns[number]
        if self._chosen is None and repeat * len(texts) <= self._whole:
            return DesignColumn.of(texts, np.arange(len(texts))).distinct
        return self.column(number).distinct

    def only(self, chosen: np.ndarray) -> "GridPoints":
        """Returns the points with these indices."""
        return GridPoints(self.columns, self._whole, chosen if self._chosen is None else self._chosen[chosen])

    def replaced(self, number: int, function: Callable[[str], str]) -> "GridPoints":
        """Returns the points with `function` of each value of a parameter."""
        columns = list(self.columns)
        texts, repeat = columns[number]
        columns[number] = ([function(text) for text in texts], repeat)
        return GridPoints(columns, self._whole, self._chosen)

    @property
    def digest(self) -> bytes:
        """A hash of all values and their order."""
        made = hashlib.sha256(json.dumps([self._whole, [repeat for _, repeat in self.columns]]).encode())
        for texts, _ in self.columns:
            made.update(texts.content if isinstance(texts, LazyNumberTexts) else json.dumps([*texts]).encode())
        made.update(b"" if self._chosen is None else self._chosen.tobytes())
        return made.digest()

    def _places(self, number: int, indices: np.ndarray) -> tuple[Sequence[str], np.ndarray]:
        texts, repeat = self.columns[number]
        indices = indices if self._chosen is None else self._chosen[indices]
        return texts, indices // repeat % len(texts)


@dataclass(frozen=True)
class Design:
    """The points of a study or an evaluation.

    Attributes:
      names: parameters that vary, as written: `geom/floor.friction[0]`, `seed`.
      points: values of each point as texts, in the order of `names`; they may be made on demand. `ABSENT` represents a
        parameter that does not exist at a point.
    """

    names: tuple[str, ...]
    points: Sequence[Values]

    @property
    def grid(self) -> GridPoints:
        """The points as columns."""
        if isinstance(self.points, GridPoints):
            return self.points
        columns = [([values[number] for values in self.points], 1) for number in range(len(self.names))]
        return GridPoints(columns, len(self.points))

    def at(self, indices: Sequence[int] | np.ndarray) -> list[Values]:
        """Returns the values of points."""
        points = self.points
        return points.at(indices) if isinstance(points, GridPoints) else [points[index] for index in indices]

    def column(self, number: int) -> DesignColumn:
        """Returns the values of a parameter, given by its place in `names`."""
        return self.grid.column(number)

    def distinct(self, number: int) -> Sequence[str]:
        """Returns the different values of a parameter, given by its place in `names`."""
        return self.grid.distinct(number)

    def values(self, index: int) -> dict[str, str]:
        """Returns the values of a point by parameter, of those that exist there."""
        values = zip(self.names, self.points[index], strict=True)
        return {name: text for name, text in values if text != ABSENT}


def numbers(texts: Sequence[str]) -> np.ndarray | None:
    """Converts the values of a parameter to numbers `(n,)`, NaN for `ABSENT`; returns None if they are not numbers.

    Those with a unit, `10deg`, are converted to SI units, as a simulation does. Texts remain those that a float would
    round to another whole number, such as seeds of 64 bits.
    """
    if isinstance(texts, LazyNumberTexts):
        return texts.numbers
    try:
        values = np.fromiter((_number(text) if text else math.nan for text in texts), float, len(texts))
        large = np.flatnonzero(np.abs(values) >= EXACT)
        whole = [place for place in large.tolist() if texts[place].lstrip("+-").isdecimal()]
        is_exact = all(int(texts[place]) == int(values[place]) for place in whole)
    except (ValueError, OverflowError):  # the latter of a whole number that is no float
        return None
    return values if is_exact else None


def _number(text: str) -> float:
    if not (quantity := QUANTITY.fullmatch(text.strip())):
        return float(text)
    number, unit = quantity.groups()
    if unit in ANGLES:
        return float(number) * ANGLES[unit]
    return float(rational(number) * rational(FACTORS[unit]))


def _without_unit(text: str) -> tuple[str, str]:
    """Splits a number from its unit, which may be empty."""
    quantity = QUANTITY.fullmatch(text.strip())
    return (quantity[1], quantity[2]) if quantity else (text, "")


def texts_at(texts: Sequence[str], places: np.ndarray) -> list[str]:
    """Returns the texts at these places."""
    if isinstance(texts, LazyNumberTexts):
        return texts.at(places)
    return [texts[int(place)] for place in places]


def parameter_names(paths: Sequence[str]) -> dict[str, str]:
    """Returns the paths of parameters by their names: each path, and its last part (`mass`) where that is unique."""
    short = [path.rpartition(".")[2].rpartition("/")[2] for path in paths]
    own = dict(zip(paths, paths, strict=True))
    return {name: path for name, path in zip(short, paths, strict=True) if short.count(name) == 1} | own


class _PointConditionVocabulary(Vocabulary):
    """The parameters of points, whose values may be texts."""

    has_texts = True


class PointCondition:
    """A condition on the parameters of points, such as `mass < 10 and integrator == "rk4"`.

    Attributes:
      parameters: paths of the parameters that it compares.

    Raises:
      UsageError: the condition is malformed, or contains an unknown name.
    """

    def __init__(self, text: str, paths: Sequence[str], label: str) -> None:
        self._condition = parse_condition(text, _PointConditionVocabulary(parameter_names(paths)), label)
        nodes = [*walk(self._condition.root)]
        self._matches = [node for node in nodes if isinstance(node, TextMatch)]
        self.parameters = {*self._condition.columns, *(match.name for match in self._matches)}

    def holds(self, points: Design) -> np.ndarray:
        """Returns at which points it holds, `(n,)` bool. No comparison holds for a parameter that does not exist.

        Raises:
          UsageError: it compares texts with numbers.
        """
        columns = dict[str, np.ndarray]()
        for path in self._condition.columns:
            column = points.column(points.names.index(path))
            if (values := column.numbers) is None:
                texts = listing([f'"{clean(each)}"' for each in column.distinct[:4]])
                raise UsageError(f"{quoted(path)} has values that are not numbers; compare it with one of {texts}")
            columns[path] = values
        known = {match: _matched(match, points.column(points.names.index(match.name))) for match in self._matches}
        return np.broadcast_to(self._condition.holds(columns, known), len(points.points))


def _matched(match: TextMatch, column: DesignColumn) -> np.ndarray:
    """Returns the values of a match `(n,)`."""
    if match.text not in column.texts:
        texts = listing([clean(each) for each in column.texts if each != ABSENT])
        raise UsageError(f"{quoted(match.name)} has no value {quoted(match.text)}; values: {texts}")
    equal = np.array([np.nan if each == ABSENT else float(each == match.text) for each in column.texts])
    return equal[column.places]


def with_conditional(whole: Design, conditions: Sequence[tuple[str, str]]) -> Design:
    """Returns the points without each conditional parameter where its condition does not hold; equal points are one.

    Args:
      conditions: parameters, and their conditions on other parameters, which may be conditional, too.

    Raises:
      UsageError: a parameter is unknown, or a condition is invalid.
    """
    if not conditions:
        return whole
    names, waiting = parameter_names(whole.names), dict[str, tuple[str, PointCondition]]()
    for written, text in conditions:
        with concerning("when", written):
            if written not in names:
                raise UnknownNameError("parameter", written, [*names])
            waiting[names[written]] = written, PointCondition(text, whole.names, option("when"))
    columns = [whole.column(number) for number in range(len(whole.names))]
    while waiting:
        ready = [path for path, (_, condition) in waiting.items() if not condition.parameters & waiting.keys()]
        if not ready:
            names_in_cycle = listing([clean(written) for written, _ in waiting.values()])
            raise UsageError(
                f"{option('when')}: the conditions of these parameters depend on themselves: {names_in_cycle}"
            )
        for path in ready:
            written, condition = waiting.pop(path)
            with concerning("when", written):
                exists = condition.holds(_of_columns(whole.names, columns))
            number = whole.names.index(path)
            columns[number] = _present_where(columns[number], exists)
    _, first = np.unique(np.stack([column.places for column in columns], axis=1), axis=0, return_index=True)
    kept = np.sort(first)
    return _of_columns(whole.names, [DesignColumn(column.texts, column.places[kept]) for column in columns])


def chosen(whole: Design, conditions: Sequence[str]) -> Design:
    """Returns the points for which all conditions hold.

    Raises:
      UsageError: a condition is invalid, or there are no such points.
    """
    if not conditions:
        return whole
    is_chosen = np.ones(len(whole.points), bool)
    for index, text in enumerate(conditions):
        with concerning("where", index):
            is_chosen &= PointCondition(text, whole.names, option("where")).holds(whole)
    if not is_chosen.any():
        raise UsageError(f"{option('where')}: none of the {len(whole.points)} points satisfies it")
    return Design(whole.names, whole.grid.only(np.flatnonzero(is_chosen)))


def _present_where(column: DesignColumn, exists: np.ndarray) -> DesignColumn:
    """Returns a parameter that is absent at the other points."""
    texts = column.texts
    if isinstance(texts, LazyNumberTexts):
        texts = LazyNumberTexts(np.append(texts.numbers, np.nan), has_integers=texts.has_integers)
    else:
        texts = [*texts, ABSENT]
    return DesignColumn(texts, np.where(exists, column.places, len(column.texts)))


def _of_columns(names: Sequence[str], columns: Sequence[DesignColumn]) -> Design:
    def texts(column: DesignColumn) -> Sequence[str]:
        if isinstance(column.texts, LazyNumberTexts):
            return column.texts.only(column.places)
        return texts_at(column.texts, column.places)

    values = [(texts(each), 1) for each in columns]
    return Design(tuple(names), GridPoints(values, len(columns[0].places)))


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
                distribution = parse_distribution(text, f"{option('vary')} {clean(path)}", FACTORS)
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
        parts.append(_beside(("seed",), [_seeds(seed, options.repeats)]))
    whole = with_conditional(_product([part for part in parts if part.names]), options.when)
    return chosen(whole, options.where)


def point_bound(options: VariationOptions) -> int:
    """Returns a number that the points of `options` do not exceed: without a model, only lists of values have one."""
    listed = [text for path, text in options.vary if not path.startswith(EACH) and "(" not in text and ".." not in text]
    if not options.vary or len(listed) < len(options.vary) or options.points is not None:
        return MOST_POINTS
    return options.repeats * prod(1 + max(text.count(","), text.count(";")) for text in listed)


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
    if distribution.name == "choice" or distribution.unit:
        return distribution.values(fractions)
    values = np.empty(len(fractions))
    for start in range(0, len(values), DRAWN):  # quantile functions need several times the memory of their values
        values[start : start + DRAWN] = distribution.quantiles(fractions[start : start + DRAWN])
    return LazyNumberTexts(values, has_integers=distribution.name == "integers")


def _seeds(first: int, count: int) -> Sequence[str]:
    """Returns consecutive seeds, as texts where a float would round one."""
    if first + count > EXACT:
        return [str(seed) for seed in range(first, first + count)]
    return LazyNumberTexts(np.arange(first, first + count, dtype=float), has_integers=True)


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
    count = prod(counts)
    if count > MOST_POINTS:
        shown = f"{count:,}" if count < EXACT else f"10^{math.log10(count):.0f}"
        raise UsageError(f"{shown} points; a study has {MOST_POINTS:,} at most")


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
            numbered = [
                (number, [cell.strip() for cell in row])
                for number, row in enumerate(csv.reader(text, skipinitialspace=True), 1)
                if row
            ]
    rows = [row for _, row in numbered]
    if len(rows) < 2 or len(set(rows[0])) < len(rows[0]) or not all(rows[0]):
        reason = "a table of points has a header that names each parameter once, and a row for each point"
        raise FileError(path, reason)
    for number, row in numbered[1:]:
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
        if COLONS.fullmatch(part.strip()):
            first, *middle, last = part.strip().split(":")
            is_count = middle and last.isdecimal() and int(last) > 1
            meant = f"{first}..{middle[0]}:{last}" if is_count else f"{first}..{last}:10"
            raise UsageError(f"{place}: a range is FIRST..LAST:COUNT{suggestion(part, (), meant)}")
        span = SPAN.fullmatch(part.strip())
        values += _spaced(span, place) if span else [part.strip()]
    if not all(values) or len(set(values)) < len(values):
        raise UsageError(f"{place}: write values separated by commas, each once")
    return values


def _spaced(span: re.Match[str], place: str) -> Sequence[str]:
    """Returns the values of `FIRST..LAST:COUNT`, including both ends; evenly spaced ones are exact in decimals.

    Both ends may have a unit, which all values then have.
    """
    (low, unit), (high, other) = _without_unit(span["first"]), _without_unit(span["last"])
    if unit != other:
        raise UsageError(f"{place}: write both ends in the same unit, or both without one")
    values = _spaced_numbers(low, high, span, place)
    return [f"{text}{unit}" for text in values] if unit else values


def _spaced_numbers(low: str, high: str, span: re.Match[str], place: str) -> Sequence[str]:
    try:
        first, last, count = rational(low), rational(high), int(span["count"])
    except ValueError:
        raise UsageError(f"{place}: write FIRST..LAST:COUNT, with numbers") from None
    if max(abs(first), abs(last)) > sys.float_info.max:
        raise UsageError(f"{place}: the ends of a span are {sys.float_info.max:.3g} at most")
    if not 2 <= count <= MOST_IN_SPAN or first == last:
        reason = f"write FIRST..LAST:COUNT, with two different ends and from 2 to {MOST_IN_SPAN} values"
        raise UsageError(f"{place}: {reason}")
    if span["log"] is None:
        step = (last - first) / (count - 1)
        unit = lcm(first.denominator, step.denominator)
        if max(abs(first * unit), abs(last * unit), unit) < EXACT:  # their ratios are rounded correctly
            multiples = int(first * unit) + int(step * unit) * np.arange(count)
            return LazyNumberTexts(multiples / unit, has_integers=True)
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
