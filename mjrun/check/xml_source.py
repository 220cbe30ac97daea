"""The XML of a model with the lines of its elements, includes followed.

MuJoCo's parser stops at the first mistake, forgets the lines of included files, and says little about what it saw.
"""

import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

DEEPEST = 50  # includes inside includes
FULLEST = 500  # files; beyond them nothing is followed any more
XML = (".xml", ".urdf")
POINTER = b"version https://git-lfs"  # with which Git LFS begins what it puts in the place of a file
PULL = "fetch the file itself: git lfs pull"


@dataclass(eq=False)
class Element:
    """One element: where its start tag is, and what it holds; `text` is its own, stripped, from `text_line` on."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    parent: "Element | None" = None
    children: "list[Element]" = field(default_factory=list)
    text: str = ""
    text_line: int = 0

    def walk(self) -> "Iterator[Element]":
        """This element and all below it, in the order of the file."""
        stack: list[Element] = [self]
        while stack:
            element = stack.pop()
            yield element
            stack.extend(reversed(element.children))

    def within(self, tag: str) -> bool:
        """Whether an element with this tag is above it."""
        above = self.parent
        while above is not None and above.tag != tag:
            above = above.parent
        return above is not None

    def __str__(self) -> str:
        name = self.attributes.get("name")
        return f"<{self.tag}>" if name is None else f'<{self.tag} name="{name}">'


class SyntaxFault(NamedTuple):
    """Why a file is no XML."""

    file: Path
    line: int
    message: str
    remedy: str


@dataclass
class Source:
    """The XML of a model.

    Attributes:
      path: the model.
      root: None when nothing could be read.
      attached: the roots of the models that it attaches, and that these attach; what they include is not followed.
      circular: whether any of these attaches itself again, on which MuJoCo crashes.
      faults: the files that are no XML.
    """

    path: Path
    root: Element | None = None
    attached: list[Element] = field(default_factory=list)
    circular: bool = False
    faults: list[SyntaxFault] = field(default_factory=list)

    def elements(self) -> Iterator[Element]:
        """All elements, in order, those of included files in the place of their include."""
        return self.root.walk() if self.root else iter(())


def read(path: Path) -> Source:
    """The XML of the model `path` as far as it can be read; nothing of an archive or a binary."""
    source = Source(path)
    if path.suffix in XML:
        source.root = _parsed(path, source.faults)
    if source.root:
        _follow(source, source.root)
        _attach(source)
    return source


def regular(path: Path) -> bool:
    """Whether `path` is a file that can be read without waiting for somebody."""
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def included(element: Element, path: Path) -> list[Path]:
    """The paths at which MuJoCo looks for what `<include>` names in the model `path`."""
    name = slashed(element.attributes.get("file", ""))
    return list(dict.fromkeys([path.parent / name, element.file.parent / name]))


def attached(element: Element, path: Path) -> list[Path]:
    """The paths at which MuJoCo looks for what `<model>` names in the model `path`."""
    name = slashed(element.attributes.get("file", ""))
    return list(dict.fromkeys([Path(name), path.parent / name]))


def slashed(name: str) -> str:
    """A file name as MuJoCo opens it: backslashes part folders everywhere."""
    return name.replace("\\", "/")


def _follow(source: Source, root: Element) -> None:
    """Puts the elements of included files in the place of each `<include>` under `root`."""
    seen = {source.path.resolve()}
    waiting = [(element, 0) for element in root.walk() if element.tag == "include"]
    while waiting:
        include, depth = waiting.pop()
        found = next(filter(regular, included(include, source.path)), None)
        if found is None or include.parent is None or depth > DEEPEST or len(seen) > FULLEST or found.resolve() in seen:
            continue
        seen.add(found.resolve())
        inner = _parsed(found, source.faults)
        if inner is None:
            continue
        where = include.parent.children.index(include)
        for child in inner.children:
            child.parent = include.parent
        include.parent.children[where : where + 1] = inner.children
        waiting += [(e, depth + 1) for child in inner.children for e in child.walk() if e.tag == "include"]


def _attach(source: Source) -> None:
    """Reads the models that `source` attaches, and those that these attach."""
    seen = {source.path.resolve()}
    waiting = [(path, frozenset(seen)) for path in reversed(attached_files(source.elements(), source.path))]
    while waiting and len(source.attached) < FULLEST:
        path, above = waiting.pop()
        real = path.resolve()
        source.circular |= real in above
        root = _parsed(path, []) if real not in seen and path.suffix in XML else None
        seen.add(real)
        if root:
            source.attached.append(root)
            waiting += [(inner, above | {real}) for inner in reversed(attached_files(root.walk(), path))]


def attached_files(elements: Iterator[Element], path: Path) -> list[Path]:
    """The files that `<model>` elements of the model `path` name, as far as there are any."""
    tried = (attached(element, path) for element in elements if element.tag == "model")
    return [found for paths in tried if (found := next(filter(regular, paths), None))]


def _parsed(path: Path, faults: list[SyntaxFault]) -> Element | None:
    """The root of one file; of a broken one, what stands before the fault."""
    if not regular(path):
        return None
    try:
        text = path.read_bytes()
    except OSError:
        return None
    building = _Building(path)
    try:
        building.parser.Parse(text, True)
    except expat.ExpatError as error:
        faults.append(building.explained(error, text))
    except (ValueError, LookupError) as error:  # an encoding that Python does not have
        faults.append(SyntaxFault(path, 1, f"its text cannot be read: {error}", "save the file as UTF-8"))
    return building.root


class _Building:
    """One file being read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.root: Element | None = None
        self.open: list[Element] = []
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        parent = self.open[-1] if self.open else None
        element = Element(tag, attributes, self.path, self.parser.CurrentLineNumber, parent)
        if parent is not None:
            parent.children.append(element)
        self.root = self.root or element
        self.open.append(element)

    def _end(self, tag: str) -> None:
        self.open.pop()

    def _text(self, text: str) -> None:
        if not (self.open and text.strip()):
            return
        last = self.open[-1]
        if not last.text:  # the parser is at the end of the text already
            last.text_line = self.parser.CurrentLineNumber - text.lstrip().count("\n")
        last.text = f"{last.text} {text.strip()}".strip()

    def explained(self, error: expat.ExpatError, text: bytes) -> SyntaxFault:
        """`error` in terms of the elements that are open where it happened."""
        said = expat.errors.messages[error.code]
        last = self.open[-1] if self.open else None
        if said == expat.errors.XML_ERROR_TAG_MISMATCH and last is not None:
            return self._mismatch(last, error.lineno, text[self.parser.ErrorByteIndex :])
        if last is not None and error.code == _NO_ELEMENT:
            message = f"the file ends before {last} is closed"
            return SyntaxFault(self.path, last.line, message, f"close it with </{last.tag}>, or end its tag with />")
        if not text.strip():
            return SyntaxFault(self.path, 1, "the file is empty", "write a model into it: <mujoco> … </mujoco>")
        if text.startswith(POINTER):
            return SyntaxFault(self.path, 1, "it is a pointer of Git LFS, and not the file itself", PULL)
        place = f"line {error.lineno}, column {error.offset + 1}"
        remedy = _CURES.get(said, f"look at {place}; `xmllint --noout {self.path}` checks a file")
        if bare := _BARE.search(text[: self.parser.ErrorByteIndex].rpartition(b"<")[2]):
            remedy = f'write {bare[1].decode(errors="replace")}="…": values of attributes stand in quotes'
        return SyntaxFault(self.path, error.lineno, f"not well-formed XML: {said} at column {error.offset + 1}", remedy)

    def _mismatch(self, last: Element, line: int, rest: bytes) -> SyntaxFault:
        found = re.match(rb"(?:</)?\s*([^\s>]+)", rest)
        closing = found[1].decode(errors="replace") if found else "?"
        if any(element.tag == closing for element in self.open):
            message = f"{last} is not closed before </{closing}> on line {line}"
            return SyntaxFault(self.path, last.line, message, f"close it with </{last.tag}>, or end its tag with />")
        message = f"</{closing}> closes nothing: the element that is open is {last} of line {last.line}"
        return SyntaxFault(self.path, line, message, f"write </{last.tag}> instead, or remove it")


_BARE = re.compile(rb"\A[^>]*\s([\w:.-]+)\s*=\s*\Z")  # before a value without its quote
_NO_ELEMENT = expat.errors.codes[expat.errors.XML_ERROR_NO_ELEMENTS]
_CURES = {
    expat.errors.XML_ERROR_DUPLICATE_ATTRIBUTE: "an element has each attribute once; remove one of the two",
    expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT: "a file holds one root element; put all inside one <mujoco>",
    expat.errors.XML_ERROR_INVALID_TOKEN: "save the file as UTF-8, and write & and < as &amp; and &lt;",
    expat.errors.XML_ERROR_UNDEFINED_ENTITY: "write &amp; for & itself; only &lt; &gt; &amp; &quot; &apos; are defined",
}
