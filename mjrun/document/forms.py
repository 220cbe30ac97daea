"""How documents write values of kinds that rooms above `options` know: cameras, ghosts, instants, names of MuJoCo."""

from collections.abc import Callable, Iterator, Mapping
from typing import cast

from mjrun.camera.script import CameraScript, InlineCamera, InstantOrEvent
from mjrun.document.camera import read_camera
from mjrun.document.output_folder import Folders
from mjrun.document.yaml_writer import number
from mjrun.errors import DocumentError, UsageError, quoted
from mjrun.options import kinds, number_kinds
from mjrun.options.kinds import AnyKind, Key, Optional, Reader, Text
from mjrun.options.number_kinds import Integer, Point, Real, Vector
from mjrun.options.option import Options, option, options
from mjrun.options.record import OneOf, Record
from mjrun.options.schema import TEXT, Path, Schema, check
from mjrun.options.view import GHOST_MOTIONS, NO_MAP
from mjrun.suffixes import is_yaml


class KnownName(Text):
    """A name that MuJoCo knows, such as a visual flag."""

    def __init__(self, of: str) -> None:
        super().__init__()
        self._of = of

    @property
    def form(self) -> Schema:
        from mjrun.rendering.segmentation import groupings
        from mjrun.rendering.visual import flags, frames, labels

        names = {"visual flag": flags, "segmentation": lambda: [*groupings()], "frame": frames, "label": labels}
        return {"type": "string", "enum": names[self._of]()}

    def read(self, value: object, reader: Reader) -> object:
        from mjrun.outputs.view_settings import check_segmentation_name
        from mjrun.rendering.visual import Visual

        check(value, TEXT)
        name = str(value)
        match self._of:
            case "visual flag":
                Visual(show=[name])
            case "frame":
                Visual(frame=name)
            case "label":
                Visual(label=name)
            case _:
                check_segmentation_name(name)
        return value


BROKEN = "free"  # stands for a camera document that is reported already


class CameraForm(OneOf[object, object]):
    """A camera as text, which may be the file of a camera document, by index, or as a document of shots."""

    def __init__(self) -> None:
        forms = "a camera as text, by index, or as {name, speed, shots}"
        super().__init__(forms, string=Text(), number=Integer(), object=Record(InlineCamera, _inline_script))

    def read(self, value: object, reader: Reader) -> object:
        camera = super().read(value, reader)
        if not isinstance(camera, str) or not is_yaml(camera):
            return camera
        try:
            return read_camera(reader.input(camera))
        except DocumentError as error:
            reader.problems.extend(error.problems)
            return BROKEN


def _inline_script(**values: object) -> CameraScript:
    camera = cast("Callable[..., InlineCamera]", InlineCamera)(**values)
    return camera.script(camera.name)


@options
class InlineGhost(Options):
    """The model once more, translucent; it does what the model does, unless key, trace or recording says otherwise."""

    offset: Vector = option(converter=Point(), default=(0.0, 0.0, 0.0), help="How far it is displaced [m].")
    opacity: float | None = option(
        converter=Optional(Real(above=0, most=1)), default=None, help="How clearly it is seen, 1 being solid."
    )
    key: str | None = option(
        converter=Optional(Key()), default=None, help="The keyframe in whose pose it stands, by name or index."
    )
    trace: str | None = option(
        converter=Optional(Text()),
        default=None,
        help="A table of positions that it goes through, relative to the folder of this document.",
    )
    map: str | None = option(
        converter=Optional(Text()),
        default=None,
        help="A file of lines that say what the columns of that table mean, instead of the map of the simulation; or "
        "none.",
    )
    recording: str | None = option(
        converter=Optional(Text()),
        default=None,
        help="A recording (.npz) that it goes through, relative to the folder of this document.",
    )

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        first, *others = [key for key in GHOST_MOTIONS if key in values] or [""]
        yield from (((key,), f"{first} and {key} exclude each other: each says what the ghost does") for key in others)
        with_comma = [key for key in (*GHOST_MOTIONS, "map") if "," in str(values.get(key, ""))]
        yield from (((key,), "what a ghost goes by holds no comma") for key in with_comma)

    def text(self) -> str:
        """The same in one text, as on a command line."""
        offset = "/".join(str(number(value)) for value in self.offset) if any(self.offset) else None
        motions = {"key": self.key, "trace": self.trace, "recording": self.recording}
        settings = {"offset": offset, "opacity": self.opacity, **motions, "map": self.map}
        return ",".join(f"{name}={value}" for name, value in settings.items() if value is not None)


class GhostText(Text):
    """The settings of a ghost as text."""

    @property
    def form(self) -> Schema:
        return {"type": "string"}


class GhostForm(OneOf[object, object]):
    """A ghost as text or as a mapping; its files are relative to the document."""

    def __init__(self) -> None:
        def text(**values: object) -> str:
            return cast("Callable[..., InlineGhost]", InlineGhost)(**values).text()

        forms = "text as in offset=0/1/0,opacity=0.3 or {offset, opacity, key, trace, map, recording}"
        super().__init__(forms, string=GhostText(), object=Record(InlineGhost, text))

    def read(self, value: object, reader: Reader) -> object:
        return ghost_text(str(super().read(value, reader)), reader.input)


def ghost_text(text: str, resolved: Callable[[str], str]) -> str:
    """The settings of a ghost in one text, its files `resolved`.

    Raises:
      UsageError: the path of a file holds a comma.
    """
    settings: list[str] = []
    for part in text.split(","):
        name, equals, value = part.partition("=")
        is_path = name in ("trace", "recording") or (name == "map" and value != NO_MAP)
        path = resolved(value) if is_path and value else value
        if "," in path:
            raise UsageError(f"{quoted(path)}: the path of what a ghost goes through holds no comma")
        settings.append(f"{name}{equals}{path}")
    return ",".join(settings)


FORMS: dict[type[AnyKind], AnyKind] = {
    kinds.Camera: CameraForm(),
    kinds.Ghost: GhostForm(),
    number_kinds.Instant: InstantOrEvent(zero=True),
}


class DocumentReader(Folders):
    """Where the paths of a document lead, and how it writes values."""

    def form(self, kind: AnyKind) -> AnyKind:
        if isinstance(kind, kinds.MujocoName):
            return KnownName(kind.of)
        return FORMS.get(type(kind), kind)
