"""Formats of reports for CI systems, as their readers read them: commands in lines, JUnit XML, and Markdown."""

import re
from html import unescape
from xml.etree import ElementTree as ET

from markdown_it import MarkdownIt

from mjrun.cli.report_formats import MOST, CiVerdict, github, junit, markdown

CASES = [
    CiVerdict("a.xml"),
    CiVerdict("b<&>.xml", "error", 'x "y"', "100% <b>\nremedy\x1b\uffff", "b<&>.xml", 3),
    CiVerdict("b<&>.xml", "warning", "w", "text"),
    CiVerdict("c.xml", "note", "n", "text", "part.xml"),
]


def test_an_annotation_is_one_line_whatever_it_says() -> None:
    assert github([CiVerdict("m", "error", "x: y", "100%\r\nb", "a,b:c.csv", 3)]) == (
        r"::error file=a%2Cb%3Ac.csv,line=3,title=x%3A y::100%25\r%0Ab"
    )
    assert github([CiVerdict("m", "note", "t", "text", "f")]) == "::notice file=f,title=t::text"


def test_what_passed_is_not_annotated() -> None:
    assert github([CiVerdict("a"), CiVerdict("b", "warning", "t", "x"), CiVerdict("c")]) == "::warning title=t::x"


def test_errors_and_warnings_are_failures_and_the_rest_passes() -> None:
    suites = ET.fromstring(junit(CASES))
    (suite,) = suites
    for counted in (suites, suite):
        assert (counted.get("tests"), counted.get("failures"), counted.get("errors")) == ("4", "2", "0")
    passed, error, warning, note = suite
    assert (passed.attrib, len(passed)) == ({"classname": "a.xml", "name": "passes"}, 0)
    assert error.attrib == {"classname": "b<&>.xml", "name": 'x "y"', "file": "b<&>.xml", "line": "3"}
    assert [(each[0].tag, each[0].get("type")) for each in (error, warning, note)] == [
        ("failure", "error"),
        ("failure", "warning"),
        ("system-out", None),
    ]
    assert error[0].get("message") == "100% <b>"
    assert error[0].text == "b<&>.xml:3: 100% <b>\nremedy\\x1b?"
    assert note[0].text == "part.xml: text"


def test_a_report_without_cases_is_a_document() -> None:
    assert ET.fromstring(junit([])).get("tests") == "0"


def rows(cases: list[CiVerdict]) -> list[list[str]]:
    """The cells of the table as they are shown."""
    html = MarkdownIt("commonmark", {"html": True}).enable("table").render(markdown(cases))
    found = [re.findall(r"<t[hd]>(.*?)</t[hd]>", row, re.DOTALL) for row in html.split("<tr>")[1:]]
    return [[" ".join(unescape(re.sub(r"<[^>]*>", " ", cell)).split()) for cell in row] for row in found]


def test_the_worst_come_first_and_names_are_shown_as_they_are() -> None:
    cases = [
        CiVerdict("a.xml", "note", "n", "text"),
        CiVerdict("b.xml"),
        CiVerdict("c.xml", "error", "MJ1 bad", "no file 'a|b_c_*d*`e`<b>@x[y](z)#1&amp;'\nwrite it", "d.xml", 7),
    ]
    assert rows(cases) == [
        ["", "place", "finding"],
        ["❌", "d.xml:7", "MJ1 bad no file 'a|b_c_*d*`e`<b>@x[y](z)#1&amp;' write it"],
        ["ℹ️", "a.xml", "n text"],
    ]
    assert markdown(cases).startswith("**❌ 1 error, ℹ️ 1 note** in 3 items\n")


def test_nothing_found_is_one_line_and_much_is_cut() -> None:
    assert markdown([CiVerdict("a.xml"), CiVerdict("b.xml")]) == "**✅ everything passes** in 2 items"
    many = [CiVerdict(f"{i}.xml", "error", "t", "x") for i in range(MOST + 3)]
    assert len(rows(many)) == MOST + 1
    assert markdown(many).endswith("\n… and 3 more")
