"""A model of a document refuses what is not in it, and collects every error."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import pytest
from pydantic import Tag, ValidationError

from mjrun.document.document_model import (
    LIST,
    NUMBER,
    DocumentModel,
    InvalidValueError,
    Location,
    Omittable,
    OneOfTexts,
    Positive,
    Vector,
    by_type,
    empty_if_null,
)


class Shelf(DocumentModel):
    """A shelf."""

    width: Positive
    wood: Annotated[str, OneOfTexts(("oak", "ash"))] = "oak"
    depth: Omittable[Positive] = None
    corner: Vector = (0.0, 0.0, 0.0)
    boards: Annotated[
        Annotated[float, Tag(NUMBER)] | Annotated[list[float], Tag(LIST)], by_type("a number or a list", NUMBER, LIST)
    ] = 1.0

    @classmethod
    def cross_field_errors(cls, values: Mapping[str, Any]) -> Iterator[tuple[Location, str]]:
        if values.get("depth") == values.get("width"):
            yield ("depth",), "a shelf is no cube"


def errors(value: object) -> list[tuple[Location, str]]:
    """Where errors are, and of what type or with what message."""
    with pytest.raises(ValidationError) as caught:
        Shelf.model_validate(value)
    details = [(each["loc"], InvalidValueError.from_details(each, ())) for each in caught.value.errors()]
    return [
        (loc, str(error.context.get("message") or error.context.get("expected") or error.type))
        for loc, error in details
    ]


def test_what_is_left_out_has_its_default() -> None:
    shelf = Shelf.model_validate({"width": 2, "boards": [1, 2], "corner": [0, 0, 1]})
    assert shelf.model_dump() == {"width": 2.0, "wood": "oak", "depth": None, "corner": (0, 0, 1), "boards": [1, 2]}


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ({}, [(("depth",), "a shelf is no cube"), (("width",), "missing")]),  # neither is there: both are the same
        ({"width": "2"}, [(("width",), "float_type")]),
        ({"width": True}, [(("width",), "float_type")]),
        ({"width": 1e999}, [(("width",), "finite_number")]),
        ({"width": 1, "depth": None}, [(("depth",), "float_type")]),
        ({"width": 1, "wood": "elm"}, [(("wood",), "'oak' or 'ash'")]),
        ({"width": 1, "corner": [1, 2]}, [(("corner",), "expected 3 numbers, got 2")]),
        ({"width": 1, "boards": "two"}, [(("boards",), "a number or a list")]),
        ({"width": 1, "hight": 1}, [(("hight",), "extra_forbidden")]),
        ({"width": -1, "depth": -1}, [(("depth",), "a shelf is no cube"), (("width",), "greater_than"),
                                      (("depth",), "greater_than")]),
        (5, [((), "a mapping with width, wood, depth, corner, boards")]),
    ],
)  # fmt: skip
def test_every_error_is_collected_with_its_location(value: object, expected: list[tuple[Location, str]]) -> None:
    assert errors(value) == expected


def test_a_key_alone_is_an_empty_mapping() -> None:
    assert empty_if_null(None) == {}
    assert empty_if_null([]) == []
