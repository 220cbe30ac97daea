"""A keyframe in the text of an MJCF file: new, or in place of the one of its name; every other byte stays as it was."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from mjrun.errors import clean

BOM = b"\xef\xbb\xbf"
INDENT = b"  "  # where the file shows none of its own
# Of every attribute of a key, the field of MjData that it holds, in MuJoCo's order.
ATTRIBUTES = {
    "time": "time",
    "qpos": "qpos",
    "qvel": "qvel",
    "act": "act",
    "ctrl": "ctrl",
    "mpos": "mocap_pos",
    "mquat": "mocap_quat",
}
_TAG = re.compile(rb"<(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")


@dataclass
class _Element:
    """Where an element is in the text: its start tag from `start` to `inner`, its end tag from `closing` to `end`."""

    tag: str
    name: str
    start: int
    inner: int
    is_empty: bool
    closing: int = 0
    end: int = 0
    children: "list[_Element]" = field(default_factory=list["_Element"])


def with_key(xml: bytes, name: str, fields: Mapping[str, np.ndarray]) -> bytes:
    """The MJCF `xml` with a key called `name` that holds `fields` of MjData, by their names; empty ones are left out.

    A key of that name is replaced. Another goes behind the last one, or into a section of its own at the end. All that
    is around it stays as it is, to the byte: comments, indentation, line ends, encoding.

    Raises:
      ValueError: it is not an MJCF model, or not well-formed; the message says what it is instead.
    """
    root = _parse(xml)
    newline = b"\r\n" if b"\r\n" in xml else b"\n"
    unit = (_indent(xml, root.children[0].start) if root.children else b"") or INDENT
    sections = [element for element in root.children if element.tag == "keyframe"]
    keys = [key for section in sections for key in section.children if key.tag == "key"]

    def lines(indent: bytes) -> bytes:
        return (newline + indent + unit).join(_lines(name, fields))

    if same := [key for key in keys if key.name == name]:
        return _replaced(xml, same[-1].start, same[-1].end, lines(_indent(xml, same[-1].start)))
    if keys:
        indent, end = _indent(xml, keys[-1].start), keys[-1].end
        return _replaced(xml, end, end, newline + indent + lines(indent))
    if sections:
        indent = _indent(xml, sections[-1].start)
        return _with_child(xml, sections[-1], lines(indent + unit), indent, unit, newline)
    section = (newline + unit).join([b"<keyframe>", unit + lines(2 * unit), b"</keyframe>"])
    return _with_child(xml, root, section, _indent(xml, root.start), unit, newline)


def key_names(xml: bytes) -> list[str]:
    """The names of the keys that are written in `xml` itself; empty for those without one.

    Raises:
      ValueError: it is not an MJCF model, or not well-formed.
    """
    sections = [element for element in _parse(xml).children if element.tag == "keyframe"]
    return [key.name for section in sections for key in section.children if key.tag == "key"]


def _with_child(xml: bytes, parent: _Element, child: bytes, indent: bytes, unit: bytes, newline: bytes) -> bytes:
    """`xml` with a `child` at the end of `parent`, which is indented by `indent`."""
    inserted = newline + indent + unit + child
    if parent.is_empty:
        opened = re.sub(rb"\s*/>\Z", b">", xml[parent.start : parent.inner])
        closing = newline + indent + f"</{parent.tag}>".encode()
        return _replaced(xml, parent.start, parent.end, opened + inserted + closing)
    end = len(xml[: parent.closing].rstrip(b" \t\r\n"))  # behind the last thing in it
    rest = xml[end : parent.closing]
    return _replaced(xml, end, end, inserted + (b"" if b"\n" in rest else newline + indent))


def _lines(name: str, fields: Mapping[str, np.ndarray]) -> list[bytes]:
    """The lines of a key, not indented: name and time, then a line for each vector."""
    texts = [
        f"{attribute}={quoteattr(' '.join(map(_number, values)))}"
        for attribute, source in ATTRIBUTES.items()
        if (values := np.ravel(fields[source]).tolist())
    ]
    heads = [f"<key name={quoteattr(name)} {texts[0]}", *texts[1:]]
    return [line.encode() for line in [*heads[:-1], heads[-1] + "/>"]]


def _number(value: float) -> str:
    """The shortest number that is read as exactly `value`."""
    return repr(value).removesuffix(".0")


def _replaced(xml: bytes, start: int, end: int, text: bytes) -> bytes:
    return xml[:start] + text + xml[end:]


def _indent(xml: bytes, start: int) -> bytes:
    """What is before `start` in its line, if it is nothing but blanks."""
    before = xml[:start].rpartition(b"\n")[2]
    return b"" if before.strip(b" \t") else before


def _parse(xml: bytes) -> _Element:
    """The root of `xml`, with all elements below it."""
    skipped = len(BOM) if xml.startswith(BOM) else 0
    # MuJoCo takes a file for UTF-8, whatever it declares, and reads past bytes that are not. As Latin-1 every byte is a
    # character, so that positions are those of bytes.
    parser = expat.ParserCreate("iso-8859-1")
    roots: list[_Element] = []
    open_elements: list[_Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        at = parser.CurrentByteIndex + skipped
        match = _TAG.match(xml, at)
        inner = match.end() if match else at
        name = attributes.get("name", "").encode("latin-1").decode("utf-8", "replace")
        element = _Element(tag, name, at, inner, xml[inner - 2 : inner] == b"/>")
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        element = open_elements.pop()
        element.closing = element.inner if element.is_empty else parser.CurrentByteIndex + skipped
        element.end = element.inner if element.is_empty else xml.index(b">", element.closing) + 1

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(xml[skipped:], True)
    except expat.ExpatError as error:
        raise ValueError(f"it is not well-formed XML: {error}") from None
    if roots[0].tag != "mujoco":
        raise ValueError(f"it is not MJCF: its root element is <{clean(roots[0].tag)}>")
    return roots[0]
