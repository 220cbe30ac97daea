"""Annotations of GitHub Actions, whose commands are lines."""

from mjrun.cli.console import Case
from mjrun.cli.report_formats.github import text


def test_an_annotation_is_one_line_whatever_it_says() -> None:
    assert text([Case("m", "error", "x: y", "100%\r\nb", "a,b:c.csv", 3)]) == (
        r"::error file=a%2Cb%3Ac.csv,line=3,title=x%3A y::100%25\r%0Ab"
    )
    assert text([Case("m", "note", "t", "text", "f")]) == "::notice file=f,title=t::text"


def test_what_passed_is_not_annotated() -> None:
    assert text([Case("a"), Case("b", "warning", "t", "x"), Case("c")]) == "::warning title=t::x"
