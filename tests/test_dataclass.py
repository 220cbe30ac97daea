"""Tests of dataclasses with shared methods: they behave like those of the standard library."""

import dataclasses
import inspect
import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, asdict, field, fields, replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.dataclass import dataclass

Decorator = Callable[..., Any]


def declared(decorate: Decorator) -> list[type]:
    """Declares classes with every feature of a dataclass that mjrun uses."""

    @decorate(frozen=True)
    class Point:
        """A point."""

        x: float
        y: float = 0.0
        tags: list[str] = field(default_factory=list)
        hidden: int = field(default=1, repr=False, compare=False)
        unit: str = field(default="m", kw_only=True)

    @decorate(frozen=True, kw_only=True)
    class Named(Point):
        """A point with a name, which must not be empty."""

        name: str
        first: int = field(default=7, kw_only=False)

        def __post_init__(self) -> None:
            if not self.name:
                raise ValueError("the name is empty")

    @decorate
    class Count:
        """A number that changes."""

        value: int = 0
        double: int = field(init=False)

        def __post_init__(self) -> None:
            self.double = 2 * self.value

    @decorate(frozen=True, eq=False)
    class Unequal:
        """An object that equals itself alone."""

        value: object = None

        def __repr__(self) -> str:
            return "its own"

    return [Point, Named, Count, Unequal]


OURS, THEIRS = declared(dataclass), declared(dataclasses.dataclass)
PAIRS = list(zip(OURS, THEIRS, strict=True))
NAMES = ["x", "y", "tags", "hidden", "unit", "name", "first", "value", "double", "unknown"]
VALUES = st.sampled_from([0, 1.5, "", "a", None, dataclasses.MISSING])


def outcome(make: Callable[[], object]) -> object:
    """Returns the representation and the state of an object, or the type of the error that prevented it."""
    try:
        made = make()
    except (TypeError, ValueError) as error:
        return type(error)
    return repr(made).replace(str(dataclasses), ""), vars(made)


@pytest.mark.parametrize("pair", PAIRS)
@given(arguments=st.lists(VALUES, max_size=5), values=st.dictionaries(st.sampled_from(NAMES), VALUES, max_size=4))
def test_any_arguments_make_the_same_object_or_the_same_kind_of_error(
    pair: tuple[Any, Any], arguments: list[object], values: dict[str, object]
) -> None:
    ours, theirs = (outcome(lambda cls=cls: cls(*arguments, **values)) for cls in pair)
    assert ours == theirs


@pytest.mark.parametrize("pair", PAIRS)
def test_signatures_and_fields_agree(pair: tuple[Any, Any]) -> None:
    ours, theirs = ([*inspect.signature(cls).parameters.values()] for cls in pair)
    assert [(each.name, each.kind, each.annotation) for each in ours] == [
        (each.name, each.kind, each.annotation) for each in theirs
    ]
    assert [each.default for each in ours if each.name != "tags"] == [
        each.default for each in theirs if each.name != "tags"
    ]
    assert [each.name for each in fields(pair[0])] == [each.name for each in fields(pair[1])]


@pytest.mark.parametrize("classes", [OURS, THEIRS])
def test_equality_and_hashes_are_of_the_compared_fields_of_one_class(classes: list[type]) -> None:
    point, named, count, unequal = (cast_any(cls) for cls in classes)
    assert point(1, tags=("a",), hidden=2) == point(1.0, tags=("a",), hidden=3)
    assert hash(point(1, tags=("a",), hidden=2)) == hash(point(1.0, tags=("a",), hidden=3))
    assert point(1) != point(2)
    assert point(1) != named(1, name="n")
    assert point(float("nan")) != point(float("nan"))
    assert count(3) == count(3) != count(4)
    assert unequal(1) != unequal(1)
    assert len({unequal(1), unequal(1)}) == 2
    with pytest.raises(TypeError, match="unhashable"):
        hash(count(3))
    with pytest.raises(TypeError, match="unhashable"):
        hash(point(1))  # with a list


def cast_any(value: Any) -> Any:
    return value


@pytest.mark.parametrize("classes", [OURS, THEIRS])
def test_frozen_objects_refuse_changes(classes: list[type]) -> None:
    point, named, count, _ = (cast_any(cls) for cls in classes)
    for frozen in (point(1), named(1, name="n")):
        with pytest.raises(FrozenInstanceError, match="cannot assign to field 'x'"):
            frozen.x = 2
        with pytest.raises(FrozenInstanceError, match="cannot delete field 'x'"):
            del frozen.x
    changed = count(1)
    changed.value = 5
    assert changed.value == 5


def test_functions_of_the_standard_library_apply() -> None:
    point, named, *_ = (cast_any(cls) for cls in OURS)
    one = named(1, name="n")
    assert replace(one, y=4.0) == named(1, 4.0, name="n")
    assert asdict(point(1)) == {"x": 1, "y": 0.0, "tags": [], "hidden": 1, "unit": "m"}
    assert point(1).tags is not point(1).tags
    with pytest.raises(ValueError, match="the name is empty"):
        replace(one, name="")


@dataclass(frozen=True)
class Pickled:
    """A class that pickle can import."""

    value: int
    other: object = None


def test_objects_survive_pickling_and_name_themselves_in_errors() -> None:
    assert pickle.loads(pickle.dumps(Pickled(1, Pickled(2)))) == Pickled(1, Pickled(2))
    with pytest.raises(TypeError, match="Pickled: missing a required argument: 'value'"):
        Pickled()  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"keyword argument 'valeu' \(did you mean 'value'\?\)"):
        Pickled(valeu=1)  # type: ignore[call-arg]
