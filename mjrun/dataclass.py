"""Dataclasses that are cheap to declare.

`dataclasses.dataclass` generates source code for the methods of each class and compiles it, which takes half a
millisecond. A command imports hundreds of such classes and uses a few. The classes declared here share their methods,
which read the fields of the class. The standard library's `field`, `fields`, `replace` and `asdict` apply to them.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import MISSING, FrozenInstanceError
from functools import cache
from inspect import Parameter, Signature
from reprlib import recursive_repr
from typing import Any, TypeVar, dataclass_transform, overload

C = TypeVar("C")
KINDS = (Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)
UNSET = object()


@overload
def dataclass(cls: type[C], /) -> type[C]: ...
@overload
def dataclass(*, frozen: bool = False, eq: bool = True, kw_only: bool = False) -> Callable[[type[C]], type[C]]: ...
@dataclass_transform(field_specifiers=(dataclasses.field,))
def dataclass(
    cls: type[C] | None = None, /, *, frozen: bool = False, eq: bool = True, kw_only: bool = False
) -> type[C] | Callable[[type[C]], type[C]]:
    """Turns a class into a dataclass, with the parameters of `dataclasses.dataclass`; keeps methods of the class."""

    def declare(cls: type[C]) -> type[C]:
        dataclasses.dataclass(init=False, repr=False, eq=False, kw_only=kw_only)(cls)
        methods: dict[str, object] = {"__init__": _initializer(cls), "__repr__": _repr, "__signature__": _SIGNATURE}
        if eq:
            methods |= {"__eq__": _equals, "__hash__": _hash if frozen else None}
        if frozen:
            methods |= {"__setattr__": _refuse_assignment, "__delattr__": _refuse_deletion}
        for name, method in methods.items():
            if name not in vars(cls):
                setattr(cls, name, method)
        return cls

    return declare if cls is None else declare(cls)


@cache
def _fields(cls: type) -> tuple["dataclasses.Field[Any]", ...]:
    return dataclasses.fields(cls)


@cache
def _signature(cls: type) -> Signature:
    """Returns the parameters of a class, those by position first."""
    parameters = [
        Parameter(field.name, KINDS[bool(field.kw_only)], default=_shown_default(field), annotation=field.type)
        for field in _fields(cls)
        if field.init
    ]
    return Signature(sorted(parameters, key=lambda parameter: parameter.kind))


def _shown_default(field: "dataclasses.Field[Any]") -> object:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return Parameter.empty if field.default is MISSING else field.default


class _ClassSignature:
    """The signature of a class, made when it is asked for."""

    def __get__(self, _: object, cls: type) -> Signature:
        return _signature(cls)


_SIGNATURE = _ClassSignature()


def _required() -> object:
    """Marks a field without a default, in the place of its factory."""
    return UNSET


@cache
def _parameters(cls: type) -> tuple[list[str], dict[str, object], dict[str, Callable[[], object]]]:
    """Returns the fields of a class that can be set by position; the default of each field, or UNSET; and factories."""
    fields = [field for field in _fields(cls) if field.init]
    positional = [field.name for field in fields if not field.kw_only]
    defaults: dict[str, object] = {}
    factories: dict[str, Callable[[], object]] = {}
    for field in fields:
        defaults[field.name] = UNSET if field.default is MISSING else field.default
        if field.default is MISSING:
            factories[field.name] = _required if field.default_factory is MISSING else field.default_factory
    return positional, defaults, factories


def _initializer(cls: type) -> Callable[..., None]:
    """Returns the method `__init__` of a class."""
    is_checked = hasattr(cls, "__post_init__")

    def __init__(self: Any, /, *arguments: object, **values: object) -> None:  # noqa: N807
        positional, defaults, factories = _parameters(cls)
        if not arguments and values.keys() == defaults.keys():  # as in `replace`
            state = values
        else:
            by_position = dict(zip(positional, arguments, strict=False))
            state = {**defaults, **values, **by_position}
            is_accepted = len(arguments) <= len(positional) and len(state) == len(defaults)
            if not is_accepted or not by_position.keys().isdisjoint(values):
                raise _mistake(cls, arguments, values)

            for name, factory in factories.items():
                if state[name] is UNSET:
                    if factory is _required:
                        raise _mistake(cls, arguments, values)
                    state[name] = factory()
        self.__dict__.update(state)
        if is_checked:
            self.__post_init__()

    return __init__


def _mistake(cls: type, arguments: tuple[object, ...], values: Mapping[str, object]) -> TypeError:
    """Returns the error for arguments that do not match the parameters of a class."""
    names = _parameters(cls)[1]
    for name in values:
        if name not in names:
            from difflib import get_close_matches  # slow to import

            close = get_close_matches(name, names, 1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            return TypeError(f"{cls.__name__}: got an unexpected keyword argument {name!r}{hint}")
    try:
        _signature(cls).bind(*arguments, **values)
    except TypeError as error:
        return TypeError(f"{cls.__name__}: {error}")
    raise AssertionError(cls)


@recursive_repr()
def _repr(self: object) -> str:
    shown = [f"{field.name}={getattr(self, field.name)!r}" for field in _fields(type(self)) if field.repr]
    return f"{type(self).__qualname__}({', '.join(shown)})"


@cache
def _compared(cls: type) -> list[str]:
    return [field.name for field in _fields(cls) if field.compare]


def _values(self: object) -> list[object]:
    """Returns the values by which two objects are equal."""
    state = vars(self)
    return [state[name] for name in _compared(type(self))]


def _equals(self: object, other: object) -> bool:
    return _values(self) == _values(other) if type(other) is type(self) else NotImplemented


def _hash(self: object) -> int:
    return hash(tuple(_values(self)))


def _refuse_assignment(self: object, name: str, value: object) -> None:
    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _refuse_deletion(self: object, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")
