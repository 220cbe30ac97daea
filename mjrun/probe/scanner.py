"""Splits the text of an expression into tokens: numbers, names, operators; errors point at a character."""

import re
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cached_property

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, quoted, shortened
from mjrun.probe.expression import CONSTANTS, FUNCTIONS, KEYWORDS, SUCCESSIVE

SHOWN = 72  # most characters of an expression that a message shows
WILDCARDS = "*?"  # in a quoted name that is not a column

_CALLED = {*FUNCTIONS, *SUCCESSIVE}
_SPACE = re.compile(r"\s*")
_DIGITS = re.compile(r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WORD = re.compile(r"[^\W\d]\w*")
_NAME = re.compile(r"\w+(?:[/:.\-]\w+)*")
_CONTINUED = re.compile(r"\w|[:.]+\w")  # after which a name has not ended
_OPERATOR = re.compile(r"\*\*|<=|>=|==|!=|[-+*/^<>(),]")
_QUOTED = re.compile(r"""'((?:[^']|'')*)'|`((?:[^`]|``)*)`|"((?:[^"]|"")*)\"""", re.DOTALL)
QUOTES = ("'", "`", '"')
_BARE = re.compile(r"\w(?:[\w/:.\-]*\w)?(?: \w(?:[\w/:.\-]*\w)?)*")
_OPENING = re.compile(r"([^\W\d]\w*)\s*\(")
_COMPONENT = re.compile(r"(?:\.\w+)*")


def is_bare(name: str) -> bool:
    """Returns whether the column `name` may be written without quotes."""
    return bool(_BARE.fullmatch(name)) and not set(name.split(" ")) & {*KEYWORDS} and not _DIGITS.fullmatch(name)


def is_word(text: str) -> bool:
    """Returns whether `text` could be the name of a function."""
    return bool(_WORD.fullmatch(text))


def is_name(text: str) -> bool:
    """Returns whether `text` looks like a name."""
    return bool(_NAME.fullmatch(text))


def spelled(name: str) -> str:
    """Returns the column `name` as an expression spells it, in quotes if necessary."""
    return name if is_bare(name) else "'" + name.replace("'", "''") + "'"


@dataclass(frozen=True)
class Token:
    """A piece of the text, from `start` to `end`; the text of a column is its name in the table."""

    kind: str  # number, column, wildcard, text, word, operator, unknown, end; within an accessor also object, component
    text: str
    start: int
    end: int


@dataclass(frozen=True)
class ProbeReference:
    """A reference `group(object, …).component`; the text of `component` includes its dots, and may be empty."""

    group: Token
    objects: tuple[Token, ...]
    component: Token


@dataclass(frozen=True)
class SourceText:
    """A text as written, and its name in messages: the option, or `when`."""

    text: str
    label: str

    def fault(self, position: int, found: str, expected: str) -> UsageError:
        """Returns the error of a fault at `position`, with a line that points at it."""
        first = max(0, position - SHOWN // 2)
        before = ("…" if first else "") + clean(self.text[first:position])
        last = first + SHOWN
        after = clean(self.text[position:last]) + ("…" if last < len(self.text) else "")
        pointer = f"\n  {before}{after}\n  {' ' * len(before)}^" if self.text.strip() else ""
        return UsageError(f"{self.label}, character {position + 1}: found {found}, expected {expected}{pointer}")

    def unknown(
        self, position: int, kind: str, name: str, valid: Sequence[str], plural: str = "", meant: Sequence[str] = ()
    ) -> UnknownNameError:
        """Returns the error of an unknown name at `position`."""
        return UnknownNameError(kind, name, valid, where=self.place(position), plural=plural, meant=meant)

    def place(self, position: int) -> str:
        """Returns the text and the number of its character at `position`."""
        return f"{quoted(shortened(self.text, SHOWN))}, character {position + 1}"


class Vocabulary:
    """The names that an expression may use: in this class columns, each by its own name.

    Attributes:
      names: names of columns, as messages list them.
      groups: names that may be called with objects, `speed(box)`.
      beginnings: beginnings of names that may be columns without being listed, `contact/`.
      constants: numbers by name.
      control_dt: time between two rows [s], if a row may refer to the previous one with `previous` and `rate`. Such
        rows are instants, and have no aggregates.
      has_texts: whether columns may have texts; what is quoted after `==` or `!=` is then a text.
    """

    beginnings: tuple[str, ...] = ()
    constants: Mapping[str, float] = CONSTANTS
    control_dt: float | None = None
    has_texts: bool = False

    def __init__(self, columns: Mapping[str, str] | Sequence[str]) -> None:
        self._given = columns

    @cached_property
    def columns(self) -> Mapping[str, str]:
        """The columns by every name."""
        return self._given if isinstance(self._given, Mapping) else {name: name for name in self._given}

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(self.columns)

    @property
    def groups(self) -> frozenset[str]:
        return frozenset()

    def is_group(self, name: str) -> bool:
        """Returns whether `name` is one of `groups`."""
        return name in self.groups

    @cached_property
    def bare(self) -> frozenset[str]:
        """The names that may be written without quotes."""
        return frozenset(filter(is_bare, self.names))

    @cached_property
    def _lengths(self) -> Sequence[int]:
        """The lengths of these names, the longest first."""
        return sorted(set(map(len, self.bare)), reverse=True)

    def ends(self, text: str, start: int) -> Iterator[int]:
        """Yields the ends of the names without quotes at `start` of a text, the longest first."""
        return (start + length for length in self._lengths if text[start : start + length] in self.bare)

    def column(self, name: str) -> str | None:
        """Returns the column of the table that is called `name`; None if none is."""
        return self.columns.get(name)

    def matching(self, pattern: str) -> tuple[str, ...]:
        """Returns the columns that match a name with wildcards; by other names only if none matches by its own."""
        matches = {name: column for name, column in self.columns.items() if fnmatchcase(name, pattern)}
        own = [column for name, column in matches.items() if name == column]
        return tuple(dict.fromkeys(own or matches.values()))

    def is_count(self, column: str) -> bool:
        """Returns whether `column` is a count, which alone is a condition: that it is above zero."""
        return False

    def missing(self, name: str, position: int, source: SourceText) -> UsageError:
        """Returns the error of an unknown column."""
        return source.unknown(position, "column", name, self.names)

    def accessed(self, accessor: ProbeReference, source: SourceText) -> str:
        """Returns the column of the table that `accessor` refers to.

        Raises:
          UsageError: the column does not exist.
        """
        raise NotImplementedError


class Scanner:
    """A scanner that splits the text of `source` into tokens, one at a time."""

    def __init__(self, source: SourceText, vocabulary: Vocabulary) -> None:
        self.source = source
        self.text = source.text
        self.vocabulary = vocabulary

    def token(self, position: int) -> Token:
        """Returns the token at or after `position`."""
        start = self._after_space(position)
        if opening := self._opening(start):
            return self._accessor(opening)
        tokens = list(filter(None, (self._number(start), self._column(start), self._word(start))))
        if tokens:
            return max(tokens, key=lambda token: token.end)  # the first of the longest
        if start == len(self.text):
            return Token("end", "", start, start)
        if self.text[start] in QUOTES:
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
            column = None if _CONTINUED.match(self.text, end) else self.vocabulary.column(name)
            if column is not None:
                called = name in _CALLED and self.text[end:].lstrip().startswith("(")
                return None if called else Token("column", column, start, end)
        return None

    def _ends(self, start: int) -> Iterator[int]:
        """Yields the possible ends of a column that begins at `start`, the longest first."""
        name = _NAME.match(self.text, start)
        if name and name[0].startswith(self.vocabulary.beginnings):
            yield from range(name.end(), start, -1)
        yield from self.vocabulary.ends(self.text, start)

    def _word(self, start: int) -> Token | None:
        """Returns the word of the language at `start`; None if it is only the beginning of a longer name."""
        word, name = _WORD.match(self.text, start), _NAME.match(self.text, start)
        if not word or not name:
            return None
        if word[0] in KEYWORDS:
            return Token("operator", word[0], start, word.end())
        known = word[0] in self.vocabulary.constants or word[0] in _CALLED
        ends = word.end() == name.end() or self.text[word.end()] in "/-"
        return Token("word", word[0], start, word.end()) if known and ends else None

    def _quoted_column(self, start: int) -> Token:
        name, end = self.quoted(start)
        column = self.vocabulary.column(name)
        if column is None and set(name) & {*WILDCARDS} and self.vocabulary.matching(name):
            return Token("wildcard", name, start, end)
        if column is None and self.vocabulary.has_texts:
            return Token("text", name, start, end)
        if column is None:
            raise self.vocabulary.missing(name, start, self.source)
        return Token("column", column, start, end)

    def quoted(self, start: int) -> tuple[str, int]:
        """Returns the name or the text in quotes at `start`, and its end."""
        quoted_name, quote = _QUOTED.match(self.text, start), self.text[start]
        if not quoted_name:
            raise self.source.fault(start, "a quote that is not closed", f"another {quote}")
        return quoted_name[0][1:-1].replace(quote * 2, quote), quoted_name.end()

    # --- accessors ---------------------------------------------------------------------------------

    def _opening(self, start: int) -> Token | None:
        """Returns the name of a group that is called at `start`, up to its parenthesis."""
        opening = _OPENING.match(self.text, start)
        if not opening or opening[1] in (*_CALLED, *KEYWORDS) or not self.vocabulary.is_group(opening[1]):
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
        if self.text[start : start + 1] in QUOTES:
            name, end = self.quoted(start)
            return Token("object", name, start, end)
        bare = _BARE.match(self.text, start)
        if not bare:
            raise self.source.fault(start, self._found(start), "the name of an object")
        return Token("object", bare[0], start, bare.end())

    def _found(self, position: int) -> str:
        return quoted(self.text[position]) if position < len(self.text) else "the end"
