"""Pages about results: their parts, the files that they include, and manifests."""

import base64
import json
import os
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote_to_bytes

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import BadValueError, FileError, clean
from mjrun.plotting.html_page import (
    FileManifest,
    Markup,
    Page,
    PageFactTable,
    PageFigure,
    PageWriter,
    ShownFile,
    TableStatistics,
    element,
    flat,
    html_page,
    included,
    inline_svg,
    joined,
    manifest_articles,
    page_file,
    recorded_verdicts,
    table_element,
)
from mjrun.plotting.table_statistics import ColumnStatistics
from mjrun.probe.verdict import Verdict
from tests.browser import Tab, browser

EVIL = '<script>alert("1")</script>'
SVG = (
    '<svg xmlns:xlink="http://www.w3.org/1999/xlink" width="8pt" height="4pt" viewBox="0 0 8 4" '
    'xmlns="http://www.w3.org/2000/svg" version="1.1"><metadata><a href="http://x"/></metadata>'
    '<defs><path id="p" d="M 0 0"/></defs>'
    '<use xlink:href="#p" style="fill: #fff" id="unused" clip-path="url(#p)"/></svg>'
)
PAGE = Page(
    EVIL,
    "mjrun 1",
    [PageFigure(SVG, f"all of {EVIL}", ["a note"]), PageFigure(SVG, "the same again")],
    [
        (EVIL, Verdict(f"a < {EVIL}", True, f"a < {EVIL}: it is 1")),
        ("b.csv", Verdict("b < 1", False, "b < 1: it is 2")),
    ],
    [
        ShownFile("video.mp4", "video/mp4", "data:video/mp4;base64,AAAA", 1234),
        ShownFile(f"{EVIL}.png", "image/png", "./%3Cb.png", 12_345_678),
        ShownFile("frames", None, "./frames", None),
    ],
    [TableStatistics(EVIL, 12345, [ColumnStatistics(EVIL, "m/s²", -1.0, 2.5, 0.1, float("nan"), 1)])],
    [FileManifest("m.json", {"command": EVIL, "options": {EVIL: [EVIL]}})],
    [PageFactTable("What was found", EVIL, ["Name", EVIL], [(EVIL, "1.25"), ("b", EVIL)], [1])],
)
VOID = {"meta", "img", "br"}


class Nesting(HTMLParser):
    """Every element is closed, and in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.targets: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.ids += [str(values["id"])] if "id" in values else []
        for key in ("href", "aria-labelledby"):
            if (value := values.get(key)) and (key != "href" or value.startswith("#")):
                self.targets.append(value.removeprefix("#"))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def nesting(html: str) -> Nesting:
    parser = Nesting()
    parser.feed(html)
    parser.close()
    return parser


def external_references(html: str) -> list[str]:
    """Everything that a browser would load or open from elsewhere, and every script."""
    found = re.findall(r"url\([^)]*\)|@import[^;]*", html)
    for tag, attributes in read(html).tags:
        found += [tag] if tag in ("script", "iframe", "object", "embed", "link", "base") else []
        for key, value in attributes.items():
            value = value or ""
            loads = key in ("src", "href", "xlink:href", "srcset", "poster", "action", "data", "background")
            found += [f"{key}={value}"] if key.startswith("on") or (loads and not is_local(value)) else []
    return [text for text in found if not re.fullmatch(r"url\(#[\w-]+\)", text)]


def is_local(address: str) -> bool:
    return address.startswith(("#", "data:image/", "data:video/", "./"))


def test_elements_are_nested_ids_are_unique_and_links_lead_somewhere() -> None:
    page = nesting(html_page(PAGE))
    assert page.open == []
    assert len(set(page.ids)) == len(page.ids)
    assert set(page.targets) <= set(page.ids)


def test_nothing_comes_from_elsewhere_and_no_name_becomes_markup() -> None:
    html = html_page(PAGE)
    assert external_references(html) == []
    assert "http:" not in html
    assert EVIL not in html


@pytest.mark.parametrize("planted", ['<script src="x">', '<img src="http://x/y">', '<p onclick="x">', "url(https://x)"])
def test_a_planted_reference_is_found(planted: str) -> None:
    assert len(external_references(html_page(PAGE) + planted)) >= 1


def test_it_is_a_document_with_a_language_headings_and_alternatives_for_pictures() -> None:
    html = html_page(PAGE)
    tags = read(html).tags
    assert html.startswith("<!doctype html>\n<html")
    assert ("html", {"lang": "en"}) in tags
    names = [tag for tag, _ in tags]
    assert [names.count(tag) for tag in ("h1", "main", "title")] == [1, 1, 1]
    assert all(attributes.get("alt") for tag, attributes in tags if tag == "img")
    assert all(attributes.get("aria-label") for tag, attributes in tags if tag == "video")
    assert all(attributes.get("aria-labelledby") for tag, attributes in tags if tag == "svg")
    assert names.count("table") == names.count("caption")


def test_it_says_what_it_was_given() -> None:
    text = read(html_page(PAGE)).text
    for part in ("1 of 2 assertions failed", "✓ passed", "✗ failed", "it is 2", "m/s²", "−1", "12.3 MB", "a note"):
        assert part in text
    assert "links to 2 files beside it" in text
    assert "2 assertions passed" in read(html_page(Page("t", "m", verdicts=[PAGE.verdicts[0]] * 2))).text
    assert "complete in itself" in read(html_page(Page("t", "m"))).text


def test_what_there_is_none_of_has_no_section() -> None:
    page = read(html_page(Page("t", "m", tables=PAGE.tables)))
    assert [attributes["id"] for tag, attributes in page.tags if tag == "section"] == ["columns"]
    assert not [tag for tag, _ in page.tags if tag == "nav"]


def test_what_was_found_comes_first_and_has_a_row_for_each_name() -> None:
    page = read(html_page(Page("t", "m", tables=PAGE.tables, facts=PAGE.facts)))
    sections = [attributes["id"] for tag, attributes in page.tags if tag == "section"]
    assert sections == ["what-was-found", "columns"]
    assert [a.get("class") for tag, a in page.tags if tag == "td"][:2] == ["number"] * 2


def test_assertions_that_pass_do_not_hide_what_failed() -> None:
    page = read(html_page(Page("t", "m", verdicts=PAGE.verdicts[:1], verdict=(False, "2 points: 1 unstable"))))
    badges = [attributes["class"] for tag, attributes in page.tags if "badge" in str(attributes.get("class"))]
    assert badges == ["badge fail", "badge pass"]


def test_captions_are_seen_unless_they_repeat_the_heading() -> None:
    facts = [PageFactTable("Threads", caption, ["a"], [("b",)]) for caption in ("threads", "threads, timestep=.1")]
    page = read(html_page(Page("t", "m", facts=facts)))
    assert [attributes.get("class") for tag, attributes in page.tags if tag == "caption"] == ["repeated", None]
    assert [attributes["id"] for tag, attributes in page.tags if tag == "section"] == ["threads-0", "threads-1"]


def test_notes_are_in_the_caption_of_their_figure() -> None:
    figure = html_page(PAGE).split("<figure>")[1]
    assert figure.index("a note") < figure.index("</figcaption>")


@pytest.mark.slow
def test_long_names_wrap_before_a_table_scrolls(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    rows = [(f"/a/folder/of/{'models' * 12}/model.xml", "1", "yes")]
    page.write_text(html_page(Page("t", "m", facts=[PageFactTable("Models", "m", ["Model", "Errors", "Loads"], rows)])))
    with browser(tmp_path / "profile") as connection:
        tab = Tab(connection, (600, 600))
        tab.open(page.as_uri())
        tab.wait("document.querySelector('.scroll')")
        assert (
            tab.evaluate(
                "(({scrollWidth, clientWidth}) => scrollWidth - clientWidth)(document.querySelector('.scroll'))"
            )
            == 0
        )


def test_a_figure_is_as_wide_as_there_is_room_and_has_no_metadata() -> None:
    svg = inline_svg(SVG, "plot-0")
    assert svg.startswith('<svg viewBox="0 0 8 4" style="--drawn: 8pt" role="img" aria-labelledby="plot-0"><defs>')
    assert '<path id="plot-0-p"' in svg
    assert '<use href="#plot-0-p"' in svg


def test_the_same_page_is_the_same_text() -> None:
    assert html_page(PAGE) == html_page(PAGE)


def test_a_small_image_is_in_the_page_byte_by_byte(tmp_path: Path) -> None:
    (tmp_path / "a.PNG").write_bytes(bytes(range(256)))
    file = page_file(str(tmp_path / "a.PNG"), str(tmp_path / "page.html"), limit=0.001)
    kind, _, content = file.address.removeprefix("data:").partition(";base64,")
    assert (kind, base64.b64decode(content)) == ("image/png", bytes(range(256)))
    assert file.is_embedded


NOT_UTF8 = ["caf\udce9.png"] if sys.platform == "linux" else []  # other systems refuse such a name


@pytest.mark.parametrize("name", ["video.mp4", "a video, 100% #1?.webm", "<b>.gif", "ü.png", *NOT_UTF8])
def test_what_is_larger_is_linked_from_where_the_page_is(name: str, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / name).write_bytes(bytes(1001))
    file = page_file(str(tmp_path / name), str(tmp_path / "out" / "page.html"), limit=0.001)
    assert not file.is_embedded
    assert file.address.isascii()
    assert not set(file.address) & set(' #?<>"')
    assert (tmp_path / "out" / os.fsdecode(unquote_to_bytes(file.address))).resolve() == (tmp_path / name).resolve()


def test_what_no_browser_shows_is_linked(tmp_path: Path) -> None:
    (tmp_path / "run.npz").write_bytes(b"x")
    (tmp_path / "frames.png").mkdir()
    files = [page_file(str(tmp_path / name), str(tmp_path / "p.html"), 10) for name in ("run.npz", "frames.png")]
    assert [(file.kind, file.address, file.size) for file in files] == [
        (None, "./run.npz", 1),
        (None, "./frames.png", None),
    ]


def test_a_file_that_is_missing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.png"):
        page_file(str(tmp_path / "none.png"), "p.html", 10)


def test_manifests_are_reported_from_other_files(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text('{"mjrun": "0.1.0", "seed": 3}')
    (tmp_path / "calibration.json").write_text('{"fx": 1}')
    (tmp_path / "broken.json").write_text("{")
    paths = [str(tmp_path / name) for name in ("run.json", "calibration.json", "broken.json")]
    files, manifests = included(paths, str(tmp_path / "page.html"), 10)
    assert [file.address for file in files] == ["./calibration.json", "./broken.json"]
    assert [manifest.content for manifest in manifests] == [{"mjrun": "0.1.0", "seed": 3}]
    with pytest.raises(FileError, match=r"none\.json"):
        included([str(tmp_path / "none.json")], "page.html", 10)


@pytest.mark.parametrize("result", [None, 3, [], {}, {"assertions": 1}, {"assertions": [1, {"text": 1}, None]}])
def test_a_manifest_that_says_nothing_of_assertions_has_no_verdicts(result: object) -> None:
    assert recorded_verdicts([FileManifest("m.json", {"result": result})]) == []


def test_verdicts_are_those_of_the_run() -> None:
    entry = {"text": "a < 1", "passed": False, "message": "a < 1: it is 2"}
    content = {"result": {"path": "run.csv", "assertions": [entry]}}
    assert recorded_verdicts([FileManifest("m.json", content)]) == [("run.csv", Verdict(**entry))]


def test_a_manifest_within_a_table_is_part_of_the_one_beside_it() -> None:
    inner = json.loads('{"mjrun": "1", "model": {"path": "a"}}')
    assert FileManifest("t", inner).is_part_of(FileManifest("m", {**inner, "result": {}}))
    assert not FileManifest("t", inner).is_part_of(FileManifest("m", {**inner, "model": {"path": "b"}}))


def test_a_page_is_published_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text("old")
    with PageWriter(str(path)) as writer:
        writer.write(Page("t", "m"))
    assert path.read_text() == "old"
    with PageWriter(str(path)) as writer:
        writer.write(Page("t", "m"))
        writer.publish()
    assert path.read_text().endswith("</html>\n")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["run.parquet", "page", "page.svg"])
def test_only_a_page_is_written_over(name: str, tmp_path: Path) -> None:
    with pytest.raises(BadValueError, match=r"ends with \.html"):
        PageWriter(str(tmp_path / name))


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=12,
)
ALLOWED = {"article", "h3", "dl", "div", "dt", "dd", "code", "span", "details", "summary", "table", "caption"}
ALLOWED |= {"thead", "tbody", "tr", "th", "td"}
KEYS = st.sampled_from(["mjrun", "command", "model", "options", "result", "outputs", "seed", "<b>"])


def article(*manifests: FileManifest) -> str:
    return "".join(manifest_articles(manifests))


@given(st.dictionaries(KEYS, JSON, max_size=6))
def test_a_manifest_of_anything_is_shown(content: dict[str, object]) -> None:
    tags = {tag for tag, _ in read(article(FileManifest("m.json", content))).tags}
    assert tags <= ALLOWED


def test_a_manifest_of_ours_says_what_made_it() -> None:
    content = {
        "mjrun": "0.1.0",
        "mujoco": "4.0.0",
        "command": "mjrun trace <b>.xml",
        "model": {"path": "<b>.xml", "sha256": "12ab"},
        "options": {"simulation": {"duration": 2.0, "key": None}, "assert_": ["a < 1"]},
        "result": {"path": "x", "wall": 1.25, "assertions": [{"text": "a < 1"}]},
        "outputs": [{"path": "run.csv", "bytes": 12, "sha256": "feed"}],
    }
    text = read(article(FileManifest("run.json", content))).text
    for part in ("mjrun trace <b>.xml", "12ab", "mjrun 0.1.0, mujoco 4.0.0", "Wall [s]1.25", "feed", "Options (2)"):
        assert part in text
    assert "simulation.key" not in text


def test_a_command_is_broken_between_its_words_only() -> None:
    command = "mjrun sweep a.xml --repeats 3  --metric 'low=min(qpos/a)'"
    page = article(FileManifest("run.json", {"command": command}))
    assert command in read(page).text
    assert [f"<span>{word}</span>" in page for word in command.split()] == [True] * 7


def test_mappings_are_taken_apart_to_a_limit() -> None:
    deep = json.loads('{"a":' * 400 + "1" + "}" * 400)
    assert len(flat(deep)) == 1
    assert flat({"a": {"b_": 1, "c": []}, "d": False}) == {"a.b": 1, "d": False}


def test_what_all_manifests_say_is_reported_once() -> None:
    shared = {"command": "mjrun run study.yaml", "seed": 0}
    pages = [
        FileManifest(name, {**shared, "result": {"wall": wall}}) for name, wall in (("a.mp4", 1.0), ("b.csv", 2.0))
    ]
    text = read(article(*pages)).text
    assert text.count("mjrun run study.yaml") == 1
    assert text.index("mjrun run") < text.index("a.mp4") < text.index("b.csv")
    assert "Wall [s]1" in text
    assert read(article(pages[0])).text.count("mjrun run study.yaml") == 1


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
