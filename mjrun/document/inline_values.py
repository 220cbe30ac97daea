"""Cameras, ghosts and pushes as mappings, where a run document uses them."""

from collections.abc import Callable, Iterator, Mapping
from typing import Annotated

from pydantic import AfterValidator, Field, Tag

from mjrun.document.camera import CameraDocument
from mjrun.document.document_model import (
    NUMBER,
    TEXT,
    DocumentModel,
    InvalidValueError,
    Location,
    Name,
    Omittable,
    OneOfTexts,
    Vector,
    by_type,
)
from mjrun.document.field_types import Exact, Instant
from mjrun.document.yaml_writer import number
from mjrun.errors import UsageError, quoted
from mjrun.options.kinds import ExpectedError
from mjrun.options.push import Push, PushKind
from mjrun.options.variations import DISTRIBUTIONS
from mjrun.outputs.scene_decorations import MOTIONS, NO_MAP


class InlineCamera(CameraDocument):
    """A camera script written where it is used."""

    name: Name = "script"
    """What captions and files call it."""


class InlineGhost(DocumentModel):
    """The model once more, translucent; it does what the model does, unless key, trace or recording says otherwise."""

    offset: Vector = (0.0, 0.0, 0.0)
    """How far it is displaced [m]."""
    opacity: Omittable[Annotated[float, Field(gt=0, le=1)]] = None
    """How clearly it is seen, 1 being solid."""
    key: Omittable[
        Annotated[
            Annotated[Name, Tag(TEXT)] | Annotated[Annotated[int, Field(ge=0)], Tag(NUMBER)],
            by_type("the name or index of a keyframe", TEXT, NUMBER),
        ]
    ] = None
    """The keyframe in whose pose it stands, by name or index."""
    trace: Omittable[Name] = None
    """A table of positions that it goes through, relative to the folder of this document."""
    map: Omittable[Name] = None
    """A file of lines that say what the columns of that table mean, instead of the map of the simulation; or none."""
    recording: Omittable[Name] = None
    """A recording (.npz) that it goes through, relative to the folder of this document."""

    @classmethod
    def cross_field_errors(cls, values: Mapping[str, object]) -> Iterator[tuple[Location, str]]:
        first, *others = [key for key in MOTIONS if key in values] or [""]
        yield from (((key,), f"{first} and {key} exclude each other: each says what the ghost does") for key in others)
        with_comma = [key for key in (*MOTIONS, "map") if "," in str(values.get(key, ""))]
        yield from (((key,), "what a ghost goes by holds no comma") for key in with_comma)

    def text(self) -> str:
        """The same in one text, as on a command line."""
        offset = "/".join(str(number(value)) for value in self.offset) if any(self.offset) else None
        motions = {"key": self.key, "trace": self.trace, "recording": self.recording}
        settings = {"offset": offset, "opacity": self.opacity, **motions, "map": self.map}
        return ",".join(f"{name}={value}" for name, value in settings.items() if value is not None)


def _written_push(text: str) -> str:
    try:
        PushKind().parse(text)
    except ExpectedError as error:
        raise InvalidValueError("expected", expected=error.expected) from None
    return text


PushText = Annotated[Name, AfterValidator(_written_push)]


class InlinePush(DocumentModel):
    """A force on a body at its centre of mass, or at a site, for a while."""

    body: Omittable[Name] = None
    """The body that is pushed at its centre of mass."""
    site: Omittable[Name] = None
    """The site at which its body is pushed."""
    force: Vector
    """In the world [N]."""
    at: Instant
    """When it begins [s]."""
    duration: Exact
    """How long it lasts [s]."""

    @classmethod
    def cross_field_errors(cls, values: Mapping[str, object]) -> Iterator[tuple[Location, str]]:
        if ("body" in values) == ("site" in values):
            yield ("site",) if "site" in values else (), "a push is on a body or at a site: give one of the two"

    def push(self) -> Push:
        """The same as a value."""
        target = f"site:{self.site}" if self.body is None else f"body:{self.body}"
        return Push(target, self.force, self.at, self.duration)


def ghost_text(ghost: str | InlineGhost, resolved: Callable[[str], str]) -> str:
    """The settings of a ghost in one text, its files `resolved`.

    Raises:
      UsageError: the path of a file holds a comma.
    """
    settings: list[str] = []
    for part in (ghost.text() if isinstance(ghost, InlineGhost) else ghost).split(","):
        name, equals, value = part.partition("=")
        is_path = name in ("trace", "recording") or (name == "map" and value != NO_MAP)
        path = resolved(value) if is_path and value else value
        if "," in path:
            raise UsageError(f"{quoted(path)}: the path of what a ghost goes through holds no comma")
        settings.append(f"{name}{equals}{path}")
    return ",".join(settings)


class InlineSpan(DocumentModel):
    """Values from one number to another, both included."""

    from_: float = Field(alias="from", description="The first value.")
    to: float
    """The last value."""
    count: Annotated[int, Field(ge=2)]
    """How many values."""
    log: bool = False
    """Equal ratios between them instead of equal distances."""


InlineDistribution = Annotated[
    dict[Annotated[str, OneOfTexts(tuple(DISTRIBUTIONS))], list[float | Name]],
    Field(min_length=1, max_length=1, description=f"Random values: {', '.join(DISTRIBUTIONS.values())}."),
]
