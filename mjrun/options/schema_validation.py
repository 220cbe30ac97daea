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
class Misfit:
    """A value in a document that does not fit its rule.

    Attributes:
      path: the path from the checked value.
      expected: the expected value; if empty,
      message: the problem; if empty,
      error: the error that the conversion of the value raised; it has a separate path.
      hint: text after the expected and the actual value.
      keys: the keys of the mapping if `path` ends with an unknown key.
    """

    path: Path = ()
    expected: str = ""
    message: str = ""
    error: UsageError | None = None
    hint: str = ""
    keys: Sequence[str] | None = None


class MisfitError(ValueError):
    """Values of a document that do not fit their rules."""

    def __init__(self, misfits: Sequence[Misfit]) -> None:
        self.misfits = misfits
        super().__init__("; ".join(f"{misfit.path}: {misfit.expected or misfit.message}" for misfit in misfits))


@dataclass
class Misfits:
    """A collection of the misfits in the parts of a value."""

    all: list[Misfit] = field(default_factory=list[Misfit])

    @contextmanager
    def at(self, *path: str | int) -> Generator[None]:
        """Collects the errors about the part at `path`."""
        try:
            yield
        except MisfitError as error:
            self.all += [replace(misfit, path=(*path, *misfit.path)) for misfit in error.misfits]
        except InvalidValueError as error:
            sentence = "" if error.part is None else f"{quoted(error.part)} is not {error.expected}"
            self.all.append(Misfit(path, error.expected * (not sentence), sentence))
        except UsageError as error:
            self.all.append(Misfit(path, error=error))

    def raise_if_any(self) -> None:
        """Raises MisfitError with all collected misfits."""
        if self.all:
            raise MisfitError(self.all)


def check(value: object, schema: Schema) -> None:
    """Checks a plain value by a rule without references.

    Raises:
      MisfitError: there are misfits; the error has all of them.
    """
    if misfits := [*_misfits(value, schema)]:
        raise MisfitError(misfits)


def type_name(value: object) -> str:
    """Returns JSON's name for the type of a value."""
    return _TYPE_NAMES.get(type(value), "null")


def _misfits(value: object, schema: Schema, path: Path = ()) -> Iterator[Misfit]:
    if "expected" in schema:
        rest = {key: rule for key, rule in schema.items() if key != "expected"}
        if any(_misfits(value, rest)):
            yield Misfit(path, str(schema["expected"]))
    elif "anyOf" in schema:
        members = [rule for rule in cast("Sequence[Schema]", schema["anyOf"]) if _has_type(value, rule, loosely=True)]
        if members:
            yield from _misfits(value, members[0], path)
        else:
            yield Misfit(path, str(schema.get("forms", "")))
    elif schema and not _has_type(value, schema):
        yield Misfit(path, _words(schema) or TYPES[str(schema["type"])])
    elif schema:
        yield from _misfits_of_type(value, schema, path)


def _has_type(value: object, schema: Schema, loosely: bool = False) -> bool:
    name, wanted = type_name(value), schema.get("type")
    numbers = ("integer", "number")
    return name == wanted or (wanted in (numbers if loosely else numbers[1:]) and name in numbers)


def _misfits_of_type(value: object, schema: Schema, path: Path) -> Iterator[Misfit]:
    match value:
        case str():
            yield from _text_misfits(value, schema, path)
        case list():
            items = cast("list[object]", value)
            if message := wrong_length(len(items), schema):
                yield Misfit(path, message=message)
                return
            rules = cast("Sequence[Schema]", schema.get("prefixItems") or [schema["items"]] * len(items))
            for index, (item, rule) in enumerate(zip(items, rules, strict=True)):
                yield from _misfits(item, rule, (*path, index))
        case dict():
            rule = cast("Schema", schema["additionalProperties"])
            for key, item in cast("dict[str, object]", value).items():
                yield from _misfits(item, rule, (*path, key))
        case int() | float():
            if expected := _wrong_number(value, schema):
                yield Misfit(path, expected)
        case _:
            pass


def _words(schema: Schema) -> str:
    """Lists the words of an `enum`, as in "'hold' or 'linear'"."""
    *most, last = [f"'{word}'" for word in cast("Sequence[str]", schema.get("enum") or [""])]
    return "" if "enum" not in schema else f"{', '.join(most)} or {last}" if most else last


def _text_misfits(text: str, schema: Schema, path: Path) -> Iterator[Misfit]:
    words = cast("Sequence[str]", schema.get("enum", [text]))
    if text not in words:
        yield Misfit(path, _words(schema), hint=suggestion(text, words))
    elif len(text) < cast("int", schema.get("minLength", 0)):
        yield Misfit(path, "text that is not empty")
    elif not re.search(str(schema.get("pattern", "")), text):
        yield Misfit(path, f"text as in {schema['pattern']}")
    elif "\0" in text:
        yield Misfit(path, message=f"{quoted(text)} contains a null character")


def _wrong_number(number: float, schema: Schema) -> str:
    """Returns the expected number if `number` is out of bounds, or else an empty text."""
    least, above, most = (cast("float | None", schema.get(key)) for key in ("minimum", "exclusiveMinimum", "maximum"))
    if not math.isfinite(number):
        return "a finite number"
    if above is not None and number <= above:
        return "a positive number" if above == 0 else f"a number above {above:g}"
    if least is not None and number < least:
        return f"a number of at least {least:g}"
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
