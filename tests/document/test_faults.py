"""Values that do not fit are reported all at once, each at its place, with what is expected."""

import pytest

from mjrun.errors import clean
from tests.document.documents import ANCHOR, Nothing, Run, problems, put, read


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("duration: 0\n", ["d.yaml:1:11: duration: expected a positive number, got 0"]),
        ("duration: '2'\n", ["d.yaml:1:11: duration: expected a number, got '2'"]),
        ("duration: yes\n", ["d.yaml:1:11: duration: expected a number, got 'yes'"]),
        ("duration: true\n", ["d.yaml:1:11: duration: expected a number, got true"]),
        ("duration:\n", ["d.yaml:1:10: duration: expected a number, got nothing"]),
        ("duration: [1]\n", ["d.yaml:1:11: duration: expected a number, got a list"]),
        ("duration: {}\n", ["d.yaml:1:11: duration: expected a number, got a mapping"]),
        ("duration: .nan\n", ["d.yaml:1:11: duration: expected a finite number, got .nan"]),
        ("duration: 1e999\n", ["d.yaml:1:11: duration: expected a finite number, got 1e999"]),
        ("steps: 2.0\n", ["d.yaml:1:8: steps: expected a whole number, got 2.0"]),
        ("model: 2\n", ["d.yaml:1:8: model: expected text, got 2; to write text, use quotes: '2'"]),
        ('model: "b\\0.xml"\n', [r"d.yaml:1:8: model: 'b\x00.xml' contains a null character"]),
        ("model: null\n", ["d.yaml:1:8: model: expected text, got null; to write text, use quotes: 'null'"]),
        ("model: ''\n", ["d.yaml:1:8: model: expected text that is not empty, got ''"]),
        ("films: {}\n", ["d.yaml:1:8: films: expected a list, got a mapping"]),
        ("films:\n  - 5\n", ["d.yaml:2:5: films[0]: expected a mapping with fps, title, got 5"]),
        ("start: 5\n", ["d.yaml:1:8: start: expected a mapping, got 5"]),
        ("start: {knee: up}\n", ["d.yaml:1:15: start.knee: expected a number or a list of numbers, got 'up'"]),
        (
            "durations: 2\n",
            ["d.yaml:1:1: unknown key 'durations' (did you mean 'duration'?); "
             "keys: duration, steps, model, films, start"],
        ),
        ("films: [{fsp: 2}]\n", ["d.yaml:1:10: films[0]: unknown key 'fsp' (did you mean 'fps'?); keys: fps, title"]),
    ],
)  # fmt: skip
def test_a_value_that_does_not_fit_is_reported_with_what_is_expected(text: str, lines: list[str]) -> None:
    assert problems(lambda: read(put(text), Run)) == lines


def test_every_error_is_reported_at_once_in_the_order_of_the_document() -> None:
    text = "steps: [1]\nfilms:\n  - fps: -1\n    fps: 2\n    1: 3\n  - *a\n  - titel: x\nduration: 0\n"
    assert problems(lambda: read(put(text), Run)) == [
        "d.yaml:1:8: steps: expected a whole number, got a list",
        "d.yaml:3:10: films[0].fps: expected a positive number, got -1",
        "d.yaml:4:5: films[0]: 'fps' is given twice; first in line 3",
        "d.yaml:5:5: films[0]: a key is text; 1 as text goes in quotes",
        f"d.yaml:6:5: films[1]: {ANCHOR}",
        "d.yaml:7:5: films[2]: unknown key 'titel' (did you mean 'title'?); keys: fps, title",
        "d.yaml:8:11: duration: expected a positive number, got 0",
    ]


def test_very_many_errors_are_counted() -> None:
    lines = problems(lambda: read(put("".join(f"k{i}: 1\n" for i in range(70))), Run))
    assert len(lines) == 51
    assert lines[-1] == "… and 20 more problems"


def test_long_and_hostile_text_is_cut_and_cleaned() -> None:
    text = f'model: "{"x" * 100}\\e[2J"\n"\u202ekey": 1\nsteps: "\\u202e"\nduration: {"y" * 100}\n'
    found = problems(lambda: read(put(text), Run))
    assert [clean(line) for line in found] == found
    assert found[-1] == f"d.yaml:4:11: duration: expected a number, got '{'y' * 39}…'"
    assert "'\\u202ekey'" in found[0]


@pytest.mark.parametrize(
    ("key", "new"),
    [("films", "videos"), ("stills", "images"), ("recording", "recordings, a list"), ("at", "time")],
)
def test_a_key_of_earlier_versions_is_reported_with_its_new_name(key: str, new: str) -> None:
    assert problems(lambda: read(put(f"{key}: 1\n"), Nothing)) == [
        f"d.yaml:1:1: unknown key '{key}': it was renamed to {new}"
    ]
