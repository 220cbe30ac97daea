"""A YAML file, read into a typed value, or every error in it at once, each at its line and column."""

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar, cast

from mjrun.document.assignments import assign
from mjrun.document.faults import NAMED, document_error, misfit_faults
from mjrun.document.kinds import other_kind
from mjrun.document.tree import Fault, InvalidNode, MappingNode, Mark, ScalarNode, described, plain
from mjrun.document.variables import DEFAULTS, VARS, merged, without_variables
from mjrun.document.yaml_parser import LineIndex, compose
from mjrun.formats.input_file import opened
from mjrun.options.kinds import Reader
from mjrun.options.record import Record
from mjrun.options.schema import Misfits
from mjrun.suffixes import YAML, is_yaml

LARGEST = 2**20  # bytes of a document

T = TypeVar("T")


def read(
    path: Path | str,
    record: Record[T],
    context: Reader | None = None,
    assignments: Sequence[str] = (),
    *,
    variables: bool = False,
) -> tuple[T, MappingNode]:
    """The value of the document at `path`, a mapping that `record` reads, and the tree that knows where it is written.

    It is YAML 1.2's core schema: only `true` and `false` are truth values, `010` is ten, times and dates are text;
    keys stand once and are text; there are no aliases, tags, merge keys or further documents.

    Args:
      context: what its paths mean, and the forms of its kinds.
      assignments: `key=value` from the command line, such as `videos[0].fps=30`, over what is written; each value
        is a scalar or a flow collection under the same rules.
      variables: whether the document may have `vars:`, for `${name}` in its texts, and `defaults:`, another document
        with the same kind of mapping, below this one; its path is relative to the document's folder. `vars` of both
        count for both. Neither reaches `record`.

    Raises:
      DocumentError: with everything that is wrong in the document, those it names and the assignments.
      FileError: the document, or one of those, is not there or cannot be read.
    """
    reader = _Reader(Path(path), variables)
    tree = reader.document(Path(path), 0)
    if tree and variables:
        tree = reader.with_defaults(tree)
    if tree and (fault := other_kind(tree, record.name)):
        raise document_error([fault])  # which explains all else that may be wrong
    if tree:
        tree, faults = assign(tree, assignments, 2, (DEFAULTS,) if variables else (), NAMED)
        reader.faults += faults
        if variables:
            tree, faults = without_variables(tree)
            reader.faults += faults
    return reader.validated(tree, record, context)


class _Reader:
    def __init__(self, path: Path, variables: bool) -> None:
        self.path, self.variables = path, variables
        self.faults: list[Fault] = []

    def document(self, path: Path, order: int, hint: str = "") -> MappingNode | None:
        """The mapping in the file at `path`; None if there is no such mapping."""
        with opened(path, "document", YAML, hint) as file:
            data = file.read(LARGEST + 1)
        top = Mark(order, 0, 0, str(path))
        if len(data) > LARGEST:
            self.faults.append(Fault(top, "", f"more than {LARGEST // 2**20} MiB are no document for mjrun"))
            return None
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            before = error.object[: error.start].decode("utf-8")  # of what follows the mark of byte order
            mark = Mark(order, *LineIndex(before).at(len(before)), str(path))
            self.faults.append(Fault(mark, "", f"not UTF-8: the byte 0x{error.object[error.start]:02x}"))
            return None
        lines = LineIndex(text)
        node, faults = compose(text, lambda index: Mark(order, *lines.at(index), str(path)))
        self.faults += faults
        if node is None and not faults:
            self.faults.append(Fault(top, "", "the document is empty"))
        elif node is not None and not isinstance(node, MappingNode | InvalidNode):
            # Not what it holds: it may be no document at all, but a file that somebody else must not see.
            form = "text" if isinstance(node, ScalarNode) and node.text else described(node)
            self.faults.append(Fault(node.mark, "", f"expected a mapping, got {form}"))
        return node if isinstance(node, MappingNode) else None

    def with_defaults(self, tree: MappingNode) -> MappingNode | None:
        """`tree` over what its `defaults` names; None if that cannot be read."""
        path = tree.entries.get(DEFAULTS)
        tree = tree.without(DEFAULTS)
        if path is None or isinstance(path, InvalidNode):
            return tree
        if not isinstance(path, ScalarNode) or not isinstance(path.value, str) or not path.value:
            self.faults.append(Fault(path.mark, DEFAULTS, f"expected the path of a document, got {described(path)}"))
            return tree
        if not is_yaml(path.value):  # a file of another kind is not looked into, let alone cited
            self.faults.append(Fault(path.mark, DEFAULTS, f"a document ends in {' or '.join(YAML)}"))
            return tree
        below = self.document(self.path.parent / path.value, 1, hint=f"{path.mark} names it as defaults")
        if below and DEFAULTS in below.entries:
            self.faults.append(Fault(below.keys[DEFAULTS], "", "defaults have no defaults of their own"))
            below = below.without(DEFAULTS)
        both = merged(tree, below)
        return both if below and isinstance(both, MappingNode) else None

    def validated(self, tree: MappingNode | None, record: Record[T], context: Reader | None) -> tuple[T, MappingNode]:
        """The value and the tree, unless something was wrong."""
        values: list[T] = []
        context = context or Reader()
        if tree:
            top = Misfits()
            with top.at():
                values.append(cast("T", record.read(plain(tree), context)))
            self.faults += misfit_faults(top.all, tree, (VARS, DEFAULTS) if self.variables else ())
        if tree is None or not values or self.faults:
            raise document_error(self.faults, context.problems)
        return values[0], tree
