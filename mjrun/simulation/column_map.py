"""Mapping from columns of a table to the state of a model: by name, by number, or by a map of expressions.

A map is a list of texts `COLUMN=EXPRESSION`, or `@FILE` for a file of such lines. The left side is a column of the
model, `time` or `qpos/knee`; the right side is an expression over the table's columns, with one value per row. If the
left side is a joint of several numbers (`qpos/root`) or a whole field (`qpos`), the right side is the common name of
columns that are numbered or named by component, or several names or expressions whose numbers are joined:
`qpos=root_mm/1000,root_quat,dof*pi/180`. There, the common name of numbered columns represents each of them.
In `qpos/{}={}_deg*pi/180`, `{}` represents any text for which both sides are valid.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import mujoco

from mjrun.errors import UnknownNameError, UsageError, clean, concerning, listing, near, option, quoted
from mjrun.formats.input_file import opened
from mjrun.physics.kinematic_samples import FIELDS, quaternions
from mjrun.probe.fields import field_probe, offered
from mjrun.probe.row_expression import RowExpression, parse_row_expression
from mjrun.probe.scanner import Vocabulary, spelled

TIME = "time"
FILE = "@"  # begins the name of a file of lines
PLACEHOLDER = "{}"
NUMBERED = ("{}/{}", "{}_{}", "{}.{}", "{}[{}]", "{}{}")  # names of the parts of a column
_LAST = re.compile(r"(.+?)(?:[/_.\[]?)[01]\]?")  # the first of numbered columns
POSITIONS = ("qpos", "mocap_pos", "mocap_quat")
TIMES = ("time", "t", "timestamp", "time_s", "sec", "seconds", "stamp", "elapsed")
LARGEST = 2**20  # characters in a file of lines

PLACES = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}  # indices of w, x, y and z


@dataclass
class ColumnMap:
    """Sources of the numbers of a state.

    Attributes:
      time: expression of the times of the rows [s]; None if the table contains no times.
      columns: names of the columns of each field, in the order of its numbers.
      sources: expressions by field and index.
      unknown: columns of the table that are named like positions but that the model lacks.
    """

    time: RowExpression | None
    columns: Mapping[str, Sequence[str]]
    sources: dict[str, dict[int, RowExpression]] = field(default_factory=dict[str, dict[int, RowExpression]])
    unknown: Sequence[str] = ()


def column_map(model: mujoco.MjModel, names: Sequence[str], texts: Sequence[str], quat: str, source: str) -> ColumnMap:
    """Maps the columns `names` of a table to the state of `model`.

    Args:
      texts: map, which precedes the names.
      quat: order of the components of quaternions whose components are not named; a key of `PLACES`.
      source: name of the table for messages.

    Raises:
      UnknownNameError: the left side of a text is not in the model, or its right side is not in the table.
      UsageError: a text is not an entry of a map; there are no positions, or those of another model.
      FileError: a file of lines cannot be read.
    """
    return _Resolver(model, names, quat, source).resolve(texts)


def map_files(texts: Sequence[str]) -> list[str]:
    """Returns the files of lines that a map names."""
    return [text.removeprefix(FILE) for text in texts if text.startswith(FILE)]


def with_files(texts: Sequence[str], place: Callable[[str], Path]) -> list[str]:
    """Returns a map with its files of lines replaced by those that `place` names."""
    return [f"{FILE}{place(text.removeprefix(FILE))}" if text.startswith(FILE) else text for text in texts]


class _Resolver:
    def __init__(self, model: mujoco.MjModel, names: Sequence[str], quat: str, source: str) -> None:
        self._model, self._names, self._source = model, list(names), source
        self._by_clean = {clean(name): name for name in names}
        self._order = PLACES[quat]
        known = offered(model)
        self._columns = {f: [c.name for c in field_probe(model, f).columns] if f in known else [] for f in FIELDS}
        self._places = {name: (f, i) for f in FIELDS for i, name in enumerate(self._columns[f])}
        self._groups = self._all_groups()
        self._map = ColumnMap(None, self._columns)

    def resolve(self, texts: Sequence[str]) -> ColumnMap:
        self._read_names()
        self._read_map(texts)
        self._require_positions()
        return self._map

    # --- names ---------------------------------------------------------------------------------------

    def _read_names(self) -> None:
        used: set[str] = set()
        for name, (f, index) in self._places.items():
            if column := self._by_clean.get(clean(name)):
                self._set(f, index, column)
                used.add(column)
        for group, (f, indices) in sorted(self._groups.items(), key=lambda item: len(item[1][1])):
            parts = self._numbered(group)
            whole = group == f
            if not parts or (whole and f in self._map.sources):
                continue
            if len(parts) != len(indices):
                self._refuse_width(group, parts, len(indices))
            self._set_all(f, indices, parts)
            used |= set(parts)
        if TIME in self._by_clean:
            self._map.time = self._column(self._by_clean[TIME])
        self._map.unknown = [name for name in self._names if name.startswith("qpos/") and name not in used]

    def _numbered(self, prefix: str) -> list[str]:
        """Returns the table's columns that are called `prefix` and numbered, from 0 or from 1."""
        for pattern in NUMBERED:
            for first in (0, 1):
                columns: list[str] = []
                while (name := pattern.format(prefix, first + len(columns))) in self._by_clean:
                    columns.append(self._by_clean[name])
                if columns:
                    return columns
        return []

    def _refuse_width(self, group: str, parts: Sequence[str], expected: int) -> None:
        raise UsageError(
            f"{clean(self._source)} has {len(parts)} columns {clean(parts[0])} … {clean(parts[-1])}, "
            f"and {group} of this model has {expected} numbers: it is a table of another model\n"
            f"this model has {listing(self._columns[group.partition('/')[0]])}"
        )

    # --- the map -------------------------------------------------------------------------------------

    def _read_map(self, texts: Sequence[str]) -> None:
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
        matches = {name: match[1] for name in self._places if (match := pattern.fullmatch(name))}
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
        if left != TIME and left not in self._places:
            raise UnknownNameError("column", left, self._valid(left), where=f"{option('map')} of this model")
        expression = parse_row_expression(right, self._names, f"{option('map')} {clean(left)}")
        if left == TIME:
            self._map.time = expression
        else:
            f, index = self._places[left]
            self._map.sources.setdefault(f, {})[index] = expression

    def _map_group(self, left: str, right: str) -> None:
        f, indices = self._groups[left]
        parts = list(_side_by_side(right))
        if len(parts) == 1 and (names := self._with_components(parts[0].strip("'`"), f, indices)):
            for index, name in zip(indices, names, strict=True):
                self._set(f, index, name)
            return
        expressions = [expression for part in parts for expression in self._expanded(part)]
        if len(expressions) != len(indices):
            raise UsageError(
                f"{option('map')}: {clean(left)} has {len(indices)} numbers, and {clean(right)} has {len(expressions)}"
            )
        self._map.sources.setdefault(f, {}).update(self._ordered(f, indices, expressions))

    def _with_components(self, prefix: str, f: str, indices: Sequence[int]) -> list[str]:
        """Returns the columns called `prefix` with the components of the model; empty if one is missing."""
        components = [self._columns[f][index].rpartition("/")[2] for index in indices]
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
        if names := self._numbered(prefix):
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
        return {prefix: self._numbered(prefix) for prefix in prefixes if prefix not in self._by_clean}

    def _valid(self, left: str) -> list[str]:
        """Returns the columns that a map may specify, those of the same field first."""
        first = left.partition("/")[0]
        return [TIME, *sorted(self._places, key=lambda name: not name.startswith(first))]

    # --- sources -------------------------------------------------------------------------------------

    def _set(self, f: str, index: int, name: str) -> None:
        self._map.sources.setdefault(f, {})[index] = self._column(name)

    def _set_all(self, f: str, indices: Sequence[int], names: Sequence[str]) -> None:
        """Reads a joint or field from columns without names of components, unless named columns contain its numbers."""
        taken = self._ordered(f, indices, [self._column(name) for name in names])
        self._map.sources[f] = {**taken, **self._map.sources.get(f, {})}

    def _ordered(
        self, f: str, indices: Sequence[int], expressions: Sequence[RowExpression]
    ) -> dict[int, RowExpression]:
        """Returns the source of each number of a joint or field by index, with quaternions in MuJoCo's order."""
        ordered = list(expressions)
        starts = [indices.index(start) for start in quaternions(self._model, f) if start in indices]
        for at in starts:
            ordered[at : at + 4] = [expressions[at + offset] for offset in self._order]
        return dict(zip(indices, ordered, strict=True))

    def _column(self, name: str) -> RowExpression:
        return parse_row_expression(spelled(name), self._names, option("map"))

    def _all_groups(self) -> dict[str, tuple[str, list[int]]]:
        """Returns whole fields and objects of several numbers by name: `qpos`, `qpos/root`."""
        groups: dict[str, tuple[str, list[int]]] = {}
        for f, columns in self._columns.items():
            if columns:
                groups[f] = f, list(range(len(columns)))
            for index, name in enumerate(columns):
                owner = name.rpartition("/")[0]
                if owner != f and owner not in self._places:
                    groups.setdefault(owner, (f, []))[1].append(index)
        return groups

    def _require_positions(self) -> None:
        source, unknown = clean(self._source), self._map.unknown
        lacking = [name for i, name in enumerate(self._columns["qpos"]) if i not in self._map.sources.get("qpos", {})]
        if unknown and lacking:
            raise UsageError(
                f"{source} is a table of another model: it has {listing(unknown)}, and lacks {listing(lacking)}\n"
                f"{self._hint()}"
            )
        if not any(self._map.sources.get(f) for f in POSITIONS):
            expected = [TIME, *(name for f in POSITIONS for name in self._columns[f])]
            raise UsageError(
                f"{source} has no positions of this model\nit has {listing(self._names) or 'no columns'}\n"
                f"the model has {listing(expected)}\n{self._hint()}"
            )

    def _hint(self) -> str:
        """Suggests an entry of a map."""
        positions = self._map.sources.get("qpos", {})
        wanted = [name for i, name in enumerate(self._columns["qpos"]) if i not in positions]
        others = [name for name in self._names if name != TIME]
        for name in wanted:
            leaf = name.partition("/")[2]
            alike = near(leaf, others) or [other for other in others if leaf.casefold() in other.casefold()]
            if alike:
                degrees = "*pi/180" if "deg" in alike[0].casefold() else ""
                return f"{option('map')} assigns columns, as in {clean(name)}={clean(spelled(alike[0]))}{degrees}"
        return f"{option('map')} assigns columns, as in {clean((wanted or ['qpos/JOINT'])[0])}=COLUMN"


def time_hint(names: Sequence[str]) -> str:
    """Suggests what to do about a table whose times are unknown."""
    likely = [name for name in names if name.casefold() in TIMES] or near(TIME, names)
    example = f", as in time={clean(spelled(likely[0]))}" if likely else ""
    return f"{option('map')} specifies the time{example}, or {option('replay_rate')} the number of rows per second"


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
