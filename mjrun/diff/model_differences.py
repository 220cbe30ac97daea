"""The differences between two models."""

from collections.abc import Sequence

from mjrun.dataclass import dataclass

Value = str | int | float | bool


@dataclass(frozen=True)
class FieldDifference:
    """A difference between two models in one object, or in the whole model.

    Attributes:
      field: MuJoCo's name: `body_mass`, `opt.timestep`. `name` is the name of an object or of the model, `order` the
        order of objects of a kind.
      object: the name of the object, or both names if they differ: `torso`, `torso → trunk`; empty for the whole model.
        For a name, with the kind: `joint knee`.
      components: the components of the field that differ, `slide`; empty if it has one only, or if all differ.
      a, b: the values of these components: numbers, names of objects, MuJoCo's names.
      unit: the unit of the numbers; empty for pure numbers and unknown units.
    """

    field: str
    object: str
    components: tuple[str, ...]
    a: tuple[Value, ...]
    b: tuple[Value, ...]
    unit: str = ""

    @property
    def largest(self) -> float | None:
        """The largest difference of two numbers; None if the values are not numbers."""
        numbers = [(a, b) for a, b in zip(self.a, self.b, strict=False) if not isinstance(a, str | bool)]
        return max((abs(float(b) - float(a)) for a, b in numbers if not isinstance(b, str)), default=None)


@dataclass(frozen=True)
class ArrayDifference:
    """Data of one asset or flex, or of the whole model, that differ between two models.

    Attributes:
      field, object: as for FieldDifference.
      shape_a, shape_b: the shapes of the arrays.
      count: the number of values that differ; None if the shapes do.
      largest: the largest difference of two numbers; None if the shapes differ.
      sha256_a, sha256_b: the hashes of the bytes of the arrays.
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
class DerivedFieldDifference:
    """A field that differs, and that the compiler derives from others.

    Attributes:
      field: MuJoCo's name; `stat` for the statistics.
      objects: the number of objects that differ in it.
      largest: the largest difference of two numbers; None if the values are not numbers, or differ in number.
    """

    field: str
    objects: int
    largest: float | None


@dataclass(frozen=True)
class UnmatchedObject:
    """An object that only one of two models has.

    Attributes:
      kind: `body`, `joint`, `geom`, …
      name: the name of the object; `geom:3` if it has none.
    """

    kind: str
    name: str


@dataclass(frozen=True)
class XmlPlace:
    """A line of a file.

    Attributes:
      file: the model, or a file that it includes or attaches.
      line: the number of the line, counted from 1.
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
      attribute: the attribute that differs; empty if only one model has the element.
      a, b: the values of the attribute as written; None if it is missing.
      place_a, place_b: the places of the elements; None if an element is missing.
    """

    element: str
    attribute: str
    a: str | None
    b: str | None
    place_a: XmlPlace | None
    place_b: XmlPlace | None


@dataclass(frozen=True)
class ModelComparison:
    """The differences between two models, `a` and `b`.

    Attributes:
      a, b: their sources.
      fields: the values that differ.
      arrays: the data of assets, and other long arrays, that differ.
      only_a, only_b: the objects that only one of them has.
      computed: the fields that differ and that the compiler derives from others. If nothing else differs, they are
        among `fields` and `arrays` instead.
      xml: the differences in the source, with lines, if both are XML files.
      warnings: MuJoCo's warnings during compilation.
    """

    a: str
    b: str
    fields: Sequence[FieldDifference]
    arrays: Sequence[ArrayDifference]
    only_a: Sequence[UnmatchedObject]
    only_b: Sequence[UnmatchedObject]
    computed: Sequence[DerivedFieldDifference]
    xml: Sequence[XmlChange]
    warnings: Sequence[str] = ()

    @property
    def equal(self) -> bool:
        """True if both compile to the same model."""
        return not (self.fields or self.arrays or self.only_a or self.only_b)
