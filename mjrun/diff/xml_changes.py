"""The differences between the XML of two models: elements and attributes, with their lines, includes followed.

Elements are matched within matched parents: by tag and name (or class), then equal ones, then those with the same tag
in their order. Attributes with the same numbers are equal, however they are written.
"""

from collections.abc import Hashable, Iterator, Sequence
from pathlib import Path

from mjrun.diff.model_matching import equal_blocks
from mjrun.diff.result import XmlChange, XmlPlace
from mjrun.model.source import Source
from mjrun.model.xml_source import Element, read_xml
from mjrun.suffixes import XML

Value = str | tuple[float, ...]
Pair = tuple[Element, Element]


def xml_changes(a: Source, b: Source) -> list[XmlChange]:
    """Returns the differences between the XML of two models, in the order of the first; none unless both are XML files.

    Models that both attach are compared by their file names.
    """
    first, second = _xml_file(a), _xml_file(b)
    if first is None or second is None or first == second:
        return []
    one, other = read_xml(first), read_xml(second)
    pairs = [(one.root, other.root)] if one.root and other.root else []
    by_name = {root.file.name: root for root in other.attached}
    pairs += [(root, by_name[root.file.name]) for root in one.attached if root.file.name in by_name]
    return [change for pair in pairs for change in _changes(*pair)]


def _xml_file(source: Source) -> Path | None:
    file = source.main_file
    return file if file and file.suffix in XML else None


def _changes(a: Element, b: Element) -> Iterator[XmlChange]:
    contents = _contents(a, b)
    yield from _attribute_changes(a, b)
    waiting = [*reversed(_sections(a, b))]  # pairs of lists of siblings, the next one last
    while waiting:
        children_a, children_b = waiting.pop()
        pairs = _matched(children_a, children_b, contents)
        matched = {id(element) for pair in pairs for element in pair}
        for element in children_a:
            if id(element) not in matched:
                yield XmlChange(_tag(element), "", None, None, _place(element), None)
        for element in children_b:
            if id(element) not in matched:
                yield XmlChange(_tag(element), "", None, None, None, _place(element))
        for one, other in pairs:
            if contents[id(one)] != contents[id(other)]:
                yield from _attribute_changes(one, other)
                waiting.append((one.children, other.children))


def _sections(a: Element, b: Element) -> list[tuple[list[Element], list[Element]]]:
    """Returns the children of both roots; sections that occur in both are merged, however often they are opened."""
    tags = [child.tag for child in a.children]
    shared = [tag for tag in dict.fromkeys(tags) if any(child.tag == tag for child in b.children)]
    rest = tuple([child for child in root.children if child.tag not in shared] for root in (a, b))
    sections = [([c for c in a.children if c.tag == tag], [c for c in b.children if c.tag == tag]) for tag in shared]
    several = [(one, other) for one, other in sections if len(one) > 1 or len(other) > 1]
    single = [(one, other) for one, other in sections if (one, other) not in several]
    merged = [([e for c in one for e in c.children], [e for c in other for e in c.children]) for one, other in several]
    return [(rest[0], rest[1]), *single, *merged]


def _attribute_changes(a: Element, b: Element) -> Iterator[XmlChange]:
    for name in dict.fromkeys([*a.attributes, *b.attributes]):
        first, second = a.attributes.get(name), b.attributes.get(name)
        if _value(first or "") != _value(second or "") or (first is None) != (second is None):
            yield XmlChange(_tag(a), name, first, second, _place(a), _place(b))


def _matched(a: Sequence[Element], b: Sequence[Element], contents: dict[int, int]) -> list[Pair]:
    """Returns the matched elements, in the order of the first."""
    named = {key: element for element in b if (key := _key(element))}
    pairs = {id(one): (one, named[key]) for one in a if (key := _key(one)) in named}
    taken = {id(other) for _, other in pairs.values()}
    left_a = [element for element in a if id(element) not in pairs]
    left_b = [element for element in b if id(element) not in taken]
    start_a = start_b = 0
    for block in equal_blocks([contents[id(e)] for e in left_a], [contents[id(e)] for e in left_b]):
        pairs |= _by_tag(left_a[start_a : block.a], left_b[start_b : block.b])
        start_a, start_b = block.a + block.size, block.b + block.size
        equal = zip(left_a[block.a : start_a], left_b[block.b : start_b], strict=True)
        pairs |= {id(one): (one, other) for one, other in equal}
    return [pairs[id(element)] for element in a if id(element) in pairs]


def _by_tag(a: Sequence[Element], b: Sequence[Element]) -> dict[int, Pair]:
    """Returns pairs of unnamed elements with the same tag, in order."""
    unnamed: dict[str, list[Element]] = {}
    for element in reversed(b):
        if not _key(element):
            unnamed.setdefault(element.tag, []).append(element)
    return {id(e): (e, unnamed[e.tag].pop()) for e in a if not _key(e) and unnamed.get(e.tag)}


def _key(element: Element) -> tuple[str, str] | None:
    """Returns the tag and name of an element, or the class of defaults."""
    name = element.attributes.get("class") if element.tag == "default" else element.attributes.get("name")
    return (element.tag, name) if name else None


def _contents(*roots: Element) -> dict[int, int]:
    """Returns a number for the content of each element below `roots`, by its id; equal elements share it."""
    contents: dict[int, int] = {}
    numbers: dict[Hashable, int] = {}
    for root in roots:
        for element in reversed([*root.walk()]):  # children first
            attributes = frozenset((name, _value(text)) for name, text in element.attributes.items())
            content = element.tag, attributes, tuple(contents[id(child)] for child in element.children)
            contents[id(element)] = numbers.setdefault(content, len(numbers))
    return contents


def _value(text: str) -> Value:
    """Returns an attribute as its numbers, if it contains numbers."""
    try:
        return tuple(map(float, text.split()))
    except ValueError:
        return text


def _tag(element: Element) -> str:
    """Returns the start tag of an element with its name or class, or else with all its attributes."""
    name = next((key for key in ("name", "class") if key in element.attributes), None)
    attributes = element.attributes if name is None else {name: element.attributes[name]}
    written = [f'{key}="{text}"' for key, text in attributes.items()]
    return f"<{' '.join([element.tag, *written])}>"


def _place(element: Element) -> XmlPlace:
    return XmlPlace(str(element.file), element.line)
