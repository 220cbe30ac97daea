"""Values that run documents write in more than one way: exact numbers, sizes, one of something or a list of it."""

import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, Discriminator, Field, PlainValidator, Tag, WithJsonSchema

from mjrun.document.document_model import LIST, NUMBER, InvalidValueError, by_type
from mjrun.errors import UsageError
from mjrun.options import kinds as option_kinds
from mjrun.options.kinds import ExpectedError

ONE = "\0one"
T = TypeVar("T")

Several = Annotated[
    Annotated[T, Tag(ONE)] | Annotated[list[T], Tag(LIST)],
    Discriminator(lambda value: LIST if isinstance(value, list | tuple) else ONE),
]
"""One of something, or a list."""


def as_tuple(given: T | list[T]) -> tuple[T, ...]:
    """What `Several` holds."""
    return tuple(given) if isinstance(given, list) else (given,)


def _exact(kind: option_kinds.ExactNumber, expected: str, bound: Any) -> Any:
    """Reads a number, or text such as `30000/1001`, as the exact number that is written."""

    def exact(value: Any) -> Fraction:
        try:
            if type(value) in (int, float, str):
                return kind(value)
        except ExpectedError:
            pass
        raise InvalidValueError("expected", expected=expected)

    text = Field(pattern=r"^[0-9.]+(/[0-9]+|[eE][-+]?[0-9]+)?$")
    return PlainValidator(exact, json_schema_input_type=Annotated[float, bound] | Annotated[str, text])


Exact = Annotated[Fraction, _exact(option_kinds.ExactNumber(), "a positive number", Field(gt=0))]
Instant = Annotated[Fraction, _exact(option_kinds.ExactNumber(zero=True), "a number of at least 0", Field(ge=0))]


def _size(value: Any) -> tuple[int, int]:
    """`1280x720`, or a list of both."""
    written = re.fullmatch(r"([0-9]{1,9})[xX]([0-9]{1,9})", value) if isinstance(value, str) else None
    sides = [int(side) for side in written.groups()] if written else value
    if isinstance(sides, list) and len(sides) == 2 and all(type(side) is int and side > 0 for side in sides):
        return sides[0], sides[1]
    raise InvalidValueError("expected", expected="width and height in pixels, as in 1280x720 or [1280, 720]")


Side = Annotated[int, Field(gt=0)]
Size = Annotated[
    tuple[int, int],
    PlainValidator(
        _size,
        json_schema_input_type=Annotated[str, Field(pattern="^[0-9]+[xX][0-9]+$")]
        | Annotated[list[Side], Field(min_length=2, max_length=2)],
    ),
]
Numbers = Annotated[
    Annotated[float, Tag(NUMBER)] | Annotated[list[float], Field(min_length=1), Tag(LIST)],
    by_type("a number or a list of numbers", NUMBER, LIST),
]


def checked_by(check: Callable[[str], object]) -> Any:
    """Refuses texts that `check` refuses, in its words."""

    def checked(text: str) -> str:
        try:
            check(text)
        except UsageError as error:
            raise InvalidValueError.with_message(error.one_line()) from None
        return text

    return AfterValidator(checked)


def suggested(names: Sequence[str]) -> Any:
    """Tells editors the names that a text may have."""
    return WithJsonSchema({"type": "string", "enum": list(names)})
