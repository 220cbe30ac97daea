"""The rigs of a camera document: models that are derived from the declarations of `camera.rigs`."""

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Annotated, ClassVar, cast

from pydantic import AfterValidator, BeforeValidator, Field, Tag

from mjrun.camera.easing import EASINGS, Ramp
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.registry import RIGS
from mjrun.camera.rigs.settings import Declared, Setting, declared_fields
from mjrun.document.document_model import (
    LIST,
    MAPPING,
    NUMBER,
    TEXT,
    DocumentModel,
    Key,
    Location,
    Name,
    OneOfTexts,
    Positive,
    Vector,
    by_type,
    empty_if_null,
    model_with_keys,
)

Ease = Annotated[str, OneOfTexts(tuple(EASINGS))]
Place = Annotated[
    Annotated[Name, Tag(TEXT)] | Annotated[Vector, Tag(LIST)],
    by_type("an object's name or a point [x, y, z]", TEXT, LIST),
]
NUMBER_OR_RAMP = "a number or {from, to, ease}"


class RampModel(DocumentModel):
    """A number that changes over the shot."""

    start: float = Field(alias="from")
    """At the beginning of the shot."""
    end: float = Field(alias="to")
    """At the end of the shot."""
    ease: Ease = "linear"
    """How it goes from one to the other."""


class PositiveRampModel(RampModel):
    """A positive number that changes over the shot."""

    start: Positive = Field(alias="from")
    """At the beginning of the shot."""
    end: Positive = Field(alias="to")
    """At the end of the shot."""


NumberOrRamp = Annotated[
    Annotated[float, Tag(NUMBER)] | Annotated[RampModel, Tag(MAPPING)], by_type(NUMBER_OR_RAMP, NUMBER, MAPPING)
]
PositiveNumberOrRamp = Annotated[
    Annotated[Positive, Tag(NUMBER)] | Annotated[PositiveRampModel, Tag(MAPPING)],
    by_type(NUMBER_OR_RAMP, NUMBER, MAPPING),
]


def ramp(value: float | RampModel) -> Ramp:
    """A number that changes over the shot, or does not."""
    if isinstance(value, RampModel):
        return Ramp(value.start, value.end, value.ease)
    return Ramp.still(value)


def optional_ramp(value: float | RampModel | None) -> Ramp | None:
    """The same of a number that may be left out."""
    return None if value is None else ramp(value)


class DeclaredModel(DocumentModel):
    """A mapping that holds the declared fields of a dataclass."""

    declared: ClassVar[type[Declared]]

    @classmethod
    def cross_field_errors(cls, values: Mapping[str, object]) -> Iterator[tuple[Location, str]]:
        return cls.declared.conflicts(values)

    def value(self) -> Declared:
        """The dataclass."""
        make = cast("Callable[..., Declared]", self.declared)
        return make(**{name: _field_value(value) for name, value in self})


def _field_value(value: object) -> object:
    """What a field of the dataclass holds for the value of a model's."""
    match value:
        case DeclaredModel():
            return value.value()
        case list():
            return [_field_value(item) for item in cast("list[object]", value)]
        case _:
            return value


@cache
def declared_model(declared: type[Declared]) -> type[DeclaredModel]:
    """The model of a dataclass with declared fields; its docstring is the description."""
    fields: dict[str, Key] = {}
    for field in declared_fields(declared):
        alias = field.key if field.key != field.name else None
        default = ... if field.required else field.default
        fields[field.name] = (_annotation(field.setting), Field(default, alias=alias, description=field.setting.help))
    name = declared.__name__.removesuffix("Rig")
    model = model_with_keys(name, DeclaredModel, fields, declared.__doc__)
    model.declared = declared
    return model


def _annotation(setting: Setting) -> object:
    """The type of a setting in a document."""
    match setting.kind:
        case "object":
            return Name
        case "place":
            return Place
        case "point":
            return Vector
        case "ramp":
            return Annotated[PositiveNumberOrRamp if setting.positive else NumberOrRamp, AfterValidator(ramp)]
        case "number":
            return Annotated[float, Field(gt=0 if setting.positive else None, ge=setting.least)]
        case "flag":
            return bool
        case "choice":
            return Annotated[str, OneOfTexts(setting.choices)]
        case "records":
            assert setting.record
            return Annotated[list[declared_model(setting.record)], Field(min_length=setting.length)]


def rig_fields() -> dict[str, Key]:
    """The fields of a shot that hold its rig, for `pydantic.create_model`; a camera of the model is not a mapping."""
    fields: dict[str, Key] = {}
    for kind, rig in RIGS.items():
        if rig is not ModelRig:
            model: object = declared_model(rig)
            if not any(field.required for field in declared_fields(rig)):
                model = Annotated[model, BeforeValidator(empty_if_null, json_schema_input_type=model | None)]
            fields[kind] = (model, Field(None, description=rig.help))
    return fields
