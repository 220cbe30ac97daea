"""Mapping from columns of a table to columns of a model: by name, by number, or by a map of expressions.

States of a replay, controls, and the measurements of a fit all find their columns here.

A map is a list of texts `COLUMN=EXPRESSION`, or `@FILE` for a file of such lines. The left side is a column of the
model, `time` or `qpos/knee`; the right side is an expression over the table's columns, with one value per row. If the
left side is a joint of several numbers (`qpos/root`) or a whole field (`qpos`), the right side is the common name of
columns that are numbered or named by component, or several names or expressions whose numbers are joined:
`qpos=root_mm/1000,root_quat,dof*pi/180`. There, the common name of numbered columns represents each of them.
In `qpos/{}={}_deg*pi/180`, `{}` represents any text for which both sides are valid.
"""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import field as dataclass_field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, concerning, listing, near, option, quoted
from mjrun.formats.input_file import opened
from mjrun.model.table_column import split_column
from mjrun.probe.row_expression import RowExpression, parse_row_expression
from mjrun.probe.scanner import Vocabulary, spelled

TIME = "time"
FILE = "@"  # begins the name of a file of lines
PLACEHOLDER = "{}"
NUMBERED = ("{}/{}", "{}_{}", "{}.{}", "{}[{}]", "{}{}")  # names of the parts of a column
_LAST = re.compile(r"(.+?)(?:[/_.\[]?)[01]\]?")  # the first of numbered columns
TIMES = ("time", "t", "timestamp", "time_s", "sec", "seconds", "stamp", "elapsed")
LARGEST = 2**20  # characters in a file of lines

PLACES = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}  # indices of w, x, y and z


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
        self._by_clean = {clean(name): name for name in names}
        self._order, self._quaternions = order, quaternions
        self._known = {name for owned in columns.values() for name in owned}
        self._groups = self._all_groups()

    # --- names ---------------------------------------------------------------------------------------

    def read_names(self, names: Collection[str]) -> None:
        """Reads the table's columns `names` by their names, or by their numbers in a joint or field."""
        readable = {clean(name): name for name in names}
        used: set[str] = set()
        for columns in self._columns.values():
            for name in columns:
                if column := readable.get(clean(name)):
                    self.map.sources[name] = self._column(column)
                    used.add(column)
        for group, (field, places) in sorted(self._groups.items(), key=lambda item: len(item[1][1])):
            parts = _numbered(group, readable)
            targets = [self._columns[field][place] for place in places]
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
        self.map.unused = [name for name in self._names if name not in used]

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
            raise UnknownNameError("column", left, self._valid(left), where=f"{option('map')} of this model")
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


def _numbered(prefix: str, names: Mapping[str, str]) -> list[str]:
    """Returns the columns among `names` that are called `prefix` and numbered, from 0 or from 1."""
    for pattern in NUMBERED:
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
        content = file.read(LARGEST + 1).decode("utf-8-sig", "replace")
    if len(content) > LARGEST or "\0" in content:
        raise UsageError(f"{clean(str(path))} is not a file of lines COLUMN=EXPRESSION")
    for number, line in enumerate(content.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield _assignment(line, f"{clean(str(path))}:{number}")  # without its text: a document may name any file


def _assignment(text: str, shown: str) -> tuple[str, str]:
    left, equals, right = (part.strip() for part in text.partition("="))
    if not (left and equals and right):
        raise UsageError(f"{option('map')}: {shown} is not COLUMN=EXPRESSION, as in qpos/knee=knee_deg*pi/180")
    return left, right
