"""Whatever text is put into a page comes out of a parser as it was."""

from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import clean
from mjrun.plotting.markup import Markup, element, joined, table_element


class Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data


def read(html: str) -> Reader:
    reader = Reader()
    reader.feed(html)
    reader.close()
    return reader


@given(st.text(max_size=30), st.text(max_size=30))
def test_text_and_attributes_are_escaped(text: str, value: str) -> None:
    reader = read(element("p", text, title=value))
    assert reader.tags == [("p", {"title": clean(value)})]
    assert reader.text == clean(text)


@pytest.mark.parametrize("text", ["<script>alert(1)</script>", "</style>", '" onload="x', "<!--", "&lt;"])
def test_what_looks_like_markup_is_text(text: str) -> None:
    reader = read(element("td", element("code", text), text, title=text))
    assert [tag for tag, _ in reader.tags] == ["td", "code"]
    assert reader.text == text + text


def test_attributes_are_named_as_in_html_and_left_out_when_they_say_nothing() -> None:
    assert element("video", src="a", controls=True, loop=False, title=None) == '<video src="a" controls></video>'
    assert element("meta", http_equiv="x", class_="y") == '<meta http-equiv="x" class="y">'


def test_pieces_of_markup_stay_as_they_are() -> None:
    assert joined(Markup("<b>x</b>"), " < ", element("br")) == "<b>x</b> &lt; <br>"


def test_a_table_names_its_columns() -> None:
    row = element("tr", element("td", "x"), element("td", "1"))
    html = table_element("About", ["Name", "Value"], [row], numeric=[1])
    assert '<th scope="col">Name</th><th scope="col" class="number">Value</th>' in html
    assert "<caption>About</caption>" in html
