"""Values that run documents write in more than one way: exact numbers, sizes, one of something or a list of it."""

import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Annotated, TypeVar, cast

from pydantic import AfterValidator, Discriminator, Field, PlainValidator, Tag, WithJsonSchema
from pydantic.fields import FieldInfo

from mjrun.document.document_model import LIST, NUMBER, InvalidValueError, Name, by_type
from mjrun.document.output_folder import refusal
from mjrun.errors import UsageError
from mjrun.options import kinds as option_kinds
from mjrun.options.kinds import ExpectedError

ONE = "\0one"
T = TypeVar("T")


def _list_or_one(value: object) -> str:
    return LIST if isinstance(value, list | tuple) else ONE


Several = Annotated[
    Annotated[T, Tag(ONE)] | Annotated[list[T], Tag(LIST)],
    Discriminator(_list_or_one),
]
"""One of something, or a list."""


def as_tuple(value: object) -> tuple[object, ...]:
    """The values of a `Several`."""
    return tuple(cast("list[object]", value)) if isinstance(value, list) else (value,)


def _exact(kind: option_kinds.ExactNumber, expected: str, bound: FieldInfo) -> PlainValidator:
    """Reads a number, or text such as `30000/1001`, as the exact number that is written."""

    def exact(value: object) -> Fraction:
        try:
            if isinstance(value, int | float | str) and not isinstance(value, bool):
                return kind(value)
        except ExpectedError:
            pass
        raise InvalidValueError("expected", expected=expected)

    text = Field(pattern=r"^[0-9.]+(/[0-9]+|[eE][-+]?[0-9]+)?$")
    return PlainValidator(exact, json_schema_input_type=Annotated[float, bound] | Annotated[str, text])


Exact = Annotated[Fraction, _exact(option_kinds.ExactNumber(), "a positive number", Field(gt=0))]
Instant = Annotated[Fraction, _exact(option_kinds.ExactNumber(zero=True), "a number of at least 0", Field(ge=0))]


def _size(value: object) -> tuple[int, int]:
    """`1280x720`, or a list of both."""
    match value:
        case str() if match := re.fullmatch(r"([0-9]{1,9})[xX]([0-9]{1,9})", value):
            width, height = int(match[1]), int(match[2])
        case [int() as width, int() as height] if not isinstance(width, bool) and not isinstance(height, bool):
            pass
        case _:
            width = height = 0
    if width > 0 and height > 0:
        return width, height
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


def checked_by(check: Callable[[str], object]) -> AfterValidator:
    """Refuses texts that `check` refuses, in its words."""

    def checked(text: str) -> str:
        try:
            check(text)
        except UsageError as error:
            raise InvalidValueError.with_message(error.one_line()) from None
        return text

    return AfterValidator(checked)


def suggested(names: Sequence[str]) -> WithJsonSchema:
    """Tells editors the names that a text may have."""
    return WithJsonSchema({"type": "string", "enum": list(names)})


def _inside(text: str) -> str:
    if reason := refusal(text):
        raise InvalidValueError.with_message(reason)
    return text


OutputPath = Annotated[Name, AfterValidator(_inside)]  # a path that a document may write to, judged by its text
