"""What can differ between two models."""

from collections.abc import Sequence
from dataclasses import dataclass

Value = str | int | float | bool


@dataclass(frozen=True)
class FieldDifference:
    """What two models say otherwise of one object, or of the whole model.

    Attributes:
      field: MuJoCo's name: `body_mass`, `opt.timestep`. `name` is the name of an object or of the model, `order` the
        order of objects of a kind.
      object: its name, or both where they differ: `torso`, `torso → trunk`; empty of the whole model. With its kind for
        a name: `joint knee`.
      components: of the field that differ, `slide`; empty if it has one only, or if all do.
      a, b: the values of these components: numbers, names of objects, MuJoCo's own words.
      unit: of the numbers; empty for pure ones, and where MuJoCo does not tell.
    """

    field: str
    object: str
    components: tuple[str, ...]
    a: tuple[Value, ...]
    b: tuple[Value, ...]
    unit: str = ""

    @property
    def largest(self) -> float | None:
        """The largest difference of two numbers; None if these are not numbers."""
        numbers = [(a, b) for a, b in zip(self.a, self.b, strict=False) if not isinstance(a, str | bool)]
        return max((abs(float(b) - float(a)) for a, b in numbers if not isinstance(b, str)), default=None)


@dataclass(frozen=True)
class ArrayDifference:
    """Data of one asset or flex, or of the whole model, that differ between two models.

    Attributes:
      field, object: as in FieldDifference.
      shape_a, shape_b: of the arrays.
      count: of the numbers that differ; None where the shapes do.
      largest: difference of two numbers; None where the shapes differ.
      sha256_a, sha256_b: of the bytes of the arrays.
    """

    field: str
    object: str
    shape_a: tuple[int, ...]
    shape_b: tuple[int, ...]
    count: int | None
    largest: float | None
    sha256_a: str
    sha256_b: str


Difference = FieldDifference | ArrayDifference


@dataclass(frozen=True)
class ComputedDifference:
    """A field that differs, and that the compiler works out from others.

    Attributes:
      field: MuJoCo's name; `stat` for the statistics.
      objects: how many differ in it.
      largest: difference of two numbers; None where they are not numbers, or not as many.
    """

    field: str
    objects: int
    largest: float | None


@dataclass(frozen=True)
class ModelObject:
    """An object that one of two models has.

    Attributes:
      kind: `body`, `joint`, `geom`, …
      name: or `geom:3` if it has none.
    """

    kind: str
    name: str


@dataclass(frozen=True)
class XmlPlace:
    """A line of a file.

    Attributes:
      file: the model, or a file that it includes or attaches.
      line: counted from 1.
    """

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass(frozen=True)
class XmlChange:
    """An element or an attribute that differs between two models.

    Attributes:
      element: its start tag with its name, `<geom name="floor">`, or with all its attributes if it has none.
      attribute: that differs; empty if the whole element is in one model only.
      a, b: the values of the attribute as they are written; None where it is not.
      place_a, place_b: of the elements; None where there is none.
    """

    element: str
    attribute: str
    a: str | None
    b: str | None
    place_a: XmlPlace | None
    place_b: XmlPlace | None


@dataclass(frozen=True)
class ModelComparison:
    """What differs between two models, `a` and `b`.

    Attributes:
      a, b: where they come from.
      fields: values that differ.
      arrays: data of assets, and other long arrays, that differ.
      only_a, only_b: objects that one of them has.
      computed: fields that differ and that the compiler works out from others. Where nothing else differs, they are
        among `fields` and `arrays` instead.
      xml: what differs in the source, with lines, where both are XML files.
      warnings: MuJoCo's, from compilation.
    """

    a: str
    b: str
    fields: Sequence[FieldDifference]
    arrays: Sequence[ArrayDifference]
    only_a: Sequence[ModelObject]
    only_b: Sequence[ModelObject]
    computed: Sequence[ComputedDifference]
    xml: Sequence[XmlChange]
    warnings: Sequence[str] = ()

    @property
    def equal(self) -> bool:
        """Whether both compile to the same model."""
        return not (self.fields or self.arrays or self.only_a or self.only_b)
