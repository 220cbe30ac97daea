"""How the settings of a rig are declared: once, for Python, the command line, camera documents and their schema."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Protocol, cast, get_type_hints

# What a setting holds:
#   object: the name of an object, as in `box`, `geom:edge`, `site:tip` or `subtree:torso`
#   place: an object or a point
#   point: three numbers
#   ramp: a number, or one that changes over the shot
#   number, flag, choice: of `choices`
#   records: a list of dataclasses, of the class `record`, whose fields are declared in the same way
Kind = Literal["object", "place", "point", "ramp", "number", "flag", "choice", "records"]

ErrorPath = tuple[str | int, ...]


class Declared(Protocol):
    """A dataclass with declared fields, such as a rig or a waypoint."""

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[ErrorPath, str]]:
        """What is wrong with the combination of values: where, and the sentence.

        Args:
          values: by key, as they are written in a document, of any type; those of records are mappings too.
        """
        ...


@dataclass(frozen=True)
class Setting:
    """The declaration of a field of a rig, which stands in its annotation: `lookat: Annotated[Place, Setting(…)]`.

    Attributes:
      kind: what the field holds.
      help: one sentence, with the unit in brackets.
      key: its name for users, where that cannot be the field's.
      choices: the valid names.
      positive: whether numbers must be greater than 0; `unit` is how an error counts them, as in `metres`.
      least: that a number must not fall below.
      record: the class of the items of a list, and `length`, the fewest of them.
    """

    kind: Kind
    help: str
    key: str = ""
    choices: tuple[str, ...] = ()
    positive: bool = False
    unit: str = ""
    least: float | None = None
    record: type | None = None
    length: int = 0


@dataclass(frozen=True)
class DeclaredField:
    """A field of a dataclass with its declaration.

    Attributes:
      name: of the field.
      key: its name for users.
      default: of the field; `dataclasses.MISSING` if it is required.
    """

    name: str
    key: str
    setting: Setting
    default: object

    @property
    def required(self) -> bool:
        """Whether there is no default."""
        return self.default is dataclasses.MISSING


@lru_cache
def declared_fields(kind: type) -> tuple[DeclaredField, ...]:
    """The declared fields of a dataclass, in order."""
    hints = get_type_hints(kind, include_extras=True)
    fields = []
    for field in dataclasses.fields(kind):
        for setting in getattr(hints[field.name], "__metadata__", ()):
            if isinstance(setting, Setting):
                fields.append(DeclaredField(field.name, setting.key or field.name, setting, field.default))
    return tuple(fields)


def written_values(declared: Declared) -> dict[str, object]:
    """Returns the fields that differ from their defaults, by key, as a document holds them."""
    values: dict[str, object] = {}
    for field in declared_fields(type(declared)):
        value = getattr(declared, field.name)
        if value is field.default or (type(value) is type(field.default) and value == field.default):
            continue
        if field.setting.kind == "records":
            value = [written_values(record) for record in cast("Iterable[Declared]", value)]
        values[field.key] = value
    return values
