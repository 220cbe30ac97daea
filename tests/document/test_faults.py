"""Values that do not fit are reported all at once, each at its place, with what is expected."""

from mjrun.errors import clean
from tests.cases import cases
from tests.document.documents import ANCHOR, Run, problems, put, read


@cases("text, lines")
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


def test_valid_keys_are_listed_once() -> None:
    text = "durations: 1\nfilms: [{fsp: 2}, {titel: x}]\nfoo: 2\n"
    assert problems(lambda: read(put(text), Run)) == [
        "d.yaml:1:1: unknown key 'durations' (did you mean 'duration'?); keys: duration, steps, model, films, start",
        "d.yaml:2:10: films[0]: unknown key 'fsp' (did you mean 'fps'?); keys: fps, title",
        "d.yaml:2:20: films[1]: unknown key 'titel' (did you mean 'title'?)",
        "d.yaml:3:1: unknown key 'foo'",
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


def test_a_key_that_is_the_name_of_an_option_in_other_tools_is_reported_with_ours() -> None:
    [problem] = problems(lambda: read(put("length: 1\n"), Run))
    assert problem.startswith("d.yaml:1:1: unknown key 'length' (did you mean 'duration'?)")
