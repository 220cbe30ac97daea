"""The tree of a document: values with their lines and columns, the meaning of scalars, and faults at places."""

import math
import re
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple, cast

from mjrun.dataclass import dataclass
from mjrun.errors import (
    DocumentError,
    DocumentProblem,
    FileError,
    ModelNotFoundError,
    UsageError,
    clean,
    listing,
    quoted,
    shortened,
    spelled,
    suggestion,
)
from mjrun.options.kinds import OneOrMoreKind
from mjrun.options.option import OTHER_NAMES, Options, document_options
from mjrun.options.schema_validation import TYPES, SchemaViolation
from mjrun.timeline import rational

DEPTH = 50  # levels of nested values
SHOWN = 40  # characters of a document's text that a message shows
INVALID = object()  # represents a value whose fault is already reported; fits no type

Plain = None | bool | int | float | str | list["Plain"] | dict[str, "Plain"]  # what a document can hold
Mapped = dict[str, Plain]
DocumentPath = tuple[str | int, ...]  # keys of mappings and indices of lists, from the top
NOTHING = {"", "~", "null", "Null", "NULL"}
TRUTH = {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}
LONGEST = 309  # digits of the largest float
_INTEGER = re.compile(r"[-+]?[0-9]+")
_PREFIXED = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_REAL = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_INFINITY = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_NO_NUMBER = {".nan", ".NaN", ".NAN"}


DOCUMENT, DEFAULTS, ASSIGNMENTS = 0, 1, 2  # numbers of the sources of a document; assignments continue


class DocumentPlace(NamedTuple):
    """A place in a document.

    Attributes:
      order: the number of the source among those of the document.
      line, column: counted from 1; 0 means the whole source, such as an assignment on the command line.
      source: the file as the user named it, or the assignment.
    """

    order: int
    line: int
    column: int
    source: str

    @property
    def precedence(self) -> int:
        """The rank of the source: each overrides those below it, and a document overrides its defaults."""
        return {DOCUMENT: DEFAULTS, DEFAULTS: DOCUMENT}.get(self.order, self.order)

    def __str__(self) -> str:
        return clean(self.source) + (f":{self.line}:{self.column}" if self.line else "")


class DocumentFault(NamedTuple):
    """A problem at a place of a document; `document_error` reports faults in order.

    Attributes:
      choices: the end of the message, which later faults with the same choices omit.
    """

    mark: DocumentPlace
    path: str
    message: str
    choices: str = ""


@dataclass(frozen=True)
class ScalarNode:
    """A single value; `text` is its source without quotes, and `origin` the variable that it came from."""

    mark: DocumentPlace
    value: bool | int | float | str | None
    text: str
    origin: str = ""


@dataclass(frozen=True)
class ListNode:
    """A list of nodes."""

    mark: DocumentPlace
    items: Sequence["Node"] = ()


@dataclass(frozen=True)
class MappingNode:
    """A mapping; `keys` are the places of its keys."""

    mark: DocumentPlace
    entries: Mapping[str, "Node"] = field(default_factory=dict[str, "Node"])
    keys: Mapping[str, DocumentPlace] = field(default_factory=dict[str, DocumentPlace])

    def with_entry(self, key: str, mark: DocumentPlace, value: "Node") -> "MappingNode":
        """Returns a copy with one entry set."""
        return MappingNode(self.mark, {**self.entries, key: value}, {**self.keys, key: mark})

    def without(self, *keys: str) -> "MappingNode":
        """Returns a copy without some entries."""
        return MappingNode(self.mark, {k: v for k, v in self.entries.items() if k not in keys}, self.keys)


@dataclass(frozen=True)
class ReportedFaultNode:
    """A value whose fault is already reported."""

    mark: DocumentPlace


Node = ScalarNode | ListNode | MappingNode | ReportedFaultNode


def plain(node: Node) -> object:
    """Converts `node` to plain Python values, with `INVALID` for invalid nodes."""
    match node:
        case ScalarNode():
            return node.value
        case ListNode():
            return [plain(item) for item in node.items]
        case MappingNode():
            return {key: plain(inner) for key, inner in node.entries.items()}
        case ReportedFaultNode():
            return INVALID


def node_of(value: object, mark: DocumentPlace) -> Node:
    """Converts plain Python values to a tree with one place for all nodes."""
    match value:
        case dict():
            entries = {str(key): node_of(inner, mark) for key, inner in cast("dict[object, object]", value).items()}
            return MappingNode(mark, entries, dict.fromkeys(entries, mark))
        case list():
            return ListNode(mark, [node_of(item, mark) for item in cast("list[object]", value)])
        case None | bool() | int() | float() | str():
            return ScalarNode(mark, value, "" if value is None else str(value))
        case _:
            return ReportedFaultNode(mark)


def scalars(node: Node, path: DocumentPath = ()) -> Iterator[tuple[DocumentPath, ScalarNode]]:
    """Yields the single values below `node`, with their paths."""
    match node:
        case ScalarNode():
            yield path, node
        case ListNode():
            for index, item in enumerate(node.items):
                yield from scalars(item, (*path, index))
        case MappingNode():
            for key, inner in node.entries.items():
                yield from scalars(inner, (*path, key))
        case ReportedFaultNode():
            pass


def find(node: Node, path: DocumentPath) -> Node:
    """Returns the node at `path`, or the last existing node on the way to it."""
    for step in path:
        if isinstance(node, MappingNode) and step in node.entries:
            node = node.entries[str(step)]
        elif isinstance(node, ListNode) and isinstance(step, int) and step < len(node.items):
            node = node.items[step]
        else:
            return node
    return node


def key_mark(node: Node, path: DocumentPath) -> DocumentPlace:
    """Returns the place of the last key in `path`."""
    parent = find(node, path[:-1])
    return parent.keys.get(str(path[-1]), parent.mark) if isinstance(parent, MappingNode) else parent.mark


def written_path(node: Node, path: DocumentPath) -> DocumentPath:
    """Returns the part of `path` that exists in the document, up to and including the first missing key.

    The index 0 is skipped if a single value replaces its list.
    """
    written: DocumentPath = ()
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


def path_text(path: DocumentPath) -> str:
    """Formats `path` as in `shots[1].orbit.distance`."""
    parts = (f"[{step}]" if isinstance(step, int) else f".{clean(shortened(step, SHOWN))}" for step in path)
    return "".join(parts).removeprefix(".")


def described(node: Node) -> str:
    """Formats a value for messages: `-2`, `'fast'`, `nothing`, `a list`."""
    match node:
        case ScalarNode(text=""):
            text = "nothing" if node.value is None else "''"
        case ScalarNode(value=str()):
            text = quoted(shortened(node.text, SHOWN))
        case ScalarNode():
            text = clean(shortened(node.text, SHOWN))
        case ListNode():
            return "a list"
        case MappingNode():
            return "a mapping"
        case ReportedFaultNode():
            return "an unreadable value"
    return text + (f" from {clean(node.origin)}" if node.origin else "")


DeclaredAt = Callable[[DocumentPath], type[Options]]  # returns the options at a place of a document

# Places whose keys are names that may contain dots.
NAMED = (
    *("set", "qpos", "qvel", "ctrl", "vary", "correlate", "when", "metrics", "free", "changes"),
    *("reset.qpos", "reset.qvel", "reset.ctrl", "reset.noise", "reset.set", "reset.vary"),
)


def document_error(faults: Iterable[DocumentFault], more: Sequence[DocumentProblem] = ()) -> DocumentError:
    """Returns the error with all `faults`, ordered by place, and `more` problems from other documents."""
    problems, listed = list[DocumentProblem](), {""}
    for fault in sorted(set(faults)):
        problems.append(_problem(fault, "" if fault.choices in listed else fault.choices))
        listed.add(fault.choices)
    return DocumentError([*problems, *more])


def _problem(fault: DocumentFault, choices: str) -> DocumentProblem:
    # An assignment already contains the path.
    named = not fault.mark.line and fault.mark.source.startswith(f"{fault.path}=")
    return DocumentProblem(str(fault.mark), "" if named else fault.path, fault.message + choices)


def violation_faults(
    violations: Iterable[SchemaViolation], tree: Node, more_keys: Sequence[str] = ()
) -> list[DocumentFault]:
    """Returns the faults in `tree` that are not reported yet; `more_keys` are additional top-level keys."""
    nodes = ((violation, find(tree, violation.path)) for violation in violations)
    return [
        _fault(violation, node, tree, more_keys) for violation, node in nodes if not isinstance(node, ReportedFaultNode)
    ]


def _fault(violation: SchemaViolation, node: Node, tree: Node, more_keys: Sequence[str]) -> DocumentFault:
    path = violation.path
    if violation.keys is not None:
        keys = [*violation.keys, *(more_keys if len(path) == 1 and violation.keys else ())]
        return DocumentFault(
            key_mark(tree, path), path_text(path[:-1]), *_unknown(str(path[-1]), keys, violation.places)
        )
    if violation.error:
        return fault_at(tree, (*path, *violation.error.path), violation.error)
    if violation.message:
        return DocumentFault(node.mark, path_text(path), spelled(violation.message))
    hint = violation.hint
    if violation.expected == TYPES["string"] and isinstance(node, ScalarNode) and node.text:
        hint = f"; to write text, use quotes: {quoted(shortened(node.text, SHOWN))}"
    return DocumentFault(node.mark, path_text(path), f"expected {violation.expected}, got {described(node)}{hint}")


def _unknown(key: str, keys: Sequence[str], places: Sequence[str]) -> tuple[str, str]:
    """Returns the message about an unknown key, which `places` would accept, and the valid keys."""
    meant = [*(name for name in OTHER_NAMES.get(key, ()) if name in keys), *places]
    message = f"unknown key {quoted(shortened(key, SHOWN))}{suggestion(key, keys, *meant)}"
    return message, f"; keys: {listing(keys)}" if keys else ""


def fault_at(tree: Node, path: DocumentPath, error: UsageError) -> DocumentFault:
    """Returns the fault for `error` at the place that `path` leads to."""
    path = written_path(tree, path)
    owners = [tuple(owner.split(".")) for owner in NAMED]
    named = any(path[: len(owner)] == owner and len(path) > len(owner) for owner in owners)
    mark = key_mark(tree, path) if named else find(tree, path).mark
    return DocumentFault(mark, path_text(path), error.one_line(error.path))


def option_fault(tree: MappingNode, place: DocumentPath, error: UsageError, declared_at: DeclaredAt) -> DocumentFault:
    """Returns the fault for `error` at its option below `place`."""
    return fault_at(tree, (*place, *_entry_path(tree, place, error.path, declared_at(place))), error)


def _entry_path(tree: MappingNode, place: DocumentPath, path: DocumentPath, declared: type[Options]) -> DocumentPath:
    """Converts `path` to the document's keys and indices; a text such as 'ctrl,energy' in a list is one item."""
    each = next((each for each in document_options(declared) if path and each.name == path[0]), None)
    if each is None:
        return path
    kind, entries = each.kind, find(tree, (*place, each.key))
    match path:
        case (_, int() as index, *rest) if (
            isinstance(entries, ListNode) and isinstance(kind, OneOrMoreKind) and kind.commas
        ):
            counts = [len(cast("tuple[object, ...]", kind.parse(str(plain(entry))))) for entry in entries.items]
            owners = [i for i, count in enumerate(counts) for _ in range(count)]
            return (each.key, owners[index], *rest)
        case _:
            return (each.key, *path[1:])


Resolve = Callable[[str], str]  # resolves a path in a document


@contextmanager
def located_files(tree: Node, resolve: Resolve) -> Generator[None]:
    """Adds the place in a document to the error of a file in the `with` block, if the document names the file."""
    try:
        yield
    except (FileError, ModelNotFoundError) as error:
        locate_file(tree, resolve, error)
        raise


def locate_file(tree: Node, resolve: Resolve, error: FileError | ModelNotFoundError) -> None:
    """Adds the place in a document to the error of a file, if the document names the file or a demonstration in it."""
    for path, node in scalars(tree):
        if node.mark.line and isinstance(node.value, str):
            text = resolve(node.value)
            if Path(error.file) in (Path(text), Path(text.rpartition(":")[0]), Path(node.value)):
                error.locate(f"{node.mark}: {path_text(path)}")
                return


def meaning(text: str) -> bool | int | float | str | None:
    """Returns the value of a plain scalar; an integer beyond the floats becomes an infinite one."""
    if text in NOTHING:
        return None
    if text in TRUTH:
        return TRUTH[text]
    if _PREFIXED.fullmatch(text):
        return _within_floats(int(text, 0)) if len(text) <= LONGEST else math.inf
    if _INTEGER.fullmatch(text) and len(text) <= LONGEST:
        return _within_floats(int(text))
    if _REAL.fullmatch(text):
        return float(text)
    if infinity := _INFINITY.fullmatch(text):
        return -math.inf if infinity[1] == "-" else math.inf
    return math.nan if text in _NO_NUMBER else text


def _within_floats(value: int) -> float:
    try:
        float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    return value


def number(value: float) -> float:
    """Returns `value` as the shortest equal number.

    Raises:
      UsageError: the value is not finite.
    """
    if not math.isfinite(value):
        raise UsageError(f"a document cannot contain the number {value}; numbers must be finite")
    return int(value) if value == int(value) and (isinstance(value, int) or abs(value) < 1e16) else float(value)


def exact(value: float | str | Fraction) -> float | str:
    """Returns `value` as a number if that is exact, or else as text such as `30000/1001`."""
    meant = rational(value)
    try:
        near = number(float(meant))
        return near if rational(near) == meant else str(meant)
    except OverflowError:
        return str(meant)
