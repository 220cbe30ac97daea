"""From declared options to the models of run documents, and from what a document holds to the options' values."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Annotated, ClassVar, Literal, cast

from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator, Strict, Tag

from mjrun.document.camera import Event, read_camera
from mjrun.document.document_model import (
    LIST,
    MAPPING,
    NUMBER,
    TEXT,
    DocumentModel,
    InvalidValueError,
    Key,
    Location,
    Name,
    Omittable,
    OneOfTexts,
    by_type,
    model_with_keys,
    of_length,
)
from mjrun.document.field_types import (
    Exact,
    Instant,
    Numbers,
    OutputPath,
    Several,
    Size,
    as_tuple,
    checked_by,
    suggested,
)
from mjrun.document.inline_values import (
    InlineCamera,
    InlineDistribution,
    InlineGhost,
    InlinePush,
    InlineSpan,
    PushText,
    ghost_text,
)
from mjrun.document.output_folder import Folders
from mjrun.errors import BadValueError, concerning, option
from mjrun.formats.format_lists import with_formats
from mjrun.options import kinds as option_kinds
from mjrun.options.diff import ColumnTolerances
from mjrun.options.evaluation import Thresholds
from mjrun.options.kinds import AnyKind, ExpectedError, setting_text
from mjrun.options.option import (
    Exclusion,
    Option,
    Options,
    document_options,
    exclusions_of,
    is_always_written,
    options_of,
)
from mjrun.options.policy import NONE, NormalizationKind, PolicyKind, is_code, is_policy_file
from mjrun.options.push import PushKind
from mjrun.options.task import Limits, RandomValue, Schedule, VectorOrKey
from mjrun.options.variations import Variations, with_paths
from mjrun.outputs.view_settings import check_segmentation_name
from mjrun.rendering.segmentation import groupings
from mjrun.rendering.visual import Visual, flags, frames, labels
from mjrun.suffixes import is_yaml

# The names of a kind that there are, for editors, and what refuses others.
NAMES: dict[str, tuple[Callable[[], list[str]], Callable[[str], object]]] = {
    "visual flag": (flags, lambda name: Visual(show=[name])),
    "segmentation": (lambda: [*groupings()], check_segmentation_name),
    "frame": (frames, lambda name: Visual(frame=name)),
    "label": (labels, lambda name: Visual(label=name)),
}


def _setting(value: object) -> str:
    try:
        return setting_text(value)
    except ExpectedError as error:
        raise InvalidValueError("expected", expected=error.expected) from None


NonNegativeInteger = Annotated[int, Field(ge=0)]
ExpressionText = Annotated[
    Annotated[Name, Tag(TEXT)] | Annotated[float, Tag(NUMBER)], by_type("an expression or a number", TEXT, NUMBER)
]


def _variation(value: object) -> str:
    try:
        return Variations().text(value)
    except ExpectedError as error:
        raise InvalidValueError("expected", expected=error.expected) from None


def _no_code(text: str) -> str:
    if is_code(text):
        raise InvalidValueError.with_message("code stays on the command line; a document cannot name it")
    return text


VariationText = Annotated[
    str,
    PlainValidator(
        _variation,
        json_schema_input_type=float
        | Name
        | bool
        | list[float | Name | bool | list[float]]
        | InlineSpan
        | InlineDistribution,
    ),
]
SettingText = Annotated[str, PlainValidator(_setting, json_schema_input_type=float | Name | bool | list[float])]


def _random_text(value: object) -> str:
    try:
        return RandomValue()(cast("str", value))
    except ExpectedError as error:
        raise InvalidValueError("expected", expected=error.expected) from None


RandomText = Annotated[str, PlainValidator(_random_text, json_schema_input_type=float | Name | InlineDistribution)]


class OptionsModel(DocumentModel):
    """A mapping whose keys are declared options."""

    declared: ClassVar[type[Options]] = Options

    @classmethod
    def cross_field_errors(cls, values: Mapping[str, object]) -> Iterator[tuple[Location, str]]:
        for exclusion in exclusions_of(cls.declared):
            if exclusion.applies(_condition(cls.declared, exclusion, values)) and all(
                _is_set(values.get(name)) for name in exclusion.names
            ):
                yield (exclusion.names[1],), exclusion.message(str)


def options_model(
    declared: type[Options],
    *,
    base: type[OptionsModel] = OptionsModel,
    name: str = "",
    first: Mapping[str, Key] | None = None,
    last: Mapping[str, Key] | None = None,
) -> type[OptionsModel]:
    """The model of a mapping with the options that `declared` declares.

    Args:
      first, last: fields before and after those, as pydantic's `create_model` takes them.
    """
    keys = {**(first or {}), **option_keys(declared), **(last or {})}
    model = model_with_keys(name or declared.__name__, base, keys, declared.__doc__)
    model.declared = declared
    return model


def option_keys(declared: type[Options], may_lack: Sequence[str] = ()) -> dict[str, Key]:
    """A key for each of the options that documents know; those in `may_lack` may be left out though they are needed."""
    return {each.attribute: _field(each, each.name in may_lack) for each in document_options(declared)}


def _condition(declared: type[Options], exclusion: Exclusion, values: Mapping[str, object]) -> object:
    """The value of the option that an exclusion depends on."""
    name = exclusion.when[0] if exclusion.when else ""
    defaults = {each.name: each.default for each in options_of(declared)}
    return values.get(name, defaults.get(name))


def _is_set(value: object) -> bool:
    """Whether a key is set to something: `separate: false` is not."""
    return value is not None and value is not False and value != []


def _field(each: Option, may_lack: bool = False) -> Key:
    """Type and default of a key."""
    annotation = field_type(each.kind)
    text = with_formats(each.help) + (f" If left out: {each.usual}." if each.usual else "")
    alias = each.key if each.key != each.attribute else None
    if is_always_written(each) and not may_lack:
        return annotation, Field(alias=alias, description=with_formats(each.help))
    default = None if each.default is None or each.is_required else _default(each)
    return annotation, Field(default, alias=alias, description=text)


def _default(each: Option) -> object:
    plain = each.kind.plain(each.default)
    return float(plain) if isinstance(plain, Fraction) else plain


def field_type(kind: AnyKind) -> object:
    """The type of a key whose values are of a kind."""
    match kind:
        case option_kinds.Optional(each=each):
            return Omittable[field_type(each)]
        case option_kinds.Several(each=each):
            return Several[field_type(each)]
        case option_kinds.MujocoName(of=of):
            names, check = NAMES[of]
            return Annotated[Name, checked_by(check), suggested(names())]
        case option_kinds.Choice(names=names):
            return Annotated[str, OneOfTexts(names)]
        case option_kinds.Integer(least=least, most=most):
            bounds = Field(gt=0, le=most) if least == 1 else Field(ge=least, le=most)
            return Annotated[int, bounds]
        case option_kinds.Real(least=least, above=above, most=most):
            return Annotated[float, Field(ge=least if above is None else None, gt=above, le=most)]
        case option_kinds.ExactNumber(zero=zero):
            return Instant if zero else Exact
        case option_kinds.File(written=written):
            return OutputPath if written else Name
        case option_kinds.Key(expected=expected):
            return Annotated[
                Annotated[Name, Tag(TEXT)] | Annotated[NonNegativeInteger, Tag(NUMBER)], by_type(expected, TEXT, NUMBER)
            ]
        case _:
            return FIELD_TYPES[type(kind)]


FIELD_TYPES: dict[type[AnyKind], object] = {
    option_kinds.Text: Name,
    option_kinds.Flag: bool,
    option_kinds.Size: Size,
    option_kinds.Range: Annotated[tuple[float, float], Strict(False), BeforeValidator(of_length(2, "numbers"))],
    option_kinds.Values: dict[str, Numbers],
    ColumnTolerances: dict[str, Numbers],
    Thresholds: dict[str, float],
    option_kinds.Settings: dict[str, SettingText],
    Variations: dict[str, VariationText],
    option_kinds.NumberVector: Numbers,
    RandomValue: RandomText,
    Limits: Annotated[list[Numbers], Field(min_length=2, max_length=2)],
    VectorOrKey: Annotated[
        Annotated[float, Tag(NUMBER)]
        | Annotated[list[float], Field(min_length=1), Tag(LIST)]
        | Annotated[Name, Tag(TEXT)],
        by_type("a number, a list of numbers, or the name of a keyframe", NUMBER, LIST, TEXT),
    ],
    Schedule: list[
        Annotated[tuple[Instant, Numbers], Strict(False), BeforeValidator(of_length(2, "entries: a time and values"))]
    ],
    option_kinds.ColumnMap: Annotated[
        Annotated[Name, Tag(TEXT)]
        | Annotated[list[Name], Tag(LIST)]
        | Annotated[dict[str, ExpressionText], Field(description="Expressions by column."), Tag(MAPPING)],
        by_type("a mapping of columns to expressions, a list of COLUMN=EXPRESSION, or @FILE", TEXT, LIST, MAPPING),
    ],
    option_kinds.Processes: Annotated[
        Annotated[Annotated[int, Field(gt=0)], Tag(NUMBER)] | Annotated[Literal["auto"], Tag(TEXT)],
        by_type("a number of processes, or auto", NUMBER, TEXT),
    ],
    option_kinds.Groups: Annotated[
        Annotated[list[Annotated[int, Field(ge=0, le=option_kinds.GROUPS[-1])]], Tag(LIST)]
        | Annotated[Literal["all", "none"], Tag(TEXT)],
        by_type("a list of groups from 0 to 5, all or none", LIST, TEXT),
    ],
    option_kinds.Instant: Annotated[
        Annotated[Instant, Tag(NUMBER)] | Annotated[Instant, Tag(TEXT)] | Annotated[Event, Tag(MAPPING)],
        by_type("a time [s] or {when, nth, offset, else}", NUMBER, TEXT, MAPPING),
    ],
    PolicyKind: Annotated[Name, AfterValidator(_no_code)],
    NormalizationKind: Name,
    option_kinds.Camera: Annotated[
        Annotated[Name, Tag(TEXT)] | Annotated[NonNegativeInteger, Tag(NUMBER)] | Annotated[InlineCamera, Tag(MAPPING)],
        by_type("a camera as text, by index, or as {name, speed, shots}", TEXT, NUMBER, MAPPING),
    ],
    option_kinds.Ghost: Annotated[
        Annotated[str, Tag(TEXT)] | Annotated[InlineGhost, Tag(MAPPING)],
        by_type("text as in offset=0/1/0,opacity=0.3 or {offset, opacity, key, trace, map, recording}", TEXT, MAPPING),
    ],
    PushKind: Annotated[
        Annotated[PushText, Tag(TEXT)] | Annotated[InlinePush, Tag(MAPPING)],
        by_type("text as in torso=0/100/0@1+0.2 or {body or site, force, at, duration}", TEXT, MAPPING),
    ],
}


def option_value(each: Option, value: object, folders: Folders) -> object:
    """The value of an option, from what the document holds.

    Raises:
      UsageError: an output outside its folder, or a mistake in a document that this one names.
      FileError: such a document cannot be read.
    """
    with concerning(each.name):
        return _converted(each.kind, value, folders)


def _converted(kind: AnyKind, value: object, folders: Folders) -> object:
    match kind, value:
        case option_kinds.Optional(each=each), _:
            return _converted(each, value, folders)
        case option_kinds.Several(each=each), _:
            parts: list[object] = []
            for index, part in enumerate(as_tuple(value)):
                with concerning(index):
                    parts.append(_converted(each, part, folders))
            return tuple(parts)
        case option_kinds.File(written=written), str(path):
            return folders.outputs.path(path) if written else folders.input(path)
        case PolicyKind(), str(text):
            return folders.input(text) if is_policy_file(text) else text
        case NormalizationKind(), str(text):
            return text if text == NONE else folders.input(text)
        case option_kinds.Ghost(), str() | InlineGhost() as ghost:
            return ghost_text(ghost, folders.input)
        case PushKind(), InlinePush() as push:
            return push.push()
        case PushKind(), str(text):
            return kind.parse(text)
        case Variations(), dict():
            texts = cast("dict[str, str]", value)
            ways = {"model": folders.model, "ctrl_from": folders.input}
            return {path: with_paths(text, ways[path]) if path in ways else text for path, text in texts.items()}
        case option_kinds.ColumnMap(), _:
            return _map_texts(kind, value, folders)
        case option_kinds.Camera(), InlineCamera() as camera:
            return camera.script(camera.name)
        case option_kinds.Camera(), str(text) if is_yaml(text):
            return read_camera(folders.input(text))
        case option_kinds.Instant(), Event() as event:
            return event.event()
        case _:
            return value


def _map_texts(kind: option_kinds.ColumnMap, value: object, folders: Folders) -> tuple[str, ...]:
    """The texts of a map, its files as they are from here."""
    try:
        texts = kind(cast("str | dict[str, object] | list[str]", value))
    except ExpectedError as error:
        raise BadValueError(option("map"), value if error.part is None else error.part, error.expected) from None
    return tuple(f"@{folders.input(text[1:])}" if text.startswith("@") else text for text in texts)
