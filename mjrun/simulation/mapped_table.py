"""Tables whose columns become those of a model: by name, by number, or by a map of expressions.

States of a replay, controls, and the measurements of a fit all find their columns here.

A map is a list of texts `COLUMN=EXPRESSION`, or `@FILE` for a file of such lines. The left side is a column of the
model, `time` or `qpos/knee`; the right side is an expression over the table's columns, with one value per row. If the
left side is a joint of several numbers (`qpos/root`) or a whole field (`qpos`), the right side is the common name of
columns that are numbered or named by component, or several names or expressions whose numbers are joined:
`qpos=root_mm/1000,root_quat,dof*pi/180`. There, the common name of numbered columns represents each of them.
In `qpos/{}={}_deg*pi/180`, `{}` represents any text for which both sides are valid.

The unit of a column that is read unchanged, which the table states or which follows its name as in `qpos/knee [deg]`
or `knee (deg)`, is converted to SI units. An expression reads the numbers of the table and converts them by itself.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import field as dataclass_field
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, concerning, listing, near, option, quoted
from mjrun.formats.input_file import opened
from mjrun.formats.table_reader import open_table, read_table
from mjrun.model.names import JOINT_TRANSMISSIONS, control_names
from mjrun.model.table_column import split_column, split_unit
from mjrun.model.units import SI_UNITS
from mjrun.options.number_kinds import UNITS as EXACT_UNITS
from mjrun.options.setting_kinds import UNITS, AngleWithUnit
from mjrun.physics.control import ControlTable
from mjrun.physics.kinematic_samples import FIELDS, Interpolation, KinematicMotion, KinematicSamples, quaternions
from mjrun.physics.timed_rows import TimedRows
from mjrun.probe.fields import field_probe, offered
from mjrun.probe.row_expression import RowExpression, parse_row_expression
from mjrun.probe.scanner import Vocabulary, spelled
from mjrun.timeline import seconds

TIME = "time"
FILE = "@"  # begins the name of a file of lines
PLACEHOLDER = "{}"
NUMBERED = ("{}/{}", "{}_{}", "{}.{}", "{}[{}]", "{}{}")  # names of the parts of a column
_LAST = re.compile(r"(.+?)(?:[/_.\[]?)[01]\]?")  # the first of numbered columns
TIMES = ("time", "t", "timestamp", "time_s", "sec", "seconds", "stamp", "elapsed")
LARGEST = 2**20  # bytes of a file of lines

PLACES = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}  # indices of w, x, y and z
CONTROL = r"ctrl(/|[_.\[]?[0-9]|\s*(\[|\Z))"  # names of controls begin like this
CONVERSIONS = {  # the SI unit of each unit, and the factor to it
    **{name: ("s", float(factor)) for name, factor in EXACT_UNITS["SECONDS"].items()},
    **{
        f"{name}{rate}": (("rad" if kind is AngleWithUnit else "m") + rate, factor)
        for name, (kind, factor) in UNITS.items()
        for rate in ("", "/s")
    },
}
DEGREES = re.compile("[°\udcb0]")  # `deg`; the second is the byte of older spreadsheets, which do not write UTF-8
SUFFIXES = ("deg", "ms", "us", "ns", "mm", "cm")  # of names without another unit: `knee_deg`


@dataclass
class ColumnMap:
    """A map from columns of a model to expressions over the columns of a table.

    Attributes:
      columns: names of the model's columns by field, in the order of its numbers.
      time: expression of the times of the rows [s]; None if the table contains no times.
      time_is_mapped: whether the map specifies the time.
      sources: expressions by column of the model: those by name first, then those of the map.
      unused: columns of the table that are not read by their names.
    """

    columns: Mapping[str, Sequence[str]]
    time: RowExpression | None = None
    time_is_mapped: bool = False
    sources: dict[str, RowExpression] = dataclass_field(default_factory=dict[str, RowExpression])
    unused: Sequence[str] = ()

    def lacking(self, field: str) -> list[str]:
        """Returns the columns of a field without an expression."""
        return [name for name in self.columns[field] if name not in self.sources]


def column_map(
    columns: Mapping[str, Sequence[str]],
    names: Sequence[str],
    texts: Sequence[str],
    source: str,
    *,
    by_name: Collection[str] | None = None,
    quat: str = "wxyz",
    quaternions: Mapping[str, Sequence[int]] = MappingProxyType({}),
) -> ColumnMap:
    """Maps the columns `names` of a table to columns of a model.

    Args:
      columns: names of the model's columns by field, `qpos`, in the order of its numbers.
      texts: map, which precedes the names.
      source: name of the table for messages.
      by_name: columns that may be read by their names; all by default.
      quat: order of the components of quaternions whose components are not named; a key of `PLACES`.
      quaternions: places in fields at which quaternions begin.

    Raises:
      UnknownNameError: the left side of a text is not in the model, or its right side is not in the table.
      UsageError: a text is not an entry of a map, or numbered columns are those of another model.
      FileError: a file of lines cannot be read.
    """
    resolver = _Resolver(columns, names, source, PLACES[quat], quaternions)
    resolver.read_names([name for name in names if by_name is None or name in by_name])
    resolver.read_map(texts)
    resolver.require_one_unit()
    return resolver.map


def map_files(texts: Sequence[str]) -> list[str]:
    """Returns the files of lines that a map names."""
    return [text.removeprefix(FILE) for text in texts if text.startswith(FILE)]


def with_files(texts: Sequence[str], place: Callable[[str], Path]) -> list[str]:
    """Returns a map with its files of lines replaced by those that `place` names."""
    return [f"{FILE}{place(text.removeprefix(FILE))}" if text.startswith(FILE) else text for text in texts]


class _Resolver:
    """A map in the making.

    Attributes:
      map: the expressions so far.
    """

    def __init__(
        self,
        columns: Mapping[str, Sequence[str]],
        names: Sequence[str],
        source: str,
        order: Sequence[int],
        quaternions: Mapping[str, Sequence[int]],
    ) -> None:
        self.map = ColumnMap(columns)
        self._columns, self._names, self._source = columns, list(names), source
        self._by_clean = _by_name(names)
        # By column of the model: the source by name, and the columns of the table that differ in their units.
        self._alternatives: dict[str, tuple[RowExpression, Sequence[str]]] = {}
        self._order, self._quaternions = order, quaternions
        self._known = {name for owned in columns.values() for name in owned}
        self._groups = self._all_groups()

    # --- names ---------------------------------------------------------------------------------------

    def read_names(self, names: Collection[str]) -> None:
        """Reads the table's columns `names` by their names, or by their numbers in a joint or field."""
        readable, units = _by_name(names), _in_several_units(names)
        used: set[str] = set()
        for columns in self._columns.values():
            for name in columns:
                if column := readable.get(clean(name)):
                    source = self.map.sources[name] = self._column(column)
                    used.add(column)
                    if others := units.get(clean(name)):
                        self._alternatives[name] = source, others
                        used |= set(others)
        known = {clean(name) for name in self._known}
        unnamed = {name: column for name, column in readable.items() if name not in known}
        for group, (field, places) in sorted(self._groups.items(), key=lambda item: len(item[1][1])):
            targets = [self._columns[field][place] for place in places]
            # Of joints called `leg` and `leg1`, the second is not a number of the first; nor is 10 the number 0 of 1.
            patterns = NUMBERED[:-1] if group[-1].isdigit() else NUMBERED
            parts = _numbered(group, unnamed, patterns)
            if not parts and len(targets) == 1 and group in readable:  # an array of one column has no numbers
                parts = [readable[group]]
            if not parts or (group == field and any(name in self.map.sources for name in targets)):
                continue
            if len(parts) != len(targets):
                self._refuse_width(group, parts, len(targets))
            numbers = self._ordered(field, places, [self._column(name) for name in parts])
            for name, number in numbers.items():
                self.map.sources.setdefault(name, number)  # named columns precede numbered ones
            used |= set(parts)
        if TIME in readable:
            self.map.time = self._column(readable[TIME])
            used.add(readable[TIME])
            if others := units.get(TIME):
                self._alternatives[TIME] = self.map.time, others
        self.map.unused = [name for name in self._names if name not in used]

    def require_one_unit(self) -> None:
        """Raises UsageError if the table has a column in several units, of which the map selects none."""
        for name, (source, columns) in self._alternatives.items():
            if source is (self.map.time if name == TIME else self.map.sources[name]):
                raise _several_units(self._source, name, columns)

    def _refuse_width(self, group: str, parts: Sequence[str], expected: int) -> None:
        raise UsageError(
            f"{clean(self._source)} has {len(parts)} columns {clean(parts[0])} … {clean(parts[-1])}, "
            f"and {group} of this model has {expected} numbers: it is a table of another model\n"
            f"this model has {listing(self._columns[self._groups[group][0]])}"
        )

    # --- the map -------------------------------------------------------------------------------------

    def read_map(self, texts: Sequence[str]) -> None:
        """Applies entries of fields and joints first, then patterns, then columns: the more specific entry wins."""
        entries: list[tuple[int, str, str]] = []
        for index, text in enumerate(texts):
            with concerning("map", index):
                for left, right in map_entries(text):
                    if any(left == other for _, other, _ in entries):
                        raise UsageError(f"{option('map')} specifies {clean(left)} twice")
                    entries.append((index, left, right))

        grouped = [entry for entry in entries if entry[1] in self._groups]
        ranked: dict[Callable[[str, str], None], list[tuple[int, str, str]]] = {
            self._map_group: sorted(grouped, key=lambda entry: -len(self._groups[entry[1]][1])),
            self._map_pattern: [entry for entry in entries if PLACEHOLDER in entry[1]],
            self._map_column: [
                entry for entry in entries if entry[1] not in self._groups and PLACEHOLDER not in entry[1]
            ],
        }
        for take, some in ranked.items():
            for index, left, right in some:
                with concerning("map", index):
                    take(left, right)

    def _map_pattern(self, left: str, right: str) -> None:
        pattern = re.compile(re.escape(left).replace(re.escape(PLACEHOLDER), "(.+)", 1))
        names = (name for columns in self._columns.values() for name in columns)
        matches = {name: match[1] for name in names if (match := pattern.fullmatch(name))}
        if not matches:
            raise UnknownNameError("column", left, self._valid(left), where=f"{option('map')} of this model")
        unknown: list[UnknownNameError] = []
        for name, text in matches.items():
            try:
                self._map_column(name, right.replace(PLACEHOLDER, text))
            except UnknownNameError as error:
                unknown.append(error)
        if len(unknown) == len(matches):
            raise next((error for error in unknown if near(error.name, self._names)), unknown[0])

    def _map_column(self, left: str, right: str) -> None:
        if left != TIME and left not in self._known:
            table_column = self._by_clean.get(clean(left.strip("'`")))
            is_reversed = table_column is not None and (right == TIME or right in self._known)
            meant = [f"{right}={spelled(table_column)}"] if table_column is not None and is_reversed else []
            place = f"{option('map')} of this model"
            raise UnknownNameError("column", left, self._valid(left), where=place, meant=meant)
        expression = parse_row_expression(right, self._names, f"{option('map')} {clean(left)}")
        if left == TIME:
            self.map.time, self.map.time_is_mapped = expression, True
        else:
            self.map.sources[left] = expression

    def _map_group(self, left: str, right: str) -> None:
        field, places = self._groups[left]
        targets = [self._columns[field][place] for place in places]
        parts = list(_side_by_side(right))
        if len(parts) == 1 and (names := self._with_components(parts[0].strip("'`"), targets)):
            self.map.sources |= {name: self._column(part) for name, part in zip(targets, names, strict=True)}
            return
        expressions = [expression for part in parts for expression in self._expanded(part)]
        if len(expressions) != len(targets):
            raise UsageError(
                f"{option('map')}: {clean(left)} has {len(targets)} numbers, and {clean(right)} has {len(expressions)}"
            )
        self.map.sources |= self._ordered(field, places, expressions)

    def _with_components(self, prefix: str, targets: Sequence[str]) -> list[str]:
        """Returns the columns called `prefix` with the components of the model; empty if one is missing."""
        components = [name.rpartition("/")[2] for name in targets]
        for pattern in NUMBERED:
            wanted = [pattern.format(prefix, component) for component in components]
            if all(name in self._by_clean for name in wanted):
                return [self._by_clean[name] for name in wanted]
        return []

    def _expanded(self, part: str) -> list[RowExpression]:
        """Expands a part of a map: a column, numbered columns, or an expression over either."""
        prefix = part.strip("'`")
        if clean(prefix) in self._by_clean:
            return [self._column(self._by_clean[clean(prefix)])]
        if names := _numbered(prefix, self._by_clean):
            return [self._column(name) for name in names]

        label, own = option("map"), {name: name for name in self._names}
        read = parse_row_expression(part, Vocabulary({**{name: name for name in self._arrays}, **own}), label).columns
        widths = {name: len(self._arrays[name]) for name in read if name not in own}
        if len(set(widths.values())) > 1:
            counts = listing([f"{name} {width}" for name, width in widths.items()])
            raise UsageError(f"{label}: arrays of different widths in {quoted(part)}: {counts}")
        width = max(widths.values(), default=1)
        rows = [{name: self._arrays[name][index] for name in widths} for index in range(width)]
        return [parse_row_expression(part, Vocabulary({**row, **own}), label) for row in rows]

    @cached_property
    def _arrays(self) -> dict[str, list[str]]:
        """Numbered columns of the table, by common name."""
        prefixes = dict.fromkeys(match[1] for name in self._by_clean if (match := _LAST.fullmatch(name)))
        return {prefix: _numbered(prefix, self._by_clean) for prefix in prefixes if prefix not in self._by_clean}

    def _valid(self, left: str) -> list[str]:
        """Returns the columns that a map may specify, those of the same field first."""
        first = left.partition("/")[0]
        names = [name for columns in self._columns.values() for name in columns]
        return [TIME, *sorted(names, key=lambda name: not name.startswith(first))]

    # --- sources -------------------------------------------------------------------------------------

    def _ordered(
        self, field: str, places: Sequence[int], expressions: Sequence[RowExpression]
    ) -> dict[str, RowExpression]:
        """Returns the expression of each number of a joint or field, with quaternions in MuJoCo's order."""
        ordered = list(expressions)
        starts = [places.index(start) for start in self._quaternions.get(field, ()) if start in places]
        for at in starts:
            ordered[at : at + 4] = [expressions[at + offset] for offset in self._order]
        return {self._columns[field][place]: each for place, each in zip(places, ordered, strict=True)}

    def _column(self, name: str) -> RowExpression:
        return parse_row_expression(spelled(name), self._names, option("map"))

    def _all_groups(self) -> dict[str, tuple[str, list[int]]]:
        """Returns whole fields and objects of several numbers by name: `qpos`, `qpos/root`."""
        groups: dict[str, tuple[str, list[int]]] = {}
        for field, columns in self._columns.items():
            if columns and field not in self._known:
                groups[field] = field, list(range(len(columns)))
            for place, name in enumerate(columns):
                owner = name.rpartition("/")[0]
                if owner not in (field, "") and owner not in self._known:
                    groups.setdefault(owner, (field, []))[1].append(place)
        return groups


def split_header(name: str) -> tuple[str, str | None]:
    """Splits the header of a column from its unit: `hip [deg]`, `hip (deg)`.

    A number or a remark, as in `dof[3]` and `hip (left)`, belongs to the name.
    """
    bare, unit = split_unit(name)
    if unit is not None:
        return (name, None) if unit.isdecimal() else (bare, unit)
    bare, unit = split_column(name)
    return (bare, unit) if unit is not None and _without_degrees(unit) in {*CONVERSIONS, *SI_UNITS} else (name, None)


def _without_degrees(unit: str) -> str:
    return DEGREES.sub("deg", unit)


def _by_name(names: Collection[str]) -> dict[str, str]:
    """Returns columns by their names, and by those without the unit, unless another has that name."""
    return {clean(split_header(name)[0]): name for name in names} | {clean(name): name for name in names}


def _in_several_units(names: Collection[str]) -> dict[str, list[str]]:
    """Returns the columns that differ only in their units, by the name without one, unless a column has that name."""
    columns: dict[str, list[str]] = {}
    for name in names:
        columns.setdefault(clean(split_header(name)[0]), []).append(name)
    return {bare: alike for bare, alike in columns.items() if len(alike) > 1 and bare not in map(clean, alike)}


def _several_units(source: str, name: str, columns: Sequence[str]) -> UsageError:
    """Returns the error of a table that has the model's column `name` in several units."""
    first, second = map(clean, columns[:2])
    return UsageError(
        f"{clean(source)} has both {first} and {second}\n"
        f"remove one; in a replay, {option('map')} can select one, as in {clean(name)}={clean(spelled(columns[0]))}"
    )


def _numbered(prefix: str, names: Mapping[str, str], patterns: Sequence[str] = NUMBERED) -> list[str]:
    """Returns the columns among `names` that are called `prefix` and numbered, from 0 or from 1."""
    for pattern in patterns:
        for first in (0, 1):
            columns: list[str] = []
            while (name := pattern.format(prefix, first + len(columns))) in names:
                columns.append(names[name])
            if columns:
                return columns
    return []


def time_hint(names: Sequence[str]) -> str:
    """Suggests what to do about a table whose times are unknown."""
    likely = [name for name in names if split_column(name)[0].casefold() in TIMES] or near(TIME, names)
    scale = "/1000" if likely and split_column(likely[0])[1] == "ms" else ""
    example = f", as in time={clean(spelled(likely[0]))}{scale}" if likely else ""
    return f"{option('map')} specifies the time{example}"


def _side_by_side(text: str) -> Iterator[str]:
    """Splits a text at commas outside of quotes and parentheses."""
    start, depth, quote = 0, 0, ""
    for position, character in enumerate(text):
        if quote or character in "'`":
            quote = "" if character == quote else quote or character
        elif character == "," and depth == 0:
            yield text[start:position].strip()
            start = position + 1
        else:
            depth += (character == "(") - (character == ")")
    yield text[start:].strip()


def map_entries(text: str) -> Iterator[tuple[str, str]]:
    """Yields the left and right sides of a text, or of every line of the file that it names."""
    if not text.startswith(FILE):
        yield _assignment(text, text)
        return
    path = Path(text.removeprefix(FILE))
    with opened(path, "file of columns", [".txt", ".map"]) as file:
        content = file.read(LARGEST + 1)
    if len(content) > LARGEST or b"\0" in content:
        raise UsageError(f"{clean(str(path))} is not a file of lines COLUMN=EXPRESSION")
    for number, line in enumerate(content.decode("utf-8-sig", "replace").splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield _assignment(line, f"{clean(str(path))}:{number}")  # without its text: a document may name any file


def _assignment(text: str, shown: str) -> tuple[str, str]:
    left, equals, right = (part.strip() for part in text.partition("="))
    if not (left and equals and right):
        raise UsageError(f"{option('map')}: {shown} is not COLUMN=EXPRESSION, as in qpos/knee=knee_deg*pi/180")
    return left, right


def column_names(path: str | Path) -> list[str]:
    """Returns the names of all columns of a table.

    Raises:
      FileError: the table cannot be read.
    """
    names = list[str]()

    def note(name: str) -> bool:
        names.append(name)
        return False

    with open_table(path, note):
        return names


def evaluated(
    path: str | Path, expressions: Mapping[str, RowExpression], units: Mapping[str, str]
) -> dict[str, np.ndarray]:
    """Evaluates expressions on all rows of a table, `(n,)` each; NaN where a cell is missing.

    A column that is used unchanged is converted to SI units if the table states another unit, such as degrees. Columns
    that no expression reads are not loaded; the others are loaded block by block.

    Args:
      expressions: expressions by column of the model.
      units: SI units of the model's columns, by name; empty where unknown.

    Raises:
      UsageError: the table states a unit that does not measure what the column of the model does.
      FileError: the table cannot be read.
    """
    evaluators = {key: expression.evaluator() for key, expression in expressions.items()}
    parts: dict[str, list[np.ndarray]] = {key: [np.empty(0)] for key in expressions}
    read = list(dict.fromkeys(name for expression in expressions.values() for name in expression.columns))
    with open_table(path, read or column_names(path)[:1], missing="nan") as table:  # one column, to count the rows
        for block in table.blocks():
            columns = dict(zip(table.names, block.T, strict=True))
            for key, evaluator in evaluators.items():
                parts[key].append(evaluator.feed(columns))
        table.require_unchanged()
        factors = {
            name: _si_factor(name, units.get(name, ""), expression, table.units)
            for name, expression in expressions.items()
        }
    return {key: np.concatenate(blocks) * factors[key] for key, blocks in parts.items()}


def _si_factor(name: str, wanted: str, expression: RowExpression, units: Mapping[str, str]) -> float:
    """Returns the factor to SI units of a column with a stated unit; 1 for an expression, which converts by itself.

    Args:
      name: name of the model's column.
      wanted: its SI unit; empty if unknown.

    Raises:
      UsageError: the unit is unknown, or one of another quantity, such as of a length for an angle.
    """
    if not expression.is_column:
        return 1
    column = expression.columns[0]
    in_header = None if column == name else split_header(column)[1]
    stated = _without_degrees(units.get(column) or in_header or "")
    if not stated:
        _refuse_suffix(name, wanted, column)
        return 1
    if stated not in CONVERSIONS and stated not in SI_UNITS:
        raise UsageError(
            f"column {clean(column)} is in an unknown unit, {quoted(stated)}\n"
            f"units that are converted: {listing(list(CONVERSIONS))}; for others, {option('map')} assigns an "
            f"expression, as in {clean(name)}={clean(spelled(column))}*FACTOR"
        )
    unit, factor = CONVERSIONS.get(stated, (stated, 1.0))
    if wanted not in ("", unit):
        raise UsageError(
            f"column {clean(column)} is in {clean(stated)}, and {clean(name)} of the model in {wanted}\n"
            f"correct the unit in the table, or convert the numbers: {option('map')} assigns an expression, as in "
            f"{clean(name)}={clean(spelled(column))}*FACTOR"
        )
    return factor


def _refuse_suffix(name: str, wanted: str, column: str) -> None:
    """Raises UsageError if the name of a column without a unit ends in one other than `wanted`, as in `knee_deg`."""
    suffix = column.rpartition("_")[2]
    if suffix not in SUFFIXES or name.endswith(f"_{suffix}"):
        return
    unit, factor = CONVERSIONS[suffix]
    if wanted == unit:
        conversion = "*pi/180" if suffix == "deg" else f"/{1 / factor:.0f}"
        source = clean(spelled(column))
        raise UsageError(
            f"column {clean(column)} seems to be in {suffix}, and {clean(name)} of the model is in {wanted}\n"
            f"{option('map')} converts it, as in {clean(name)}={source}{conversion}, or reads its numbers unchanged: "
            f"{clean(name)}={source}+0"
        )


def units_of(model: mujoco.MjModel, fields: Iterable[str]) -> dict[str, str]:
    """Returns the units of the columns of some fields, and of the time."""
    probes = [field_probe(model, field) for field in fields]
    return {TIME: "s"} | {column.name: column.unit for probe in probes for column in probe.columns}


def state_map(model: mujoco.MjModel, names: Sequence[str], texts: Sequence[str], quat: str, source: str) -> ColumnMap:
    """Maps the columns `names` of a table to the state of `model`, as in `column_map`.

    Raises:
      UsageError: as `column_map`; or the table has no positions, or those of another model.
    """
    known = offered(model)
    columns = {f: [c.name for c in field_probe(model, f).columns] if f in known else [] for f in FIELDS}
    turning = {f: quaternions(model, f) for f in FIELDS}
    mapped = column_map(columns, names, texts, source, quat=quat, quaternions=turning)
    _require_positions(mapped, names, source)
    return mapped


def _require_positions(mapped: ColumnMap, names: Sequence[str], source: str) -> None:
    """Raises UsageError if a table has no positions of a model, or those of another one."""
    unknown = [name for name in mapped.unused if name.startswith("qpos/")]
    lacking = mapped.lacking("qpos")
    if unknown and lacking:
        raise UsageError(
            f"{clean(source)} is a table of another model: it has {listing(unknown)}, and lacks {listing(lacking)}\n"
            f"{_hint(lacking, names)}"
        )
    positions = [name for field in ("qpos", "mocap_pos", "mocap_quat") for name in mapped.columns[field]]
    if not any(name in mapped.sources for name in positions):
        raise UsageError(
            f"{clean(source)} has no positions of this model\nit has {listing(names) or 'no columns'}\n"
            f"the model has {listing([TIME, *positions])}\n{_hint(lacking, names)}"
        )


def _hint(wanted: Sequence[str], names: Sequence[str]) -> str:
    """Suggests an entry of a map for one of the model's columns `wanted`."""
    others = [name for name in names if name != TIME]
    for name in wanted:
        leaf = name.partition("/")[2]
        alike = near(leaf, others) or [other for other in others if leaf.casefold() in other.casefold()]
        if alike:
            degrees = "*pi/180" if "deg" in alike[0].casefold() else ""
            return f"{option('map')} assigns columns, as in {clean(name)}={clean(spelled(alike[0]))}{degrees}"
    return f"{option('map')} assigns columns, as in {clean((wanted or ['qpos/JOINT'])[0])}=COLUMN"


def read_motion(
    path: Path,
    model: mujoco.MjModel,
    start: mujoco.MjData,
    texts: Sequence[str] = (),
    quat: str = "wxyz",
    rate: Fraction | None = None,
    interpolation: Interpolation | None = None,
) -> KinematicMotion:
    """Reads the motion of `model` from a table.

    Args:
      start: state of everything that the table does not contain.
      texts: map, as in `state_map`.
      quat: order of quaternions whose components are not named.
      rate: rows per second [Hz] of a table without times.
      interpolation: interpolation between rows.

    Raises:
      UsageError: the table has no positions of this model or no times, or is not a motion; or the map is invalid.
      FileError: the table cannot be read.
    """
    names = column_names(path)
    mapped = state_map(model, names, texts, quat, str(path))
    if mapped.time is None and rate is None:
        raise UsageError(
            f"{clean(str(path))} has no column 'time'\n"
            f"{time_hint(names)}, or {option('replay_rate')} the number of rows per second"
        )
    if mapped.time is not None and rate is not None:
        raise UsageError(
            f"{clean(str(path))} has a column 'time', and {option('replay_rate')} is for tables without one\n"
            f"{option('map')} can specify another time: time=EXPRESSION",
            ("replay_rate",),
        )
    sources = mapped.sources if mapped.time is None else {**mapped.sources, TIME: mapped.time}
    values = evaluated(path, sources, units_of(model, [field for field in FIELDS if mapped.columns[field]]))
    if rate is None:
        times = values.pop(TIME)
    else:
        times = np.array(seconds(np.arange(len(next(iter(values.values())))), 1 / rate), float)
    by_field = {
        field: {place: values[name] for place, name in enumerate(columns) if name in values}
        for field, columns in mapped.columns.items()
    }
    return KinematicMotion(model, start, KinematicSamples(str(path), times, mapped.columns, by_field), interpolation)


def read_controls(
    path: Path, model: mujoco.MjModel, source: str, constants: Mapping[str, Sequence[int]], *, linear: bool
) -> ControlTable:
    """Reads the controls of `model` from a table.

    Args:
      source: name of the table for messages.
      constants: indices of the controls that the option `ctrl` sets, by its key; `*` means the others.
      linear: whether controls change in straight lines; otherwise they hold until the next one.

    Raises:
      UnknownNameError: a column names an actuator that is not in the model.
      UsageError: the table lacks times or an actuator, drives one that has a constant, or has invalid numbers.
      FileError: the table cannot be read.
    """
    actuators, available = control_names(model), column_names(path)
    names = [f"ctrl/{name}" for name in actuators]
    others, units_by_name = _other_controls(model, available), _in_several_units(available)
    for column, entry in others.items():
        if alike := units_by_name.get(clean(split_header(column)[0])):
            raise _several_units(source, entry.partition("=")[0], alike)
    readable = {_by_name(available).get(TIME), *others}
    table = read_table(path, lambda name: name in readable or re.match(CONTROL, name) is not None)
    columns = table.columns
    mapped = column_map({"ctrl": names}, list(columns), list(others.values()), source)

    if mapped.time is None:
        raise UsageError(
            f"{clean(source)} has no column 'time'\nit needs 'time' in seconds, and ctrl/ACTUATOR for each actuator"
        )
    driven = [index for index, name in enumerate(names) if name in mapped.sources]
    twice = [key for key, held in constants.items() if key != "*" and not set(held).isdisjoint(driven)]
    if twice:
        raise UsageError(f"{option('ctrl')} and {clean(source)} both drive {listing(twice)}")
    for name in mapped.unused:
        if name.startswith("ctrl/") and name not in others:
            actuator = split_header(name)[0].removeprefix("ctrl/")
            raise UnknownNameError("actuator", actuator, actuators, where=f"the columns of {source}")
    held = {index for indices in constants.values() for index in indices}
    missing = [name for index, name in enumerate(names) if index not in driven and index not in held]
    if not driven or missing:
        wanted = listing(missing or names) or "nothing: it has no actuators"
        raise UsageError(
            f"{clean(source)} lacks columns for actuators of the model: {wanted}\n"
            f"it has {listing(available)}; a column may also be named after the actuator or its joint, with [deg] for "
            f"degrees, and {option('ctrl')} sets the others"
        )

    units = units_of(model, ["ctrl"])

    def values(name: str, expression: RowExpression) -> np.ndarray:
        return expression.values(columns) * _si_factor(name, units[name], expression, table.units)

    controls = {names[index]: values(names[index], mapped.sources[names[index]]) for index in driven}
    return ControlTable(TimedRows(values(TIME, mapped.time), controls, source, linear), driven)


def _other_controls(model: mujoco.MjModel, columns: Sequence[str]) -> dict[str, str]:
    """Returns the entries of a map for columns that are named after an actuator, or after a joint that only one drives.

    The name may be followed by a unit in brackets.
    """
    joints = _joints_of_controls(model)
    driven = [joint for joint in joints.values() if joint]
    named, found = _by_name(columns), set[str]()
    found |= {name.removeprefix("ctrl/") for name in named if name.startswith("ctrl/")}
    entries: dict[str, str] = {}
    for control, joint in joints.items():
        for name in (control, *([joint] if driven.count(joint) == 1 and joint not in joints else [])):
            column = named.get(name)
            if column and control not in found:
                found.add(control)
                entries[column] = f"ctrl/{control}={spelled(column)}"
    return entries


def _joints_of_controls(model: mujoco.MjModel) -> dict[str, str]:
    """Returns the controls, each with the joint that its actuator drives, or an empty text."""
    names = control_names(model)
    joints = dict.fromkeys(names, "")
    for i in range(model.nactuator):
        if model.actuator_ctrlnum[i] == 1 and model.actuator_trntype[i] in JOINT_TRANSMISSIONS:
            joint = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, int(model.actuator_trnid[i, 0])) or ""
            joints[names[int(model.actuator_ctrladr[i])]] = joint
    return joints
