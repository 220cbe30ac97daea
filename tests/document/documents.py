"""Small documents and their models, for the tests of reading."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from mjrun.document import reader
from mjrun.errors import DocumentError, FileError
from mjrun.options.kinds import Kind, ReadingContext, TextKind, optional
from mjrun.options.number_kinds import IntegerKind, RealKind
from mjrun.options.option import Options, option, options, required
from mjrun.options.setting_kinds import NamedNumbersKind
from mjrun.options.structured_kinds import ListKind, OptionsMappingKind

ANCHOR = "anchors (&) and aliases (*) are not supported; put such text in quotes"


class AnyKind(Kind[Any, Any]):
    """Any value."""

    def __call__(self, value: Any) -> Any:
        return value

    def read(self, value: object, reader: ReadingContext) -> object:
        return value


@options
class Nothing(Options):
    """A document without options."""


@options
class Anything(Options):
    """A document that says one thing, whatever it is."""

    a: Any = required(converter=AnyKind(), help="Anything.")


@options
class Film(Options):
    """A part of a document."""

    fps: float = option(converter=RealKind(above=0), default=60.0, help="Frames per second.")
    title: str | None = option(converter=optional(TextKind()), default=None, help="A text.")


@options
class Run(Options):
    """A document as the ones to come will be."""

    duration: float = option(converter=RealKind(above=0), default=1.0, help="How long [s].")
    steps: int | None = option(converter=optional(IntegerKind(None)), default=None, help="How many.")
    model: str = option(converter=TextKind(), default="m.xml", help="A file.")
    films: tuple[Film, ...] = option(
        converter=ListKind[Film](OptionsMappingKind(Film, Film)), default=(), help="Films."
    )
    start: Any = option(converter=NamedNumbersKind(), default={}, help="Numbers by name.")


def read(path: Path | str, declared: type[Options], assignments: Sequence[str] = (), *, variables: bool = False) -> Any:
    """The document at `path` as the options that it holds."""
    return reader.read(path, OptionsMappingKind(declared, declared), None, assignments, variables=variables)[0]


def put(text: str | bytes, name: str = "d.yaml") -> Path:
    path = Path(name)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def problems(action: Callable[[], object]) -> list[str]:
    """The lines of the error that `action` ends in."""
    with pytest.raises(DocumentError) as caught:
        action()
    return str(caught.value).splitlines()


def outcome(action: Callable[[], object]) -> object:
    """What `action` gives, or the error that it may end in."""
    try:
        return action()
    except (DocumentError, FileError) as error:
        return error
