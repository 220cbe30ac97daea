"""Elements and attributes against MuJoCo's own schema, all at once, with what was probably meant.

MuJoCo stops at the first violation, and inside `<frame>` and `<replicate>` it does not look at attributes at all.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache

import mujoco

from mjrun.check.finding import Sighting
from mjrun.check.rules.deprecated import REMEDIES, REMOVED_ATTRIBUTES, REMOVED_ELEMENTS, REMOVED_PLUGINS, REMOVED_VALUES
from mjrun.check.xml_source import Element, Source
from mjrun.errors import clean, listing, near, quoted, suggestion

UNKNOWN, MISPLACED, ATTRIBUTE, REMOVED, VALUE, TWICE = "MJ102", "MJ103", "MJ104", "MJ105", "MJ106", "MJ111"
BODY = "(world)body"  # as the schema calls the node of both
POSE = {"pos", "quat", "axisangle", "xyaxes", "zaxis", "euler"}
# What MuJoCo's schema does not list, and its reference does.
UNLISTED = {
    "worldbody": frozenset(),
    "frame": frozenset({"name", "childclass", *POSE}),
    "replicate": frozenset({"count", "sep", "offset", "euler", "childclass"}),
    "include": frozenset({"file"}),
}
RARE = ("default", "frame", "replicate")  # where an element may stand, and is seldom meant to


@dataclass
class Node:
    """What may stand in an element: attributes, children, and whether a parent has it at most once."""

    attributes: set[str] = field(default_factory=set)
    children: "dict[str, Node]" = field(default_factory=dict)
    unique: bool = False

    def child(self, tag: str) -> "Node | None":
        """The node of a child, or None if there must be none with this tag."""
        return self.children.get(tag)


@cache
def schema() -> Node:
    """The schema of the installed MuJoCo, its root being what holds `<mujoco>`."""
    top = Node()
    path: list[Node] = [top]
    for line in mujoco.mj_printSchema(False, False).splitlines():
        found = re.match(r"( *)(\S+) \((.)\)\s*(.*)", line)
        if not found:
            path[-1].attributes.update(line.split())
            continue
        indent, name, kind, attributes = found.groups()
        node = Node(set(attributes.split()), unique=kind in "?!")
        del path[len(indent) // 3 + 1 :]
        path[-1].children[name] = node
        path.append(node)
        if kind == "R":
            node.children[name] = node
    _name_bodies(top.children["mujoco"])
    return top


def _name_bodies(root: Node) -> None:
    """Makes `worldbody`, `body`, `frame` and `replicate` nodes of their own, with one set of children."""
    body = root.children.pop(BODY)
    inside = body.children
    inside.pop(BODY)
    for name in ("frame", "replicate"):
        inside[name] = Node(set(UNLISTED[name]), inside)
    inside["body"] = Node(body.attributes, inside)
    root.children["worldbody"] = Node(set(), inside)


@cache
def _places() -> dict[str, list[tuple[str, Node]]]:
    """Where each element may stand: its parents' tags with its node."""
    found: dict[str, dict[str, Node]] = {}
    waiting, seen = [("mujoco", schema().children["mujoco"])], set()
    while waiting:
        parent, node = waiting.pop(0)
        if (parent, id(node.children)) in seen:
            continue
        seen.add((parent, id(node.children)))
        for tag, child in node.children.items():
            found.setdefault(tag, {}).setdefault(parent, child)
            waiting.append((tag, child))
    return {tag: sorted(parents.items(), key=lambda home: home[0] in RARE) for tag, parents in found.items()}


def violations(source: Source) -> Iterator[tuple[str, Sighting]]:
    """Everything in the XML that is not in the schema: codes and sightings, in the order of the file."""
    if source.root is None or source.root.tag != "mujoco":
        return
    stack = [(source.root, schema().children["mujoco"])]
    while stack:
        element, node = stack.pop()
        yield from _attributes(element, node)
        yield from _repeated(element, node)
        if element.text and not _is_value(element):
            yield VALUE, _stray_text(element)
        below = []
        for child in element.children:
            inner = node.child(child.tag)
            if inner is None and child.tag not in UNLISTED:
                yield _unknown(child, node)
                inner = _meant(child)
            if inner is not None:
                below.append((child, inner))
        stack.extend(reversed(below))


def _sighting(element: Element, message: str, remedy: str) -> Sighting:
    return Sighting(message, remedy, str(element), (element.file, element.line))


def _attributes(element: Element, node: Node) -> Iterator[tuple[str, Sighting]]:
    for name, value in element.attributes.items():
        removed = REMOVED_VALUES.get((element.tag, name, value))
        if name == "plugin" and value in REMOVED_PLUGINS:
            removed = REMOVED_PLUGINS[value]
        if removed:
            message = f"{name}={quoted(value)} of <{element.tag}> was removed {removed[0]}"
            yield REMOVED, _sighting(element, message, removed[1])
        if name in node.attributes:
            continue
        if known := REMOVED_ATTRIBUTES.get((element.tag, name)):
            message = f"the attribute {quoted(name)} of <{element.tag}> was removed {known[0]}"
            yield REMOVED, _sighting(element, message, known[1])
            continue
        message = f"<{clean(element.tag)}> has no attribute {quoted(name)}{suggestion(name, node.attributes)}"
        yield ATTRIBUTE, _sighting(element, message, _attribute_remedy(element, name, node))


def _attribute_remedy(element: Element, name: str, node: Node) -> str:
    if not node.attributes:
        inner = [c.tag for c in element.children if c.tag in node.children and name in node.children[c.tag].attributes]
        example = f"<{inner[0]} {name}=…>" if inner else "its children"
        return f"<{element.tag}> only groups, and takes no attributes; write it on {example}"
    close = near(name, node.attributes)
    if close:
        return f"write {close[0]}"
    return f"attributes of <{element.tag}>: {listing(sorted(node.attributes))}"


def _repeated(element: Element, node: Node) -> Iterator[tuple[str, Sighting]]:
    counts = Counter(child.tag for child in element.children)
    for child in element.children:
        inner = node.child(child.tag)
        if inner is None or not inner.unique or counts[child.tag] < 2:
            continue
        first = next(other for other in element.children if other.tag == child.tag)
        if child is not first:
            message = f"<{child.tag}> stands in <{element.tag}> more than once; the first is on line {first.line}"
            yield TWICE, _sighting(child, message, "put all its attributes into one element")


def _unknown(element: Element, node: Node) -> tuple[str, Sighting]:
    """Why there can be no such element here."""
    tag, parent = element.tag, element.parent
    assert parent is not None
    if tag in REMOVED_ELEMENTS:
        since, remedy = REMOVED_ELEMENTS[tag]
        return REMOVED, _sighting(element, f"<{tag}> was removed {since}", remedy)
    if value := _as_attribute(element, node):
        return VALUE, value
    where = _places().get(tag)
    if where and tag not in REMEDIES:
        homes = " or ".join(f"<{home}>" for home, _ in where[:3])
        message = f"<{tag}> stands in <{clean(parent.tag)}>, and belongs directly in {homes}"
        return MISPLACED, _sighting(element, message, _move(tag, parent, [home for home, _ in where]))
    message = f"<{clean(parent.tag)}> holds no element <{clean(tag)}>{suggestion(tag, node.children)}"
    return UNKNOWN, _sighting(element, message, REMEDIES.get(tag) or _children_remedy(tag, parent, node))


def _move(tag: str, parent: Element, homes: list[str]) -> str:
    if homes[0] == "mujoco":
        outer = "worldbody" if parent.tag == "worldbody" or parent.within("worldbody") else parent.tag
        return f"move <{tag}> … </{tag}> out of <{clean(outer)}>, directly into <mujoco>"
    return f"move it into <{homes[0]}>"


def _children_remedy(tag: str, parent: Element, node: Node) -> str:
    close = near(tag, node.children)
    if close:
        return f"write <{close[0]}>"
    if not node.children:
        return f"<{clean(parent.tag)}> holds no elements; end its tag with />"
    return f"elements of <{clean(parent.tag)}>: {listing(sorted(node.children))}"


def _as_attribute(element: Element, node: Node) -> Sighting | None:
    """What to say when `element` is a value, as in `<friction>0.3</friction>`."""
    parent, tag = element.parent, element.tag
    assert parent is not None
    if not (element.text and not element.attributes and not element.children):
        return None
    holders = [name for name, inner in node.children.items() if tag in inner.attributes]
    if tag in node.attributes:
        holders.insert(0, parent.tag)
    if not holders:
        return None
    holder = holders[0]
    inner = node if holder == parent.tag else node.children[holder]
    values = {tag: element.text}
    if holder != parent.tag:  # all that stands beside it and belongs in the same element
        values = {c.tag: c.text for c in parent.children if c.text and c.tag in inner.attributes}
    example = " ".join(f'{name}="{value}"' for name, value in values.items())
    message = f"<{tag}> is written as an element, and is an attribute of <{holder}>"
    return _sighting(element, message, f"write <{holder} {example}/>: MJCF holds values in attributes")


def _is_value(element: Element) -> bool:
    """Whether an element was already told to be a value."""
    return not element.attributes and not element.children


def _stray_text(element: Element) -> Sighting:
    shown = element.text if len(element.text) <= 40 else f"{element.text[:39]}…"
    message = f"text between the tags of <{clean(element.tag)}>: {quoted(shown)}"
    remedy = "MuJoCo ignores it; put values into attributes, remarks into <!-- … -->"
    return Sighting(message, remedy, str(element), (element.file, element.text_line))


def _meant(element: Element) -> Node | None:
    """The node of a misplaced element, if there is only one it can be."""
    where = _places().get(element.tag, [])
    return where[0][1] if len(where) == 1 else None
