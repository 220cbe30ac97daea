"""Edits that add a keyframe to the text of an MJCF file, or replace one; every other byte stays unchanged."""

import re
from collections.abc import Mapping
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from mjrun.errors import clean
from mjrun.model.xml_source import START_TAG, Element, XmlParser

BOM = b"\xef\xbb\xbf"
INDENT = b"  "  # for files without indentation
# The field of MjData that each attribute of a key holds, in MuJoCo's order.
ATTRIBUTES = {
    "time": "time",
    "qpos": "qpos",
    "qvel": "qvel",
    "act": "act",
    "ctrl": "ctrl",
    "mpos": "mocap_pos",
    "mquat": "mocap_quat",
}


def with_key(xml: bytes, name: str, fields: Mapping[str, np.ndarray]) -> bytes:
    """Returns the MJCF `xml` with a key called `name` that holds `fields` of MjData, by name; empty fields are omitted.

    A key with that name is replaced. A new key follows the last one, or goes into a new section at the end. All other
    bytes stay unchanged: comments, indentation, line ends, encoding.

    Raises:
      ValueError: `xml` is not an MJCF model, or not well-formed; the message states the fault.
    """
    if xml.startswith(BOM):
        return BOM + with_key(xml.removeprefix(BOM), name, fields)
    root = _parse(xml)
    newline = b"\r\n" if b"\r\n" in xml else b"\n"
    unit = (_indent(xml, root.children[0].offset) if root.children else b"") or INDENT
    sections = [element for element in root.children if element.tag == "keyframe"]
    keys = _keys(root)

    def lines(indent: bytes) -> bytes:
        return (newline + indent + unit).join(_lines(name, fields))

    if same := [key for key in keys if _name(key) == name]:
        start = same[-1].offset
        return _replaced(xml, start, _end(xml, same[-1]), lines(_indent(xml, start)))
    if keys:
        indent, end = _indent(xml, keys[-1].offset), _end(xml, keys[-1])
        return _replaced(xml, end, end, newline + indent + lines(indent))
    if sections:
        indent = _indent(xml, sections[-1].offset)
        return _with_child(xml, sections[-1], lines(indent + unit), indent, unit, newline)
    section = (newline + unit).join([b"<keyframe>", unit + lines(2 * unit), b"</keyframe>"])
    return _with_child(xml, root, section, _indent(xml, root.offset), unit, newline)


def key_names(xml: bytes) -> list[str]:
    """Returns the names of the keys in `xml`; empty for unnamed keys. Included files are not read.

    Raises:
      ValueError: `xml` is not an MJCF model, or not well-formed.
    """
    return [_name(key) for key in _keys(_parse(xml.removeprefix(BOM)))]


def _keys(root: Element) -> list[Element]:
    sections = [element for element in root.children if element.tag == "keyframe"]
    return [key for section in sections for key in section.children if key.tag == "key"]


def _name(key: Element) -> str:
    """Returns the name of a key, decoded as UTF-8 like MuJoCo does."""
    return key.attributes.get("name", "").encode("latin-1").decode("utf-8", "replace")


def _inner(xml: bytes, element: Element) -> int:
    """Returns the offset at which the start tag of an element ends."""
    tag = START_TAG.match(xml, element.offset)
    assert tag, "the parser reported an element here"
    return tag.end()


def _is_empty(xml: bytes, element: Element) -> bool:
    return xml[: _inner(xml, element)].endswith(b"/>")


def _end(xml: bytes, element: Element) -> int:
    """Returns the offset at which an element ends."""
    return _inner(xml, element) if _is_empty(xml, element) else xml.index(b">", element.closing) + 1


def _with_child(xml: bytes, parent: Element, child: bytes, indent: bytes, unit: bytes, newline: bytes) -> bytes:
    """Returns `xml` with `child` at the end of `parent`, which is indented by `indent`."""
    inserted = newline + indent + unit + child
    if _is_empty(xml, parent):
        end = _inner(xml, parent)
        opened = re.sub(rb"\s*/>\Z", b">", xml[parent.offset : end])
        closing = newline + indent + f"</{parent.tag}>".encode()
        return _replaced(xml, parent.offset, end, opened + inserted + closing)
    end = len(xml[: parent.closing].rstrip(b" \t\r\n"))  # after its last child
    rest = xml[end : parent.closing]
    return _replaced(xml, end, end, inserted + (b"" if b"\n" in rest else newline + indent))


def _lines(name: str, fields: Mapping[str, np.ndarray]) -> list[bytes]:
    """Returns the lines of a key without indentation: name and time, then one line for each vector."""
    texts = [
        f"{attribute}={quoteattr(' '.join(map(_number, values)))}"
        for attribute, source in ATTRIBUTES.items()
        if (values := np.ravel(fields[source]).tolist())
    ]
    heads = [f"<key name={quoteattr(name)} {texts[0]}", *texts[1:]]
    return [line.encode() for line in [*heads[:-1], heads[-1] + "/>"]]


def _number(value: float) -> str:
    """Returns the shortest text that reads back as exactly `value`."""
    return repr(value).removesuffix(".0")


def _replaced(xml: bytes, start: int, end: int, text: bytes) -> bytes:
    return xml[:start] + text + xml[end:]


def _indent(xml: bytes, start: int) -> bytes:
    """Returns the text before `start` on its line if it is blank."""
    before = xml[:start].rpartition(b"\n")[2]
    return b"" if before.strip(b" \t") else before


def _parse(xml: bytes) -> Element:
    """Returns the root of `xml`, with all elements below it."""
    # MuJoCo reads a file as UTF-8, whatever encoding it declares, and accepts invalid bytes. In Latin-1 every byte is a
    # character, so positions in the text are positions of bytes.
    parser = XmlParser(Path(), "iso-8859-1")
    try:
        parser.expat.Parse(xml, True)
    except expat.ExpatError as error:
        raise ValueError(f"it is not well-formed XML: {error}") from None
    assert parser.root
    if parser.root.tag != "mujoco":
        raise ValueError(f"it is not MJCF: its root element is <{clean(parser.root.tag)}>")
    return parser.root
