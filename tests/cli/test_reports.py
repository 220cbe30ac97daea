"""Reports: the form that is printed, and where."""

from __future__ import annotations

import json
from dataclasses import dataclass

import pytest

from mjrun.cli.console import CommandReport, Console, document_form
from mjrun.cli.report_formats import CiVerdict
from mjrun.errors import flag
from mjrun.options.every_command import DOCUMENT_FORMS


@dataclass(frozen=True)
class Result:
    value: int = 3


def not_made() -> str:
    raise AssertionError("no form is made that is not printed")


ALL = CommandReport(
    "thing",
    Result(),
    text=lambda: "text",
    summary=lambda: "summary",
    forms={"csv": lambda: "a,b", "sarif": lambda: {"version": "2.1.0"}},
    cases=lambda: [CiVerdict("a"), CiVerdict("b", "note", "rule", "text", "f")],
)
SHORT = CommandReport(
    "", Result(), summary=lambda: "long\nsummary", forms={"csv": lambda: "a,b"}, remark=lambda: "remark"
)
JSON = {"value": 3, "schema": "mjrun-thing-1"}


@pytest.mark.parametrize(
    ("report", "form", "verbosity", "out", "err"),
    [
        (ALL, "", 0, "text\nsummary\n", ""),
        (ALL, "", -1, "text\n", ""),
        (ALL, "csv", 0, "a,b\n", "summary\n"),
        (ALL, "csv", -1, "a,b\n", ""),
        (ALL, "github", 0, "::notice file=f,title=rule::text\n", "summary\n"),
        (SHORT, "github", 0, "", "remark\n"),
        (ALL, "sarif", 0, '{\n  "version": "2.1.0"\n}\n', "summary\n"),
        (SHORT, "", 0, "long\nsummary\n", ""),
        (SHORT, "csv", 0, "a,b\n", "remark\n"),
    ],
)
def test_prose_and_other_forms_have_their_streams(
    capsys: pytest.CaptureFixture[str], report: CommandReport, form: str, verbosity: int, out: str, err: str
) -> None:
    console = Console()
    console.verbosity = verbosity
    console.answer(report, form)
    console.finish()
    assert capsys.readouterr() == (out, err)


def test_a_summary_makes_way_for_the_output(capsys: pytest.CaptureFixture[str]) -> None:
    Console().answer(SHORT, is_piped=True)
    assert capsys.readouterr() == ("", "long\nsummary\n")


def test_a_document_is_asked_for_by_its_option() -> None:
    assert document_form(["video", "a.xml", "--", "--json"]) == ""
    assert [document_form(["video", flag(name)]) for name in DOCUMENT_FORMS] == list(DOCUMENT_FORMS)


@pytest.mark.parametrize(("kind", "expected"), [("thing", JSON), ("", {"value": 3})])
def test_json_is_the_result_and_its_schema_alone(
    capsys: pytest.CaptureFixture[str], kind: str, expected: dict[str, object]
) -> None:
    console = Console(document_form="json")
    console.answer(CommandReport(kind, Result(), text=not_made, summary=not_made, forms={"csv": not_made}))
    console.finish()
    assert json.loads(capsys.readouterr().out) == expected
