"""The comparison of two models: object by object as MuJoCo compiles them, and element by element in their XML.

Elements are matched within matched parents: by tag and name (or class), then equal ones, then those with the same tag
in their order. Attributes with the same numbers are equal, however they are written.
"""

import hashlib
from collections.abc import Hashable, Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from mjrun.diff.model_matching import (
    PARENTS,
    UNORDERED,
    ModelObjects,
    ModelRowMatching,
    ObjectMatching,
    equal_blocks,
)
from mjrun.diff.result import (
    ArrayDifference,
    DerivedFieldDifference,
    Difference,
    FieldDifference,
    ModelComparison,
    UnmatchedObject,
    Value,
    XmlChange,
    XmlPlace,
)
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.model.fields import (
    SIZES,
    STRETCHES,
    ModelField,
    array,
    as_rows,
    model_fields,
    referred_kinds,
    stretch,
    stretch_kind,
    user_sizes,
)
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.names import PLURALS, QUATERNION, VECTOR
from mjrun.model.non_default_settings import (
    VISUAL,
    NonDefaultSetting,
    option_differences,
    statistic_differences,
    visual_differences,
)
from mjrun.model.source import ModelSource
from mjrun.model.units import field_unit
from mjrun.model.xml_source import Element, read_xml
from mjrun.suffixes import XML

SHORT = 8  # numbers of an object that are listed one by one; more are reported as an array, unless they are ids
COLOUR, LIMITS = ("r", "g", "b", "a"), ("lower", "upper")
# The names of the components of a field, by the end of its name and their number.
COMPONENTS: dict[tuple[str, int], Sequence[str]] = {
    ("pos", 3): VECTOR, ("axis", 3): VECTOR, ("_dir", 3): VECTOR, ("scale", 3): VECTOR, ("0", 3): VECTOR,
    ("quat", 4): QUATERNION, ("rgba", 4): COLOUR, ("ambient", 3): COLOUR, ("diffuse", 3): COLOUR,
    ("light_specular", 3): COLOUR, ("range", 2): LIMITS, ("lengthspring", 2): LIMITS,
    ("friction", 3): ("slide", "spin", "roll"), ("pair_friction", 5): ("slide1", "slide2", "spin", "roll1", "roll2"),
    ("surfacevel", 6): ("vx", "vy", "vz", "wx", "wy", "wz"), ("body_invweight0", 2): ("translation", "rotation"),
    ("resolution", 2): ("width", "height"), ("sensorsize", 2): ("width", "height"),
    ("exclude_signature", 2): ("body1", "body2"), ("hfield_size", 4): ("x", "y", "top", "bottom"),
}  # fmt: skip
TEXTS = ("text_data", "plugin_attr")
MEMORY = "a compiled model"  # the name of a model without a source


class _FieldComparer:
    """A comparison of fields of two models whose objects are matched."""

    def __init__(self, objects: ObjectMatching, tolerances: Tolerances) -> None:
        self._objects, self._rows = objects, ModelRowMatching(objects)
        self._models = objects.a.model, objects.b.model
        self._tolerances = tolerances

    def differences(self, field: ModelField) -> Iterator[Difference]:
        """Yields the differences in one field, in the order of the first model."""
        if field.rows in STRETCHES:
            yield from self._stretches(field)
        elif self._rows.rows(field.rows) is not None:
            yield from self._matched_rows(field)
        else:
            yield from self._array(field.name, "", *(array(model, field.name) for model in self._models))

    def disagree(self, name: str, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Returns where two arrays of one shape differ; floats within the tolerance of the field agree, as do NaNs."""
        different = a != b
        if not np.issubdtype(a.dtype, np.floating) or not different.any():
            return different
        return different & ~self._tolerances.of(name).agree(a.astype(float), b.astype(float))

    def _matched_rows(self, field: ModelField) -> Iterator[FieldDifference]:
        rows = self._rows.rows(field.rows)
        assert rows is not None
        a, b = _Values(self._objects.a, field).rows(rows.a), _Values(self._objects.b, field).rows(rows.b)
        self._turn(field, b)
        names = self._align_components(field, a, b)
        different = self._different(field, a, b)
        for k in np.flatnonzero(different.any(axis=1)).tolist():
            chosen = np.flatnonzero(different[k]).tolist()
            components = tuple(names[i] for i in chosen) if len(chosen) < len(names) else ()
            pair = zip(self._models, (rows.a[k], rows.b[k]), strict=True)
            unit, other = (field_unit(model, field.name, int(row)) for model, row in pair)
            unit = unit if unit == other else ""
            yield FieldDifference(field.name, rows.labels[k], components, a.plain(k, chosen), b.plain(k, chosen), unit)

    def _turn(self, field: ModelField, b: "_Values") -> None:
        """Puts the two objects of pairs and excludes of the second model in the order of the first."""
        for kind, names in UNORDERED.items():
            if field.name in names:
                match, turned = self._objects.matches[kind], self._objects.are_turned(kind)
                two = self._objects.b.two(kind)[0][match.b]
                two[turned] = two[turned, ::-1]
                b.array = two if len(names) == 1 else two[:, [names.index(field.name)]]

    def _align_components(self, field: ModelField, a: "_Values", b: "_Values") -> Sequence[str]:
        """Makes the columns of both correspond, and returns their names."""
        dimension = str(field.extents[1]) if len(field.extents) > 1 else ""
        columns = self._rows.rows(dimension) if dimension else None
        if columns is not None:
            a.columns(columns.a)
            b.columns(columns.b)
            return columns.labels
        width = max(a.width, b.width)  # of user data; the shorter one is padded with zeros
        a.pad(width)
        b.pad(width)
        named = next((names for (end, n), names in COMPONENTS.items() if n == width and field.name.endswith(end)), None)
        return named or [str(i) for i in range(width)]

    def _stretches(self, field: ModelField) -> Iterator[Difference]:
        kind = stretch_kind(field.rows)
        match = self._objects.matches[kind]
        values = [_Values(objects, field) for objects in (self._objects.a, self._objects.b)]
        for pair in zip(match.a.tolist(), match.b.tolist(), strict=True):
            label = self._rows.label(kind, *pair)
            a, b = (
                value.rows(np.arange(*stretch(model, field.rows, index).indices(len(value.array))))
                for value, model, index in zip(values, self._models, pair, strict=True)
            )
            if field.name in TEXTS:
                yield from _text(field.name, label, a.array, b.array)
            elif a.array.shape != b.array.shape or (a.kinds is None and a.array.size > SHORT):
                yield from self._array(field.name, label, a.array, b.array)
            else:
                yield from self._short(field, label, a, b)

    def _short(self, field: ModelField, label: str, a: "_Values", b: "_Values") -> Iterator[FieldDifference]:
        """Yields the difference in the few numbers of an object, as one row."""
        a, b = a.flat(), b.flat()
        chosen = np.flatnonzero(self._different(field, a, b)[0]).tolist()
        if chosen:
            components = tuple(map(str, chosen)) if len(chosen) < a.width else ()
            yield FieldDifference(field.name, label, components, a.plain(0, chosen), b.plain(0, chosen))

    def _different(self, field: ModelField, a: "_Values", b: "_Values") -> np.ndarray:
        """Returns where rows differ: numbers beyond the tolerance, and ids of different objects."""
        first, second = self._canonical("a", a), self._canonical("b", b)
        different = self.disagree(field.name, first, second)
        if a.kinds is None or b.kinds is None:
            return different
        return different | ((first != second) & ((a.kinds != 0) | (b.kinds != 0)))

    def _canonical(self, side: str, values: "_Values") -> np.ndarray:
        return self._objects.canonical(side, values.array, values.kinds)

    def _array(self, name: str, label: str, a: np.ndarray, b: np.ndarray) -> Iterator[ArrayDifference]:
        count = largest = None
        if a.shape == b.shape:
            count = int(np.count_nonzero(self.disagree(name, a, b)))
            if not count:
                return
            largest = float(np.nanmax(np.abs(b.astype(float) - a.astype(float))))
        yield ArrayDifference(name, label, a.shape, b.shape, count, largest, _sha256(a), _sha256(b))


class _Values:
    """Rows of a field of one model, `(n, m)`, with the types of the objects that its ids refer to."""

    def __init__(self, objects: ModelObjects, field: ModelField) -> None:
        self._objects, self._field = objects, field
        values, kinds = array(objects.model, field.name), referred_kinds(objects.model, field.name)
        self.array = as_rows(values)
        self.kinds = None if kinds is None else as_rows(kinds)

    @property
    def width(self) -> int:
        return self.array.shape[1]

    def rows(self, indices: np.ndarray) -> "_Values":
        """Returns some of the rows."""
        return self._with(self.array[indices], None if self.kinds is None else self.kinds[indices])

    def flat(self) -> "_Values":
        """Returns all values as one row."""
        return self._with(self.array.reshape(1, -1), None if self.kinds is None else self.kinds.reshape(1, -1))

    def columns(self, indices: np.ndarray) -> None:
        """Selects some of the columns."""
        self.array = self.array[:, indices]

    def pad(self, width: int) -> None:
        """Appends columns of zeros."""
        if width > self.width:
            self.array = np.pad(self.array, ((0, 0), (0, width - self.width)))

    def plain(self, row: int, columns: Sequence[int]) -> tuple[Value, ...]:
        """Returns some values of one row as plain values."""
        return tuple(self._plain(row, column) for column in columns)

    def _plain(self, row: int, column: int) -> Value:
        value = self.array[row, column]
        if self.kinds is not None and (kind := int(self.kinds[row, column])):
            return self._objects.referred(kind, int(value))
        return self._field.plain(value)

    def _with(self, values: np.ndarray, kinds: np.ndarray | None) -> "_Values":
        new = object.__new__(_Values)
        new._objects, new._field, new.array, new.kinds = self._objects, self._field, values, kinds
        return new


def _text(name: str, label: str, a: np.ndarray, b: np.ndarray) -> Iterator[FieldDifference]:
    first, second = (
        values.tobytes().rstrip(b"\0").replace(b"\0", b" ").decode("utf-8", "replace") for values in (a, b)
    )
    if first != second:
        yield FieldDifference(name, label, (), (first,), (second,))


def _sha256(values: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()


def compare_models(a: ModelSource, b: ModelSource, tolerances: Tolerances | None = None) -> ModelComparison:
    """Compares the compilation of two models, object by object.

    Objects are matched by name, unnamed ones by their position among those of their parent body. Addresses, ids and
    counts are not compared as numbers, but as the objects that they refer to, so that an inserted object is one
    difference. Names of files are not compared. Numbers agree within the tolerance of their field; NaN equals NaN, and
    0 equals −0. Integers, choices and names must be equal.

    Args:
      tolerances: the tolerances by the names of fields, `body_mass` or `opt.timestep`; exact by default.

    Raises:
      ModelError: one of the models cannot be found, read or compiled.
      UsageError: an override refers to nothing, or its value does not fit; a tolerance applies to no field.
    """
    with collected_warnings() as warnings:
        first, second = a.load(), b.load()
    objects = ObjectMatching(ModelObjects(first), ModelObjects(second))
    tolerances = tolerances or Tolerances(Tolerance(), {})
    tolerances.require(_field_names(first), "field")
    comparer = _FieldComparer(objects, tolerances)
    stated = [*_settings(first, second, comparer), *_names(objects), *_orders(objects)]
    computed: dict[str, list[Difference]] = {"stat": [*_converted(statistic_differences(second, first), comparer)]}
    if first.narena != second.narena:
        computed["narena"] = [FieldDifference("narena", "", (), (int(first.narena),), (int(second.narena),), "bytes")]
    for field in model_fields():
        differences = [*comparer.differences(field)]
        if field.computed:
            computed[field.name] = differences
        else:
            stated += differences

    only_a = [UnmatchedObject(kind, objects.a.label(kind, i)) for kind, m in objects.matches.items() for i in m.only_a]
    only_b = [UnmatchedObject(kind, objects.b.label(kind, i)) for kind, m in objects.matches.items() for i in m.only_b]
    follow = [_summary(name, differences) for name, differences in computed.items() if differences]
    if not (stated or only_a or only_b):
        stated, follow = [each for differences in computed.values() for each in differences], []
    fields = [each for each in stated if isinstance(each, FieldDifference)]
    arrays = [each for each in stated if isinstance(each, ArrayDifference)]
    a_name, b_name = (source.text or MEMORY for source in (a, b))
    return ModelComparison(
        a=a_name,
        b=b_name,
        fields=fields,
        arrays=arrays,
        only_a=only_a,
        only_b=only_b,
        computed=follow,
        xml=xml_changes(a, b),
        warnings=tuple(warnings),
        exact=tolerances.are_exact,
    )


def _field_names(model: mujoco.MjModel) -> list[str]:
    """Returns the names of all fields that can have a tolerance."""
    visual = [(f"vis.{section}", getattr(model.vis, field)) for section, field in VISUAL.items()]
    settings: list[tuple[str, object]] = [("opt", model.opt), ("stat", model.stat), *visual]
    names = [f"{path}.{name}" for path, owner in settings for name in dir(type(owner)) if not name.startswith("_")]
    return [*(field.name for field in model_fields()), *names]


def _settings(a: mujoco.MjModel, b: mujoco.MjModel, comparer: _FieldComparer) -> Iterator[Difference]:
    """Yields the differences in options, flags, visual settings, and sizes that the user sets."""
    yield from _converted((*option_differences(b, a), *visual_differences(b, a)), comparer)
    for size in (*SIZES, *user_sizes()):
        first, second = int(getattr(a, size)), int(getattr(b, size))
        if first != second:
            yield FieldDifference(size, "", (), (first,), (second,))


def _converted(settings: Sequence[NonDefaultSetting], comparer: _FieldComparer) -> Iterator[FieldDifference]:
    """Yields the differences in settings of the second model whose `default` is that of the first."""
    for setting in settings:
        a, b = _values(setting.default), _values(setting.value)
        chosen = [i for i, (x, y) in enumerate(zip(a, b, strict=True)) if _differ(setting.path, x, y, comparer)]
        if chosen:
            names = _component_names(setting.path, len(a))
            components = tuple(names[i] for i in chosen) if len(chosen) < len(a) else ()
            first, second = tuple(a[i] for i in chosen), tuple(b[i] for i in chosen)
            yield FieldDifference(setting.path, "", components, first, second, setting.unit)


def _values(value: Value | tuple[float, ...]) -> tuple[Value, ...]:
    return value if isinstance(value, tuple) else (value,)


def _differ(path: str, a: Value, b: Value, comparer: _FieldComparer) -> bool:
    if isinstance(a, float) and isinstance(b, float):
        return bool(comparer.disagree(path, np.array([a]), np.array([b]))[0])
    return a != b


def _component_names(path: str, count: int) -> Sequence[str]:
    if path.startswith(("vis.rgba", "vis.headlight")):
        return ("r", "g", "b", "a")
    return ("x", "y", "z") if count == 3 else [str(i) for i in range(count)]


def _names(objects: ObjectMatching) -> Iterator[FieldDifference]:
    """Yields the names that differ: of the models, and of objects that are otherwise the same."""
    a, b = (bytes(each.model.names).partition(b"\0")[0].decode("utf-8", "replace") for each in (objects.a, objects.b))
    if a != b:
        yield FieldDifference("name", "", (), (a,), (b,))
    for kind, match in objects.matches.items():
        for i, j in zip(map(int, match.a), map(int, match.b), strict=True):
            first, second = objects.a.names[kind][i], objects.b.names[kind][j]
            if first != second:
                yield FieldDifference("name", f"{kind} {objects.a.label(kind, i)}", (), (first,), (second,))


def _orders(objects: ObjectMatching) -> Iterator[FieldDifference]:
    """Yields objects in a different order, on which the layout of `qpos`, `ctrl` and `sensordata` depends.

    Objects of bodies are compared within their body, so that a moved body is one difference.
    """
    for kind, match in objects.matches.items():
        parents = objects.a.parents(kind)[match.a]
        stayed = objects.parent_numbers("a", kind)[match.a] == objects.parent_numbers("b", kind)[match.b]
        for parent in np.unique(parents[stayed]).tolist():
            group = stayed & (parents == parent)
            if (np.diff(match.b[group]) < 0).any():
                a = tuple(objects.a.label(kind, i) for i in match.a[group].tolist())
                b = tuple(objects.b.label(kind, i) for i in sorted(match.b[group].tolist()))
                place = f" of {objects.a.label('body', parent)}" if kind in PARENTS else ""
                yield FieldDifference("order", f"{PLURALS.get(kind, f'{kind}s')}{place}", (), a, b)


def _summary(name: str, differences: Sequence[Difference]) -> DerivedFieldDifference:
    largest = [each.largest for each in differences if each.largest is not None]
    return DerivedFieldDifference(name, len(differences), max(largest, default=None))


AttributeValue = str | tuple[float, ...]
Pair = tuple[Element, Element]


def xml_changes(a: ModelSource, b: ModelSource) -> list[XmlChange]:
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


def _xml_file(source: ModelSource) -> Path | None:
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


def _value(text: str) -> AttributeValue:
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
