"""Records read the options of a class, and tell everything that does not fit with its place."""

from typing import Any

import pytest

from mjrun.errors import spelled
from mjrun.options import kinds, number_kinds
from mjrun.options.kinds import ReadingContext
from mjrun.options.option import OptionExclusion, Options, option, options, required
from mjrun.options.schema_validation import InvalidValueError, Path, Schema, SchemaViolationError
from mjrun.options.structured_kinds import ListKind, MappingKind, OneOfKind, OptionsMappingKind, plain_values


@options
class Toaster(Options):
    """A toaster."""

    exclusions = (OptionExclusion(("slices", "bagel"), "there is one slot"),)

    heat: float = required(converter=number_kinds.RealKind(above=0.0, most=9.0), help="How hot.")
    slices: int = option(converter=number_kinds.IntegerKind(1), default=2, help="How many.")
    bagel: bool = option(converter=kinds.FlagKind(), default=False, help="Toast one side.")
    assert_: str | None = option(
        converter=kinds.optional(kinds.TextKind()), default=None, usual="nothing", help="A claim."
    )


@options
class Bread(Options):
    """Bread."""


TOASTER = OptionsMappingKind(Toaster, Toaster)
EXCLUDED = "slices and bagel exclude each other: there is one slot"


def violations(value: object, record: kinds.AnyKind = TOASTER) -> list[tuple[Path, str]]:
    """Where something is wrong, and what is expected, or else wrong, there."""
    with pytest.raises(SchemaViolationError) as caught:
        record.read(value, ReadingContext())
    return [
        (violation.path, violation.expected or violation.message or f"keys: {', '.join(violation.keys or ())}")
        for violation in caught.value.violations
    ]


def test_a_declaration_alone_reads_documents_and_describes_them() -> None:
    toaster = TOASTER.read({"heat": 3, "assert": "warm"}, ReadingContext())
    assert toaster == Toaster(heat=3, assert_="warm")
    definitions: dict[str, Schema] = {}
    schema: Any = TOASTER.mapping_schema(ReadingContext(), definitions)
    assert schema["description"] == "A toaster."
    assert schema["required"] == ["heat"]
    heat = {"description": "How hot.", "exclusiveMinimum": 0.0, "maximum": 9.0, "type": "number"}
    assert schema["properties"]["heat"] == heat
    assert schema["properties"]["assert"]["description"] == "A claim. If left out: nothing."
    assert schema["properties"]["slices"]["default"] == 2
    assert TOASTER.schema(ReadingContext(), definitions) == {"$ref": "#/$defs/Toaster"}
    assert definitions == {"Toaster": schema}


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ({}, [((), "'heat' is missing")]),
        ({"heat": "2"}, [(("heat",), "a number")]),
        ({"heat": True}, [(("heat",), "a number")]),
        ({"heat": 1e999}, [(("heat",), "a finite number")]),
        ({"heat": 10**400}, [(("heat",), "a finite number")]),
        ({"heat": 0}, [(("heat",), "a positive number")]),
        ({"heat": 10}, [(("heat",), "a number of at most 9")]),
        ({"heat": 1, "slices": 0}, [(("slices",), "a positive number")]),
        ({"heat": 1, "slices": None}, [(("slices",), "a whole number")]),
        ({"heat": 1, "assert_": "warm"}, [(("assert_",), "keys: heat, slices, bagel, assert")]),
        ({"heat": 1, "slices": 3, "bagel": True}, [(("bagel",), EXCLUDED)]),
        ({"heat": -1, "slices": 3, "bagel": True}, [(("bagel",), EXCLUDED), (("heat",), "a positive number")]),
    ],
)
def test_everything_that_is_wrong_is_reported_with_its_place(value: object, expected: list[tuple[Path, str]]) -> None:
    found = [(path, spelled(text)) for path, text in violations(value)]
    assert found == expected


def test_an_exclusion_concerns_what_is_set_only() -> None:
    assert TOASTER.read({"heat": 1, "slices": 3, "bagel": False}, ReadingContext())


def test_what_is_no_mapping_is_reported_the_keys() -> None:
    with pytest.raises(InvalidValueError, match=r"^a mapping with heat, slices, bagel, assert$"):
        TOASTER.read(5, ReadingContext())


def test_a_key_alone_is_an_empty_mapping_where_nothing_is_needed() -> None:
    blank = OptionsMappingKind[dict[str, object]](Bread, dict, blank=True)
    assert blank.read(None, ReadingContext()) == {}
    assert blank.schema(ReadingContext(), {}) == {"anyOf": [{"$ref": "#/$defs/Bread"}, {"type": "null"}]}
    with pytest.raises(InvalidValueError):
        TOASTER.read(None, ReadingContext())


def test_lists_and_mappings_tell_of_every_part() -> None:
    toasters = ListKind[Toaster](TOASTER, least=1)
    assert toasters.read([{"heat": 1}], ReadingContext()) == (Toaster(heat=1),)
    assert toasters([Toaster(heat=1)]) == (Toaster(heat=1),)
    assert violations([{"heat": 0}, 5], toasters)[0] == ((0, "heat"), "a positive number")
    assert violations([], toasters) == [((), "expected at least 1 item, got none")]
    with pytest.raises(InvalidValueError, match=r"^a list$"):
        toasters.read({}, ReadingContext())
    with pytest.raises(InvalidValueError, match=r"^at least 1$"):
        toasters([])
    by_name = MappingKind[Toaster](TOASTER)
    assert by_name.read({"a": {"heat": 1}}, ReadingContext()) == {"a": Toaster(heat=1)}
    assert violations({"a": {"heat": 0}, "": {"heat": 1}}, by_name) == [
        (("a", "heat"), "a positive number"),
        (("",), "text that is not empty"),
    ]


def test_one_of_several_forms_is_chosen_by_the_type() -> None:
    forms = OneOfKind[Any, Any]("a number or a toaster", number=number_kinds.RealKind(), object=TOASTER)
    assert forms.read(2, ReadingContext()) == 2
    assert forms.read({"heat": 2}, ReadingContext()) == Toaster(heat=2)
    assert violations(-1, forms) == [((), "a number of at least 0")]
    with pytest.raises(InvalidValueError, match=r"^a number or a toaster$"):
        forms.read("2", ReadingContext())


def test_what_is_written_is_what_is_not_the_default() -> None:
    assert plain_values(Toaster(heat=3, slices=2, assert_="warm")) == {"heat": 3.0, "assert": "warm"}
