"""JUnit XML, as a parser of XML reads it."""

from xml.etree import ElementTree as ET

from mjrun.cli.console import Case
from mjrun.cli.report_formats.junit import text

CASES = [
    Case("a.xml"),
    Case("b<&>.xml", "error", 'x "y"', "100% <b>\nremedy\x1b\uffff", "b<&>.xml", 3),
    Case("b<&>.xml", "warning", "w", "text"),
    Case("c.xml", "note", "n", "text", "part.xml"),
]


def test_errors_and_warnings_are_failures_and_the_rest_passes() -> None:
    suites = ET.fromstring(text(CASES))
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
    assert ET.fromstring(text([])).get("tests") == "0"
