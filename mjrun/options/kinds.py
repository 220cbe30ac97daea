"""Kinds of option values: conversion and checks of what Python, a command line and a document give.

A kind is a converter: called with a value from Python, it returns the value checked and immutable. `parse` turns the
text of a command line, and `read` the plain value of a document, into a value for this call; `schema` describes the
latter.

Kinds are plain classes: every command makes all of them before it knows which it needs, and dataclasses would take
longer to generate than all else here.
"""

import re
from collections.abc import Callable, Sequence
from os import PathLike, fspath
from pathlib import PurePath
from typing import Any, Generic, TypeVar, cast

from mjrun.errors import DocumentProblem, suggestion
from mjrun.options.schema_validation import TEXT, InvalidValueError, Schema, SchemaViolationCollector, check
from mjrun.suffixes import is_url

V = TypeVar("V", contravariant=True)
T = TypeVar("T")
W = TypeVar("W")


class ReadingContext:
    """Context in which a document's values are read: the folders of its paths, and kinds of higher rooms.

    This base class changes neither.

    Attributes:
      problems: problems in other documents that this document refers to; they are reported after its own.
      documents: the files of this document and of those that it refers to, once they are read.
    """

    def __init__(self) -> None:
        self.problems: list[DocumentProblem] = []
        self.documents: list[str] = []

    def input(self, path: str) -> str:
        """Resolves the path of an input file."""
        return path

    def output(self, path: str) -> str:
        """Resolves the path of an output file.

        Raises:
          UsageError: a document must not write to this path.
        """
        return path

    def model(self, text: str) -> str:
        """Resolves a model."""
        return text

    def form(self, kind: "AnyKind") -> "AnyKind":
        """Returns the kind that reads values of `kind` from documents."""
        return kind


class Kind(Generic[V, T]):
    """The values that an option accepts.

    Attributes:
      metavar: the placeholder for the value in help texts.
      accepted: completes the sentence "… is not" for values of types that the kind cannot convert.
    """

    metavar: str = "TEXT"
    accepted: str = ""
    is_sequence: bool = False

    def __init__(self, metavar: str = "") -> None:
        self.metavar = metavar or self.metavar

    def __call__(self, value: V) -> T:
        """Converts a value from Python.

        Raises:
          InvalidValueError: the value is invalid.
        """
        raise NotImplementedError

    def parse(self, text: str) -> object:
        """Converts text from a command line to a value that `__call__` accepts.

        Raises:
          InvalidValueError: the text is invalid.
        """
        return text

    @property
    def form(self) -> Schema:
        """The rule for values in documents, without their parts.

        Raises:
          NotImplementedError: documents do not support the kind.
        """
        raise NotImplementedError

    def schema(self, reader: ReadingContext, definitions: dict[str, Schema]) -> Schema:
        """Returns the rule with the rules of all parts; those that have names are added to `definitions`."""
        return self.form

    def read(self, value: object, reader: ReadingContext) -> object:
        """Converts a plain value from a document to a value that `__call__` accepts.

        Raises:
          SchemaViolationError, InvalidValueError: the value is invalid.
          UsageError: a path in it is invalid.
        """
        check(value, self.form)
        return value

    def plain(self, value: T) -> object:
        """Converts `value` to its form in a document; exact numbers are left to the writer."""
        return value


AnyKind = Kind[Any, Any]


class TextKind(Kind[str, str]):
    """Any text."""

    @property
    def form(self) -> Schema:
        return TEXT

    def __call__(self, value: object) -> str:
        if not isinstance(value, str):
            raise InvalidValueError("text")
        return value


class MujocoNameKind(TextKind):
    """The name of a MuJoCo object or setting, such as a visual flag; resolved by the code that uses it.

    Attributes:
      of: the type of the named thing; documents and editors list the names.
    """

    def __init__(self, metavar: str, of: str) -> None:
        super().__init__(metavar)
        self.of = of


class GhostKind(TextKind):
    """The settings of a ghost as text; documents also accept a mapping."""

    metavar = "SETTING,…"


class ChoiceKind(Kind[str, str]):
    """One of several words."""

    def __init__(self, names: tuple[str, ...]) -> None:
        super().__init__("|".join(names))
        self.names = names

    @property
    def form(self) -> Schema:
        return {"type": "string", "enum": [*self.names]}

    def parse(self, text: str) -> str:
        """Returns the word that is `text` but for upper and lower case, which do not count on the command line."""
        return next((name for name in self.names if name.lower() == text.lower()), text)

    def __call__(self, value: str) -> str:
        if value not in self.names:
            hint = suggestion(value, self.names) if isinstance(value, str) else ""  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InvalidValueError(f"one of {', '.join(self.names)}{hint}")
        return value


class FlagKind(Kind[bool, bool]):
    """True or false; `negatable` adds a `--no-` spelling on the command line."""

    def __init__(self, *, negatable: bool = False) -> None:
        self.negatable = negatable

    @property
    def form(self) -> Schema:
        return {"type": "boolean"}

    def __call__(self, value: object) -> bool:
        if not isinstance(value, bool):
            raise InvalidValueError("true or false")
        return value


class NameOrIndexKind(Kind[str | int, str]):
    """An object by name or index: a keyframe, a preset."""

    metavar = "NAME|INDEX"

    def __init__(self, metavar: str = "", expected: str = "the name or index of a keyframe") -> None:
        super().__init__(metavar)
        self.expected = expected

    @property
    def form(self) -> Schema:
        return {"anyOf": [TEXT, {"type": "integer", "minimum": 0}], "forms": self.expected}

    def __call__(self, value: str | int) -> str:
        return str(value)


class PathKind(Kind[str | PathLike[str], str]):
    """A path.

    Attributes:
      written: True for an output; inputs are relative to the document's folder, outputs to the output folder.
      stored: whether an output may be in a store, given by its URL.
      streamed: whether an output may be standard output, written `-`.
      unlike: suffixes that an output must not have, since it would replace what users write, by mistake.
    """

    metavar = "FILE"

    def __init__(
        self,
        metavar: str = "",
        *,
        written: bool = False,
        stored: bool = False,
        streamed: bool = False,
        unlike: Sequence[str] = (),
    ) -> None:
        super().__init__(metavar)
        self.written, self.stored, self.streamed, self.unlike = written, stored, streamed, unlike

    @property
    def form(self) -> Schema:
        return TEXT

    def __call__(self, value: str | PathLike[str]) -> str:
        try:
            path = fspath(value)
        except TypeError:
            given = cast("object", value)  # such as a table, too long to print
            shown = None if given is None or isinstance(given, int | float) else type(given).__name__
            remedy = "" if self.written else "; write data that are in memory to a file first"
            raise InvalidValueError(f"the name of a file{remedy}", shown) from None
        if not path:  # usually an unset variable of a shell script
            raise InvalidValueError("the name of a file")
        if self.written and not self.stored and is_url(path):
            raise InvalidValueError("a path on this machine; only mjrun sweep writes its folder to a store")
        if self.written and not self.streamed and path == "-":
            raise InvalidValueError("the name of a file or folder; it cannot be standard output")
        if PurePath(path).suffix.lower() in self.unlike:
            raise InvalidValueError("a name for this file: it ends like a model, a document or code")
        return path

    def read(self, value: object, reader: ReadingContext) -> object:
        check(value, self.form)
        return reader.output(str(value)) if self.written else reader.input(str(value))


class PythonFunctionKind(Kind[Callable[..., object] | None, Callable[..., object] | None]):
    """Python code that the user names on the command line, or a callable in Python; never in a document."""

    metavar = "CODE"

    def __call__(self, value: object) -> Callable[..., object] | None:
        if value is not None and not callable(value):
            raise InvalidValueError("a function or another object that can be called, not its name")
        return value


class CameraKind(Kind[object, object]):
    """A camera as text, a document of shots, or the value of such a document."""

    metavar = "SPEC"
    accepted = "a camera of the model, a rig as in 'track:hand', or shots"

    def __call__(self, value: object) -> object:
        match value:
            case int():
                return str(value)
            case PathLike():
                return fspath(cast("PathLike[str]", value))
            case _:
                return value


class OneOrMoreKind(Kind["W | Sequence[W]", tuple[T, ...]], Generic[W, T]):
    """One or several values of a kind; repeatable on the command line.

    Attributes:
      commas: True if one text may hold several values, separated by commas outside of brackets.
      expected: the expected text if an empty text is an error.
    """

    def __init__(self, each: Kind[W, T], *, commas: bool = False, expected: str = "") -> None:
        super().__init__(f"{each.metavar},…" if commas else each.metavar)
        self.accepted = each.accepted
        self.each: AnyKind = each
        self.commas, self.expected = commas, expected

    def __call__(self, value: "W | Sequence[W]") -> tuple[T, ...]:
        parts: Sequence[object] = [value] if self._is_one(value) else [*cast("Sequence[object]", value)]
        if self.commas:
            parts = [word for part in parts for word in (self._words(part) if isinstance(part, str) else (part,))]
        return tuple(self.each(part) for part in parts)

    def parse(self, text: str) -> object:
        """Converts one value, or all values in one text."""
        return self._words(text) if self.commas else self.each.parse(text)

    @property
    def repeated(self) -> AnyKind:
        """The kind of one repetition on the command line."""
        return self if self.commas else self.each

    def _words(self, text: str) -> tuple[object, ...]:
        words = [word.strip() for word in re.split(r",(?![^\[]*\])", text) if word.strip()]
        if self.expected and not words:
            raise InvalidValueError(self.expected)
        return tuple(map(self._parse_word, words))

    def plain(self, value: tuple[T, ...]) -> object:
        parts = [self.each.plain(part) for part in value]
        return parts[0] if len(parts) == 1 else parts

    def _parse_word(self, word: str) -> object:
        try:
            return self.each.parse(word)
        except InvalidValueError as error:
            raise InvalidValueError(error.expected, word) from None

    def _is_one(self, value: object) -> bool:
        """Returns whether `value` is a single value; (640, 480) is one size."""
        if not isinstance(value, Sequence) or isinstance(value, str):
            return True
        parts = cast("Sequence[object]", value)
        return self.each.is_sequence and len(parts) == 2 and not isinstance(parts[0], Sequence)

    def read(self, value: object, reader: ReadingContext) -> object:
        each = reader.form(self.each)
        if not isinstance(value, list):
            return (each.read(value, reader),)
        return read_list(each, cast("list[object]", value), reader)

    def schema(self, reader: ReadingContext, definitions: dict[str, Schema]) -> Schema:
        each = reader.form(self.each).schema(reader, definitions)
        return {"anyOf": [each, {"type": "array", "items": each}]}


def optional(each: Kind[W, T]) -> Kind[W | None, T | None]:
    """Returns a kind whose value may be left out, as of every option with the default None."""
    return cast("Kind[W | None, T | None]", each)


def read_list(each: AnyKind, items: Sequence[object], reader: ReadingContext) -> tuple[object, ...]:
    """Reads the items of a list in a document.

    Raises:
      SchemaViolationError: there are violations; the error has all of them.
    """
    parts: list[object] = []
    violations = SchemaViolationCollector()
    for index, item in enumerate(items):
        with violations.at(index):
            parts.append(each.read(item, reader))
    violations.raise_if_any()
    return tuple(parts)
