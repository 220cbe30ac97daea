"""Plain words mean what the core schema of YAML 1.2 says."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.document.documents import Anything, put, read

SCALARS = [
    ("", None), ("~", None), ("null", None), ("Null", None), ("NULL", None), ("nuLL", "nuLL"),
    ("true", True), ("True", True), ("TRUE", True), ("false", False), ("False", False), ("FALSE", False),
    ("tRue", "tRue"), ("yes", "yes"), ("no", "no"), ("on", "on"), ("off", "off"), ("y", "y"), ("No", "No"),
    ("0", 0), ("010", 10), ("-7", -7), ("+7", 7), ("0o17", 15), ("0x1F", 31), ("0xfg", "0xfg"), ("0o8", "0o8"),
    ("-0x1F", "-0x1F"), ("0b11", "0b11"), ("1_000", "1_000"), ("1,000", "1,000"), ("09", 9), ("１", "１"),
    ("1.5", 1.5), ("1.", 1.0), (".5", 0.5), ("-.5", -0.5), ("1e-3", 1e-3), ("1E3", 1000.0), ("1e+3", 1000.0),
    ("+1.e2", 100.0), ("1e", "1e"), ("e3", "e3"), (".", "."), ("1.5.2", "1.5.2"), ("1_0.5", "1_0.5"),
    (".inf", math.inf), ("-.inf", -math.inf), ("+.INF", math.inf), (".Inf", math.inf), ("inf", "inf"),
    ("-inf", "-inf"), ("nan", "nan"), ("infinity", "infinity"), ("-.nan", "-.nan"), ("1e400", math.inf),
    ("12:30:00", "12:30:00"), ("1:30", "1:30"), ("190:20:30.15", "190:20:30.15"), ("2001-12-14", "2001-12-14"),
    ("2001-12-14t21:59:43.10-05:00", "2001-12-14t21:59:43.10-05:00"), ("=", "="), ("<<", "<<"),
    ("'5'", "5"), ('"true"', "true"), ("''", ""), ("'~'", "~"), ("'it''s'", "it's"), (r'"\x41\u00e9\n\0"', "Aé\n\0"),
    ("speed(box) > 0.02", "speed(box) > 0.02"), ("a#b", "a#b"), ("a # b", "a"), ("a:b", "a:b"), ("C:/x", "C:/x"),
    ("${x}", "${x}"), ("日本 🚗", "日本 🚗"), ("|\n  a\n  b", "a\nb\n"), (">-\n  a\n  b", "a b"),
    ("[1, .5, no, 010]", [1, 0.5, "no", 10]), ("{b: 1, 'c': [], d: }", {"b": 1, "c": [], "d": None}),
    ('{"b": 1,"c":[true,null]}', {"b": 1, "c": [True, None]}),
]  # fmt: skip


@pytest.mark.parametrize(("text", "value"), SCALARS)
def test_a_word_means_what_the_core_schema_of_yaml_1_2_says(text: str, value: object) -> None:
    found = read(put(f"a: {text}\n"), Anything).a
    assert found == value
    assert type(found) is type(value)


def test_nan_is_written_with_a_dot() -> None:
    assert math.isnan(read(put("a: .nan"), Anything).a)


def test_an_integer_of_more_digits_than_any_float_is_infinite() -> None:
    assert read(put("a: " + "9" * 5000), Anything).a == math.inf
    assert read(put("a: 0x" + "f" * 5000), Anything).a == math.inf
    assert read(put("a: -" + "9" * 300), Anything).a == -int("9" * 300)


@given(st.floats(allow_nan=False) | st.integers(-(10**300), 10**300))
@settings(max_examples=100, deadline=None)
def test_a_number_comes_back_as_it_was_printed(value: float) -> None:
    text = {"inf": ".inf", "-inf": "-.inf"}.get(repr(value), repr(value))
    found = read(put(f"a: {text}"), Anything).a
    assert (found, type(found)) == (value, type(value))
    assert math.copysign(1, found) == math.copysign(1, value)
