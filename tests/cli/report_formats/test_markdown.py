"""Markdown, as a renderer of Markdown reads it."""

import re
from html import unescape

from markdown_it import MarkdownIt

from mjrun.cli.console import Case
from mjrun.cli.report_formats.markdown import MOST, text


def rows(cases: list[Case]) -> list[list[str]]:
    """The cells of the table as they are shown."""
    html = MarkdownIt("commonmark", {"html": True}).enable("table").render(text(cases))
    found = [re.findall(r"<t[hd]>(.*?)</t[hd]>", row, re.DOTALL) for row in html.split("<tr>")[1:]]
    return [[" ".join(unescape(re.sub(r"<[^>]*>", " ", cell)).split()) for cell in row] for row in found]


def test_the_worst_come_first_and_names_are_shown_as_they_are() -> None:
    cases = [
        Case("a.xml", "note", "n", "text"),
        Case("b.xml"),
        Case("c.xml", "error", "MJ1 bad", "no file 'a|b_c_*d*`e`<b>@x[y](z)#1&amp;'\nwrite it", "d.xml", 7),
    ]
    assert rows(cases) == [
        ["", "place", "finding"],
        ["❌", "d.xml:7", "MJ1 bad no file 'a|b_c_*d*`e`<b>@x[y](z)#1&amp;' write it"],
        ["ℹ️", "a.xml", "n text"],
    ]
    assert text(cases).startswith("**❌ 1 error, ℹ️ 1 note** in 3 items\n")


def test_nothing_found_is_one_line_and_much_is_cut() -> None:
    assert text([Case("a.xml"), Case("b.xml")]) == "**✅ everything passes** in 2 items"
    many = [Case(f"{i}.xml", "error", "t", "x") for i in range(MOST + 3)]
    assert len(rows(many)) == MOST + 1
    assert text(many).endswith("\n… and 3 more")
