"""Variables stand for their values, and a document is laid over its defaults."""

from pathlib import Path
from typing import Any

import pytest

from mjrun.document import reader
from tests.cases import cases
from tests.document.documents import Anything, Film, Run, problems, put, read


def resolved(text: str, *assignments: str) -> Any:
    return read(put(text), Anything, assignments, variables=True).a


@cases("text, value")
def test_variables_stand_for_their_values(text: str, value: object) -> None:
    found = resolved(f"vars: {{x: 0.50, n: box, t: true, e: ~, d: '$${{n}}'}}\n{text}\n")
    assert found == value
    assert type(found) is type(value)


def test_a_setting_may_change_a_variable_use_one_and_make_the_first() -> None:
    assert resolved("vars: {x: 1}\na: ${x}", "vars.x=2") == 2
    assert resolved("vars: {x: 1}\na: 5", "a=[0, '${x}']") == [0, 1]
    assert resolved("a: ${x}", "vars.x=3") == 3


LETTERS = "is not a name of letters, digits and _"


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        (
            "vars: {speed: 1}\na: ${sped}",
            ["d.yaml:2:4: a: no variable 'sped' (did you mean 'speed'?); vars: speed"],
        ),
        ("a: ['x ${y}']", ["d.yaml:1:5: a[0]: no variable 'y'; there are no vars"]),
        ("a: ${", ["d.yaml:1:4: a: ${ begins a variable, ${name}; write $${ for ${"]),
        ("a: ${x${y}}", ["d.yaml:1:4: a: ${ begins a variable, ${name}; write $${ for ${"]),
        ("vars: {x: 1, y: '${x}'}\na: ${y}", ["d.yaml:1:17: vars.y: a variable cannot refer to another variable; "
                                              "write $${ for ${"]),
        ("vars: {x: [1]}\na: ${x}", ["d.yaml:1:11: vars.x: expected a single value, got a list"]),
        ("vars: 5\na: 1", ["d.yaml:1:7: vars: expected a mapping of names to values, got 5"]),
        ("vars: {x y: 5}\na: 1", [f"d.yaml:1:8: vars: 'x y' {LETTERS}"]),
    ],
)  # fmt: skip
def test_a_variable_that_cannot_be_is_reported_where_it_is_used(text: str, lines: list[str]) -> None:
    assert problems(lambda: resolved(text)) == lines


def test_what_a_variable_says_is_reported_where_it_does_not_fit() -> None:
    path = put("vars: {d: long}\nduration: ${d}\nfilms: [{fps: '${e}'}]\n")
    assert problems(lambda: read(path, Run, variables=True)) == [
        "d.yaml:2:11: duration: expected a number, got 'long' from ${d}",
        "d.yaml:3:15: films[0].fps: no variable 'e'; vars: d",
    ]


def test_variables_cannot_make_a_document_explode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "MOST_INSERTED", 10)
    assert resolved("vars: {x: abcde}\na: '${x}${x}'") == "abcde" * 2
    (line,) = problems(lambda: resolved("vars: {x: abcde}\na: ['${x}${x}', '${x}!']"))
    assert line == "d.yaml:2:17: a[1]: variables insert more than 10 characters"


def test_defaults_count_where_the_document_says_nothing() -> None:
    Path("below").mkdir()
    put(
        "duration: 5\nmodel: ${m}\nfilms: [{fps: 1}, {fps: 2}]\nstart: {knee: 1, hip: 2}\nvars: {m: a, n: b}\n",
        "below/d.yaml",
    )
    above = put(
        "defaults: d.yaml\nsteps: 3\nfilms: [{fps: 4}]\nstart: {hip: 3, toe: 4}\nvars: {m: c}\n", "below/e.yaml"
    )
    assert read(above, Run, ["start.toe=6"], variables=True) == Run(
        duration=5, steps=3, model="c", films=[Film(fps=4)], start={"knee": 1, "hip": 3, "toe": 6}
    )  # fmt: skip
