"""The forms that documents have: pydantic models that refuse what is not theirs and tell every error at once."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    Strict,
    ValidationError,
    model_validator,
)

if TYPE_CHECKING:
    from typing import Optional as Maybe
else:

    class Maybe:
        """What may be left out, and is None then. None that is written is refused."""

        def __class_getitem__(cls, kind: Any) -> Any:
            return kind


# Tags of the kinds of values. No key of a document begins with a control character, so they cannot be taken for one.
NUMBER, TEXT, LIST, MAPPING = "\0number", "\0text", "\0list", "\0mapping"
KINDS = {int: NUMBER, float: NUMBER, str: TEXT, list: LIST, dict: MAPPING}

FEW = 6  # keys that a message names beside another fault

Loc = tuple[str | int, ...]


class ComplaintError(ValueError):
    """What is wrong with a value: the `kind` of error and its `facts`, as pydantic has them or our forms."""

    def __init__(self, kind: str, **facts: Any) -> None:
        self.kind, self.facts = kind, facts
        super().__init__(kind)

    @classmethod
    def saying(cls, message: str) -> "ComplaintError":
        """One whose sentence is known."""
        return cls("said", message=message)

    @classmethod
    def of(cls, details: Mapping[str, Any], keys: Iterable[str]) -> "ComplaintError":
        """The one in pydantic's `details`, from a form with `keys`."""
        facts = dict(details.get("ctx", {}))
        error = facts.get("error")
        if isinstance(error, ComplaintError):
            return error
        if error is not None:
            return cls.saying(str(error))
        return cls(details["type"], said=details["msg"], keys=tuple(keys), **facts)


class DocumentModel(BaseModel):
    """A mapping in a document: no keys but these, numbers are numbers and finite."""

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )

    @classmethod
    def complaints(cls, given: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
        """What is wrong with the mapping beyond its single values: where in it, and the sentence.

        The values are as they are written, of any type.
        """
        return iter(())

    @classmethod
    def key_names(cls) -> list[str]:
        """The keys that the mapping may have."""
        return [field.alias or name for name, field in cls.model_fields.items()]

    @model_validator(mode="wrap")
    @classmethod
    def _tell_all(cls, given: Any, handler: ModelWrapValidatorHandler["DocumentModel"]) -> "DocumentModel":
        if isinstance(given, cls):
            return handler(given)
        if not isinstance(given, dict):
            few = f" with {', '.join(cls.key_names())}" if len(cls.key_names()) <= FEW else ""
            raise ComplaintError("kind", expected=f"a mapping{few}")
        found = [(loc, ComplaintError.saying(message)) for loc, message in cls.complaints(given)]
        try:
            made = handler(given)
        except ValidationError as error:
            details = error.errors(include_url=False, include_input=False)
            found += [(each["loc"], ComplaintError.of(each, cls.key_names())) for each in details]
        else:
            if not found:
                return made
        lines: list[Any] = [{"type": "value_error", "loc": loc, "ctx": {"error": c}, "input": None} for loc, c in found]
        raise ValidationError.from_exception_data(cls.__name__, lines)


class _Kinds(Discriminator):
    """A discriminator that may stand in unions, whose members are hashed; pydantic's holds a dict."""

    def __hash__(self) -> int:
        return id(self)


def kinds(expected: str, *taken: str) -> Discriminator:
    """Tells the values of a union apart by their kind in the document; a kind that is not `taken` is not `expected`."""

    def tag(value: Any) -> str | None:
        kind = KINDS.get(type(value))
        return kind if kind in taken else None

    context: dict[str, int | str | float] = {"expected": expected}
    return _Kinds(tag, custom_error_type="kind", custom_error_message="{expected}", custom_error_context=context)


@dataclass(frozen=True)
class Among:
    """One of these texts, in `Annotated[str, Among(…)]`."""

    names: tuple[str, ...]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return handler.generate_schema(Literal.__getitem__(self.names))  # type: ignore[attr-defined]


def items(count: int, what: str) -> Callable[[Any], Any]:
    """Refuses lists of other than `count` items, which are `what`."""

    def checked(value: Any) -> Any:
        if isinstance(value, list) and len(value) != count:
            raise ComplaintError.saying(f"expected {count} {what}, got {len(value) or 'none'}")
        return value

    return checked


def given_nothing(value: Any) -> Any:
    """`key:` alone is the mapping of defaults."""
    return {} if value is None else value


Positive = Annotated[float, Field(gt=0)]
Name = Annotated[str, Field(min_length=1)]
Vector = Annotated[tuple[float, float, float], Strict(False), BeforeValidator(items(3, "numbers"))]
