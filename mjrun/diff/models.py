"""Do two models agree? What is compared is what MuJoCo compiles them to, object by object."""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from mjrun.diff.model_differences import (
    ArrayDifference,
    ComputedDifference,
    Difference,
    FieldDifference,
    ModelComparison,
    ModelObject,
    Value,
)
from mjrun.diff.model_matching import PARENTS, ModelObjects, ObjectMatching
from mjrun.diff.model_values import FieldComparer
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.diff.xml_changes import xml_changes
from mjrun.model.description.non_default_settings import (
    VISUAL,
    NonDefaultSetting,
    option_differences,
    statistic_differences,
    visual_differences,
)
from mjrun.model.fields import SIZES, model_fields, user_sizes
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.names import PLURALS
from mjrun.model.source import Source

MEMORY = "a compiled model"  # what one is called that comes from no file


def compare_models(a: Source, b: Source, tolerances: Tolerances | None = None) -> ModelComparison:
    """Compares what two models compile to, object by object.

    Objects are matched by name; unnamed ones by their place among those of their parent body. Addresses, ids and
    counts are not compared as numbers, but as the objects that they refer to, so that an inserted object is one
    difference. Names of files are not compared at all. Numbers agree within the tolerance of their field; NaN agrees
    with NaN, and 0 with −0. Integers, choices and names must be equal.

    Args:
      tolerances: by the names of fields, `body_mass` or `opt.timestep`; exact if nothing is said.

    Raises:
      ModelError: one of the models cannot be found, read or compiled.
      UsageError: an override of one of them names nothing, or its value does not fit; a tolerance is for no field.
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

    only_a = [ModelObject(kind, objects.a.label(kind, i)) for kind, m in objects.matches.items() for i in m.only_a]
    only_b = [ModelObject(kind, objects.b.label(kind, i)) for kind, m in objects.matches.items() for i in m.only_b]
    follow = [_summary(name, differences) for name, differences in computed.items() if differences]
    if not (stated or only_a or only_b):
        stated, follow = [each for differences in computed.values() for each in differences], []
    fields = [each for each in stated if isinstance(each, FieldDifference)]
    arrays = [each for each in stated if isinstance(each, ArrayDifference)]
    a_name, b_name = (source.text or MEMORY for source in (a, b))
    return ModelComparison(a_name, b_name, fields, arrays, only_a, only_b, follow, xml_changes(a, b), tuple(warnings))


def _field_names(model: mujoco.MjModel) -> list[str]:
    """The names of all fields that can differ within a tolerance."""
    visual = [(f"vis.{section}", getattr(model.vis, field)) for section, field in VISUAL.items()]
    settings = [("opt", model.opt), ("stat", model.stat), *visual]
    names = [f"{path}.{name}" for path, owner in settings for name in dir(type(owner)) if not name.startswith("_")]
    return [*(field.name for field in model_fields()), *names]


def _settings(a: mujoco.MjModel, b: mujoco.MjModel, comparer: FieldComparer) -> Iterator[Difference]:
    """What differs in options, flags, visual settings, and sizes that the user sets."""
    yield from _converted((*option_differences(b, a), *visual_differences(b, a)), comparer)
    for size in (*SIZES, *user_sizes()):
        first, second = int(getattr(a, size)), int(getattr(b, size))
        if first != second:
            yield FieldDifference(size, "", (), (first,), (second,))


def _converted(settings: Sequence[NonDefaultSetting], comparer: FieldComparer) -> Iterator[FieldDifference]:
    """Settings of the second model whose `default` is that of the first."""
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
    """Names that differ: of the models, and of objects that are the same but for it."""
    a, b = (bytes(each.model.names).partition(b"\0")[0].decode("utf-8", "replace") for each in (objects.a, objects.b))
    if a != b:
        yield FieldDifference("name", "", (), (a,), (b,))
    for kind, match in objects.matches.items():
        for i, j in zip(match.a.tolist(), match.b.tolist(), strict=True):
            first, second = objects.a.names[kind][i], objects.b.names[kind][j]
            if first != second:
                yield FieldDifference("name", f"{kind} {objects.a.label(kind, i)}", (), (first,), (second,))


def _orders(objects: ObjectMatching) -> Iterator[FieldDifference]:
    """Objects that stand in another order, on which the layout of `qpos`, `ctrl` and `sensordata` depends.

    Objects of bodies are compared within their body, so that a body that moves is one difference.
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


def _summary(name: str, differences: Sequence[Difference]) -> ComputedDifference:
    largest = [each.largest for each in differences if each.largest is not None]
    return ComputedDifference(name, len(differences), max(largest, default=None))
