"""YAML text: parsed to a tree, as far as documents use YAML, with faults for the rest; and made from plain values.

PyYAML's messages about tokens and streams are replaced by messages in terms of documents.
"""

# PyYAML says little of its types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

import re
from bisect import bisect_right
from collections.abc import Callable, Mapping
from typing import NoReturn, cast

from mjrun.document import tree
from mjrun.document.tree import meaning
from mjrun.errors import UsageError, clean, quoted, shortened
from mjrun.packages import cause_of

try:
    import yaml
    from yaml import events
except ImportError as error:  # imported late, where nothing else explains that it is missing
    raise cause_of(error) or error from None

NO_DIRECTIVES = "a line that begins with % is a directive, which documents do not support"
NO_TAGS = "tags (!) are not supported; the type of a value follows from its form"
NO_ANCHORS = "anchors (&) and aliases (*) are not supported; put such text in quotes"
NO_MERGE = "merge keys (<<) are not supported"
NO_COMMAS = 'within {…} a comma ends a value; put values with commas in quotes, as in "uniform(0, 1)"'
BARE_VARIABLE = "within [ ] and { }, put text that contains ${ in quotes"
UNCLOSED = "this quote is not closed"
HOLES = "put text that contains ': ' in quotes"

# Contexts in which PyYAML's problem does not matter, with where to point: at the beginning of the context, or not.
CONTEXTS = {
    "while scanning a directive": (NO_DIRECTIVES, True),
    "while parsing a directive": (NO_DIRECTIVES, True),
    "while scanning an anchor": (NO_ANCHORS, True),
    "while scanning an alias": (NO_ANCHORS, True),
    "while scanning a tag": (NO_TAGS, True),
    "while parsing a tag": (NO_TAGS, True),
    "while parsing a node": (NO_TAGS, False),
    "while scanning a quoted scalar": (UNCLOSED, True),
    "while scanning a simple key": (f"expected 'key: value'; is a colon missing, or an indentation? {HOLES}", True),
    "while scanning a block scalar": ("only +, - and an indentation from 1 to 9 may follow | or >", False),
    "while parsing a block mapping": ("the indentation of this line matches no other line of its mapping", False),
    "while parsing a block collection": ("the indentation of this line matches no other line of its list", False),
}
# PyYAML's other problems; {} is the match of the pattern.
PROBLEMS = {
    r"found character '\\t' that.*": "a tab; YAML is indented and spaced by spaces",
    r"found character (.+) that.*": "put text that begins with {} in quotes",
    r"sequence entries are not allowed here": "a list cannot begin here; write each '- …' on a separate line",
    r"mapping keys are not allowed here": "a key cannot appear here",
    r"mapping values are not allowed here": f"a key cannot appear here; is it indented as its neighbours? {HOLES}",
    r"found unknown escape character ['\"](.+)['\"]": "no escape \\{} in double quotes; in single quotes \\ is itself",
    r"expected escape sequence of (\d+) .*": "this escape needs {} hexadecimal digits",
    r"expected '<document start>'.*": "the document ends before this",
    r"expected the node content.*": "a value is missing before this",
    r"found (incompatible|duplicate) YAML d.*": NO_DIRECTIVES,
    r"duplicate tag handle .*": NO_DIRECTIVES,
}

NODES = 50_000  # values per document
WIDTH = 110  # of a line that is written, if it can be broken

MarkAt = Callable[[int], tree.DocumentPlace]  # of the character at an index

# Characters that YAML does not print, byte order marks, and line ends that only some programs recognize. The set of all
# others would take milliseconds to compile.
FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]")
_SURROGATE = re.compile("[\ud800-\udfff]")
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")
_LINE_END = re.compile(r"\r\n|\r|\n")
_ESCAPED = re.compile("[\n\r\t]")
_TAGS = {str: "str", int: "int", float: "float", bool: "bool", type(None): "null"}


class LineIndex:
    """The lines and columns of the characters in `text`; lines end as in editors."""

    def __init__(self, text: str) -> None:
        self._starts = [0, *(found.end() for found in _LINE_END.finditer(text))]

    def at(self, index: int) -> tuple[int, int]:
        """Returns line and column, from 1, of the character at `index`."""
        line = bisect_right(self._starts, index)
        return line, index - self._starts[line - 1] + 1


def compose(text: str, place: MarkAt, inline: bool = False) -> tuple[tree.Node | None, list[tree.DocumentFault]]:
    """Returns the tree of `text` and its faults; no tree if the text is empty or cannot be parsed further.

    Aliases, anchors, tags, directives, merge keys and further documents are faults; keys are unique texts.

    Args:
      inline: accept only scalars and flow collections, as in a value on the command line.
    """
    composer = _Composer(text, place, inline)
    try:
        return composer.document(), composer.faults
    except _UnreadableError:
        return None, composer.faults


class _UnreadableError(Exception):
    """Text that cannot be parsed further; its fault is collected."""


class _Composer:
    def __init__(self, text: str, place: MarkAt, inline: bool) -> None:
        self.text, self.place, self.inline = text, place, inline
        self.faults: list[tree.DocumentFault] = []
        self.nodes = self.depth = 0

    def document(self) -> tree.Node | None:
        if found := FORBIDDEN.search(self.text):
            self._halt(found.start(), forbidden(found[0]))
        self.loader = yaml.SafeLoader(self.text)
        self._event()  # the stream begins
        start = self._event()
        if not isinstance(start, events.DocumentStartEvent):
            return None
        if start.tags or start.version not in (None, (1, 2)):
            self._fault(self.place(start.start_mark.index), (), NO_DIRECTIVES)
        node = self._node(self._event(), ())
        self._event()  # the document ends
        if not isinstance(extra := self._event(), events.StreamEndEvent):
            self._halt(extra.start_mark.index, "a second document begins here, and a file holds one")
        return node

    def _event(self) -> events.Event:
        try:
            return self.loader.get_event()
        except yaml.MarkedYAMLError as error:
            message, index = explain(error, self.loader.marks[-1] if self.loader.marks else None)
            self._halt(index, BARE_VARIABLE if self.text[index - 1 : index + 1] == "${" else message)
        except (ValueError, OverflowError):  # PyYAML accepts any eight digits as a character
            self._halt(self.loader.get_mark().index, "this escape means no character")

    def _halt(self, index: int, message: str) -> NoReturn:
        self.faults.append(tree.DocumentFault(self.place(index), "", message))
        raise _UnreadableError

    def _fault(self, mark: tree.DocumentPlace, path: tree.DocumentPath, message: str) -> None:
        self.faults.append(tree.DocumentFault(mark, tree.path_text(path), message))

    def _node(self, event: events.Event, path: tree.DocumentPath) -> tree.Node:
        assert isinstance(event, events.NodeEvent), "YAML's grammar has a value here"
        index = event.start_mark.index
        mark = self.place(index)
        self.nodes += 1
        if self.nodes > NODES:
            self._halt(index, f"more than {NODES:,} values are no document for mjrun")
        if self.depth >= tree.DEPTH:
            self._halt(index, f"more than {tree.DEPTH} lists and mappings within each other are no document for mjrun")
        self._check_properties(event, mark, path)
        if isinstance(event, events.AliasEvent):
            return tree.ReportedFaultNode(mark)
        if isinstance(event, events.ScalarEvent):
            return self._scalar(event, mark, path)
        if self.inline and isinstance(event, events.CollectionStartEvent) and not event.flow_style:
            self._halt(index, "expected one value, [a list] or {a: mapping}")
        self.depth += 1
        node = self._list(mark, path) if isinstance(event, events.SequenceStartEvent) else self._mapping(mark, path)
        self.depth -= 1
        return node

    def _check_properties(self, event: events.NodeEvent, mark: tree.DocumentPlace, path: tree.DocumentPath) -> None:
        """Reports YAML's node properties, anchors and tags, as faults."""
        if event.anchor is not None:
            self._fault(mark, path, NO_ANCHORS)
        if getattr(event, "tag", None) is not None:
            self._fault(mark, path, NO_TAGS)

    def _scalar(self, event: events.ScalarEvent, mark: tree.DocumentPlace, path: tree.DocumentPath) -> tree.Node:
        if found := _SURROGATE.search(event.value):
            self._fault(mark, path, f"the escape {quoted(found[0])} is half a character")
            return tree.ReportedFaultNode(mark)
        return tree.ScalarNode(mark, meaning(event.value) if event.implicit[0] else event.value, event.value)

    def _list(self, mark: tree.DocumentPlace, path: tree.DocumentPath) -> tree.ListNode:
        items: list[tree.Node] = []
        while not isinstance(event := self._event(), events.SequenceEndEvent):
            items.append(self._node(event, (*path, len(items))))
        return tree.ListNode(mark, items)

    def _mapping(self, mark: tree.DocumentPlace, path: tree.DocumentPath) -> tree.MappingNode:
        entries: dict[str, tree.Node] = {}
        keys: dict[str, tree.DocumentPlace] = {}
        while not isinstance(event := self._event(), events.MappingEndEvent):
            key, key_mark = self._key(event, path), self.place(event.start_mark.index)
            value = self._node(self._event(), path if key is None else (*path, key))
            if key in keys:
                self._fault(key_mark, path, f"{quoted(shortened(key, tree.SHOWN))} is given twice{_first(keys[key])}")
            elif key is not None:
                entries[key], keys[key] = value, key_mark
        return tree.MappingNode(mark, entries, keys)

    def _key(self, event: events.Event, path: tree.DocumentPath) -> str | None:
        """Returns the key that `event` begins; None if it is invalid."""
        plain = isinstance(event, events.ScalarEvent) and event.implicit[0]
        node = self._node(event, path)
        if isinstance(node, tree.ReportedFaultNode):
            return None
        if not isinstance(node, tree.ScalarNode):
            self._fault(node.mark, path, f"a key is text, not {tree.described(node)}")
        elif plain and node.text == "<<":
            self._fault(node.mark, path, NO_MERGE)
        elif plain and node.text.count(")") > node.text.count("("):
            self._fault(node.mark, path, NO_COMMAS)
        elif not isinstance(node.value, str):
            self._fault(node.mark, path, f"a key is text; {tree.described(node)} as text goes in quotes")
        elif _CONTROL.search(node.value):
            self._fault(node.mark, path, f"a key with control characters, {tree.described(node)}")
        else:
            return node.value
        return None


def _first(mark: tree.DocumentPlace) -> str:
    return f"; first in line {mark.line}" if mark.line else ""


def explain(error: yaml.MarkedYAMLError, opened: yaml.Mark | None) -> tuple[str, int]:
    """Returns the message for `error`, and the index of its character; `opened` is the start of the innermost list or
    mapping, if any.
    """
    mark = error.problem_mark or error.context_mark
    context = error.context_mark or mark
    place = mark.index if mark else 0
    if error.context in CONTEXTS:
        message, at_context = CONTEXTS[error.context]
        return message, context.index if context and at_context else place
    problem = error.problem or ""
    if opened and "flow" in (error.context or ""):
        if problem.endswith("'<stream end>'"):
            return "this bracket is not closed", opened.index
        if closing := re.match(r"expected ',' or '(.)'", problem):
            return f"expected ',' or '{closing[1]}'; the bracket opens in line {opened.line + 1}", place
    for pattern, sentence in PROBLEMS.items():
        if found := re.fullmatch(pattern, problem, re.DOTALL):
            return sentence.format(*found.groups()), place
    return f"not YAML: {clean(shortened(problem))}", place


def forbidden(character: str) -> str:
    """Returns the message about a `character` that documents cannot contain."""
    return f"{quoted(character)} (U+{ord(character):04X}) is not allowed; write it as an escape in double quotes"


def yaml_text(value: tree.Plain) -> str:
    """Formats `value`, made of mappings, lists, texts, numbers, booleans and None, as a document.

    Raises:
      UsageError: a document cannot contain one of its texts.
    """
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=WIDTH)


class _Dumper(yaml.SafeDumper):
    """A dumper that resolves plain scalars as the reader of documents does."""

    def resolve(self, kind: type[yaml.Node], value: str, implicit: tuple[bool, bool]) -> str:
        if kind is yaml.ScalarNode and implicit[0]:
            found = "merge" if value == "<<" else _TAGS[type(meaning(value))]
            return f"tag:yaml.org,2002:{found}"
        return super().resolve(kind, value, (False, False))

    def ignore_aliases(self, data: object) -> bool:
        return True

    def represent(self, data: object) -> None:
        """Writes the top level in block style, however short it is."""
        node = self.represent_data(data)
        if isinstance(node, yaml.CollectionNode):
            node.flow_style = False
        self.serialize(node)

    def represent_mapping(self, tag: str, mapping: object, flow_style: bool | None = None) -> yaml.MappingNode:
        entries = cast("Mapping[str, object]", mapping)
        for key in entries:
            if _CONTROL.search(key):
                raise UsageError(f"{quoted(key)}: a key in a document cannot contain control characters")
        return super().represent_mapping(tag, entries, flow_style)


def _represent_text(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    if _SURROGATE.search(text):
        raise UsageError(f"{quoted(text)} is not valid UTF-8, which a document requires")
    style = '"' if _ESCAPED.search(text) or FORBIDDEN.search(text) else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


def _represent_float(dumper: _Dumper, value: float) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:float", repr(value))


_Dumper.add_representer(str, _represent_text)
_Dumper.add_representer(float, _represent_float)
