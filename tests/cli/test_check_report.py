"""Theorems about the reports of `mjrun check`."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest

from mjrun.check.check import CheckResult, ModelCheckResult
from mjrun.check.finding import SEVERITIES, Finding, FixedFile
from mjrun.check.rule_catalogue import explanation
from mjrun.check.rule_runner import RULES
from mjrun.cli import check_report
from mjrun.cli.report_formats import github, junit, markdown

NASTY = "a\x1b[31m%\n::error::b,:"


def nasty() -> CheckResult:
    finding = Finding("MJ301", "note", f"m {NASTY}", f"dir/{NASTY}.xml", 3, f"actuator '{NASTY}'", NASTY)
    return CheckResult((ModelCheckResult("a", True, (finding,)),), 0, 0)


def test_foreign_names_reach_neither_terminal_nor_pipeline_as_they_are() -> None:
    annotations = github(check_report.cases(nasty())).split("\n")
    for told in ([*check_report.lines(nasty())], annotations):
        assert not any("\x1b" in line or "\n" in line for line in told)
        assert sum(line.startswith("::") for line in told) <= 1
    (annotation,) = annotations
    properties = annotation.split("::")[1]
    assert properties.count(",") == 2  # between file, line and title
    assert "%25" in properties


@pytest.mark.parametrize(
    ("path", "uri"),
    [
        ("a b/c.xml", "a%20b/c.xml"),
        ("../é.xml", "../%C3%A9.xml"),
        ("/tmp/a#b.xml", "file:///tmp/a%23b.xml"),
        ("a:b.xml", "a%3Ab.xml"),
        (os.fsdecode(b"\xff.xml"), "%FF.xml"),
    ],
)
def test_a_file_is_a_uri_in_sarif(path: str, uri: str) -> None:
    result = CheckResult((ModelCheckResult("a", True, (Finding("MJ301", "note", "m", path),)),), 0, 0)
    document: Any = check_report.sarif(result)
    place = document["runs"][0]["results"][0]["locations"][0]["physicalLocation"]
    assert place == {"artifactLocation": {"uri": uri}, "region": {"startLine": 1}}


def test_a_code_links_to_the_page_of_its_rule_on_terminals_that_show_links(monkeypatch: pytest.MonkeyPatch) -> None:
    linked = result(finding("MJ301"))
    for variable in ("SSH_CONNECTION", "FORCE_HYPERLINK"):
        monkeypatch.delenv(variable, raising=False)
    assert "\x1b" not in check_report.check_report(linked).text()
    monkeypatch.setenv("FORCE_HYPERLINK", "1")
    line = check_report.check_report(linked).text()
    address, shown = line.removeprefix("a.xml:3: note \x1b]8;;").split("\x1b]8;;\x1b\\")[0].split("\x1b\\")
    assert (shown, Path(unquote(urlsplit(address).path)).read_text("utf-8")) == ("MJ301", explanation("MJ301"))
    monkeypatch.setenv("SSH_CONNECTION", "remote")  # files are out of reach there
    assert "\x1b" not in check_report.check_report(linked).text()
    document: Any = check_report.sarif(linked)
    assert not any("helpUri" in rule for rule in document["runs"][0]["tool"]["driver"]["rules"])

    monkeypatch.setattr("mjrun.check.rule_catalogue.SITE", "https://example.org/mjrun/")
    assert "\x1b]8;;https://example.org/mjrun/rules/MJ301.html\x1b\\MJ301" in check_report.check_report(linked).text()
    document = check_report.sarif(linked)
    pages = {rule["id"]: rule["helpUri"] for rule in document["runs"][0]["tool"]["driver"]["rules"]}
    assert pages == {code: f"https://example.org/mjrun/rules/{code}.html" for code in RULES}


def result(*findings: Finding, loads: bool = True, skipped: int = 0) -> CheckResult:
    return CheckResult((ModelCheckResult("a.xml", loads, findings),), skipped, 0)


def finding(code: str, file: str = "a.xml", name: str = "") -> Finding:
    return Finding(code, RULES[code].severity, "message", file, 3, name, "remedy")


@pytest.mark.parametrize(
    ("checked", "text"),
    [
        (result(), "1 model: nothing found"),
        (result(finding("MJ301")), "1 model: 1 note"),
        (result(finding("MJ301"), finding("MJ302"), finding("MJ302")), "1 model: 2 warnings, 1 note"),
        (result(finding("MJ102"), loads=False), "1 model: 1 error; 1 does not load"),
        (result(skipped=1), "1 model: nothing found; 1 file skipped that is not a model"),
        (result(skipped=2), "1 model: nothing found; 2 files skipped that are not models"),
        (CheckResult((), 0, 0), "no model: nothing found"),
    ],
)
def test_the_summary_counts_in_plain_english(checked: CheckResult, text: str) -> None:
    assert check_report.summary(checked) == text


@pytest.mark.parametrize(
    ("written", "total", "each"),
    [
        (
            True,
            "1 fixed in 2 files; 1 file created",
            ["a.xml: fixed 1 MJ506", "c.xml: changed with it", "b.obj: created"],
        ),
        (
            False,
            "1 would be fixed in 2 files; 1 file would be created",
            ["a.xml: would fix 1 MJ506", "c.xml: would be changed with it", "b.obj: would be created"],
        ),
    ],
)
def test_files_that_fixes_create_are_listed_and_counted(written: bool, total: str, each: list[str]) -> None:
    others = (FixedFile("c.xml", {}, ""), FixedFile("b.obj", {}, "", is_new=True))
    files = (FixedFile("a.xml", {"MJ506": 1}, ""), *others)
    checked = CheckResult((ModelCheckResult("a.xml", True, ()),), 0, 0, fixed=files, written=written)
    assert check_report.summary(checked) == f"1 model: nothing found; {total}"
    assert list(check_report.lines(checked)) == each


@pytest.mark.parametrize(
    ("one", "message"),
    [
        (finding("MJ301"), "message"),
        (finding("MJ301", name="joint 'j'"), "joint 'j': message"),
        (finding("MJ301", name="<joint>"), "message"),
        (finding("MJ301", file="part.xml"), "message (in a.xml)"),
    ],
)
def test_a_message_begins_with_its_object_and_ends_with_its_model_where_the_file_is_another(
    one: Finding, message: str
) -> None:
    assert check_report.full_message(one, "a.xml") == message


def test_the_levels_of_sarif_and_github_are_the_severities() -> None:
    codes = {RULES[code].severity: code for code in ("MJ102", "MJ302", "MJ301")}
    checked = result(*(finding(codes[severity]) for severity in SEVERITIES))
    document: Any = check_report.sarif(checked)
    levels = [entry["level"] for entry in document["runs"][0]["results"]]
    assert levels == list(SEVERITIES)
    commands = [line.split()[0] for line in github(check_report.cases(checked)).split("\n")]
    assert commands == ["::notice", "::warning", "::error"]


def test_models_without_findings_are_cases_that_passed() -> None:
    checked = CheckResult(
        (ModelCheckResult("a.xml", True, ()), ModelCheckResult("b.xml", True, (finding("MJ301"),))), 0, 0
    )
    assert [(case.name, case.level) for case in check_report.cases(checked)] == [("a.xml", ""), ("b.xml", "note")]


def test_a_finding_in_a_file_of_several_models_is_shown_once() -> None:
    shared = finding("MJ302", "part.xml", "joint 'j'")
    models = [ModelCheckResult(name, True, (shared, finding("MJ301", name))) for name in ("a.xml", "b.xml")]
    checked = CheckResult(tuple(models), 0, 0)
    lines = [line for line in check_report.lines(checked) if "MJ" in line]
    assert [line.partition(":")[0] for line in lines] == ["part.xml", "a.xml", "b.xml"]
    assert (
        check_report.summary(checked)
        == "2 models: 2 warnings, 2 notes; 1 of them in files of several models, shown once"
    )
    document: Any = check_report.sarif(checked)
    assert len(document["runs"][0]["results"]) == 3
    cases = [*check_report.cases(checked)]
    assert [case.repeats for case in cases] == [False, False, True, False]
    assert github(cases).count("::warning") == 1
    assert markdown(cases).count("part.xml:3") == 1
    assert junit(cases).count('type="warning"') == 2  # it is a verdict about each model


def test_findings_are_folded_to_the_width_of_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    found = Finding("MJ102", "warning", "robot.xml", "a message of words, " * 5, line=3, remedy="do this or that, " * 5)
    folded = dict[str, list[str]]()
    for width in ("40", "0"):
        monkeypatch.setenv("COLUMNS", width)
        folded[width] = list(check_report.lines(result(found)))
    assert max(map(len, folded["40"])) <= 40
    assert len(folded["0"]) == 2
    assert " ".join(" ".join(folded["40"]).split()) == " ".join(" ".join(folded["0"]).split())

    summaries = dict[str, str]()
    for width in ("40", "0"):
        monkeypatch.setenv("COLUMNS", width)
        summaries[width] = check_report.check_report(replace(result(found), skipped=3, gone=5)).summary()
    assert max(map(len, summaries["40"].splitlines())) <= 40
    assert "\n" not in summaries["0"]
    assert summaries["40"].split() == summaries["0"].split()
