"""Plain values are checked by the rules of JSON Schema, with places and sentences."""

import pytest

from mjrun.errors import UsageError
from mjrun.options.number_kinds import NUMBERS
from mjrun.options.schema_validation import (
    InvalidValueError,
    Schema,
    SchemaViolation,
    SchemaViolationCollector,
    SchemaViolationError,
    check,
)
from mjrun.options.setting_kinds import SETTING
from tests.document.schema_oracle import fits

LIST: Schema = {"type": "array", "items": {"type": "number"}}
PAIR: Schema = {"type": "array", "prefixItems": [{"type": "number"}, {"type": "string"}], "minItems": 2, "maxItems": 2}


@pytest.mark.parametrize(
    ("schema", "value", "expected"),
    [
        ({"type": "number"}, 1, []),
        ({"type": "number"}, 1.5, []),
        ({"type": "number"}, True, [((), "a number")]),
        ({"type": "number", "exclusiveMinimum": 1.5}, 1.5, [((), "a number above 1.5")]),
        ({"type": "number", "minimum": 1}, 0.5, [((), "a number of at least 1")]),
        ({"type": "number", "maximum": 1}, 2, [((), "a number of at most 1")]),
        ({"type": "integer"}, 1.0, [((), "a whole number")]),
        ({"type": "boolean"}, "yes", [((), "true or false")]),
        ({"type": "string", "minLength": 1}, "", [((), "text that is not empty")]),
        ({"type": "string"}, None, [((), "text")]),
        ({"type": "string", "enum": ["oak", "ash", "elm"]}, "pine", [((), "'oak', 'ash' or 'elm'")]),
        ({"type": "string", "enum": ["oak"]}, 5, [((), "'oak'")]),
        ({"type": "string"}, "a\0b", [((), r"'a\x00b' contains a null character")]),
        (LIST, [1, "a", "b"], [((1,), "a number"), ((2,), "a number")]),
        (
            {**LIST, "minItems": 2},
            [1],
            [((), "expected at least 2 items, got 1")],
        ),
        (
            {**LIST, "maxItems": 1},
            [1, 2],
            [((), "expected at most 1 item, got 2")],
        ),
        (PAIR, [1, 2], [((1,), "text")]),
        ({**PAIR, "counted": "parts"}, [], [((), "expected 2 parts, got none")]),
        ({"type": "object", "additionalProperties": {"type": "number"}}, {"a": "b"}, [(("a",), "a number")]),
        ({"type": "object", "additionalProperties": {"type": "number"}}, [], [((), "a mapping")]),
        (NUMBERS, [1, 2], []),
        (NUMBERS, "1", [((), "a number or a list of numbers")]),
        (SETTING, [0, "up"], [((), "a finite number, text, true or false, or a list of finite numbers")]),
        ({}, object(), []),
    ],
)
def test_what_does_not_fit_is_reported_with_its_place(schema: Schema, value: object, expected: list[object]) -> None:
    found: list[object] = []
    try:
        check(value, schema)
    except SchemaViolationError as error:
        found = [(violation.path, violation.expected or violation.message) for violation in error.violations]
    assert found == expected


@pytest.mark.parametrize("value", [1, 0, -1, 1.5, True, "", "a", None, [], [1], ["a", 1], {}, {"a": 1}])
@pytest.mark.parametrize("schema", [NUMBERS, SETTING, PAIR, {"type": "integer", "minimum": 0}])
def test_a_rule_means_what_it_means_to_an_independent_checker(schema: Schema, value: object) -> None:
    rule = {key: part for key, part in schema.items() if key not in ("expected", "forms", "counted")}
    try:
        check(value, schema)
    except SchemaViolationError:
        assert not fits(value, rule, rule)
    else:
        assert fits(value, rule, rule)


def test_errors_of_parts_are_collected_with_their_places() -> None:
    violations = SchemaViolationCollector()
    with violations.at("a", 1):
        raise InvalidValueError("a tree")
    with violations.at("b"):
        raise InvalidValueError("a tree", "bush")
    with violations.at("c"):
        raise SchemaViolationError([SchemaViolation(("d",), "a tree")])
    error = UsageError("no tree", ("trees",))
    with violations.at("e"):
        raise error
    with pytest.raises(SchemaViolationError) as caught:
        violations.raise_if_any()
    assert caught.value.violations == [
        SchemaViolation(("a", 1), "a tree"),
        SchemaViolation(("b",), message="'bush' is not a tree"),
        SchemaViolation(("c", "d"), "a tree"),
        SchemaViolation(("e",), error=error),
    ]
