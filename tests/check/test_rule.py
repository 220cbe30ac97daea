"""Theorems about rules."""

from collections.abc import Iterator
from pathlib import Path

from mjrun.check.context import CheckContext
from mjrun.check.finding import Finding, Place, Violation, short_path
from mjrun.check.rule import Rule, rule
from mjrun.model.xml_source import Element, read_xml
from tests.check.models import FINE, write

PLAIN = Rule("MJ999", "warning", "a title")


@rule("MJ998", "note", "geoms")
def geoms(context: CheckContext) -> Iterator[Violation]:
    yield context.violation("geom", 0, "first", "remedy")
    yield context.violation("geom", 0, "second", "remedy", "error")


def test_a_decorated_function_is_a_rule_whose_findings_have_its_code_and_severity() -> None:
    path = Path(write("a.xml", FINE))
    findings = list(geoms.findings(CheckContext.load(path, read_xml(path))))
    assert (geoms.code, geoms.severity, geoms.title) == ("MJ998", "note", "geoms")
    assert findings == [
        Finding("MJ998", "note", "first", "a.xml", 6, "geom 'g'", "remedy"),
        Finding("MJ998", "error", "second", "a.xml", 6, "geom 'g'", "remedy"),
    ]


def test_a_rule_without_a_function_finds_nothing_in_a_model_that_loads() -> None:
    path = Path(write("a.xml", FINE))
    assert list(PLAIN.findings(CheckContext.load(path, read_xml(path)))) == []


def test_a_finding_has_the_place_of_its_element_or_is_about_the_whole_model() -> None:
    element = Element("geom", {"name": "g"}, Path("part.xml"), 7)
    assert PLAIN.in_element(element, "m", "r") == Finding(
        "MJ999", "warning", "m", "part.xml", 7, '<geom name="g">', "r"
    )
    assert PLAIN.in_model(Path("a.xml"), "m") == Finding("MJ999", "warning", "m", "a.xml")


def test_the_origin_of_an_attached_object_is_part_of_the_message() -> None:
    place = Place(Path("a.xml"), 3, (Path("arm.xml"), 9))
    assert PLAIN.finding("m", "r", place) == Finding(
        "MJ999", "warning", "m (attached from arm.xml:9)", "a.xml", 3, "", "r"
    )


def test_a_detour_in_a_path_is_taken_out_only_if_it_leads_to_the_same_file() -> None:
    Path("a/b").mkdir(parents=True)
    Path("x.xml").touch()
    Path("link").symlink_to("a/b")
    Path("a/x.xml").touch()
    assert short_path(Path("a/../x.xml")) == "x.xml"
    assert short_path(Path("link/../x.xml")) == "link/../x.xml"
