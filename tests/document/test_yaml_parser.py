"""YAML and JSON are read as the values that they stand for, within limits; what is neither is told in plain words."""

import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.document.documents import ANCHOR, Anything, Run, problems, put, read

values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats(allow_nan=False)
    | st.text("aé 0.-:#'\"\n\t\\"),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text("abc0 :-", max_size=3), inner, max_size=4),
    max_leaves=12,
)


@given(values)
@settings(max_examples=100, deadline=None)
def test_json_is_read_as_json(value: object) -> None:
    text = json.dumps({"a": value}, ensure_ascii=False).replace("Infinity", ".inf")
    assert read(put(text), Anything).a == value


def block(value: object, indent: str = "") -> str:
    """`value` in YAML's block style, with its single values as in JSON."""
    if isinstance(value, dict) and value:
        return "".join(f"\n{indent}{json.dumps(key)}:{block(inner, indent + '  ')}" for key, inner in value.items())
    if isinstance(value, list) and value:
        return "".join(f"\n{indent}-{block(inner, indent + ' ')}" for inner in value)
    return " " + json.dumps(value, ensure_ascii=False).replace("Infinity", ".inf")


@given(values)
@settings(max_examples=100, deadline=None)
def test_lines_that_are_indented_are_read_as_what_is_in_brackets(value: object) -> None:
    assert read(put(block({"a": value})), Anything).a == value


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_line_ends_as_on_any_system_and_a_mark_of_byte_order_is_no_text(end: str) -> None:
    text = "\ufeff# a comment\nduration: 2\nfilms:\n- fps: -1\n".replace("\n", end)
    assert problems(lambda: read(put(text), Run)) == ["d.yaml:4:8: films[0].fps: expected a positive number, got -1"]


def test_a_document_may_begin_by_saying_that_it_is_yaml_1_2() -> None:
    assert read(put("%YAML 1.2\n---\na: no\n...\n"), Anything).a == "no"


@pytest.mark.parametrize("opening", ["[", "{b: ", "? ", "- ", "{? ", "[b: "])
def test_values_within_each_other_have_a_limit_however_they_are_nested(opening: str) -> None:
    depth = 49
    assert read(put("a: " + "[" * depth + "]" * depth), Anything)
    (line,) = problems(lambda: read(put("a:\n  " + opening * 100_000), Anything))
    assert line.startswith("d.yaml:2:")
    assert line.endswith(": more than 50 lists and mappings within each other are no document for mjrun")


def test_a_value_with_commas_is_reported_to_be_quoted() -> None:
    first = problems(lambda: read(put("a: {qpos: uniform(-0.1, 0.1)}\n"), Anything))
    assert first == [
        'd.yaml:1:25: a: within {…} a comma ends a value; put values with commas in quotes, as in "uniform(0, 1)"'
    ]
    assert read(put("a: {f(x): 1, g)(: 2}\n"), Anything).a == {"f(x)": 1, "g)(": 2}


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


QUOTES = "put text that contains ': ' in quotes"

INDENT = f"a key cannot appear here; is it indented as its neighbours? {QUOTES}"

COLON = f"expected 'key: value'; is a colon missing, or an indentation? {QUOTES}"

TAG = "tags (!) are not supported; the type of a value follows from its form"

DIRECTIVE = "a line that begins with % is a directive, which documents do not support"

HEADER = "only +, - and an indentation from 1 to 9 may follow | or >"

WRONG = [
    ("", ["d.yaml: the document is empty"]),
    ("# nothing\n", ["d.yaml: the document is empty"]),
    ("---\n...\n", ["d.yaml:2:1: expected a mapping, got nothing"]),
    ("- a: 1\n", ["d.yaml:1:1: expected a mapping, got a list"]),
    ("a text\n", ["d.yaml:1:1: expected a mapping, got text"]),
    ("a: 1\na: 2\n", ["d.yaml:2:1: 'a' is given twice; first in line 1"]),
    ("a: 1\n'a': 2\n", ["d.yaml:2:1: 'a' is given twice; first in line 1"]),
    ("a: {b: 1, b: 2, b: 3}", ["d.yaml:1:11: a: 'b' is given twice; first in line 1",
                               "d.yaml:1:17: a: 'b' is given twice; first in line 1"]),
    ("a: &x 1\n", [f"d.yaml:1:4: a: {ANCHOR}"]),
    ("a: *x\n", [f"d.yaml:1:4: a: {ANCHOR}"]),
    ("a: [&x 1, *x]\n", [f"d.yaml:1:5: a[0]: {ANCHOR}", f"d.yaml:1:11: a[1]: {ANCHOR}"]),
    ("a: &\n", [f"d.yaml:1:4: {ANCHOR}"]),
    ("a: *\n", [f"d.yaml:1:4: {ANCHOR}"]),
    ("a: !!str 5\n", [f"d.yaml:1:4: a: {TAG}"]),
    ("a: ! 5\n", [f"d.yaml:1:4: a: {TAG}"]),
    ("a: !x 5\n", [f"d.yaml:1:4: a: {TAG}"]),
    ("a: !!python/object/apply:os.system [ls]\n", [f"d.yaml:1:4: a: {TAG}"]),
    ("a: !y!x 5\n", [f"d.yaml:1:4: {TAG}"]),
    ("a: !<x\n", [f"d.yaml:1:4: {TAG}"]),
    ("a: {<<: {b: 1}}\n", ["d.yaml:1:5: a: merge keys (<<) are not supported"]),
    ("a: 1\n1: 2\n", ["d.yaml:2:1: a key is text; 1 as text goes in quotes"]),
    ("a: {true: 2, ~: 3}\n", ["d.yaml:1:5: a: a key is text; true as text goes in quotes",
                              "d.yaml:1:14: a: a key is text; ~ as text goes in quotes"]),
    ("a: 1\n? [b]\n: 2\n", ["d.yaml:2:3: a key is text, not a list"]),
    ("a: 1\n? {b: 1, b: 2}\n: 2\n", ["d.yaml:2:3: a key is text, not a mapping",
                                     "d.yaml:2:10: 'b' is given twice; first in line 2"]),
    ('a: {"b\\0": 1}\n', [r"d.yaml:1:5: a: a key with control characters, 'b\x00'"]),
    ("a: 1\n---\na: 2\n", ["d.yaml:2:1: a second document begins here, and a file holds one"]),
    ("a: 1\n...\nb\n", ["d.yaml:3:1: the document ends before this"]),
    ("{a: 1} b\n", ["d.yaml:1:8: the document ends before this"]),
    ("%YAML 1.1\n---\na: 1\n", [f"d.yaml:1:1: {DIRECTIVE}"]),
    ("%YAML 3.0\n---\na: 1\n", [f"d.yaml:1:1: {DIRECTIVE}"]),
    ("%TAG ! x\n---\na: 1\n", [f"d.yaml:1:1: {DIRECTIVE}"]),
    ("%YAML x\n---\na: 1\n", [f"d.yaml:1:1: {DIRECTIVE}"]),
    ("a:\n\tb: 1\n", ["d.yaml:2:1: a tab; YAML is indented and spaced by spaces"]),
    ("a:\tb\n", ["d.yaml:1:3: a tab; YAML is indented and spaced by spaces"]),
    ("a: b: c\n", [f"d.yaml:1:5: {INDENT}"]),
    ("a: 1\n  b: 2\n", [f"d.yaml:2:4: {INDENT}"]),
    ("a:\n  b: 1\n c: 2\n", ["d.yaml:3:2: the indentation of this line matches no other line of its mapping"]),
    ("a:\n  - b\n c: 2\n", ["d.yaml:3:2: the indentation of this line matches no other line of its mapping"]),
    ("a:\n  - b:\n   c: 2\n", ["d.yaml:3:4: the indentation of this line matches no other line of its list"]),
    ("a: 1\nb\nc: 2\n", [f"d.yaml:2:1: {COLON}"]),
    ("a: - b\n", ["d.yaml:1:4: a list cannot begin here; write each '- …' on a separate line"]),
    ("a: ? b\n", ["d.yaml:1:4: a key cannot appear here"]),
    ("a: @b\n", ["d.yaml:1:4: put text that begins with '@' in quotes"]),
    ("a: `b\n", ["d.yaml:1:4: put text that begins with '`' in quotes"]),
    ("a: %b\n", ["d.yaml:1:4: put text that begins with '%' in quotes"]),
    ("a: [1, 2\n", ["d.yaml:1:4: this bracket is not closed"]),
    ("a: {b: [1]\n", ["d.yaml:1:4: this bracket is not closed"]),
    ("a: [\n", ["d.yaml:1:4: this bracket is not closed"]),
    ("a: [1\nb: 2\n", ["d.yaml:2:2: expected ',' or ']'; the bracket opens in line 1"]),
    ("a: {b: 1} }\n", ["d.yaml:1:11: the indentation of this line matches no other line of its mapping"]),
    ("a: ]\n", ["d.yaml:1:4: a value is missing before this"]),
    ("a: [1, , 2]\n", ["d.yaml:1:8: a value is missing before this"]),
    ("a: {b: ${c}}\n", ["d.yaml:1:9: within [ ] and { }, put text that contains ${ in quotes"]),
    ("a: 'b\n", ["d.yaml:1:4: this quote is not closed"]),
    ('a: "b\n---\n', ["d.yaml:1:4: this quote is not closed"]),
    ('a: "\\q"\n', ["d.yaml:1:6: no escape \\q in double quotes; in single quotes \\ is itself"]),
    ('a: "it\\\'s"\n', ["d.yaml:1:8: no escape \\' in double quotes; in single quotes \\ is itself"]),
    ("%TAG !e! {\n---\na: 1\n", [f"d.yaml:1:1: {DIRECTIVE}"]),
    ('a: "\\xg"\n', ["d.yaml:1:7: this escape needs 2 hexadecimal digits"]),
    ('a: "\\U00110000"\n', ["d.yaml:1:7: this escape means no character"]),
    ('a: "\\ud800"\n', [r"d.yaml:1:4: a: the escape '\ud800' is half a character"]),
    ("a: |0\n  b\n", [f"d.yaml:1:5: {HEADER}"]),
    ("a: > b\n", [f"d.yaml:1:6: {HEADER}"]),
    (b"a: \xff\n", ["d.yaml:1:4: not UTF-8: the byte 0xff"]),
    (b"\xef\xbb\xbfb: 1\na: \xc3\xa9 \xe9\n", ["d.yaml:2:6: not UTF-8: the byte 0xe9"]),
    ("a: 1".encode("utf-16"), ["d.yaml:1:1: not UTF-8: the byte 0xff"]),
    ("a: b\0c\n", [r"d.yaml:1:5: '\x00' (U+0000) is not allowed; write it as an escape in double quotes"]),
    ("a: \x1b[2J", [r"d.yaml:1:4: '\x1b' (U+001B) is not allowed; write it as an escape in double quotes"]),
    ("a: b\u2028c", [r"d.yaml:1:5: '\u2028' (U+2028) is not allowed; write it as an escape in double quotes"]),
    ("a: b\ufeff", [r"d.yaml:1:5: '\ufeff' (U+FEFF) is not allowed; write it as an escape in double quotes"]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "lines"), WRONG)
def test_what_is_no_document_is_reported_at_its_line_and_column(text: str | bytes, lines: list[str]) -> None:
    assert problems(lambda: read(put(text), Anything)) == lines
