"""Declarations of options, and classes of them."""

import dataclasses
import inspect
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from enum import Flag, auto
from functools import cache
from typing import Any, ClassVar, TypeVar, cast, dataclass_transform

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UsageError, suggestion
from mjrun.errors import option as mention
from mjrun.options.kinds import AnyKind
from mjrun.options.schema_validation import InvalidValueError, Path

V = TypeVar("V")
T = TypeVar("T")
C = TypeVar("C")

# Names of options in other tools that are too different to be suggested by similarity.
OTHER_NAMES = {
    "at": ("time",),
    "bitrate": ("crf",),
    "baseline": ("compare", "golden"),
    "columns": ("probe",),
    "compare": ("golden",),
    "disable": ("ignore",),
    "duration": ("time", "steps"),
    "exclude": ("ignore",),
    "fields": ("probe",),
    "framerate": ("fps",),
    "height": ("size",),
    "keyframe": ("key",),
    "length": ("duration",),
    "param": ("free", "vary", "set"),
    "parameter": ("free", "vary", "set"),
    "params": ("free", "vary", "set"),
    "randomize": ("vary",),
    "record": ("videos", "recording"),
    "resolution": ("size",),
    "signals": ("probe",),
    "slow_motion": ("speed",),
    "slowmo": ("speed",),
    "strict": ("fail_on",),
    "threshold": ("fail_above", "fail_below"),
    "time": ("duration",),
    "tolerance": ("atol", "rtol"),
    "width": ("size",),
    "workers": ("jobs",),
    "-d": ("duration",),
    "-n": ("episodes", "samples"),
    "-r": ("fps", "rate"),
    "-s": ("size",),
    "-t": ("duration",),
}


class FrontEnd(Flag):
    """Front ends that accept an option."""

    COMMAND = auto()
    DOCUMENT = auto()
    PYTHON = auto()
    EVERYWHERE = COMMAND | DOCUMENT | PYTHON


@dataclass(frozen=True)
class Option:
    """One option, with all facts that front ends use.

    Attributes:
      name: the same in all front ends: `trail_span`; the command line writes `--trail-span`.
      attribute: the attribute of the declaring class: the name, or `assert_` if the name is a Python keyword.
      kind: the kind of the values.
      help: one or two sentences, with the unit.
      default: the default value; `dataclasses.MISSING` for a required option.
      usual: text that help shows instead of a default that would not be informative.
      short: a second spelling on the command line, `-o`.
      section: heading under which help lists it.
      places: the front ends that accept it.
      flag_value: the value that the command line uses if the option is given without one.
      key: the name in documents.
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
    key: str

    @property
    def is_required(self) -> bool:
        """True if the option has no default."""
        return self.default is dataclasses.MISSING


@dataclass(frozen=True)
class OptionExclusion:
    """Two options that exclude each other, with the reason: "both set the length".

    Attributes:
      when: an option and its value, if the exclusion holds only with that value.
    """

    names: tuple[str, str]
    reason: str
    when: tuple[str, object] | None = None

    def applies(self, value: object) -> bool:
        """Returns whether the exclusion holds for a value of the option in `when`."""
        return self.when is None or value == self.when[1]

    def message(self, spelling: Callable[[str], str] = mention) -> str:
        """Returns the error message."""
        one, other = map(spelling, self.names)
        return f"{one} and {other} exclude each other: {self.reason}"


@dataclass(frozen=True)
class OptionRequirement:
    """The requirement of an option for another one, its partner, without which it has no effect.

    Attributes:
      clause: what the option does to the partner: "whose position it sets".
      value: the value that the partner must have, or contain; None if any value will do.
      test: returns whether a value of the partner will do, of which `value` is an example.
      alternatives: options that will do in place of the partner, with any value.
    """

    name: str
    partner: str
    clause: str
    value: str | None = None
    test: Callable[[object], bool] | None = None
    alternatives: tuple[str, ...] = ()

    def is_met(self, values: Mapping[str, object]) -> bool:
        """Returns whether the values of options, by key, meet the requirement."""
        if any(_is_set(values.get(name)) for name in self.alternatives):
            return True
        partner = values.get(self.partner)
        if self.test is not None:
            return self.test(partner)
        if self.value is None:
            return _is_set(partner)
        return partner == self.value or (isinstance(partner, list | tuple) and self.value in partner)

    def message(self, spelling: Callable[[str], str] = mention) -> str:
        """Returns the error message."""
        partner = spelling(self.partner) if self.value is None else f"{spelling(self.partner)} {self.value}"
        others = [*map(spelling, self.alternatives)]
        last = f" or {others.pop()}" if others else ""
        return f"{spelling(self.name)} requires {', '.join([partner, *others])}{last}, {self.clause}"


_OF_CLASS = cast("bool", dataclasses.MISSING)  # `options` and `positional_options` decide


def option(
    *,
    converter: Callable[[V], T],
    help: str,  # noqa: A002
    default: V,
    usual: str = "",
    short: str | tuple[str, ...] = (),
    places: FrontEnd | None = None,
    flag_value: str | None = None,
    key: str = "",
    kw_only: bool = _OF_CLASS,
) -> T:
    """Declares a field of options; `converter` is its `Kind`, and `key` its name in documents if that differs."""
    made = cast("T", None) if default is None else converter(default)
    facts = {**_facts(converter, help, usual, short, places, key), "flag_value": flag_value}
    if isinstance(made, dict):
        return dataclasses.field(default_factory=dict, kw_only=kw_only, metadata=facts)  # type: ignore[return-value]
    return dataclasses.field(default=made, kw_only=kw_only, metadata=facts)


def required(
    *,
    converter: Callable[[V], T],
    help: str,  # noqa: A002
    usual: str = "",
    short: str | tuple[str, ...] = (),
    key: str = "",
    kw_only: bool = _OF_CLASS,
) -> T:
    """Declares a field of options without a default."""
    return dataclasses.field(kw_only=kw_only, metadata=_facts(converter, help, usual, short, None, key))


def _facts(
    kind: object, text: str, usual: str, short: str | tuple[str, ...], places: FrontEnd | None, key: str
) -> dict[str, object]:
    shorts = (short,) if isinstance(short, str) else short
    facts: dict[str, object] = {"kind": kind, "help": text, "usual": usual, "flag_value": None}
    return {**facts, "short": shorts, "places": places, "key": key}


class Options:
    """Base of all classes of options: frozen values, checked and converted on construction.

    Attributes:
      section: heading in help.
      places: the front ends that accept the options that a class declares itself, unless their declarations differ.
      exclusions: pairs of options that exclude each other.
      requirements: options that have no effect without another one.
    """

    section: ClassVar[str] = "Options"
    places: ClassVar[FrontEnd] = FrontEnd.EVERYWHERE
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = ()
    requirements: ClassVar[tuple[OptionRequirement, ...]] = ()

    def __post_init__(self) -> None:
        for each in options_of(type(self)):
            value = getattr(self, each.attribute)
            if value is each.default or (_is_empty(value) and each.default == {}):  # converted when it was declared
                continue
            object.__setattr__(self, each.attribute, converted(mention(each.name), each.kind, value, each.default))
        values = given_values(self)
        for path, message in (*self.conflicts(values), *self.unmet_requirements(values)):
            raise UsageError(located(message, path), path)

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        """Checks combinations of valid values; yields the place and the message of each conflict.

        Args:
          values: the values by key, as a document contains them, of any type.
        """
        for exclusion in exclusions_of(cls):
            condition = exclusion.when and values.get(exclusion.when[0], _by_name(cls)[exclusion.when[0]].default)
            if exclusion.applies(condition) and all(_is_set(values.get(name)) for name in exclusion.names):
                yield (exclusion.names[1],), exclusion.message()

    @classmethod
    def unmet_requirements(cls, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        """Checks that options have the partners without which they have no effect; yields places and messages.

        Args:
          values: the values by key, as for `conflicts`, of the document and the command line together.
        """
        for requirement in requirements_of(cls):
            if _is_set(values.get(requirement.name)) and not requirement.is_met(values):
                yield (requirement.name,), requirement.message()


def converted(name: str, kind: AnyKind, value: object, default: object = None) -> Any:
    """Converts the value of an option, or of another argument, that Python code has given.

    Args:
      name: the name of the argument, as messages show it.
      default: the value that it is compared with, to find out whether it is given.

    Raises:
      BadValueError: the kind does not accept the value.
    """
    try:
        value = _plain(value)
        made = kind(value)
        _ = _is_set(made), _differs(made, default)  # the comparisons of later checks, which tables refuse
    except InvalidValueError as error:
        wrong = _shown(value) if error.part is None else error.part
        raise BadValueError(name, wrong, error.expected) from None
    except (AttributeError, OverflowError, TypeError, ValueError) as error:
        expected = kind.accepted or f"a value that this option accepts ({kind.metavar})"
        raise BadValueError(name, value, expected) from error
    return made


def _plain(value: object) -> object:
    """Converts NumPy's numbers and arrays to Python's, also within lists and dictionaries.

    Raises:
      TypeError: a key of a dictionary is not text.
    """
    if type(value).__module__ == "numpy" and hasattr(value, "tolist"):  # functions have none
        return cast("Any", value).tolist()
    if type(value) is dict:
        named = cast("dict[object, object]", value)
        if not all(isinstance(name, str) for name in named):
            raise TypeError("a name is not text")
        return {name: _plain(each) for name, each in named.items()}
    if type(value) in (list, tuple):
        elements = map(_plain, cast("Sequence[object]", value))
        return [*elements] if type(value) is list else (*elements,)
    return value


def _is_empty(value: object) -> bool:
    """Returns whether a value is an empty dictionary; comparisons of tables and arrays are not true or false."""
    return isinstance(value, dict) and value == {}


def _is_set(value: object) -> bool:
    """Returns whether a value is set: `separate: false` is not."""
    return value is not None and value is not False and value != []


def located(message: str, path: Path) -> str:
    """Prefixes `message` with its place, as in `waypoint 2: at: …`, unless it names the option itself."""
    if not path or mention(str(path[0])) in message:
        return message
    names: list[str] = []
    for step in path:
        if isinstance(step, int):
            names[-1] = f"{names[-1].removesuffix('s')} {step + 1}"
        else:
            names.append(step)
    return ": ".join([*names, message])


def options_for(
    caller: str, given: Mapping[str, object], *classes: type[Options], without: Collection[str] = ()
) -> list[dict[str, Any]]:
    """Returns the keyword arguments of a function that each class declares.

    Args:
      caller: name of the function, for messages.
      without: options that the function does not have.

    Raises:
      TypeError: an option is unknown.
    """
    declared = [{each.attribute for each in options_of(cls)} - {*without} for cls in classes]
    known = sorted(set[str]().union(*declared))
    for name in given:
        if name not in known:
            raise TypeError(f"{caller}: unknown option {name!r}{suggestion(name, known)}")
    return [{name: value for name, value in given.items() if name in names} for names in declared]


def values_of(values: Options, *classes: type[Options]) -> dict[str, Any]:
    """Returns the values of the options of `classes` among those of a derived class, by attribute."""
    return {each.attribute: getattr(values, each.attribute) for cls in classes for each in options_of(cls)}


def given_values(values: Options) -> dict[str, object]:
    """Returns the options that differ from their defaults, by key, as a document contains them."""
    given: dict[str, object] = {}
    for each in options_of(type(values)):
        value = getattr(values, each.attribute)
        if _differs(value, each.default):
            given[each.key] = _as_mappings(value)
    return given


def _as_mappings(value: object) -> object:
    """Replaces options in lists by mappings."""
    items = cast("tuple[object, ...]", value if isinstance(value, tuple) else ())
    mappings = [given_values(item) for item in items if isinstance(item, Options)]
    return mappings or cast("object", value)


def _shown(value: object) -> object:
    """Formats a value for messages, with short numbers in lists."""
    if isinstance(value, list | tuple):
        parts = cast("Sequence[object]", value)
        return ", ".join(f"{part:g}" if isinstance(part, float) else str(part) for part in parts)
    return value


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(option, required, dataclasses.field))
def options(cls: type[C]) -> type[C]:
    """Declares a class of options: a frozen dataclass with keyword arguments."""
    return dataclass(frozen=True, kw_only=True)(cls)


@dataclass_transform(frozen_default=True, field_specifiers=(option, required, dataclasses.field))
def positional_options(cls: type[C]) -> type[C]:
    """Declares a class of options: a frozen dataclass with positional arguments."""
    return dataclass(frozen=True)(cls)


@cache
def options_of(cls: type[Options]) -> tuple[Option, ...]:
    """Returns the options that `cls` declares and inherits, its own first."""
    declared: dict[str, Option] = {}
    for home in cls.__mro__:
        for each in _declared(home, cls):
            declared.setdefault(each.name, each)
    return tuple(declared.values())


def document_options(declared: type[Options]) -> list[Option]:
    """Returns the options that documents accept."""
    return [each for each in options_of(declared) if FrontEnd.DOCUMENT in each.places]


def document_key(key: str, kind: AnyKind, text: str, default: object = None) -> Option:
    """Declares a key that only documents have; with `dataclasses.MISSING` as its default, it is required."""
    facts = _facts(kind, text, "", (), FrontEnd.DOCUMENT, key)
    return Option(key, key, default=default, section="", **cast("dict[str, Any]", facts))


def is_always_written(each: Option) -> bool:
    """Returns whether a document must set the option, as a document cannot write to standard output."""
    return each.is_required or each.name == "output"


@cache
def exclusions_of(cls: type[Options]) -> tuple[OptionExclusion, ...]:
    """Returns the exclusions that `cls` declares and inherits."""
    return tuple(dict.fromkeys(each for home in cls.__mro__ for each in vars(home).get("exclusions", ())))


@cache
def requirements_of(cls: type[Options]) -> tuple[OptionRequirement, ...]:
    """Returns the requirements that `cls` declares and inherits."""
    return tuple(dict.fromkeys(each for home in cls.__mro__ for each in vars(home).get("requirements", ())))


@cache
def _by_name(cls: type[Options]) -> dict[str, Option]:
    return {each.name: each for each in options_of(cls)}


def is_given(values: Options, name: str) -> bool:
    """Returns whether an option differs from its default."""
    each = _by_name(type(values))[name]
    return _differs(getattr(values, each.attribute), each.default)


def _differs(value: object, default: object) -> bool:
    if value is None or default is None:
        return value is not None
    return value is not default and value != default


def _declared(home: type, cls: type[Options]) -> Iterator[Option]:
    fields = {field.name: field for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    section, places = vars(home).get("section", cls.section), vars(home).get("places", Options.places)
    for attribute in inspect.get_annotations(home):
        field = fields.get(attribute)
        if field is None or "kind" not in field.metadata:
            continue
        default = field.default_factory() if callable(field.default_factory) else field.default
        name = attribute.rstrip("_")
        facts: dict[str, Any] = {**field.metadata, "key": field.metadata["key"] or name}
        facts["places"] = facts["places"] or places
        yield Option(name, attribute, default=default, section=section, **facts)
