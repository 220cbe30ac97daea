"""The comparison of two models, by what MuJoCo compiles them to, object by object."""

import hashlib
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from mjrun.diff.model_matching import PARENTS, ModelObjects, ModelRowMatching, ObjectMatching
from mjrun.diff.result import (
    ArrayDifference,
    DerivedFieldDifference,
    Difference,
    FieldDifference,
    ModelComparison,
    UnmatchedObject,
    Value,
)
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.diff.xml_changes import xml_changes
from mjrun.model.description.non_default_settings import (
    VISUAL,
    NonDefaultSetting,
    option_differences,
    statistic_differences,
    visual_differences,
)
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
from mjrun.model.source import Source
from mjrun.model.units import field_unit

SHORT = 8  # numbers of an object that are listed one by one; more are reported as an array
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


class FieldComparer:
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
        names = self._align_components(field, a, b)
        different = self._different(field, a, b)
        for k in np.flatnonzero(different.any(axis=1)).tolist():
            chosen = np.flatnonzero(different[k]).tolist()
            components = tuple(names[i] for i in chosen) if len(chosen) < len(names) else ()
            unit = field_unit(self._models[0], field.name, int(rows.a[k]))
            yield FieldDifference(field.name, rows.labels[k], components, a.plain(k, chosen), b.plain(k, chosen), unit)

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
            elif a.array.shape != b.array.shape or a.array.size > SHORT:
                yield from self._array(field.name, label, self._canonical("a", a), self._canonical("b", b))
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


MEMORY = "a compiled model"  # the name of a model without a source


def compare_models(a: Source, b: Source, tolerances: Tolerances | None = None) -> ModelComparison:
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
    comparer = FieldComparer(objects, tolerances)
    stated = [*_settings(first, second, comparer), *_names(objects), *_orders(objects)]
    computed: dict[str, list[Difference]] = {"stat": [*_converted(statistic_differences(second, first), comparer)]}
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
    return ModelComparison(a_name, b_name, fields, arrays, only_a, only_b, follow, xml_changes(a, b), tuple(warnings))


def _field_names(model: mujoco.MjModel) -> list[str]:
    """Returns the names of all fields that can have a tolerance."""
    visual = [(f"vis.{section}", getattr(model.vis, field)) for section, field in VISUAL.items()]
    settings: list[tuple[str, object]] = [("opt", model.opt), ("stat", model.stat), *visual]
    names = [f"{path}.{name}" for path, owner in settings for name in dir(type(owner)) if not name.startswith("_")]
    return [*(field.name for field in model_fields()), *names]


def _settings(a: mujoco.MjModel, b: mujoco.MjModel, comparer: FieldComparer) -> Iterator[Difference]:
    """Yields the differences in options, flags, visual settings, and sizes that the user sets."""
    yield from _converted((*option_differences(b, a), *visual_differences(b, a)), comparer)
    for size in (*SIZES, *user_sizes()):
        first, second = int(getattr(a, size)), int(getattr(b, size))
        if first != second:
            yield FieldDifference(size, "", (), (first,), (second,))


def _converted(settings: Sequence[NonDefaultSetting], comparer: FieldComparer) -> Iterator[FieldDifference]:
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


def _differ(path: str, a: Value, b: Value, comparer: FieldComparer) -> bool:
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
