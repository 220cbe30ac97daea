"""Assignments `key=value` on the command line, such as `videos[0].fps=30`, which replace values of a document."""

import re
from collections.abc import Sequence

from mjrun.document.tree import (
    Fault,
    InvalidNode,
    ListNode,
    MappingNode,
    Mark,
    Node,
    Path,
    ScalarNode,
    described,
    path_text,
    shortened,
)
from mjrun.document.yaml_parser import DEPTH, compose
from mjrun.errors import quoted, suggestion

SHOWN = 60  # characters of an assignment that messages show

_STEP = re.compile(r"(?:^|\.)([^.\[\]\x00-\x1f\x7f-\x9f]+)|\[([0-9]{1,9})\]")


class _InvalidPathError(Exception):
    """A path to a place that cannot exist."""


def assign(
    tree: MappingNode, assignments: Sequence[str], order: int, fixed: Sequence[str] = (), named: Sequence[str] = ()
) -> tuple[MappingNode, list[Fault]]:
    """Applies `assignments` to `tree` in turn; returns the new tree and the faults.

    Missing mappings are created; items of lists must exist.

    Args:
      order: the number of the first assignment among the sources of the document.
      fixed: top-level keys that cannot be set.
      named: places below which all text up to = is one name, which may contain dots: `set.opt.cone` below `set`.
    """  # fmt: skip
    faults: list[Fault] = []
    for i, assignment in enumerate(assignments):
        mark = Mark(order + i, 0, 0, shortened(assignment, SHOWN))
        key, equals, text = assignment.partition("=")
        try:
            if not equals:
                raise _InvalidPathError("write key=value")
            path = _path(key, named)
            if path[0] in fixed:
                raise _InvalidPathError(f"{path[0]} is set in the document only")
            value, value_faults = compose(text, lambda index, mark=mark: mark, inline=True)
            faults += value_faults
            if value or not value_faults:
                tree = _with(tree, path, value or ScalarNode(mark, None, ""))
        except _InvalidPathError as error:
            faults.append(Fault(mark, "", str(error)))
    return tree, faults


def _path(text: str, named: Sequence[str]) -> Path:
    owner = next((f"{place}." for place in named if text.startswith(f"{place}.")), "")
    if owner and text != owner:
        return (*owner.split(".")[:-1], text.removeprefix(owner))
    steps: list[str | int] = []
    position = 0
    while match := _STEP.match(text, position):
        steps.append(match[1] if match[1] is not None else int(match[2]))
        position = match.end()
        if len(steps) > DEPTH:
            raise _InvalidPathError(f"a path of more than {DEPTH} parts leads to nothing in a document")
    if position < len(text) or not steps or isinstance(steps[0], int):
        raise _InvalidPathError(f"{quoted(shortened(text))} is not a path; write it as in duration, videos[0].fps")
    return tuple(steps)


def _with(tree: MappingNode, path: Path, value: Node) -> MappingNode:
    changed = _set(tree, path, value, ())
    assert isinstance(changed, MappingNode)  # a path begins with a key
    return changed


def _set(node: Node | None, path: Path, value: Node, above: Path) -> Node:
    """Returns `node`, at the path `above`, with `value` set at `path` below it."""
    if not path:
        return value
    if isinstance(node, InvalidNode):
        return node
    step, below = path[0], path[1:]
    if isinstance(step, int):
        return _set_item(node, step, below, value, above)
    if node is None or (isinstance(node, ScalarNode) and node.value is None):
        node = MappingNode(value.mark)
    if not isinstance(node, MappingNode):
        raise _InvalidPathError(f"{path_text(above)} is {described(node)} and has no keys")
    if step not in node.entries and below and isinstance(below[0], int):
        raise _InvalidPathError(f"no list {quoted(path_text((*above, step)))}{suggestion(step, node.entries)}")
    return node.with_entry(step, value.mark, _set(node.entries.get(step), below, value, (*above, step)))


def _set_item(node: Node | None, index: int, below: Path, value: Node, above: Path) -> ListNode:
    if not isinstance(node, ListNode):
        raise _InvalidPathError(f"{path_text(above)} is {described(node) if node else 'nothing'}, not a list")
    count = len(node.items)
    if index >= count:
        raise _InvalidPathError(
            f"{path_text(above)} has {count or 'no'} item{'' if count == 1 else 's'}, counted from 0"
        )
    items = list(node.items)
    items[index] = _set(items[index], below, value, (*above, index))
    return ListNode(node.mark, items)
