"""Checks of plain document values by rules in JSON Schema, with paths and messages."""

import math
import re
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field, replace
from typing import cast

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, quoted, suggestion

# A rule of JSON Schema, with annotations for messages:
#   expected: the expected value, whatever part of the rule fails
#   forms: the expected value if its type matches no member of anyOf
#   counted: the noun for the items of a list of fixed length
Schema = Mapping[str, object]
Path = tuple[str | int, ...]

ANNOTATIONS = ("expected", "forms", "counted")
NUMBER: Schema = {"type": "number"}
TEXT: Schema = {"type": "string", "minLength": 1}
TYPES = {
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "string": "text",
    "array": "a list",
    "object": "a mapping",
}
_TYPE_NAMES: dict[type, str] = {
    bool: "boolean",
    int: "integer",
    float: "number",
    str: "string",
    list: "array",
    dict: "object",
}


class InvalidValueError(ValueError):
    """A value that its kind does not accept.

    Attributes:
      expected: completes the sentence "… is not".
      part: the invalid part of a text that holds several values; None if the whole text is invalid.
    """

    def __init__(self, expected: str, part: str | None = None) -> None:
        self.expected, self.part = expected, part
        super().__init__(expected)


@dataclass(frozen=True)
class SchemaViolation:
    """A value in a document that does not fit its rule.

    Attributes:
      path: the path from the checked value.
      expected: the expected value; if empty,
      message: the problem; if empty,
      error: the error that the conversion of the value raised; it has a separate path.
      hint: text after the expected and the actual value.
      keys: the keys of the mapping if `path` ends with an unknown key.
      places: paths, as text, of items that would accept this key, such as `videos[0].fps`.
    """

    path: Path = ()
    expected: str = ""
    message: str = ""
    error: UsageError | None = None
    hint: str = ""
    keys: Sequence[str] | None = None
    places: Sequence[str] = ()


class SchemaViolationError(ValueError):
    """Values of a document that do not fit their rules."""

    def __init__(self, violations: Sequence[SchemaViolation]) -> None:
        self.violations = violations
        super().__init__(
            "; ".join(f"{violation.path}: {violation.expected or violation.message}" for violation in violations)
        )


@dataclass
class SchemaViolationCollector:
    """A collection of the violations in the parts of a value."""

    all: list[SchemaViolation] = field(default_factory=list[SchemaViolation])

    @contextmanager
    def at(self, *path: str | int) -> Generator[None]:
        """Collects the errors about the part at `path`."""
        try:
            yield
        except SchemaViolationError as error:
            self.all += [replace(violation, path=(*path, *violation.path)) for violation in error.violations]
        except InvalidValueError as error:
            sentence = "" if error.part is None else f"{quoted(error.part)} is not {error.expected}"
            self.all.append(SchemaViolation(path, error.expected * (not sentence), sentence))
        except UsageError as error:
            self.all.append(SchemaViolation(path, error=error))

    def raise_if_any(self) -> None:
        """Raises SchemaViolationError with all collected violations."""
        if self.all:
            raise SchemaViolationError(self.all)


def check(value: object, schema: Schema) -> None:
    """Checks a plain value by a rule without references.

    Raises:
      SchemaViolationError: there are violations; the error has all of them.
    """
    if violations := [*_violations(value, schema)]:
        raise SchemaViolationError(violations)


def type_name(value: object) -> str:
    """Returns JSON's name for the type of a value."""
    return _TYPE_NAMES.get(type(value), "null")


def _violations(value: object, schema: Schema, path: Path = ()) -> Iterator[SchemaViolation]:
    if "expected" in schema:
        rest = {key: rule for key, rule in schema.items() if key != "expected"}
        if any(_violations(value, rest)):
            yield SchemaViolation(path, str(schema["expected"]))
    elif "anyOf" in schema:
        members = [rule for rule in cast("Sequence[Schema]", schema["anyOf"]) if _has_type(value, rule, loosely=True)]
        if members:
            yield from _violations(value, members[0], path)
        else:
            yield SchemaViolation(path, str(schema.get("forms", "")))
    elif schema and not _has_type(value, schema):
        yield SchemaViolation(path, _words(schema) or TYPES[str(schema["type"])])
    elif schema:
        yield from _violations_of_type(value, schema, path)


def _has_type(value: object, schema: Schema, loosely: bool = False) -> bool:
    name, wanted = type_name(value), schema.get("type")
    numbers = ("integer", "number")
    return name == wanted or (wanted in (numbers if loosely else numbers[1:]) and name in numbers)


def _violations_of_type(value: object, schema: Schema, path: Path) -> Iterator[SchemaViolation]:
    match value:
        case str():
            yield from _text_violations(value, schema, path)
        case list():
            items = cast("list[object]", value)
            if message := wrong_length(len(items), schema):
                yield SchemaViolation(path, message=message)
                return
            rules = cast("Sequence[Schema]", schema.get("prefixItems") or [schema["items"]] * len(items))
            for index, (item, rule) in enumerate(zip(items, rules, strict=True)):
                yield from _violations(item, rule, (*path, index))
        case dict():
            rule = cast("Schema", schema["additionalProperties"])
            for key, item in cast("dict[str, object]", value).items():
                yield from _violations(item, rule, (*path, key))
        case int() | float():
            if expected := _wrong_number(value, schema):
                yield SchemaViolation(path, expected)
        case _:
            pass


def _words(schema: Schema) -> str:
    """Lists the words of an `enum`, as in "'hold' or 'linear'"."""
    *most, last = [f"'{word}'" for word in cast("Sequence[str]", schema.get("enum") or [""])]
    return "" if "enum" not in schema else f"{', '.join(most)} or {last}" if most else last


def _text_violations(text: str, schema: Schema, path: Path) -> Iterator[SchemaViolation]:
    words = cast("Sequence[str]", schema.get("enum", [text]))
    if text not in words:
        yield SchemaViolation(path, _words(schema), hint=suggestion(text, words))
    elif len(text) < cast("int", schema.get("minLength", 0)):
        yield SchemaViolation(path, "text that is not empty")
    elif not re.search(str(schema.get("pattern", "")), text):
        yield SchemaViolation(path, f"text as in {schema['pattern']}")
    elif "\0" in text:
        yield SchemaViolation(path, message=f"{quoted(text)} contains a null character")


def _wrong_number(number: float, schema: Schema) -> str:
    """Returns the expected number if `number` is out of bounds, or else an empty text."""
    bounds = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum")
    least, above, most, below = (cast("float | None", schema.get(key)) for key in bounds)
    try:
        is_finite = math.isfinite(number)
    except OverflowError:  # a whole number beyond the floats
        is_finite = False
    if not is_finite:
        return "a finite number"
    if above is not None and number <= above:
        return "a positive number" if above == 0 else f"a number above {above:g}"
    if least is not None and number < least:
        return f"a number of at least {least:g}"
    if below is not None and number >= below:
        return f"a number below {below:g}"
    return f"a number of at most {most:g}" if most is not None and number > most else ""


def wrong_length(length: int, schema: Schema) -> str:
    """Returns the message if the length of a list is out of bounds, or else an empty text."""
    least, most = cast("int", schema.get("minItems", 0)), cast("int", schema.get("maxItems", length))
    if least <= length <= most:
        return ""
    if least == most:
        return f"expected {least} {schema.get('counted', 'items')}, got {length or 'none'}"
    bound, count = ("at least", least) if length < least else ("at most", most)
    return f"expected {bound} {count} item{'' if count == 1 else 's'}, got {length or 'none'}"
