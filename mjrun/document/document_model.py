"""The base of all models of documents: they refuse unknown keys, and report every error at once."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, cast

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    Strict,
    ValidationError,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema, ErrorDetails, InitErrorDetails

from mjrun.errors import quoted
from mjrun.suffixes import MODELS

if TYPE_CHECKING:
    from typing import Optional as Omittable  # pyright: ignore[reportUnusedImport]
else:

    class Omittable:
        """The type of a key that may be left out, and is None then. A None that is written is refused."""

        def __class_getitem__(cls, annotation: object) -> object:
            return annotation


# Tags of the types of values. No key of a document begins with a control character, so that no tag is taken for one.
NUMBER, TEXT, LIST, MAPPING = "\0number", "\0text", "\0list", "\0mapping"
TAGS: dict[type, str] = {int: NUMBER, float: NUMBER, str: TEXT, list: LIST, dict: MAPPING}

MODEL = (  # the description of the key `model`
    f"The model: a file ({', '.join(MODELS)}), relative to the folder of this document, or another source such as "
    "scene:dominos."
)

LISTED_KEYS = 6  # at most, in a message about something else

Location = tuple[str | int, ...]
Key = tuple[object, object]  # the type of a key of a mapping, and what pydantic's `Field` says of it
Model = TypeVar("Model", bound="DocumentModel")


class InvalidValueError(ValueError):
    """A value that does not fit.

    Attributes:
      type: of the error: one of pydantic's; `expected`, with that in the context; or `message`, likewise.
      keys: those that the mapping may have.
      context: what the message is made of.
    """

    def __init__(self, type: str, keys: Iterable[str] = (), **context: object) -> None:  # noqa: A002
        self.type, self.keys, self.context = type, tuple(keys), context
        super().__init__(type)

    @classmethod
    def with_message(cls, message: str) -> "InvalidValueError":
        """An error whose message is known."""
        return cls("message", message=message)

    @classmethod
    def from_details(cls, details: ErrorDetails, keys: Iterable[str]) -> "InvalidValueError":
        """The error in pydantic's `details`, from a model with `keys`."""
        context = dict(details.get("ctx", {}))
        error = context.get("error")
        if isinstance(error, InvalidValueError):
            return error
        if error is not None:
            return cls.with_message(str(error))
        return cls(details["type"], keys, msg=details["msg"], **context)


class DocumentModel(BaseModel):
    """A mapping in a document: no keys but these, numbers are numbers and finite."""

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )

    @classmethod
    def cross_field_errors(cls, values: Mapping[str, object]) -> Iterator[tuple[Location, str]]:
        """What is wrong with values that are right by themselves: the location, and the message.

        Args:
          values: by key, as they are written, of any type.
        """
        return iter(())

    @classmethod
    def key_names(cls) -> list[str]:
        """The keys that the mapping may have."""
        return [field.alias or name for name, field in cls.model_fields.items()]

    @model_validator(mode="wrap")
    @classmethod
    def _collect_errors(cls, value: object, handler: ModelWrapValidatorHandler["DocumentModel"]) -> "DocumentModel":
        if isinstance(value, cls):
            return handler(value)
        if not isinstance(value, dict):
            keys = cls.key_names()
            few = f" with {', '.join(keys)}" if len(keys) <= LISTED_KEYS else ""
            raise InvalidValueError("expected", expected=f"a mapping{few}")

        values = cast("dict[str, object]", value)
        errors = [(loc, InvalidValueError.with_message(message)) for loc, message in cls.cross_field_errors(values)]
        try:
            model = handler(value)
        except ValidationError as error:
            for details in error.errors(include_url=False, include_input=False):
                errors.append((details["loc"], InvalidValueError.from_details(details, cls.key_names())))
        else:
            if not errors:
                return model
        lines: list[InitErrorDetails] = [
            {"type": "value_error", "loc": loc, "ctx": {"error": error}, "input": None} for loc, error in errors
        ]
        raise ValidationError.from_exception_data(cls.__name__, lines)


def model_with_keys(name: str, base: type[Model], keys: Mapping[str, Key], description: str | None) -> type[Model]:
    """A model of mappings with `keys`, besides those of `base`."""
    fields: dict[str, Any] = {**keys}
    return create_model(name, __base__=base, __doc__=description, **fields)


class _HashableDiscriminator(Discriminator):
    """A discriminator that may stand in unions, whose members are hashed; pydantic's holds a dict."""

    def __hash__(self) -> int:
        return id(self)


def by_type(expected: str, *tags: str) -> Discriminator:
    """Tells the members of a union apart by the type of the value; a type without one of `tags` is not `expected`."""

    def tag(value: object) -> str | None:
        name = TAGS.get(type(value))
        return name if name in tags else None

    context: dict[str, int | str | float] = {"expected": expected}
    return _HashableDiscriminator(
        tag, custom_error_type="expected", custom_error_message="{expected}", custom_error_context=context
    )


@dataclass(frozen=True)
class OneOfTexts:
    """One of these texts, in `Annotated[str, OneOfTexts(…)]`."""

    names: tuple[str, ...]

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return handler.generate_schema(Literal.__getitem__(self.names))  # type: ignore[attr-defined]


def of_length(count: int, what: str) -> Callable[[object], object]:
    """A validator that refuses lists of other than `count` items, which are `what`."""

    def validate(value: object) -> object:
        length = len(cast("list[object]", value)) if isinstance(value, list) else count
        if length != count:
            raise InvalidValueError.with_message(f"expected {count} {what}, got {length or 'none'}")
        return cast("object", value)

    return validate


def empty_if_null(value: object) -> object:
    """`key:` alone is an empty mapping, all of whose keys have their defaults."""
    return {} if value is None else value


def _without_null(text: str) -> str:
    if "\0" in text:
        raise InvalidValueError.with_message(f"{quoted(text)} holds a character that no name or path has")
    return text


Positive = Annotated[float, Field(gt=0)]
Name = Annotated[str, Field(min_length=1), AfterValidator(_without_null)]
Vector = Annotated[tuple[float, float, float], Strict(False), BeforeValidator(of_length(3, "numbers"))]
