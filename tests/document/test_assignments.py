"""Assignments `key=value` replace what a document says."""

from pathlib import Path
from typing import Any, cast

import pytest

from tests.cases import cases
from tests.document.documents import ANCHOR, Film, Run, problems, put, read

WRITTEN = "duration: 2\nfilms:\n  - fps: 30\n  - {title: b}\nstart:\n"


@cases("assignments, expected")
def test_a_setting_stands_over_what_is_written(assignments: list[str], expected: dict[str, Any]) -> None:
    written = {"duration": 2, "films": [{"fps": 30}, {"title": "b"}], "start": {}}
    path = put(WRITTEN.replace("start:", "start: {}") if not any("start" in a for a in assignments) else WRITTEN)
    values = written | expected
    films = [Film(**film) for film in cast("list[dict[str, Any]]", values["films"])]
    assert read(path, Run, assignments) == Run(**{**values, "films": films})


PLACES = "is not a path; write it as in duration, videos[0].fps"


@pytest.mark.parametrize(
    ("assignment", "lines"),
    [
        ("duration", ["duration: write key=value; switches such as --json and --markdown take no value"]),
        (f"a{'.a' * 2000}=5", [f"{'a.' * 29}a…: a path can have at most 50 parts"]),
        ("=5", [f"=5: '' {PLACES}"]),
        ("[0]=5", [f"[0]=5: '[0]' {PLACES}"]),
        ("a..b=5", [f"a..b=5: 'a..b' {PLACES}"]),
        ("films[-1].fps=5", [f"films[-1].fps=5: 'films[-1].fps' {PLACES}"]),
        ("films[0]fps=5", [f"films[0]fps=5: 'films[0]fps' {PLACES}"]),
        ("films[2].fps=5", ["films[2].fps=5: films has 2 items, counted from 0"]),
        ("filns[0].fps=5", ["filns[0].fps=5: no list 'filns' (did you mean 'films'?)"]),
        ("start[0]=5", ["start[0]=5: start is a mapping, not a list"]),
        ("films.fps=5", ["films.fps=5: films is a list and has no keys"]),
        ("duration.s=5", ["duration.s=5: duration is 2 and has no keys"]),
        ("films[0].fps.x=5", ["films[0].fps.x=5: films[0].fps is 30 and has no keys"]),
        ("duration=-1", ["duration=-1: expected a positive number, got -1"]),
        ("duration=", ["duration=: expected a number, got nothing"]),
        ("films[1].fps=x", ["films[1].fps=x: expected a number, got 'x'"]),
        ("films[1]={fps: x}", ["films[1]={fps: x}: films[1].fps: expected a number, got 'x'"]),
        (
            "durations=1",
            [
                "durations=1: unknown key 'durations' (did you mean 'duration'?); "
                "keys: duration, steps, model, films, start"
            ],
        ),
        (
            "fps=5",
            ["fps=5: unknown key 'fps' (did you mean 'films[0].fps'?); keys: duration, steps, model, films, start"],
        ),
        ("duration=[1", ["duration=[1: this bracket is not closed"]),
        ("duration=a: 1", ["duration=a: 1: expected one value, [a list] or {a: mapping}"]),
        ("duration=- 1", ["duration=- 1: expected one value, [a list] or {a: mapping}"]),
        ("duration=&a 1", [f"duration=&a 1: {ANCHOR}"]),
        ("duration=1\n---\n2", [r"duration=1\n---\n2: a second document begins here, and a file holds one"]),
        (
            "model=\udcff",
            [r"model=\udcff: '\udcff' (U+DCFF) is not allowed; write it as an escape in double quotes"],
        ),
    ],
)
def test_a_setting_that_does_not_fit_is_reported_as_it_was_given(assignment: str, lines: list[str]) -> None:
    path = put(WRITTEN.replace("start:", "start: {}"))
    assert problems(lambda: read(path, Run, [assignment])) == lines


def test_a_file_among_settings_is_told_to_belong_to_an_option(tmp_path: Path) -> None:
    policy = tmp_path / "p.onnx"
    policy.touch()
    path = put(WRITTEN.replace("start:", "start: {}"))
    (problem,) = problems(lambda: read(path, Run, [str(policy)]))
    assert problem.endswith(": write key=value; a file belongs to an option, such as --policy")


def test_faults_of_the_document_come_before_those_of_settings_and_a_good_setting_mends_a_bad_value() -> None:
    path = put("duration: -1\nsteps: x\n")
    assert problems(lambda: read(path, Run, ["model=5", "nothing", "duration=2"])) == [
        "d.yaml:2:8: steps: expected a whole number, got 'x'",
        "model=5: expected text, got 5; to write text, use quotes: '5'",
        "nothing: write key=value; switches such as --json and --markdown take no value",
    ]
