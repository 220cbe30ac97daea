"""Theorems about edits of the text of XML files."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from mjrun.model.text_edits import ElementEditor, TextEdit, UneditableError, disjoint, edited
from mjrun.model.xml_source import Element, read_xml

TRICKY = """<mujoco model="name='x' > y"><!-- <geom name="g"/> -->
  <worldbody>\r
    <geom\tname = 'g' size="1  2
      3" rgba="1 0 0 1"/>\r
    <body name="a"></body>
  </worldbody>
</mujoco>"""


@pytest.fixture
def text(tmp_path: Path) -> bytes:
    path = tmp_path / "model.xml"
    path.write_bytes(TRICKY.encode())
    return TRICKY.encode()


@pytest.fixture
def editor(tmp_path: Path, text: bytes) -> ElementEditor:
    return ElementEditor({tmp_path / "model.xml": text})


def element(folder: Path, tag: str) -> Element:
    return next(e for e in read_xml(folder / "model.xml").elements() if e.tag == tag)


def test_each_edit_changes_what_it_says_and_no_other_byte(tmp_path: Path, text: bytes, editor: ElementEditor) -> None:
    geom, root = element(tmp_path, "geom"), element(tmp_path, "mujoco")
    end = TRICKY.index("/>", geom.offset) + len("/>\r\n")
    whole = TRICKY[TRICKY.rindex("\n", 0, geom.offset) + 1 : end]
    for edits, old, new in (
        (editor.with_words(geom, "size", {0: "9", 2: "7"}), 'size="1  2\n      3"', 'size="9  2\n      7"'),
        ([editor.with_value(geom, "name", "h'")], "name = 'g'", "name = 'h&apos;'"),
        ([editor.with_value(geom, "mass", '"')], 'rgba="1 0 0 1"/>', 'rgba="1 0 0 1" mass="&quot;"/>'),
        ([editor.with_value(root, "name", "m")], '> y">', '> y" name="m">'),
        ([editor.renamed(geom, "rgba", "colour")], "rgba=", "colour="),
        ([editor.without(geom, "name")], "\tname = 'g'", ""),
        ([editor.without(geom, "name", geom.attributes)], whole, ""),
        ([editor.without(geom, "name", {"name"})], "\tname = 'g'", ""),
        ([editor.without_element(element(tmp_path, "body"))], '    <body name="a"></body>\n', ""),
        ([editor.with_child(element(tmp_path, "body"), "<x/>")], '"a"><', '"a">\r\n      <x/>\r\n    <'),
        ([editor.with_child(element(tmp_path, "worldbody"), "<x/>")], "  </worldbody>", "    <x/>\r\n  </worldbody>"),
        ([editor.followed_by(geom, ["<x/>", "<y/>"])], '1"/>\r', '1"/>\r\n    <x/>\r\n    <y/>\r'),
        (
            [editor.replaced_by(element(tmp_path, "body"), ["<x/>", "<y/>"])],
            '<body name="a"></body>',
            "<x/>\r\n    <y/>",
        ),
    ):
        assert TRICKY.count(old) == 1
        assert edited(text, edits).decode() == TRICKY.replace(old, new)
        ElementTree.fromstring(edited(text, edits))


def test_a_child_opens_an_element_that_was_closed_at_once(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text("<mujoco>\n  <contact />\n</mujoco>")
    edit = ElementEditor({path: path.read_bytes()}).with_child(element(tmp_path, "contact"), "<x/>")
    assert edited(path.read_bytes(), [edit]).decode() == "<mujoco>\n  <contact>\n    <x/>\n  </contact>\n</mujoco>"


def test_text_that_the_file_cannot_hold_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_bytes(b"<?xml version='1.0' encoding='latin-1'?><mujoco model='x'/>")
    editor, root = ElementEditor({path: path.read_bytes()}), element(tmp_path, "mujoco")
    assert editor.with_value(root, "model", "y").text == "y"
    with pytest.raises(UneditableError, match="only ASCII"):
        editor.with_value(root, "model", "\u00e9")
    path.write_bytes("<mujoco><!-- \u00e9 --></mujoco>".encode("latin-1"))
    with pytest.raises(UneditableError, match="only ASCII"):
        ElementEditor({path: path.read_bytes()}).with_value(element(tmp_path, "mujoco"), "model", "\u00e9")
    path.write_bytes("<mujoco/>".encode("utf-16"))
    with pytest.raises(UneditableError, match="encoding"):
        ElementEditor({path: path.read_bytes()}).with_value(root, "model", "y")


def test_groups_of_edits_are_made_whole_and_once() -> None:
    a, b, c = (TextEdit("f", start, start + 2, "x") for start in (0, 1, 2))
    insertion = TextEdit("f", 2, 2, "y")
    assert list(disjoint([(a,), (b, c), (a,), (c, insertion), (a, insertion)])) == [
        (a,),
        (c, insertion),
        (a, insertion),
    ]
    assert edited(b"0123", [insertion, c, a]) == b"xyx"
    new, other = (TextEdit("new", 0, 0, text) for text in "xy")
    assert list(disjoint([(a, new), (b, other), (c, new)])) == [(a, new), (c, new)]  # a file is created once


def test_an_element_after_another_on_the_line_is_indented_like_the_line(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text("<mujoco>\n  <a/><b/>\n</mujoco>")
    edit = ElementEditor({path: path.read_bytes()}).followed_by(element(tmp_path, "b"), ["<x/>"])
    assert edited(path.read_bytes(), [edit]).decode() == "<mujoco>\n  <a/><b/>\n  <x/>\n</mujoco>"
