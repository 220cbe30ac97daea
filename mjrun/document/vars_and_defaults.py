"""Keys at the top of documents: `vars:`, named values, and `defaults:`, another document below this one."""

import re
from collections.abc import Mapping

from mjrun.document import tree
from mjrun.errors import listing, quoted, suggestion

VARS, DEFAULTS = "vars", "defaults"
LARGEST = 2**20  # characters that variables may insert into a document

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_REFERENCE = re.compile(r"\$\$\{|\$\{([^{}$]*)\}|\$\{")


def merged(above: tree.Node, below: tree.Node | None) -> tree.Node:
    """Merges `above` over `below`: mappings by key; any other value of `above` replaces that of `below`."""
    if not isinstance(above, tree.MappingNode) or not isinstance(below, tree.MappingNode):
        return above
    entries = {key: merged(above.entries[key], below.entries.get(key)) for key in above.entries}
    return tree.MappingNode(above.mark, {**below.entries, **entries}, {**below.keys, **above.keys})


def without_variables(root: tree.MappingNode) -> tuple[tree.MappingNode, list[tree.Fault]]:
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
        self.faults: list[tree.Fault] = []
        self.substituted = 0

    def define(self, node: tree.Node | None) -> None:
        """Reads the variables."""
        if node is None or isinstance(node, tree.InvalidNode):
            return
        if not isinstance(node, tree.MappingNode):
            self._fault(node.mark, (VARS,), f"expected a mapping of names to values, got {tree.described(node)}")
            return
        for name, value in node.entries.items():
            if not _NAME.fullmatch(name):
                self._fault(
                    node.keys[name], (VARS,), f"{quoted(tree.shortened(name))} is not a name of letters, digits and _"
                )
            self.variables[name] = self._variable(value, (VARS, name))

    def _variable(self, value: tree.Node, path: tree.Place) -> tree.Node:
        if not isinstance(value, tree.ScalarNode | tree.InvalidNode):
            self._fault(value.mark, path, f"expected a single value, got {tree.described(value)}")
            return tree.InvalidNode(value.mark)
        if isinstance(value, tree.ScalarNode) and any(match[0] != "$${" for match in _REFERENCE.finditer(value.text)):
            self._fault(value.mark, path, "a variable cannot refer to another variable; write $${ for ${")
            return tree.InvalidNode(value.mark)
        return self.resolved(value, path)

    def resolved(self, node: tree.Node, path: tree.Place) -> tree.Node:
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

    def _scalar(self, node: tree.ScalarNode, text: str, path: tree.Place) -> tree.Node:
        whole = _REFERENCE.fullmatch(text)
        if whole and whole[1] is not None:
            value = self._value(whole, node.mark, path)
            return tree.ScalarNode(node.mark, value.value, value.text, text) if value else tree.InvalidNode(node.mark)
        parts: list[str] = []
        end = 0
        for match in _REFERENCE.finditer(text):
            value = None if match[0] == "$${" else self._value(match, node.mark, path)
            if match[0] != "$${" and not value:
                return tree.InvalidNode(node.mark)
            parts += [text[end : match.start()], value.text if value else "${"]
            end = match.end()
            self.substituted += len(parts[-1])
            if self.substituted > LARGEST:
                self._fault(node.mark, path, f"variables insert more than {LARGEST:,} characters")
                return tree.InvalidNode(node.mark)
        text = "".join([*parts, text[end:]])
        return tree.ScalarNode(node.mark, text, text)

    def _value(self, match: re.Match[str], mark: tree.DocumentPlace, path: tree.Place) -> tree.ScalarNode | None:
        """Returns the variable that `match` refers to; None if it does not exist."""
        name = match[1]
        if name is None:
            self._fault(mark, path, "${ begins a variable, ${name}; write $${ for ${")
            return None
        if name not in self.variables:
            self._fault(mark, path, _unknown(name, self.variables))
        value = self.variables.get(name)
        return value if isinstance(value, tree.ScalarNode) else None

    def _fault(self, mark: tree.DocumentPlace, path: tree.Place, message: str) -> None:
        self.faults.append(tree.Fault(mark, tree.path_text(path), message))


def _unknown(name: str, variables: Mapping[str, tree.Node]) -> str:
    choices = f"vars: {listing(list(variables))}" if variables else "there are no vars"
    return f"no variable {quoted(tree.shortened(name))}{suggestion(name, variables)}; {choices}"
