"""Reading of YAML files into typed values, with all errors at their lines and columns."""

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

LARGEST = 2**20  # bytes per document

T = TypeVar("T")


def read(
    path: Path | str,
    record: Record[T],
    context: Reader | None = None,
    assignments: Sequence[str] = (),
    *,
    variables: bool = False,
) -> tuple[T, MappingNode]:
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
      DocumentError: with all faults in the document, the documents that it names, and the assignments.
      FileError: the document, or one of those, is missing or cannot be read.
    """
    reader = _Reader(Path(path), variables)
    tree = reader.document(Path(path), 0)
    if tree and variables:
        tree = reader.with_defaults(tree)
    if tree and (fault := other_kind(tree, record.name)):
        raise document_error([fault])  # which explains any further faults
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
        """Returns the mapping in the file at `path`; None if there is no such mapping."""
        with opened(path, "document", YAML, hint) as file:
            data = file.read(LARGEST + 1)
        top = Mark(order, 0, 0, str(path))
        if len(data) > LARGEST:
            self.faults.append(Fault(top, "", f"more than {LARGEST // 2**20} MiB are no document for mjrun"))
            return None
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            before = error.object[: error.start].decode("utf-8")  # after the byte order mark
            mark = Mark(order, *LineIndex(before).at(len(before)), str(path))
            self.faults.append(Fault(mark, "", f"not UTF-8: the byte 0x{error.object[error.start]:02x}"))
            return None
        lines = LineIndex(text)
        node, faults = compose(text, lambda index: Mark(order, *lines.at(index), str(path)))
        self.faults += faults
        if node is None and not faults:
            self.faults.append(Fault(top, "", "the document is empty"))
        elif node is not None and not isinstance(node, MappingNode | InvalidNode):
            # Its content is not quoted: it may be a file other than a document, with secrets.
            form = "text" if isinstance(node, ScalarNode) and node.text else described(node)
            self.faults.append(Fault(node.mark, "", f"expected a mapping, got {form}"))
        return node if isinstance(node, MappingNode) else None

    def with_defaults(self, tree: MappingNode) -> MappingNode | None:
        """Returns `tree` merged over the document in its `defaults`; None if that cannot be read."""
        path = tree.entries.get(DEFAULTS)
        tree = tree.without(DEFAULTS)
        if path is None or isinstance(path, InvalidNode):
            return tree
        if not isinstance(path, ScalarNode) or not isinstance(path.value, str) or not path.value:
            self.faults.append(Fault(path.mark, DEFAULTS, f"expected the path of a document, got {described(path)}"))
            return tree
        if not is_yaml(path.value):  # a file of another kind is neither read nor quoted
            self.faults.append(Fault(path.mark, DEFAULTS, f"a document ends in {' or '.join(YAML)}"))
            return tree
        below = self.document(self.path.parent / path.value, 1, hint=f"{path.mark} names it as defaults")
        if below and DEFAULTS in below.entries:
            self.faults.append(Fault(below.keys[DEFAULTS], "", "the document in defaults cannot have defaults"))
            below = below.without(DEFAULTS)
        both = merged(tree, below)
        return both if below and isinstance(both, MappingNode) else None

    def validated(self, tree: MappingNode | None, record: Record[T], context: Reader | None) -> tuple[T, MappingNode]:
        """Returns the value and the tree if there were no faults."""
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
