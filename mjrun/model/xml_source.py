"""The XML of a model with the lines of its elements, includes followed, and the default classes of elements.

MuJoCo's parser stops at the first mistake, forgets the lines of included files, and reports little about the elements.
"""

import codecs
import hashlib
import re
import stat
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import field
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from mjrun.confinement.confinement import is_readable
from mjrun.dataclass import dataclass
from mjrun.suffixes import XML

MAX_DEPTH = 50  # levels of nested includes
MAX_FILES = 500  # beyond these, includes and attached models are not followed
START_TAG = re.compile(rb"<(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")
# A comment, or text that may resemble one.
COMMENT = re.compile(rb"(?<=<!--)(?P<text>.*?)(?=-->)|<!\[CDATA\[.*?\]\]>", re.DOTALL)
DASHES = re.compile(rb"-{2,}|-\Z")  # which MuJoCo accepts in comments, unlike XML
ASCII = 127  # the largest byte of ASCII
LFS_POINTER = b"version https://git-lfs"  # the first bytes of the pointer that Git LFS leaves in place of a file
LFS_REMEDY = "fetch the file itself: git lfs pull"
_UNQUOTED_VALUE = re.compile(rb"\A[^>]*\s([\w:.-]+)\s*=\s*\Z")  # the text before it
_INVALID_TOKEN = expat.errors.codes[expat.errors.XML_ERROR_INVALID_TOKEN]
_NO_ELEMENT = expat.errors.codes[expat.errors.XML_ERROR_NO_ELEMENTS]
_REMEDIES = {
    expat.errors.XML_ERROR_DUPLICATE_ATTRIBUTE: "an element has each attribute only once; remove one of the two",
    expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT: "a file has one root element; put everything into one <mujoco>",
    expat.errors.XML_ERROR_INVALID_TOKEN: "save the file as UTF-8, and write & and < as &amp; and &lt;",
    expat.errors.XML_ERROR_UNDEFINED_ENTITY: "write &amp; for & itself; only &lt; &gt; &amp; &quot; &apos; are defined",
}
ACTUATORS = (
    *("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion"),
    *("orientation", "pid", "dcmotor", "plugin"),
)
# The tags of elements in defaults that concern elements of other tags, too.
CUBE_FACES = ("fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")  # attributes of textures
SHARED = (ACTUATORS, ("tendon", "spatial", "fixed"))


@dataclass(eq=False)
class Element:
    """An element and the position of its start tag.

    Attributes:
      text: its text without that of its children, stripped; it begins at `text_line`.
      offset: the byte in its file at which the start tag begins.
      closing: the byte at which the end tag begins.
      last_line: the line of the end tag.
    """

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    parent: "Element | None" = None
    children: "list[Element]" = field(default_factory=list)
    text: str = ""
    text_line: int = 0
    offset: int = 0
    closing: int = 0
    last_line: int = 0

    def walk(self) -> "Iterator[Element]":
        """Yields this element and all elements below it, in the order of the file."""
        stack: list[Element] = [self]
        while stack:
            element = stack.pop()
            yield element
            stack.extend(reversed(element.children))

    def within(self, tag: str) -> bool:
        """Returns whether an element with this tag is above it."""
        above = self.parent
        while above is not None and above.tag != tag:
            above = above.parent
        return above is not None

    def child(self, tag: str) -> "Element | None":
        """Returns the first child with this tag; None without one."""
        return next((child for child in self.children if child.tag == tag), None)

    def numbers(self, attribute: str) -> tuple[float, ...]:
        """Returns the numbers of an attribute; none if it is missing or holds something else."""
        try:
            return tuple(map(float, self.attributes.get(attribute, "").split()))
        except ValueError:
            return ()

    def __str__(self) -> str:
        name = self.attributes.get("name")
        return f"<{self.tag}>" if name is None else f'<{self.tag} name="{name}">'


@dataclass(eq=False)
class Comment:
    """A comment, and the element that it belongs to: one that starts earlier on its line, or else the next one.

    Attributes:
      element: None for a comment after the last element.
    """

    text: str
    file: Path
    line: int
    element: Element | None = None


class XmlProblem(NamedTuple):
    """The reason why a file is not well-formed XML."""

    file: Path
    line: int
    message: str
    remedy: str


@dataclass
class XmlSource:
    """The XML of a model.

    Attributes:
      path: the path of the model.
      root: the root element; None if nothing could be read.
      includes: the `<include>` elements that were replaced by the included elements.
      attached: the roots of the models that it attaches, directly or indirectly; their includes are not followed.
      circular: true if one of these attaches itself again, which crashes MuJoCo.
      errors: an error for each file that is not well-formed.
      comments: the comments of the model and of its includes.
      attached_comments: those of the models that it attaches.
      texts: the bytes of each file that was read.
    """

    path: Path
    root: Element | None = None
    includes: list[Element] = field(default_factory=list)
    attached: list[Element] = field(default_factory=list)
    circular: bool = False
    errors: list[XmlProblem] = field(default_factory=list)
    comments: list[Comment] = field(default_factory=list)
    attached_comments: list[Comment] = field(default_factory=list)
    texts: dict[Path, bytes] = field(default_factory=dict)

    @property
    def mjcf_texts(self) -> dict[Path, bytes]:
        """The bytes of each file of MJCF that was read; URDF is not edited, be it the model or attached."""
        others = {root.file for root in (self.root, *self.attached) if root and root.tag != "mujoco"}
        return {path: text for path, text in self.texts.items() if path not in others}

    def elements(self) -> Iterator[Element]:
        """Yields all elements in order, those of included files in place of the include."""
        return self.root.walk() if self.root else iter(())


def read_xml(path: Path) -> XmlSource:
    """Reads the XML of the model `path` as far as possible; it has no elements for an archive or a binary."""
    source = XmlSource(path)
    if path.suffix in XML:
        source.root = _parsed(source, path)
    if source.root:
        _follow(source, source.root)
        _attach(source)
    return source


def is_regular(path: Path) -> bool:
    """Returns whether `path` is a regular file, which can be read without blocking, and which this process may read."""
    try:
        return is_readable(path) and stat.S_ISREG(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def xml_paths(element: Element, path: Path) -> list[Path]:
    """Returns the paths at which MuJoCo looks for the file of an `<include>` or `<model>` in the model `path`."""
    name = with_slashes(element.attributes.get("file", ""))
    return list(dict.fromkeys([path.parent / name, element.file.parent / name]))


def with_slashes(name: str) -> str:
    """Returns a file name as MuJoCo opens it: backslashes separate folders on every system."""
    return name.replace("\\", "/")


def _follow(source: XmlSource, root: Element) -> None:
    """Replaces each `<include>` under `root` by the elements of the included file."""
    seen = {source.path.resolve()}
    waiting = [(element, 0) for element in root.walk() if element.tag == "include"]
    while waiting:
        include, depth = waiting.pop()
        path = next(filter(is_regular, xml_paths(include, source.path)), None)
        if path is None or include.parent is None or path.resolve() in seen:
            continue
        if depth > MAX_DEPTH or len(seen) > MAX_FILES:
            continue

        seen.add(path.resolve())
        inner = _parsed(source, path)
        if inner is None:
            continue

        source.includes.append(include)
        position = include.parent.children.index(include)
        for child in inner.children:
            child.parent = include.parent
        include.parent.children[position : position + 1] = inner.children
        waiting += [(e, depth + 1) for child in inner.children for e in child.walk() if e.tag == "include"]


def _attach(source: XmlSource) -> None:
    """Reads the models that `source` attaches, directly or indirectly."""
    seen = {source.path.resolve()}
    waiting = [(path, frozenset(seen)) for path in reversed(attached_files(source.elements(), source.path))]
    while waiting and len(source.attached) < MAX_FILES:
        path, above = waiting.pop()
        real = path.resolve()
        source.circular |= real in above
        own = XmlSource(path, comments=source.attached_comments, texts=source.texts)
        root = _parsed(own, path) if real not in seen and path.suffix in XML else None
        seen.add(real)
        if root:
            source.attached.append(root)
            waiting += [(inner, above | {real}) for inner in reversed(attached_files(root.walk(), path))]


def attached_files(elements: Iterator[Element], path: Path) -> list[Path]:
    """Returns the files that `<model>` elements of the model `path` refer to; missing ones are omitted."""
    candidates = (xml_paths(element, path) for element in elements if element.tag == "model")
    return [file for paths in candidates if (file := next(filter(is_regular, paths), None))]


def _parsed(source: XmlSource, path: Path, encoding: str | None = None) -> Element | None:
    """Parses one file; returns its root up to the first error, and adds the error and the comments to `source`.

    Like MuJoCo, it accepts bytes in an encoding that the file does not declare; as Latin-1, each is a character.
    """
    if not is_regular(path):
        return None
    try:
        text = path.read_bytes()
    except OSError:
        return None
    source.texts[path] = text
    if text.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        source.errors.append(
            XmlProblem(path, 1, "the file is in UTF-16, which MuJoCo does not read", "save it as UTF-8")
        )
        return None
    parser = XmlParser(path, encoding)
    try:
        parser.expat.Parse(without_dashes(text), True)
    except expat.ExpatError as error:
        if error.code == _INVALID_TOKEN and text[parser.expat.ErrorByteIndex] > ASCII and encoding is None:
            return _parsed(source, path, "iso-8859-1")
        source.errors.append(parser.explain(error, text))
    except (ValueError, LookupError) as error:  # an encoding unknown to Python
        source.errors.append(XmlProblem(path, 1, f"its text cannot be read: {error}", "save the file as UTF-8"))
    source.comments += parser.comments
    return parser.root


def scan(
    text: bytes, start: Callable[[str, dict[str, str], int], object], end: Callable[[str], object] | None = None
) -> None:
    """Calls `start` with the tag, the attributes and the line of each element, and `end` with its tag.

    Text that is not well-formed, or in an unknown encoding, is scanned up to the fault.
    """
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, attributes: start(tag, attributes, parser.CurrentLineNumber)
    parser.EndElementHandler = end
    with suppress(expat.ExpatError, ValueError, LookupError):
        parser.Parse(without_dashes(text), True)


def content_digest(text: bytes) -> str:
    """Returns the SHA-256 of the elements and attributes of a model, which its comments and indentation do not change.

    Text that is not well-formed, or declares entities, which MuJoCo does not read, is hashed byte by byte.
    """
    events = list[tuple[object, ...]]()
    parser = expat.ParserCreate()
    parser.ordered_attributes = parser.buffer_text = True
    parser.XmlDeclHandler = parser.ProcessingInstructionHandler = lambda *declaration: events.append(declaration)
    parser.StartElementHandler = lambda tag, attributes: events.append((tag, attributes))
    parser.EndElementHandler = lambda _: events.append(())
    parser.CharacterDataHandler = lambda content: events.append((content.strip(),)) if content.strip() else None
    parser.StartDoctypeDeclHandler = _refuse
    try:
        parser.Parse(without_dashes(text), True)
    except (expat.ExpatError, ValueError, LookupError):
        return hashlib.sha256(text).hexdigest()
    return hashlib.sha256(repr(events).encode()).hexdigest()


def _refuse(*_: object) -> None:
    raise ValueError


def without_dashes(text: bytes) -> bytes:
    """Returns text of the same length whose comments XML allows."""

    def replaced(comment: re.Match[bytes]) -> bytes:
        if comment["text"] is None:
            return comment[0]
        return DASHES.sub(lambda dashes: b"=" * len(dashes[0]), comment["text"])

    return COMMENT.sub(replaced, text)


class XmlParser:
    """A parser that builds the elements of one file, in the encoding that it declares or in another."""

    def __init__(self, path: Path, encoding: str | None = None) -> None:
        self.path = path
        self.root: Element | None = None
        self.open: list[Element] = []
        self.comments: list[Comment] = []
        self._last: Element | None = None
        self._waiting: list[Comment] = []  # for the next element
        self.expat = expat.ParserCreate(encoding)
        self.expat.buffer_text = True
        self.expat.StartElementHandler = self._start
        self.expat.EndElementHandler = self._end
        self.expat.CharacterDataHandler = self._text
        self.expat.CommentHandler = self._comment

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        parent = self.open[-1] if self.open else None
        line, offset = self.expat.CurrentLineNumber, self.expat.CurrentByteIndex
        element = Element(tag, attributes, self.path, line, parent, offset=offset)
        if parent is not None:
            parent.children.append(element)
        self.root = self.root or element
        self.open.append(element)
        self._last = element
        for comment in self._waiting:
            comment.element = element
        self._waiting.clear()

    def _end(self, tag: str) -> None:
        element = self.open.pop()
        element.closing, element.last_line = self.expat.CurrentByteIndex, self.expat.CurrentLineNumber

    def _comment(self, text: str) -> None:
        line = self.expat.CurrentLineNumber
        comment = Comment(text.strip(), self.path, line)
        self.comments.append(comment)
        if self._last is not None and self._last.line == line:
            comment.element = self._last
        else:
            self._waiting.append(comment)

    def _text(self, text: str) -> None:
        if not (self.open and text.strip()):
            return
        element = self.open[-1]
        if not element.text:  # the parser is already at the end of the text
            element.text_line = self.expat.CurrentLineNumber - text.lstrip().count("\n")
        element.text = f"{element.text} {text.strip()}".strip()

    def explain(self, error: expat.ExpatError, text: bytes) -> XmlProblem:
        """Returns `error` in terms of the elements that are open where it occurred."""
        reason = expat.errors.messages[error.code]
        last = self.open[-1] if self.open else None
        if reason == expat.errors.XML_ERROR_TAG_MISMATCH and last is not None:
            return self._mismatch(last, error.lineno, text[self.expat.ErrorByteIndex :])
        if last is not None and error.code == _NO_ELEMENT:
            message = f"the file ends before {last} is closed"
            return XmlProblem(self.path, last.line, message, f"close it with </{last.tag}>, or end its tag with />")
        if not text.strip():
            return XmlProblem(self.path, 1, "the file is empty", "write a model into it: <mujoco> … </mujoco>")
        if text.startswith(LFS_POINTER):
            return XmlProblem(self.path, 1, "it is a Git LFS pointer, not the file itself", LFS_REMEDY)
        place = f"line {error.lineno}, column {error.offset + 1}"
        remedy = _REMEDIES.get(reason, f"look at {place}; `xmllint --noout {self.path}` checks a file")
        if unquoted := _UNQUOTED_VALUE.search(text[: self.expat.ErrorByteIndex].rpartition(b"<")[2]):
            remedy = f'write {unquoted[1].decode(errors="replace")}="…": attribute values must be quoted'
        return XmlProblem(
            self.path, error.lineno, f"not well-formed XML: {reason} at column {error.offset + 1}", remedy
        )

    def _mismatch(self, last: Element, line: int, rest: bytes) -> XmlProblem:
        tag = re.match(rb"(?:</)?\s*([^\s>]+)", rest)
        closing = tag[1].decode(errors="replace") if tag else "?"
        if any(element.tag == closing for element in self.open):
            message = f"{last} is not closed before </{closing}> on line {line}"
            return XmlProblem(self.path, last.line, message, f"close it with </{last.tag}>, or end its tag with />")
        message = f"</{closing}> closes nothing: the open element is {last} on line {last.line}"
        return XmlProblem(self.path, line, message, f"write </{last.tag}> instead, or remove it")


def holder(element: Element, attribute: str) -> Element | None:
    """Returns the element that sets an attribute of `element`; None if the value is MuJoCo's default."""
    return element if attribute in element.attributes else default_holder(element, attribute)


def default_holder(element: Element, attribute: str) -> Element | None:
    """Returns the element of a default class that sets an attribute unless `element` does; None without one."""
    tags = next((tags for tags in SHARED if element.tag in tags), (element.tag,))
    for default in _inherited(element):
        for child in reversed(default.children):
            if child.tag in tags and attribute in child.attributes:
                return child
    return None


def _inherited(element: Element) -> Iterator[Element]:
    """Yields the `<default>` elements that concern an element, those that override others first."""
    root = element
    while root.parent is not None:
        root = root.parent
    defaults = [each for each in root.walk() if each.tag == "default"][::-1]
    name = _class(element)
    while name is not None:
        own = [each for each in defaults if _class_name(each) == name]
        yield from own
        above = own[-1].parent if own else None
        name = _class_name(above) if above is not None and above.tag == "default" else None


def _class(element: Element) -> str:
    """Returns the name of the class of an element; empty for that of the whole model."""
    above = element.parent
    if above is not None and above.tag == "default":
        return _class_name(above)
    name = element.attributes.get("class")
    while name is None and above is not None:
        name, above = above.attributes.get("childclass"), above.parent
    return "" if name in (None, "main") else str(name)


def _class_name(default: Element) -> str:
    """Returns the class that a `<default>` defines; empty for that of the whole model."""
    name = default.attributes.get("class", "")
    return "" if name == "main" else name
