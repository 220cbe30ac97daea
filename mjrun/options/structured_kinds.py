"""Kinds of structured values: mappings whose keys are declared options, lists, and values with several forms."""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Generic, TypeVar, cast

from mjrun.errors import FAULTS
from mjrun.options.kinds import AnyKind, Kind, ReadingContext, read_list
from mjrun.options.option import Option, Options, document_options, is_always_written
from mjrun.options.schema_validation import (
    TEXT,
    InvalidValueError,
    Path,
    Schema,
    SchemaViolation,
    SchemaViolationCollector,
    SchemaViolationError,
    check,
    type_name,
    wrong_length,
)

LISTED_KEYS = 6  # at most, in a message about a wrong type

V = TypeVar("V")
T = TypeVar("T")


class OptionsMappingKind(Kind[T, T]):
    """A mapping whose keys are the options of a class; `make` builds its value.

    Args:
      make: builds the value from keyword arguments; `dict` keeps them.
      name: the name of the rule in JSON Schema.
      more: additional keys, listed first.
      optional: required options that a document may leave out.
      blank: accept `key:` alone as an empty mapping, with the default of every key.
      is_partial: the command line may add options, so that requirements are checked when the value is made.
    """

    metavar = "MAPPING"

    def __init__(
        self,
        declared: type[Options],
        make: Callable[..., T],
        *,
        name: str = "",
        more: Sequence[Option] = (),
        optional: Sequence[str] = (),
        blank: bool = False,
        is_partial: bool = False,
    ) -> None:
        super().__init__()
        self._more, self._optional = more, optional
        self.declared, self.make = declared, make
        self.name, self.blank, self._is_partial = name or declared.__name__, blank, is_partial

    def options(self) -> list[Option]:
        """Returns the options of the mapping."""
        return [*self._more, *document_options(self.declared)]

    @property
    def keys(self) -> list[str]:
        """The accepted keys."""
        return [each.key for each in self.options()]

    def _is_needed(self, each: Option) -> bool:
        return is_always_written(each) and each.key not in self._optional

    def __call__(self, value: T) -> T:
        if isinstance(self.make, type) and not isinstance(value, self.make):
            raise InvalidValueError(f"a {self.make.__name__}")
        return value

    def conflicts(self, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        """Checks combinations of valid values, as `Options.conflicts` does."""
        yield from self.declared.conflicts(values)
        if not self._is_partial:
            yield from self.declared.unmet_requirements(values)

    def read(self, value: object, reader: ReadingContext) -> object:
        if value is None and self.blank:
            value = {}
        options = {each.key: each for each in self.options()}
        if not isinstance(value, dict):
            few = f" with {', '.join(options)}" if len(options) <= LISTED_KEYS else ""
            raise InvalidValueError(f"a mapping{few}")

        written = cast("dict[str, object]", value)
        violations = SchemaViolationCollector(
            [SchemaViolation(path, message=message) for path, message in self.conflicts(written)]
        )
        values: dict[str, object] = {}
        for key, part in written.items():
            each = options.get(key)
            if each is None:
                # Comparing thousands of keys to suggest similar ones would be slow, and few are shown.
                keys = [*options] if len(violations.all) < FAULTS else []
                places = [*_places(key, written, options)] if keys else []
                violations.all.append(SchemaViolation((key,), keys=keys, places=places))
                continue
            with violations.at(key):
                values[each.attribute] = reader.form(each.kind).read(part, reader)
        missing = (key for key, each in options.items() if self._is_needed(each) and key not in written)
        violations.all += [SchemaViolation((), message=f"'{key}' is missing") for key in missing]
        violations.raise_if_any()
        return self.make(**values)

    def schema(self, reader: ReadingContext, definitions: dict[str, Schema]) -> Schema:
        if self.name not in definitions:
            definitions[self.name] = {}  # a part may refer to the same rule
            definitions[self.name] = self.mapping_schema(reader, definitions)
        reference: Schema = {"$ref": f"#/$defs/{self.name}"}
        return {"anyOf": [reference, {"type": "null"}]} if self.blank else reference

    def mapping_schema(self, reader: ReadingContext, definitions: dict[str, Schema]) -> dict[str, object]:
        """Returns the rule of the mapping itself."""
        properties: dict[str, Schema] = {}
        for each in self.options():
            rule = dict(reader.form(each.kind).schema(reader, definitions))
            needed = self._is_needed(each)
            rule["description"] = each.help + (f" If left out: {each.usual}." if each.usual and not needed else "")
            if not needed and not each.is_required and each.default is not None:
                default = reader.form(each.kind).plain(each.default)
                rule["default"] = float(default) if isinstance(default, Fraction) else default
            properties[each.key] = rule
        about = (inspect.getdoc(self.declared) or "").partition("\n\n")[0]
        schema: dict[str, object] = {"title": self.name, "description": about, "type": "object"}
        schema |= {"properties": properties, "additionalProperties": False}
        required = [each.key for each in self.options() if self._is_needed(each)]
        return {**schema, "required": required} if required else schema

    def plain(self, value: T) -> object:
        return plain_values(cast("Options", value))


def _places(key: str, written: Mapping[str, object], options: Mapping[str, Option]) -> Iterator[str]:
    """Yields the place of `key` in the first item of each list in `written` whose items accept it."""
    for name, part in written.items():
        kind = options[name].kind if name in options else None
        if not isinstance(kind, ListKind) or not mappings_in(part):
            continue
        item = kind.each.members.get("object") if isinstance(kind.each, OneOfKind) else kind.each
        if isinstance(item, OptionsMappingKind) and key in item.keys:
            yield f"{name}[0].{key}"


class ListKind(Kind[Sequence[T], tuple[T, ...]], Generic[T]):
    """A list of values of one kind; a single value is not accepted in its place.

    Attributes:
      least: the minimum number of items.
    """

    metavar = "LIST"
    accepted = "a list"

    def __init__(self, each: AnyKind, least: int = 0) -> None:
        super().__init__()
        self.each, self.least = each, least

    def __call__(self, value: Sequence[T]) -> tuple[T, ...]:
        items = tuple(self.each(item) for item in value)
        if len(items) < self.least:
            raise InvalidValueError(f"at least {self.least}", str(len(items)))
        return items

    def read(self, value: object, reader: ReadingContext) -> object:
        if not isinstance(value, list):
            raise InvalidValueError(self.accepted)
        items = cast("list[object]", value)
        if message := wrong_length(len(items), {"minItems": self.least}):
            raise SchemaViolationError([SchemaViolation(message=message)])
        return read_list(reader.form(self.each), items, reader)

    def schema(self, reader: ReadingContext, definitions: dict[str, Schema]) -> Schema:
        rule: Schema = {"type": "array", "items": reader.form(self.each).schema(reader, definitions)}
        return {**rule, "minItems": self.least} if self.least else rule

    def plain(self, value: tuple[T, ...]) -> object:
        return [self.each.plain(item) for item in value]


class MappingKind(Kind[Mapping[str, T], Mapping[str, T]], Generic[T]):
    """A mapping from names to values of one kind."""

    metavar = "MAPPING"

    def __init__(self, each: AnyKind) -> None:
        super().__init__()
        self.each = each

    def __call__(self, value: Mapping[str, T]) -> Mapping[str, T]:
        return {name: self.each(item) for name, item in value.items()}

    def read(self, value: object, reader: ReadingContext) -> object:
        if not isinstance(value, dict):
            raise InvalidValueError("a mapping")
        values: dict[str, object] = {}
        violations = SchemaViolationCollector()
        for name, item in cast("dict[str, object]", value).items():
            with violations.at(name):
                check(name, TEXT)
                values[name] = reader.form(self.each).read(item, reader)
        violations.raise_if_any()
        return values

    def schema(self, reader: ReadingContext, definitions: dict[str, Schema]) -> Schema:
        each = reader.form(self.each).schema(reader, definitions)
        return {"type": "object", "propertyNames": {"minLength": 1}, "additionalProperties": each}


class OneOfKind(Kind[V, T]):
    """A value that a document may write in several forms, distinguished by their JSON types.

    Args:
      forms: the expected forms, for the message about a value of another type.
      members: kinds by JSON type; that of `number` also accepts integers.
    """

    def __init__(self, forms: str, **members: AnyKind) -> None:
        super().__init__()
        self.forms, self.members = forms, members

    def read(self, value: object, reader: ReadingContext) -> object:
        name = type_name(value)
        member = self.members.get(name) or self.members.get({"integer": "number", "number": "integer"}.get(name, ""))
        if member is None:
            raise InvalidValueError(self.forms)
        return member.read(value, reader)

    def schema(self, reader: ReadingContext, definitions: dict[str, Schema]) -> Schema:
        return {"anyOf": [member.schema(reader, definitions) for member in dict.fromkeys(self.members.values())]}


def plain_values(values: Options) -> dict[str, object]:
    """Returns the document keys of options that differ from their defaults."""
    plain: dict[str, object] = {}
    for each in document_options(type(values)):
        value = getattr(values, each.attribute)
        if value is not None and (is_always_written(each) or value != each.default):
            plain[each.key] = each.kind.plain(value)
    return plain


def mappings_in(value: object) -> list[dict[str, object]]:
    """Returns the mappings of a list in a document, or an empty list if it contains anything else."""
    items = cast("list[object]", value) if isinstance(value, list) else []
    mappings = [cast("dict[str, object]", item) for item in items if isinstance(item, dict)]
    return mappings if len(mappings) == len(items) else []
