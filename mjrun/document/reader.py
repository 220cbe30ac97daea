"""Reading of YAML files, changed by assignments `key=value`, into typed values, with all errors at their places.

Two keys at the top are resolved first: `vars:`, named values, and `defaults:`, another document below this one.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar, cast

from mjrun.dataclass import dataclass
from mjrun.document import tree
from mjrun.errors import FileError, listing, quoted, shortened, suggestion
from mjrun.formats.input_file import is_file, opened
from mjrun.options.kinds import ReadingContext
from mjrun.options.schema_validation import SchemaViolationCollector
from mjrun.options.structured_kinds import OptionsMappingKind
from mjrun.suffixes import YAML, is_yaml

VARS, DEFAULTS = "vars", "defaults"
LARGEST = 2**20  # bytes of a document
MOST_INSERTED = 2**20  # characters that variables may insert into a document

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_REFERENCE = re.compile(r"\$\$\{|\$\{([^{}$]*)\}|\$\{")
ASSIGNMENT = 60  # characters of an assignment that messages show
SWITCHES = "switches such as --json and --markdown take no value"

_STEP = re.compile(r"(?:^|\.)([^.\[\]\x00-\x1f\x7f-\x9f]+)|\[([0-9]{1,9})\]")

T = TypeVar("T")


def merged(above: tree.Node, below: tree.Node | None) -> tree.Node:
    """Merges `above` over `below`: mappings by key; any other value of `above` replaces that of `below`."""
    if not isinstance(above, tree.MappingNode) or not isinstance(below, tree.MappingNode):
        return above
    entries = {key: merged(above.entries[key], below.entries.get(key)) for key in above.entries}
    return tree.MappingNode(above.mark, {**below.entries, **entries}, {**below.keys, **above.keys})


def without_variables(root: tree.MappingNode) -> tuple[tree.MappingNode, list[tree.DocumentFault]]:
    """Returns `root` without its `vars`, with every `${name}` replaced by its value, and the faults.

    A scalar that consists of `${name}` gets the value of the variable, number or text; within a longer text, the
    source of the value is inserted. `$${` becomes `${`.
    """
    resolver = _Resolver()
    resolver.define(root.entries.get(VARS))
    rest = root.without(VARS)
    entries = {key: resolver.resolved(value, (key,)) for key, value in rest.entries.items()}
    return tree.MappingNode(rest.mark, entries, rest.keys), resolver.faults


class _Resolver:
    def __init__(self) -> None:
        self.variables: dict[str, tree.Node] = {}
        self.faults: list[tree.DocumentFault] = []
        self.substituted = 0

    def define(self, node: tree.Node | None) -> None:
        """Reads the variables."""
        if node is None or isinstance(node, tree.ReportedFaultNode):
            return
        if not isinstance(node, tree.MappingNode):
            self._fault(node.mark, (VARS,), f"expected a mapping of names to values, got {tree.described(node)}")
            return
        for name, value in node.entries.items():
            if not _NAME.fullmatch(name):
                shown = quoted(shortened(name, tree.SHOWN))
                self._fault(node.keys[name], (VARS,), f"{shown} is not a name of letters, digits and _")
            self.variables[name] = self._variable(value, (VARS, name))

    def _variable(self, value: tree.Node, path: tree.DocumentPath) -> tree.Node:
        if not isinstance(value, tree.ScalarNode | tree.ReportedFaultNode):
            self._fault(value.mark, path, f"expected a single value, got {tree.described(value)}")
            return tree.ReportedFaultNode(value.mark)
        if isinstance(value, tree.ScalarNode) and any(match[0] != "$${" for match in _REFERENCE.finditer(value.text)):
            self._fault(value.mark, path, "a variable cannot refer to another variable; write $${ for ${")
            return tree.ReportedFaultNode(value.mark)
        return self.resolved(value, path)

    def resolved(self, node: tree.Node, path: tree.DocumentPath) -> tree.Node:
        """Replaces the variables in `node`, which is at `path`."""
        match node:
            case tree.ListNode():
                return tree.ListNode(node.mark, [self.resolved(item, (*path, i)) for i, item in enumerate(node.items)])
            case tree.MappingNode():
                entries = {key: self.resolved(value, (*path, key)) for key, value in node.entries.items()}
                return tree.MappingNode(node.mark, entries, node.keys)
            case tree.ScalarNode(value=str(text)) if "${" in text:
                return self._scalar(node, text, path)
            case _:
                return node

    def _scalar(self, node: tree.ScalarNode, text: str, path: tree.DocumentPath) -> tree.Node:
        whole = _REFERENCE.fullmatch(text)
        if whole and whole[1] is not None:
            value = self._value(whole, node.mark, path)
            if not value:
                return tree.ReportedFaultNode(node.mark)
            return tree.ScalarNode(node.mark, value.value, value.text, text)
        parts: list[str] = []
        end = 0
        for match in _REFERENCE.finditer(text):
            value = None if match[0] == "$${" else self._value(match, node.mark, path)
            if match[0] != "$${" and not value:
                return tree.ReportedFaultNode(node.mark)
            parts += [text[end : match.start()], value.text if value else "${"]
            end = match.end()
            self.substituted += len(parts[-1])
            if self.substituted > MOST_INSERTED:
                self._fault(node.mark, path, f"variables insert more than {MOST_INSERTED:,} characters")
                return tree.ReportedFaultNode(node.mark)
        text = "".join([*parts, text[end:]])
        return tree.ScalarNode(node.mark, text, text)

    def _value(self, match: re.Match[str], mark: tree.DocumentPlace, path: tree.DocumentPath) -> tree.ScalarNode | None:
        """Returns the variable that `match` refers to; None if it does not exist."""
        name = match[1]
        if name is None:
            self._fault(mark, path, "${ begins a variable, ${name}; write $${ for ${")
            return None
        if name not in self.variables:
            self._fault(mark, path, _unknown(name, self.variables))
        value = self.variables.get(name)
        return value if isinstance(value, tree.ScalarNode) else None

    def _fault(self, mark: tree.DocumentPlace, path: tree.DocumentPath, message: str) -> None:
        self.faults.append(tree.DocumentFault(mark, tree.path_text(path), message))


def _unknown(name: str, variables: Mapping[str, tree.Node]) -> str:
    choices = f"vars: {listing(list(variables))}" if variables else "there are no vars"
    return f"no variable {quoted(shortened(name, tree.SHOWN))}{suggestion(name, variables)}; {choices}"


@dataclass(frozen=True)
class DocumentKind:
    """A kind of document.

    Attributes:
      name: as in "a run document".
      use: the command or option that accepts such a document.
      keys: the keys that only this kind has.
    """

    name: str
    use: str
    keys: frozenset[str]


RUN = ("videos", "images", "traces", "plots", "recordings", "keyframes", "exports")
STUDY = ("vary", "points", "metrics", "samples", "sampler")
FIT = ("data", "free", "holdout_data", "excite")
TASK = ("observations", "actions", "rewards", "terminations")
EVALUATION = ("task", "episodes", "compare", "fail_below")

# By the names of their models.
KINDS = {
    "Run": DocumentKind("a run document", "mjrun run", frozenset(RUN)),
    "Study": DocumentKind("a study document", "mjrun sweep", frozenset(STUDY)),
    "Fit": DocumentKind("a fit document", "mjrun fit", frozenset(FIT)),
    "Task": DocumentKind("a task document", "mjrun eval, or mjrun video with a policy", frozenset(TASK)),
    "Evaluation": DocumentKind("an evaluation document", "mjrun eval", frozenset(EVALUATION)),
    "CameraDocument": DocumentKind("a camera script", "the camera of mjrun video", frozenset(("shots",))),
}


def kind_of(root: tree.MappingNode) -> DocumentKind | None:
    """Returns the kind of document that `root` is: the only one whose keys it has; None if it is ambiguous.

    An evaluation may have the keys of variations that a study has, and the key `videos` of a run.
    """
    kinds = [name for name, kind in KINDS.items() if not kind.keys.isdisjoint(root.entries)]
    if "Evaluation" in kinds and {*kinds} <= {"Run", "Study", "Evaluation"}:
        return KINDS["Evaluation"]
    return KINDS[kinds[0]] if len(kinds) == 1 else None


def kind_of_file(path: Path | str) -> DocumentKind | None:
    """Returns the kind of the document at `path`; None if it is ambiguous or unreadable, which its reader reports."""
    root = unchecked_document(path)
    return None if root is None else kind_of(root)


def unchecked_document(path: Path | str, suffixes: Sequence[str] = ()) -> tree.MappingNode | None:
    """Returns the tree of the document at `path`; None if it is unreadable, which its reader reports."""
    from mjrun.document.yaml_text import compose

    try:
        with opened(Path(path), "document", suffixes) as file:
            text = file.read(LARGEST).decode("utf-8-sig")
    except (FileError, OSError, UnicodeDecodeError):
        return None
    node, _ = compose(text, lambda index: tree.DocumentPlace(0, 0, 0, str(path)))
    return node if isinstance(node, tree.MappingNode) else None


def other_kind(root: tree.MappingNode, expected: str) -> tree.DocumentFault | None:
    """Returns the fault if `root` is a document of another kind than `expected`, the name of a model."""
    kind, wanted = kind_of(root), KINDS.get(expected)
    if kind is None or wanted is None or kind is wanted:
        return None
    key = next(key for key in root.entries if key in kind.keys)
    message = f"{quoted(key)} makes this {kind.name}, for {kind.use}; expected {wanted.name}"
    return tree.DocumentFault(root.keys[key], "", message)


class _InvalidPathError(Exception):
    """A path to a place that cannot exist."""


def assign(
    root: tree.MappingNode, assignments: Sequence[str], order: int, fixed: Sequence[str] = (), named: Sequence[str] = ()
) -> tuple[tree.MappingNode, list[tree.DocumentFault]]:
    """Applies `assignments` to `root` in turn; returns the new tree and the faults.

    Missing mappings are created; items of lists must exist.

    Args:
      order: the number of the first assignment among the sources of the document.
      fixed: top-level keys that cannot be set.
      named: places below which all text up to = is one name, which may contain dots: `set.opt.cone` below `set`.
    """  # fmt: skip
    from mjrun.document.yaml_text import compose

    faults: list[tree.DocumentFault] = []
    for i, assignment in enumerate(assignments):
        mark = tree.DocumentPlace(order + i, 0, 0, shortened(assignment, ASSIGNMENT))
        key, equals, text = assignment.partition("=")
        try:
            if not equals:
                belongs = "a file belongs to an option, such as --policy" if is_file(assignment) else SWITCHES
                raise _InvalidPathError(f"write key=value; {belongs}")
            path = _path(key, named)
            if path[0] in fixed:
                raise _InvalidPathError(f"{path[0]} is set in the document only")
            value, value_faults = compose(text, lambda index, mark=mark: mark, inline=True)
            faults += value_faults
            if value or not value_faults:
                root = _with(root, path, value or tree.ScalarNode(mark, None, ""))
        except _InvalidPathError as error:
            faults.append(tree.DocumentFault(mark, "", str(error)))
    return root, faults


def _path(text: str, named: Sequence[str]) -> tree.DocumentPath:
    owner = next((f"{place}." for place in named if text.startswith(f"{place}.")), "")
    if owner and text != owner:
        return (*owner.split(".")[:-1], text.removeprefix(owner))
    steps: list[str | int] = []
    position = 0
    while match := _STEP.match(text, position):
        steps.append(match[1] if match[1] is not None else int(match[2]))
        position = match.end()
        if len(steps) > tree.DEPTH:
            raise _InvalidPathError(f"a path can have at most {tree.DEPTH} parts")
    if position < len(text) or not steps or isinstance(steps[0], int):
        shown = quoted(shortened(text, tree.SHOWN))
        raise _InvalidPathError(f"{shown} is not a path; write it as in duration, videos[0].fps")
    return tuple(steps)


def _with(root: tree.MappingNode, path: tree.DocumentPath, value: tree.Node) -> tree.MappingNode:
    changed = _set(root, path, value, ())
    assert isinstance(changed, tree.MappingNode)  # a path begins with a key
    return changed


def _set(node: tree.Node | None, path: tree.DocumentPath, value: tree.Node, above: tree.DocumentPath) -> tree.Node:
    """Returns `node`, at the path `above`, with `value` set at `path` below it."""
    if not path:
        return value
    if isinstance(node, tree.ReportedFaultNode):
        return node
    step, below = path[0], path[1:]
    if isinstance(step, int):
        return _set_item(node, step, below, value, above)
    if node is None or (isinstance(node, tree.ScalarNode) and node.value is None):
        node = tree.MappingNode(value.mark)
    if not isinstance(node, tree.MappingNode):
        raise _InvalidPathError(f"{tree.path_text(above)} is {tree.described(node)} and has no keys")
    if step not in node.entries and below and isinstance(below[0], int):
        raise _InvalidPathError(f"no list {quoted(tree.path_text((*above, step)))}{suggestion(step, node.entries)}")
    return node.with_entry(step, value.mark, _set(node.entries.get(step), below, value, (*above, step)))


def _set_item(
    node: tree.Node | None, index: int, below: tree.DocumentPath, value: tree.Node, above: tree.DocumentPath
) -> tree.ListNode:
    if not isinstance(node, tree.ListNode):
        raise _InvalidPathError(f"{tree.path_text(above)} is {tree.described(node) if node else 'nothing'}, not a list")
    count = len(node.items)
    if index >= count:
        raise _InvalidPathError(
            f"{tree.path_text(above)} has {count or 'no'} item{'' if count == 1 else 's'}, counted from 0"
        )
    items = list(node.items)
    items[index] = _set(items[index], below, value, (*above, index))
    return tree.ListNode(node.mark, items)


def read(
    path: Path | str,
    record: OptionsMappingKind[T],
    context: ReadingContext | None = None,
    assignments: Sequence[str] = (),
    *,
    variables: bool = False,
) -> tuple[T, tree.MappingNode]:
    """Reads the document at `path`, a mapping, by `record`; returns its value and the tree with the places.

    Documents follow YAML 1.2's core schema: only `true` and `false` are booleans, `010` is ten, times and dates are
    text. Keys are unique texts; aliases, tags, merge keys and further documents are faults.

    Args:
      context: resolves paths and the forms of kinds.
      assignments: `key=value` from the command line, such as `videos[0].fps=30`, which override the document; each
        value is a scalar or a flow collection under the same rules.
      variables: allow `vars:`, for `${name}` in texts, and `defaults:`, another document of the same kind below this
        one, with a path relative to the document's folder. The `vars` of both apply to both. Neither key reaches
        `record`.

    Raises:
      DocumentError: the document, one that it names or an assignment is faulty; all faults are listed.
      FileError: the document, or one of those, is missing or cannot be read.
    """
    reader = _Reader(Path(path), variables)
    root = reader.document(Path(path), tree.DOCUMENT)
    if root and variables:
        root = reader.with_defaults(root)
    if root and (fault := other_kind(root, record.name)):
        raise tree.document_error([fault])  # which explains any further faults
    if root:
        root, faults = assign(root, assignments, tree.ASSIGNMENTS, (DEFAULTS,) if variables else (), tree.NAMED)
        reader.faults += faults
        if variables:
            root, faults = without_variables(root)
            reader.faults += faults
    return reader.validated(root, record, context)


class _Reader:
    def __init__(self, path: Path, variables: bool) -> None:
        self.path, self.variables = path, variables
        self.files: list[str] = []
        self.faults: list[tree.DocumentFault] = []

    def document(self, path: Path, order: int, hint: str = "") -> tree.MappingNode | None:
        """Returns the mapping in the file at `path`; None if there is no such mapping."""
        with opened(path, "document", YAML, hint) as file:
            data = file.read(LARGEST + 1)
        self.files.append(str(path))
        from mjrun.document.yaml_text import LineIndex, compose  # PyYAML is slow to import

        top = tree.DocumentPlace(order, 0, 0, str(path))
        if len(data) > LARGEST:
            self.faults.append(
                tree.DocumentFault(top, "", f"more than {LARGEST // 2**20} MiB are no document for mjrun")
            )
            return None
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            before = error.object[: error.start].decode("utf-8")  # after the byte order mark
            mark = tree.DocumentPlace(order, *LineIndex(before).at(len(before)), str(path))
            self.faults.append(tree.DocumentFault(mark, "", f"not UTF-8: the byte 0x{error.object[error.start]:02x}"))
            return None
        lines = LineIndex(text)
        node, faults = compose(text, lambda index: tree.DocumentPlace(order, *lines.at(index), str(path)))
        self.faults += faults
        if node is None and not faults:
            self.faults.append(tree.DocumentFault(top, "", "the document is empty"))
        elif node is not None and not isinstance(node, tree.MappingNode | tree.ReportedFaultNode):
            # Its content is not quoted: it may be a file other than a document, with secrets.
            form = "text" if isinstance(node, tree.ScalarNode) and node.text else tree.described(node)
            hint = "" if is_yaml(path) else f"; documents end in {' or '.join(YAML)}"
            self.faults.append(tree.DocumentFault(node.mark, "", f"expected a mapping, got {form}{hint}"))
        return node if isinstance(node, tree.MappingNode) else None

    def with_defaults(self, root: tree.MappingNode) -> tree.MappingNode | None:
        """Returns `root` merged over the document in its `defaults`; None if that cannot be read."""
        path = root.entries.get(DEFAULTS)
        root = root.without(DEFAULTS)
        if path is None or isinstance(path, tree.ReportedFaultNode):
            return root
        if not isinstance(path, tree.ScalarNode) or not isinstance(path.value, str) or not path.value:
            self.faults.append(
                tree.DocumentFault(path.mark, DEFAULTS, f"expected the path of a document, got {tree.described(path)}")
            )
            return root
        if not is_yaml(path.value):  # a file of another kind is neither read nor quoted
            self.faults.append(tree.DocumentFault(path.mark, DEFAULTS, f"a document ends in {' or '.join(YAML)}"))
            return root
        below = self.document(self.path.parent / path.value, tree.DEFAULTS, hint=f"{path.mark} names it as defaults")
        if below and DEFAULTS in below.entries:
            self.faults.append(
                tree.DocumentFault(below.keys[DEFAULTS], "", "the document in defaults cannot have defaults")
            )
            below = below.without(DEFAULTS)
        both = merged(root, below)
        return both if below and isinstance(both, tree.MappingNode) else None

    def validated(
        self, root: tree.MappingNode | None, record: OptionsMappingKind[T], context: ReadingContext | None
    ) -> tuple[T, tree.MappingNode]:
        """Returns the value and the tree if there were no faults."""
        values: list[T] = []
        context = context or ReadingContext()
        context.documents.extend(self.files)
        if root:
            top = SchemaViolationCollector()
            with top.at(), tree.located_files(root, context.input):
                values.append(cast("T", record.read(tree.plain(root), context)))
            self.faults += tree.violation_faults(top.all, root, (VARS, DEFAULTS) if self.variables else ())
        if root is None or not values or self.faults:
            raise tree.document_error(self.faults, context.problems)
        return values[0], root
