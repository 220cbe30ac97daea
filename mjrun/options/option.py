"""What an option is, and how a class of them is declared."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Flag, auto
from functools import cache
from typing import ClassVar, TypeVar, cast, dataclass_transform

from mjrun.errors import BadValueError, UsageError
from mjrun.errors import option as mention
from mjrun.options.kinds import AnyKind, ExpectedError

V = TypeVar("V")
T = TypeVar("T")
C = TypeVar("C")


class FrontEnd(Flag):
    """Who knows an option."""

    COMMAND = auto()
    DOCUMENT = auto()
    PYTHON = auto()
    EVERYWHERE = COMMAND | DOCUMENT | PYTHON


@dataclass(frozen=True)
class Option:
    """One option, as every front end needs to know it.

    Attributes:
      name: the same everywhere: `trail_span`; the command line writes `--trail-span`.
      attribute: of the class that declares it: the name, or `assert_` where that is a word of Python's.
      kind: of its values.
      help: one or two sentences, with the unit.
      default: what it is when nothing is said; `dataclasses.MISSING` where something must be said.
      usual: what help shows instead of a default that says nothing by itself.
      short: a second spelling on the command line, `-o`.
      section: heading under which help lists it.
      places: who knows it.
      flag_value: on the command line, the value of the option without one.
      plural: what documents call it where they hold all of several in one place.
    """

    name: str
    attribute: str
    kind: AnyKind
    help: str
    default: object
    usual: str
    short: tuple[str, ...]
    section: str
    places: FrontEnd
    flag_value: str | None
    plural: str

    @property
    def key(self) -> str:
        """Its key in documents."""
        return self.plural or self.name

    @property
    def is_required(self) -> bool:
        """Whether something must be said."""
        return self.default is dataclasses.MISSING


@dataclass(frozen=True)
class Exclusion:
    """Options that cannot both be given, and why: "both say how long".

    Attributes:
      when: an option and its value without which they can, if there is one.
    """

    names: tuple[str, str]
    reason: str
    when: tuple[str, object] | None = None

    def applies(self, value: object) -> bool:
        """Whether it holds, given the value of the option in `when`."""
        return self.when is None or value == self.when[1]

    def message(self, spelling: Callable[[str], str] = mention) -> str:
        """The sentence."""
        one, other = map(spelling, self.names)
        return f"{one} and {other} exclude each other: {self.reason}"


def option(
    *,
    converter: Callable[[V], T],
    help: str,  # noqa: A002
    default: V,
    usual: str = "",
    short: str | tuple[str, ...] = (),
    places: FrontEnd = FrontEnd.EVERYWHERE,
    flag_value: str | None = None,
    plural: str = "",
    kw_only: bool = True,
) -> T:
    """Declares a field of a class of options; `converter` is its `Kind`."""
    made = converter(default)
    facts = {**_facts(converter, help, usual, short, places), "flag_value": flag_value, "plural": plural}
    if isinstance(made, dict):
        return dataclasses.field(default_factory=dict, kw_only=kw_only, metadata=facts)  # type: ignore[return-value]
    return dataclasses.field(default=made, kw_only=kw_only, metadata=facts)


def required(
    *,
    converter: Callable[[V], T],
    help: str,  # noqa: A002
    usual: str = "",
    short: str | tuple[str, ...] = (),
    places: FrontEnd = FrontEnd.EVERYWHERE,
    kw_only: bool = True,
) -> T:
    """The same, where something must be said."""
    return dataclasses.field(kw_only=kw_only, metadata=_facts(converter, help, usual, short, places))


def _facts(kind: object, text: str, usual: str, short: str | tuple[str, ...], places: FrontEnd) -> dict[str, object]:
    shorts = (short,) if isinstance(short, str) else short
    facts: dict[str, object] = {"flag_value": None, "plural": ""}
    return {**facts, "kind": kind, "help": text, "usual": usual, "short": shorts, "places": places}


class Options:
    """Base of all classes of options: frozen values, checked and converted as they are made.

    Attributes:
      section: heading in help.
      exclusions: pairs of options that cannot both be given.
    """

    section: ClassVar[str] = "Options"
    exclusions: ClassVar[tuple[Exclusion, ...]] = ()

    def __post_init__(self) -> None:
        given: set[str] = set()
        for each in options_of(type(self)):
            value = getattr(self, each.attribute)
            try:
                made = each.kind(value)
            except ExpectedError as error:
                wrong = _shown(value) if error.part is None else error.part
                raise BadValueError(mention(each.name), wrong, error.expected) from None
            except (AttributeError, TypeError, ValueError) as error:
                expected = each.kind.accepted or f"a value that this option accepts ({each.kind.metavar})"
                raise BadValueError(mention(each.name), value, expected) from error
            object.__setattr__(self, each.attribute, made)
            if _is_given(each, made):
                given.add(each.name)
        for exclusion in exclusions_of(type(self)):
            condition = exclusion.when and getattr(self, exclusion.when[0])
            if given.issuperset(exclusion.names) and exclusion.applies(condition):
                raise UsageError(exclusion.message(), path=(exclusion.names[1],))


def _shown(value: object) -> object:
    """A value as messages show it: the numbers of a list short, side by side."""
    if isinstance(value, list | tuple):
        parts = cast("Sequence[object]", value)
        return ", ".join(f"{part:g}" if isinstance(part, float) else str(part) for part in parts)
    return value


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(option, required, dataclasses.field))
def options(cls: type[C]) -> type[C]:
    """Makes a class of options: a frozen dataclass of keywords."""
    return dataclass(frozen=True, kw_only=True)(cls)


@cache
def options_of(cls: type[Options]) -> tuple[Option, ...]:
    """The options that `cls` declares and inherits, its own first."""
    declared: dict[str, Option] = {}
    for home in cls.__mro__:
        for each in _declared(home, cls):
            declared.setdefault(each.name, each)
    return tuple(declared.values())


def document_options(declared: type[Options]) -> list[Option]:
    """Those options that documents know."""
    return [each for each in options_of(declared) if FrontEnd.DOCUMENT in each.places]


def is_always_written(each: Option) -> bool:
    """Whether a document must say something: it has no standard output."""
    return each.is_required or each.name == "output"


@cache
def exclusions_of(cls: type[Options]) -> tuple[Exclusion, ...]:
    """The exclusions that `cls` declares and inherits."""
    return tuple(dict.fromkeys(each for home in cls.__mro__ for each in vars(home).get("exclusions", ())))


@cache
def _by_name(cls: type[Options]) -> dict[str, Option]:
    return {each.name: each for each in options_of(cls)}


def is_given(values: Options, name: str) -> bool:
    """Whether an option is other than its default."""
    each = _by_name(type(values))[name]
    return _is_given(each, getattr(values, each.attribute))


def _is_given(each: Option, value: object) -> bool:
    if value is None or each.default is None:
        return value is not None
    return value is not each.default and value != each.default


def _declared(home: type, cls: type[Options]) -> Iterator[Option]:
    fields = {field.name: field for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    section = vars(home).get("section", cls.section)
    for attribute in vars(home).get("__annotations__", {}):
        field = fields.get(attribute)
        if field is None or "kind" not in field.metadata:
            continue
        default = field.default_factory() if callable(field.default_factory) else field.default
        yield Option(attribute.rstrip("_"), attribute, default=default, section=section, **field.metadata)
