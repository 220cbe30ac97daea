"""The differences of two models as lines of text."""

from collections.abc import Iterator, Sequence
from itertools import groupby

from mjrun.diff.model_differences import (
    ArrayDifference,
    ComputedDifference,
    FieldDifference,
    ModelComparison,
    ModelObject,
    Value,
    XmlChange,
)
from mjrun.errors import clean, counted
from mjrun.model.names import PLURALS

LISTED = 10  # objects of a field, names of a kind and changes of the XML that are listed before a list is cut
NUMBERS = 7  # of a row that are shown side by side; of more, the one that differs most
DIGITS = 6  # of a number, or as many as it takes to see a difference
HASH = 12  # characters of a SHA-256


def model_sentences(result: ModelComparison) -> list[str]:
    """A line for each value, array, and model with objects of its own."""
    values = [_field_line(each) for each in result.fields]
    return [*values, *map(_array_line, result.arrays), *_objects_of_one(result)]


def model_lines(result: ModelComparison, *, every: bool = False) -> Iterator[str]:
    """What differs: values, arrays, objects of one model, what follows from these, the XML.

    Args:
      every: whether long lists are not cut.
    """
    most = None if every else LISTED
    for _, group in groupby(result.fields, lambda each: each.field):
        yield from _cut([_field_line(each) for each in group], most)
    for _, group in groupby(result.arrays, lambda each: each.field):
        yield from _cut([_array_line(each) for each in group], most)
    yield from _objects_of_one(result)
    if result.computed:
        yield f"computed from these: {', '.join(map(_computed, result.computed))}"
    if result.xml and not result.equal:
        yield "in the XML:"
        yield from (f"  {line}" for line in _cut([_xml_line(change) for change in result.xml], most))


def _objects_of_one(result: ModelComparison) -> Iterator[str]:
    for source, objects in ((result.a, result.only_a), (result.b, result.only_b)):
        if objects:
            yield f"only in {clean(source)}: {_objects(objects)}"


def _cut(lines: Sequence[str], most: int | None) -> Iterator[str]:
    yield from lines[:most]
    if most is not None and len(lines) > most:
        yield f"… and {len(lines) - most} more like this"


def _field_line(difference: FieldDifference) -> str:
    name = _named(difference.field, difference.object)
    if len(difference.a) > NUMBERS:
        return f"{name} {_most(difference)}"
    components = f".{','.join(map(clean, difference.components))}" if difference.components else ""
    a, b = _side_by_side(difference.a, difference.b)
    unit = f" {difference.unit}" if difference.unit else ""
    return f"{name}{components} {a} → {b}{unit}"


def _most(difference: FieldDifference) -> str:
    """Of many numbers, how many differ, and by how much at most."""
    largest = "" if difference.largest is None else f", by {difference.largest:.{DIGITS}g} at most"
    return f"differs in {len(difference.a)} values{largest}"


def _array_line(difference: ArrayDifference) -> str:
    name = _named(difference.field, difference.object)
    hashes = f"sha256 {difference.sha256_a[:HASH]} → {difference.sha256_b[:HASH]}"
    if difference.count is None:
        return f"{name} {_shape(difference.shape_a)} → {_shape(difference.shape_b)}, {hashes}"
    largest = f"by {difference.largest:.{DIGITS}g} at most" if difference.largest is not None else ""
    return f"{name} {_shape(difference.shape_a)} differs in {counted(difference.count, 'value')}, {largest}, {hashes}"


def _shape(shape: Sequence[int]) -> str:
    return "×".join(map(str, shape))


def _named(field: str, label: str) -> str:
    return f"{field}[{clean(label)}]" if label else field


def _side_by_side(a: Sequence[Value], b: Sequence[Value]) -> tuple[str, str]:
    if len(a) != len(b):
        return _row(list(map(_plain, a))), _row(list(map(_plain, b)))
    pairs = [_pair(x, y) for x, y in zip(a, b, strict=True)]
    return _row([x for x, _ in pairs]), _row([y for _, y in pairs])


def _row(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"


def _pair(a: Value, b: Value) -> tuple[str, str]:
    """Two values with as many digits as it takes to tell them apart."""
    if isinstance(a, float) and isinstance(b, float) and a != b:
        for digits in range(DIGITS, 18):
            first, second = f"{a:.{digits}g}", f"{b:.{digits}g}"
            if first != second:
                return first, second
    return _plain(a), _plain(b)


def _plain(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else clean(str(value)) or "''"


def _objects(objects: Sequence[ModelObject]) -> str:
    """Objects by kind."""
    parts: list[str] = []
    for kind, group in groupby(objects, lambda each: each.kind):
        names = [clean(each.name) for each in group]
        more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
        plural = PLURALS.get(kind, f"{kind}s") if len(names) > 1 else kind
        parts.append(f"{plural} {', '.join(names[:LISTED])}{more}")
    return "; ".join(parts)


def _computed(difference: ComputedDifference) -> str:
    count = f" ({difference.objects})" if difference.objects > 1 else ""
    return f"{difference.field}{count}"


def _xml_line(change: XmlChange) -> str:
    places = " → ".join(clean(str(place)) for place in (change.place_a, change.place_b) if place)
    element = clean(change.element)
    if not change.attribute:
        return f"{places}: {element} {'removed' if change.place_b is None else 'added'}"
    a, b = ("not set" if text is None else f'"{clean(text)}"' for text in (change.a, change.b))
    return f"{places}: {element} {clean(change.attribute)} {a} → {b}"
