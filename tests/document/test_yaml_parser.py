"""YAML and JSON are read as the values that they stand for, within limits."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.document.documents import Anything, Run, problems, put, read

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
