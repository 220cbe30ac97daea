"""Keys at the top of documents: `vars:`, named values, and `defaults:`, another document below this one."""

import re
from collections.abc import Mapping

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
from mjrun.errors import listing, quoted, suggestion

VARS, DEFAULTS = "vars", "defaults"
LARGEST = 2**20  # characters that variables may insert into a document

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_REFERENCE = re.compile(r"\$\$\{|\$\{([^{}$]*)\}|\$\{")


def merged(above: Node, below: Node | None) -> Node:
    """Merges `above` over `below`: mappings by key; any other value of `above` replaces that of `below`."""
    if not isinstance(above, MappingNode) or not isinstance(below, MappingNode):
        return above
    entries = {key: merged(above.entries[key], below.entries.get(key)) for key in above.entries}
    return MappingNode(above.mark, {**below.entries, **entries}, {**below.keys, **above.keys})


def without_variables(tree: MappingNode) -> tuple[MappingNode, list[Fault]]:
    """Returns `tree` without its `vars`, with every `${name}` replaced by its value, and the faults.

    A scalar that consists of `${name}` gets the value of the variable, number or text; within a longer text, the
    source of the value is inserted. `$${` becomes `${`.
    """
    resolver = _Resolver()
    resolver.define(tree.entries.get(VARS))
    rest = tree.without(VARS)
    entries = {key: resolver.resolved(value, (key,)) for key, value in rest.entries.items()}
    return MappingNode(rest.mark, entries, rest.keys), resolver.faults


class _Resolver:
    def __init__(self) -> None:
        self.variables: dict[str, Node] = {}
        self.faults: list[Fault] = []
        self.substituted = 0

    def define(self, node: Node | None) -> None:
        """Reads the variables."""
        if node is None or isinstance(node, InvalidNode):
            return
        if not isinstance(node, MappingNode):
            self._fault(node.mark, (VARS,), f"expected a mapping of names to values, got {described(node)}")
            return
        for name, value in node.entries.items():
            if not _NAME.fullmatch(name):
                self._fault(
                    node.keys[name], (VARS,), f"{quoted(shortened(name))} is not a name of letters, digits and _"
                )
            self.variables[name] = self._variable(value, (VARS, name))

    def _variable(self, value: Node, path: Path) -> Node:
        if not isinstance(value, ScalarNode | InvalidNode):
            self._fault(value.mark, path, f"expected a single value, got {described(value)}")
            return InvalidNode(value.mark)
        if isinstance(value, ScalarNode) and any(match[0] != "$${" for match in _REFERENCE.finditer(value.text)):
            self._fault(value.mark, path, "a variable cannot refer to another variable; write $${ for ${")
            return InvalidNode(value.mark)
        return self.resolved(value, path)

    def resolved(self, node: Node, path: Path) -> Node:
        """Replaces the variables in `node`, which is at `path`."""
        match node:
            case ListNode():
                return ListNode(node.mark, [self.resolved(item, (*path, i)) for i, item in enumerate(node.items)])
            case MappingNode():
                entries = {key: self.resolved(value, (*path, key)) for key, value in node.entries.items()}
                return MappingNode(node.mark, entries, node.keys)
            case ScalarNode(value=str(text)) if "${" in text:
                return self._scalar(node, text, path)
            case _:
                return node

    def _scalar(self, node: ScalarNode, text: str, path: Path) -> Node:
        whole = _REFERENCE.fullmatch(text)
        if whole and whole[1] is not None:
            value = self._value(whole, node.mark, path)
            return ScalarNode(node.mark, value.value, value.text, text) if value else InvalidNode(node.mark)
        parts: list[str] = []
        end = 0
        for match in _REFERENCE.finditer(text):
            value = None if match[0] == "$${" else self._value(match, node.mark, path)
            if match[0] != "$${" and not value:
                return InvalidNode(node.mark)
            parts += [text[end : match.start()], value.text if value else "${"]
            end = match.end()
            self.substituted += len(parts[-1])
            if self.substituted > LARGEST:
                self._fault(node.mark, path, f"variables insert more than {LARGEST:,} characters")
                return InvalidNode(node.mark)
        text = "".join([*parts, text[end:]])
        return ScalarNode(node.mark, text, text)

    def _value(self, match: re.Match[str], mark: Mark, path: Path) -> ScalarNode | None:
        """Returns the variable that `match` refers to; None if it does not exist."""
        name = match[1]
        if name is None:
            self._fault(mark, path, "${ begins a variable, ${name}; write $${ for ${")
            return None
        if name not in self.variables:
            self._fault(mark, path, _unknown(name, self.variables))
        value = self.variables.get(name)
        return value if isinstance(value, ScalarNode) else None

    def _fault(self, mark: Mark, path: Path, message: str) -> None:
        self.faults.append(Fault(mark, path_text(path), message))


def _unknown(name: str, variables: Mapping[str, Node]) -> str:
    choices = f"vars: {listing(list(variables))}" if variables else "there are no vars"
    return f"no variable {quoted(shortened(name))}{suggestion(name, variables)}; {choices}"
