"""Edits of the text of XML files: each replaces a span of bytes, and every other byte stays unchanged."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from mjrun.dataclass import dataclass
from mjrun.model.xml_source import START_TAG, Element

ATTRIBUTE = re.compile(rb"\s+(?P<name>[^\s=>/\"']+)\s*=\s*(?P<value>\"[^\"]*\"|'[^']*')")
NAME = re.compile(rb"<[^\s/>]+")
WORD = re.compile(rb"[^\s\"']+")
END = re.compile(rb"\s*/?>\Z")
DECLARED_ENCODING = re.compile(rb"\A\s*<\?xml[^>]*encoding\s*=\s*[\"']([\w.-]+)[\"']")
ENTITIES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"})
UNICODE = (b"utf-8", b"utf8", b"ascii", b"us-ascii")


@dataclass(frozen=True)
class TextEdit:
    """A replacement of a span of a file; an empty span is a place to insert text.

    An edit at the start of a file that does not exist creates it.

    Attributes:
      file: the path of the file.
      start, end: the span in bytes; the end is exclusive.
      text: the new text.
    """

    file: str
    start: int
    end: int
    text: str

    def overlaps(self, other: "TextEdit") -> bool:
        """Returns whether both change the same bytes, or create the same file."""
        overlap = self.start < other.end and other.start < self.end
        return self.file == other.file and (overlap or self.end == other.end == 0)


class UneditableError(ValueError):
    """An element whose text cannot be edited, such as one in a file of an unusual encoding."""


class _Attribute(NamedTuple):
    """The spans of an attribute in its file: all of it with the space before it, its name, its value in quotes."""

    whole: tuple[int, int]
    name: tuple[int, int]
    value: tuple[int, int]


class ElementEditor:
    """An editor of elements in the texts of files.

    Args:
      texts: the bytes of each file, as they were parsed.
    """

    def __init__(self, texts: Mapping[Path, bytes]) -> None:
        self._texts = texts

    def with_value(self, element: Element, name: str, value: str) -> TextEdit:
        """Returns the edit that sets an attribute, which is added at the end of the tag if it is missing.

        Raises:
          UneditableError: the element cannot be edited.
        """
        attribute = self._attributes(element).get(name.encode())
        if attribute is None:
            end = self._end_of_attributes(element)
            return self._edit(element, (end, end), f' {name}="{escaped(value)}"')
        start, end = attribute.value
        quote = self._texts[element.file][start : start + 1].decode()
        return self._edit(element, (start + 1, end - 1), escaped(value, quote))

    def with_words(self, element: Element, name: str, words: Mapping[int, str]) -> tuple[TextEdit, ...]:
        """Returns the edits that replace some of the words of an attribute, by index; the space between them stays.

        Raises:
          UneditableError: the element cannot be edited, or has no such words.
        """
        start, end = self._attribute(element, name).value
        spans = [match.span() for match in WORD.finditer(self._texts[element.file], start + 1, end - 1)]
        if any(index >= len(spans) for index in words):
            raise UneditableError(f"{element} has no such words in {name}")
        return tuple(self._edit(element, spans[index], word) for index, word in words.items())

    def renamed(self, element: Element, old: str, new: str) -> TextEdit:
        """Returns the edit that renames an attribute.

        Raises:
          UneditableError: the element cannot be edited, or has no such attribute.
        """
        return self._edit(element, self._attribute(element, old).name, new)

    def without(self, element: Element, name: str, removed: Collection[str] = ()) -> TextEdit:
        """Returns the edit that removes an attribute, or an empty element if `removed` are all of its attributes.

        Raises:
          UneditableError: the element cannot be edited, or has no such attribute.
        """
        attribute = self._attribute(element, name)
        if element.attributes.keys() <= set(removed) and self._tag(element)[0].endswith(b"/>"):
            return self.without_element(element)
        return self._edit(element, attribute.whole, "")

    def without_element(self, element: Element) -> TextEdit:
        """Returns the edit that removes an element, with its line if nothing else is on it.

        Raises:
          UneditableError: the element cannot be edited.
        """
        start, end = element.offset, self._end(element)
        text = self._texts[element.file]
        line_start = text.rfind(b"\n", 0, start) + 1
        rest = re.compile(rb"[ \t]*(?:\r?\n|\r)").match(text, end)
        if rest and not text[line_start:start].strip():
            start, end = line_start, rest.end()
        return self._edit(element, (start, end), "")

    def followed_by(self, element: Element, others: Sequence[str]) -> TextEdit:
        """Returns the edit that adds elements after another one, each on a separate line.

        Raises:
          UneditableError: the element cannot be edited.
        """
        end = self._end(element)
        return self._edit(element, (end, end), "".join(f"{self._new_line(element)}{other}" for other in others))

    def replaced_by(self, element: Element, others: Sequence[str]) -> TextEdit:
        """Returns the edit that replaces an element by others, each on a separate line.

        Raises:
          UneditableError: the element cannot be edited.
        """
        return self._edit(element, (element.offset, self._end(element)), self._new_line(element).join(others))

    def with_child(self, element: Element, child: str) -> TextEdit:
        """Returns the edit that adds an element at the end of another one, every line indented like its last child.

        Raises:
          UneditableError: the element cannot be edited.
        """
        tag, text = self._tag(element), self._texts[element.file]
        own = self._indent(element)
        last = element.children[-1] if element.children else None
        indent = self._indent(last) if last and last.file == element.file else f"{own}  "
        newline = self._newline(element)
        child = child.replace("\n", f"{newline}{indent}")
        if tag[0].endswith(b"/>"):
            end = self._end_of_attributes(element)
            inner = f">{newline}{indent}{child}{newline}{own}</{element.tag}>"
            return self._edit(element, (end, tag.end()), inner)
        place = element.closing
        before = text[text.rfind(b"\n", 0, place) + 1 : place]
        if before.strip():  # the end tag shares its line
            return self._edit(element, (place, place), f"{newline}{indent}{child}{newline}{own}")
        start = place - len(before)
        return self._edit(element, (start, start), f"{indent}{child}{newline}")

    def _new_line(self, element: Element) -> str:
        """Returns the text between an element and the next one, on a separate line."""
        return self._newline(element) + self._indent(element)

    def _newline(self, element: Element) -> str:
        return "\r\n" if b"\r\n" in self._texts[element.file] else "\n"

    def _indent(self, element: Element) -> str:
        text = self._texts[element.file]
        before = text[text.rfind(b"\n", 0, element.offset) + 1 : element.offset]
        return before[: len(before) - len(before.lstrip(b" \t"))].decode()

    def _end(self, element: Element) -> int:
        tag = self._tag(element)
        if tag[0].endswith(b"/>"):
            return tag.end()
        return self._texts[element.file].index(b">", element.closing) + 1

    def _attribute(self, element: Element, name: str) -> _Attribute:
        attribute = self._attributes(element).get(name.encode())
        if attribute is None:
            raise UneditableError(f"{element} has no attribute {name}")
        return attribute

    def _attributes(self, element: Element) -> dict[bytes, _Attribute]:
        tag = self._tag(element)
        position = tag.start() + self._name_length(tag[0])
        attributes: dict[bytes, _Attribute] = {}
        while match := ATTRIBUTE.match(self._texts[element.file], position, tag.end()):
            attributes[match["name"]] = _Attribute(match.span(), match.span("name"), match.span("value"))
            position = match.end()
        return attributes

    def _end_of_attributes(self, element: Element) -> int:
        tag = self._tag(element)
        end = END.search(tag[0])
        assert end, "a start tag ends in >"
        return tag.start() + end.start()

    def _tag(self, element: Element) -> re.Match[bytes]:
        """Returns the start tag of an element, if its file is in an encoding in which the tag can be edited."""
        text = self._texts.get(element.file, b"")
        tag = START_TAG.match(text, element.offset)
        if tag is None or tag[0][1 : self._name_length(tag[0])] != element.tag.encode():
            raise UneditableError(f"{element.file} cannot be edited: it is not MJCF, or its encoding is unusual")
        return tag

    @staticmethod
    def _name_length(tag: bytes) -> int:
        name = NAME.match(tag)
        return name.end() if name else 0

    def _edit(self, element: Element, span: tuple[int, int], text: str) -> TextEdit:
        if not text.isascii() and not _is_unicode(self._texts[element.file]):
            raise UneditableError(f"{element.file} is not encoded in UTF-8; only ASCII is added to it")
        return TextEdit(str(element.file), *span, text)


def _is_unicode(text: bytes) -> bool:
    """Returns whether UTF-8 can be added to a text."""
    declared = DECLARED_ENCODING.match(text)
    with suppress(UnicodeDecodeError):
        return bool(text.decode()) and (declared is None or declared[1].lower() in UNICODE)
    return False


def number_word(value: float) -> str:
    """Returns a number with ten digits, more than any measure of a model has: `0.7071067812`, `1`."""
    return f"{value:.10g}"


def edited(text: bytes, edits: Iterable[TextEdit]) -> bytes:
    """Returns the bytes of a file with edits, which do not overlap."""
    parts: list[bytes] = []
    position = 0
    for edit in sorted(edits, key=lambda edit: (edit.start, edit.end)):
        parts += [text[position : edit.start], edit.text.encode()]
        position = edit.end
    return b"".join([*parts, text[position:]])


def disjoint(groups: Iterable[tuple[TextEdit, ...]]) -> Iterator[tuple[TextEdit, ...]]:
    """Yields the groups of edits, each once, that overlap none of those before them."""
    taken: dict[TextEdit, None] = {}
    seen: set[tuple[TextEdit, ...]] = set()
    for group in groups:
        new = [edit for edit in group if edit not in taken]
        if group in seen or any(edit.overlaps(other) for edit in new for other in taken):
            continue
        seen.add(group)
        taken |= dict.fromkeys(new)
        yield group


def escaped(value: str, quote: str = '"') -> str:
    """Returns the text of an attribute in XML, without the quotes around it."""
    return value.translate(ENTITIES).replace(quote, "&quot;" if quote == '"' else "&apos;")
