"""From the text of an expression to its tokens: numbers, names, operators, and errors that point at a character."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from mjrun.errors import UnknownNameError, UsageError, clean, quoted
from mjrun.probe.expression import CONSTANTS, FUNCTIONS, KEYWORDS, SUCCESSIVE

SHOWN = 72  # characters of an expression that a message shows
WILDCARDS = "*?"  # in a quoted name that is no column's

_CALLED = {*FUNCTIONS, *SUCCESSIVE}
_SPACE = re.compile(r"\s*")
_DIGITS = re.compile(r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WORD = re.compile(r"[^\W\d]\w*")
_NAME = re.compile(r"\w+(?:[/:.\-]\w+)*")
_GOES_ON = re.compile(r"\w|[:.]+\w")  # so a name does not end here
_OPERATOR = re.compile(r"\*\*|<=|>=|==|!=|[-+*/^<>(),]")
_QUOTED = re.compile(r"""'((?:[^']|'')*)'|`((?:[^`]|``)*)`|"((?:[^"]|"")*)\"""", re.DOTALL)
_QUOTES = "'`\""
_BARE = re.compile(r"\w(?:[\w/:.\-]*\w)?(?: \w(?:[\w/:.\-]*\w)?)*")
_OPENING = re.compile(r"([^\W\d]\w*)\s*\(")
_COMPONENT = re.compile(r"(?:\.\w+)*")


def is_bare(name: str) -> bool:
    """Whether the column `name` may be written without quotes."""
    return bool(_BARE.fullmatch(name)) and not set(name.split(" ")) & {*KEYWORDS} and not _DIGITS.fullmatch(name)


def is_word(text: str) -> bool:
    """Whether `text` could be the name of a function."""
    return bool(_WORD.fullmatch(text))


def is_name(text: str) -> bool:
    """Whether `text` looks like a name."""
    return bool(_NAME.fullmatch(text))


def spelled(name: str) -> str:
    """The column `name` as an expression spells it: in quotes where it needs them."""
    return name if is_bare(name) else "'" + name.replace("'", "''") + "'"


@dataclass(frozen=True)
class Token:
    """A piece of the text, from `start` to `end`; the text of a column is its name in the table."""

    kind: str  # number, column, wildcard, word, operator, unknown, end; within an accessor also object, component
    text: str
    start: int
    end: int


@dataclass(frozen=True)
class ProbeReference:
    """`group(object, …).component`: `component` has its dots, and no text where there is none."""

    group: Token
    objects: tuple[Token, ...]
    component: Token


@dataclass(frozen=True)
class SourceText:
    """A text as it was written, and what messages call it: the option, or `when`."""

    text: str
    label: str

    def fault(self, position: int, found: str, expected: str) -> UsageError:
        """What is wrong with the text, and a line that points at it."""
        first = max(0, position - SHOWN // 2)
        before = ("…" if first else "") + clean(self.text[first:position])
        last = first + SHOWN
        after = clean(self.text[position:last]) + ("…" if last < len(self.text) else "")
        pointer = f"\n  {before}{after}\n  {' ' * len(before)}^" if self.text.strip() else ""
        return UsageError(f"{self.label}, character {position + 1}: found {found}, expected {expected}{pointer}")

    def unknown(self, position: int, kind: str, name: str, valid: Sequence[str], plural: str = "") -> UnknownNameError:
        """The name at `position` is not among the valid ones."""
        return UnknownNameError(kind, name, valid, where=self.place(position), plural=plural)

    def place(self, position: int) -> str:
        """Where the text is, and where in it."""
        whole = self.text if len(self.text) <= SHOWN else self.text[:SHOWN] + "…"
        return f"{quoted(whole)}, character {position + 1}"


class Vocabulary:
    """The names that an expression may use: here columns, each by its own name.

    Attributes:
      names: of columns, as messages list them.
      groups: names that may be called with objects, `speed(box)`.
      beginnings: of names that may be columns without being listed, `contact/`.
      constants: numbers by name.
      control_dt: the time between two rows [s], where a row may refer to the one before it as `previous` and `rate` do;
        such rows are instants, and have no aggregates.
    """

    beginnings: tuple[str, ...] = ()
    constants: Mapping[str, float] = CONSTANTS
    control_dt: float | None = None

    def __init__(self, columns: Mapping[str, str] | Sequence[str]) -> None:
        self.names = tuple(columns)
        self._columns = columns if isinstance(columns, Mapping) else {name: name for name in columns}

    @property
    def groups(self) -> frozenset[str]:
        return frozenset()

    def column(self, name: str) -> str | None:
        """The name in the table of what is called `name`; None if nothing is."""
        return self._columns.get(name)

    def matching(self, pattern: str) -> tuple[str, ...]:
        """The columns that a name with wildcards stands for, by their names in the table; by other names if need be."""
        matches = {name: self._columns[name] for name in self.names if fnmatchcase(name, pattern)}
        own = [column for name, column in matches.items() if name == column]
        return tuple(dict.fromkeys(own or matches.values()))

    def is_count(self, column: str) -> bool:
        """Whether `column` is a number that alone says something: that there is any."""
        return False

    def missing(self, name: str, position: int, source: SourceText) -> UsageError:
        """The error that nothing is called `name`."""
        return source.unknown(position, "column", name, self.names)

    def accessed(self, accessor: ProbeReference, source: SourceText) -> str:
        """The name in the table of the column that `accessor` stands for.

        Raises:
          UsageError: it stands for none.
        """
        raise NotImplementedError


class Scanner:
    """Cuts the text of `source` into tokens, one at a time."""

    def __init__(self, source: SourceText, vocabulary: Vocabulary) -> None:
        self.source, self.text, self.vocabulary = source, source.text, vocabulary
        self.bare = {name for name in vocabulary.names if is_bare(name)}
        self.lengths = sorted({len(name) for name in self.bare}, reverse=True)

    def token(self, position: int) -> Token:
        """The token at or after `position`."""
        start = self._after_space(position)
        if opening := self._opening(start):
            return self._accessor(opening)
        tokens = [t for t in (self._number(start), self._column(start), self._word(start)) if t]
        if tokens:
            return max(tokens, key=lambda token: token.end)  # the first of the longest
        if start == len(self.text):
            return Token("end", "", start, start)
        if self.text[start] in _QUOTES:
            return self._quoted_column(start)
        if operator := _OPERATOR.match(self.text, start):
            return Token("operator", operator[0], start, operator.end())
        name = _NAME.match(self.text, start)
        return Token("unknown", name[0] if name else self.text[start], start, name.end() if name else start + 1)

    def _after_space(self, position: int) -> int:
        space = _SPACE.match(self.text, position)
        return space.end() if space else position

    def _number(self, start: int) -> Token | None:
        digits = _DIGITS.match(self.text, start)
        return Token("number", digits[0], start, digits.end()) if digits else None

    def _column(self, start: int) -> Token | None:
        for end in self._ends(start):
            name = self.text[start:end]
            column = None if _GOES_ON.match(self.text, end) else self.vocabulary.column(name)
            if column is not None:
                called = name in _CALLED and self.text[end:].lstrip().startswith("(")
                return None if called else Token("column", column, start, end)
        return None

    def _ends(self, start: int) -> Iterator[int]:
        """Where a column that begins at `start` may end, the longest first."""
        name = _NAME.match(self.text, start)
        if name and name[0].startswith(self.vocabulary.beginnings):
            yield from range(name.end(), start, -1)
        for length in self.lengths:
            if self.text[start : start + length] in self.bare:
                yield start + length

    def _word(self, start: int) -> Token | None:
        """A word of the language; a longer name that begins with it is none."""
        word, name = _WORD.match(self.text, start), _NAME.match(self.text, start)
        if not word or not name:
            return None
        if word[0] in KEYWORDS:
            return Token("operator", word[0], start, word.end())
        known = word[0] in self.vocabulary.constants or word[0] in _CALLED
        ends = word.end() == name.end() or self.text[word.end()] in "/-"
        return Token("word", word[0], start, word.end()) if known and ends else None

    def _quoted_column(self, start: int) -> Token:
        name, end = self._quoted(start)
        column = self.vocabulary.column(name)
        if column is None and set(name) & {*WILDCARDS} and self.vocabulary.matching(name):
            return Token("wildcard", name, start, end)
        if column is None:
            raise self.vocabulary.missing(name, start, self.source)
        return Token("column", column, start, end)

    def _quoted(self, start: int) -> tuple[str, int]:
        """The name in quotes at `start`, and where it ends."""
        found, quote = _QUOTED.match(self.text, start), self.text[start]
        if not found:
            raise self.source.fault(start, "a quote that is not closed", f"another {quote}")
        return found[0][1:-1].replace(quote * 2, quote), found.end()

    # --- accessors ---------------------------------------------------------------------------------

    def _opening(self, start: int) -> Token | None:
        """The name of a group that is called at `start`, up to its parenthesis."""
        opening = _OPENING.match(self.text, start)
        if not opening or opening[1] in (*_CALLED, *KEYWORDS) or opening[1] not in self.vocabulary.groups:
            return None
        return Token("group", opening[1], start, opening.end())

    def _accessor(self, group: Token) -> Token:
        objects = [self._object(group.end)]
        while (end := self._after_space(objects[-1].end)) < len(self.text) and self.text[end] == ",":
            objects.append(self._object(end + 1))
        if self.text[end : end + 1] != ")":
            raise self.source.fault(end, self._found(end), "',' or ')'; a name with other characters is quoted")
        dotted = _COMPONENT.match(self.text, end + 1)
        component = Token("component", dotted[0] if dotted else "", end + 1, dotted.end() if dotted else end + 1)
        column = self.vocabulary.accessed(ProbeReference(group, tuple(objects), component), self.source)
        return Token("column", column, group.start, component.end)

    def _object(self, position: int) -> Token:
        start = self._after_space(position)
        if self.text[start : start + 1] in (*_QUOTES,):
            return Token("object", *self._with_start(start))
        name = _BARE.match(self.text, start)
        if not name:
            raise self.source.fault(start, self._found(start), "the name of an object")
        return Token("object", name[0], start, name.end())

    def _with_start(self, start: int) -> tuple[str, int, int]:
        name, end = self._quoted(start)
        return name, start, end

    def _found(self, position: int) -> str:
        return quoted(self.text[position]) if position < len(self.text) else "the end"
