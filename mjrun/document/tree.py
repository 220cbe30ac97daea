"""A document as it is written: values that know their line and column."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from mjrun.errors import clean, quoted

SHOWN = 40  # characters of a foreign text that a message shows
INVALID = object()  # what stands for a value that is reported already; fits no type

Plain = None | bool | int | float | str | list["Plain"] | dict[str, "Plain"]  # what a document can hold
Mapped = dict[str, Plain]
Path = tuple[str | int, ...]  # keys of mappings and indices of lists, from the top


@dataclass(frozen=True, order=True)
class Mark:
    """Where something is written.

    Attributes:
      order: of its source among those that a document is read from.
      line, column: from 1; 0 means the source as a whole, as a setting on the command line is.
      source: the file as the user named it, or the setting.
    """

    order: int
    line: int
    column: int
    source: str

    def __str__(self) -> str:
        return clean(self.source) + (f":{self.line}:{self.column}" if self.line else "")


@dataclass(frozen=True, order=True)
class Fault:
    """Something wrong; faults are reported in their order."""

    mark: Mark
    path: str
    message: str


@dataclass(frozen=True)
class ScalarNode:
    """A single value; `text` is how it was written, without quotes, and `origin` the variable that it came from."""

    mark: Mark
    value: bool | int | float | str | None
    text: str
    origin: str = ""


@dataclass(frozen=True)
class ListNode:
    """A list."""

    mark: Mark
    items: Sequence["Node"] = ()


@dataclass(frozen=True)
class MappingNode:
    """A mapping; `keys` are the places of its keys."""

    mark: Mark
    entries: Mapping[str, "Node"] = field(default_factory=dict[str, "Node"])
    keys: Mapping[str, Mark] = field(default_factory=dict[str, Mark])

    def with_entry(self, key: str, mark: Mark, value: "Node") -> "MappingNode":
        """The same with one entry set."""
        return MappingNode(self.mark, {**self.entries, key: value}, {**self.keys, key: mark})

    def without(self, *keys: str) -> "MappingNode":
        """The same with fewer entries."""
        return MappingNode(self.mark, {k: v for k, v in self.entries.items() if k not in keys}, self.keys)


@dataclass(frozen=True)
class InvalidNode:
    """A value that is reported already and means nothing."""

    mark: Mark


Node = ScalarNode | ListNode | MappingNode | InvalidNode


def plain(node: Node) -> object:
    """`node` as Python's own values, `INVALID` where it is broken."""
    match node:
        case ScalarNode():
            return node.value
        case ListNode():
            return [plain(item) for item in node.items]
        case MappingNode():
            return {key: plain(inner) for key, inner in node.entries.items()}
        case InvalidNode():
            return INVALID


def node_of(value: object, mark: Mark) -> Node:
    """Python's own values as a document in which all stands at one place."""
    match value:
        case dict():
            entries = {str(key): node_of(inner, mark) for key, inner in cast("dict[object, object]", value).items()}
            return MappingNode(mark, entries, dict.fromkeys(entries, mark))
        case list():
            return ListNode(mark, [node_of(item, mark) for item in cast("list[object]", value)])
        case None | bool() | int() | float() | str():
            return ScalarNode(mark, value, "" if value is None else str(value))
        case _:
            return InvalidNode(mark)


def find(node: Node, path: Path) -> Node:
    """What stands at `path`, or the last on the way to it that is there."""
    for step in path:
        if isinstance(node, MappingNode) and step in node.entries:
            node = node.entries[str(step)]
        elif isinstance(node, ListNode) and isinstance(step, int) and step < len(node.items):
            node = node.items[step]
        else:
            return node
    return node


def key_mark(node: Node, path: Path) -> Mark:
    """Where the key that `path` ends with stands."""
    parent = find(node, path[:-1])
    return parent.keys.get(str(path[-1]), parent.mark) if isinstance(parent, MappingNode) else parent.mark


def written_path(node: Node, path: Path) -> Path:
    """`path` as far as the document goes into detail; a key that a mapping leaves out ends it.

    The index 0 is skipped where one value is written without its list.
    """
    written: Path = ()
    for step in path:
        if isinstance(node, MappingNode) and isinstance(step, str):
            written = (*written, step)
            if step not in node.entries:
                return written
            node = node.entries[step]
        elif isinstance(node, ListNode) and isinstance(step, int) and step < len(node.items):
            written, node = (*written, step), node.items[step]
        elif isinstance(node, ListNode) or step != 0:
            return written
    return written


def path_text(path: Path) -> str:
    """`path` as in `shots[1].orbit.distance`."""
    parts = (f"[{step}]" if isinstance(step, int) else f".{clean(shortened(step))}" for step in path)
    return "".join(parts).removeprefix(".")


def shortened(text: str, most: int = SHOWN) -> str:
    """`text`, or its beginning if it is long."""
    return text if len(text) <= most else text[: most - 1] + "…"


def described(node: Node) -> str:
    """A value as messages show it: `-2`, `'fast'`, `nothing`, `a list`."""
    match node:
        case ScalarNode(text=""):
            text = "nothing" if node.value is None else "''"
        case ScalarNode(value=str()):
            text = quoted(shortened(node.text))
        case ScalarNode():
            text = clean(shortened(node.text))
        case ListNode():
            return "a list"
        case MappingNode():
            return "a mapping"
        case InvalidNode():
            return "what cannot be read"
    return text + (f" from {clean(node.origin)}" if node.origin else "")
