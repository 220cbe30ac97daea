"""Declarations of descriptions: the MuJoCo field that each attribute of a dataclass holds, and its column in tables.

The values of a field come from `mjrun.model.fields`, their unit from `mjrun.model.units`. By default the column has the
name of the attribute.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TypeVar

import mujoco

from mjrun.dataclass import dataclass
from mjrun.model.fields import as_rows, floats, plain_values, referred_kinds
from mjrun.model.names import COUNTS, enum_name, names
from mjrun.model.units import Unit, field_unit

Pair = tuple[float, float]
T = TypeVar("T", bound="ModelObject")


@dataclass(frozen=True)
class DescribedAttribute:
    """The origin of an attribute, and its column in tables.

    Attributes:
      read: the function that returns the values of all objects in order of id, given a model and their kind.
      heading: the heading of the column.
      unit: the function that returns the unit, given a model and an id.
      usual: an uninformative value: the column is blank if every object has it.
      is_detail: true if the column is omitted where space is short.
      is_range: true if each value is a range.
    """

    read: Callable[[mujoco.MjModel, str], Sequence[Any]]
    heading: str = ""
    unit: Unit = lambda model, index: ""
    usual: float = 0
    is_detail: bool = False
    is_range: bool = False


@dataclass(frozen=True)
class ModelObject:
    """An object of a model.

    Attributes:
      id, name: its id and name; `geom:3` if it has no name.
    """

    KIND: ClassVar[str]

    id: int
    name: str

    @classmethod
    def facts(cls) -> dict[str, DescribedAttribute]:
        """Returns the declaration of each attribute, by name."""
        declared = {field.name: field.metadata.get("fact") for field in dataclasses.fields(cls)}
        return {name: fact for name, fact in declared.items() if fact}


def objects(kind: type[T], model: mujoco.MjModel) -> tuple[T, ...]:
    """Returns the descriptions of all objects of a kind, in order of id."""
    columns = [fact.read(model, kind.KIND) for fact in kind.facts().values()]
    own_names = names(model, kind.KIND)
    return tuple(map(kind, range(len(own_names)), own_names, *columns))


def of_field(
    name: str,
    *,
    at: str = "",
    then: Callable[[Any], Any] | None = None,
    heading: str = "",
    unit: str | None = None,
    usual: float = 0,
    is_detail: bool = False,
) -> Any:
    """Declares an attribute that holds the values of the field `name` of MjModel.

    Args:
      at: the field with the row of each object; by default the row is its id.
      then: a function applied to each value.
      heading: the heading of the column; by default the name of the attribute.
      unit: the unit of the values; by default that of the field.
    """

    def read(model: mujoco.MjModel, kind: str) -> Sequence[Any]:
        values = plain_values(model, name)
        if at:
            values = [values[row] for row in getattr(model, at)]
        return [then(value) for value in values] if then else values

    def own_unit(model: mujoco.MjModel, index: int) -> str:
        return field_unit(model, name, getattr(model, at)[index] if at else index)

    return _attribute(
        DescribedAttribute(read, heading, own_unit if unit is None else lambda model, index: unit, usual, is_detail)
    )


def within_limits(limited: str, limits: str, *, is_detail: bool = False) -> Any:
    """Declares an attribute that holds the range in the field `limits`; None unless the field `limited` enforces it."""

    def read(model: mujoco.MjModel, kind: str) -> Sequence[Pair | None]:
        return limited_ranges(getattr(model, limited), getattr(model, limits))

    def unit(model: mujoco.MjModel, index: int) -> str:
        return field_unit(model, limits, index)

    return _attribute(DescribedAttribute(read, unit=unit, is_detail=is_detail, is_range=True))


def computed(
    compute: Callable[[mujoco.MjModel, int], Any],
    *,
    unit: str = "",
    is_detail: bool = False,
) -> Any:
    """Declares an attribute that is computed from a model and the id of the object."""

    def read(model: mujoco.MjModel, kind: str) -> Sequence[Any]:
        return [compute(model, i) for i in range(getattr(model, COUNTS[kind]))]

    return _attribute(DescribedAttribute(read, unit=lambda model, index: unit, is_detail=is_detail))


def referred_kind(field: str) -> Any:
    """Declares an attribute that holds the kind of object which the ids in a field refer to."""

    def read(model: mujoco.MjModel, kind: str) -> Sequence[str]:
        kinds = referred_kinds(model, field)
        assert kinds is not None, field
        return [enum_name(mujoco.mjtObj, row[0]) for row in as_rows(kinds)]

    return _attribute(DescribedAttribute(read))


def _attribute(fact: DescribedAttribute) -> Any:
    return dataclasses.field(metadata={"fact": fact})


def limited_ranges(limited: Sequence[Any], limits: Sequence[Any]) -> list[Pair | None]:
    """Returns each range, or None if it is not enforced."""
    return [(float(low), float(high)) if on else None for on, (low, high) in zip(limited, limits, strict=True)]


def without_trailing_zeros(values: Sequence[Any]) -> tuple[float, ...]:
    """Returns numbers as floats, without trailing zeros."""
    numbers = list(floats(values))
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)
