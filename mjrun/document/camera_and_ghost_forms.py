"""The camera document, and document forms of ghosts, instants and MuJoCo's names.

A camera document has shots in time, each a rig, with cuts, blends and events:

```yaml
speed: 0.25
shots:
  - orbit: {lookat: floor, distance: 0.9, azimuth: {from: 140, to: 240, ease: cosine}, elevation: -30}
    until: {when: speed(box) > 0.02}
  - track: {target: box, distance: 0.08, azimuth: 280, elevation: -10}
    blend: {shape: sigmoid, width: 0.3}
```
"""

import pathlib
from collections.abc import Callable, Iterator, Mapping
from typing import cast

from mjrun.camera.script import CameraDocument, CameraScript, InlineCamera, InstantOrEventKind
from mjrun.document.reader import read
from mjrun.document.tree import number
from mjrun.errors import DocumentError, UsageError, quoted
from mjrun.options import kinds, number_kinds
from mjrun.options.kinds import AnyKind, NameOrIndexKind, ReadingContext, TextKind, optional
from mjrun.options.number_kinds import IntegerKind, PointKind, RealKind, Vector
from mjrun.options.option import Options, option, options
from mjrun.options.rendering import GHOST_MOTIONS, NO_MAP
from mjrun.options.schema_validation import TEXT, Path, Schema, check
from mjrun.options.structured_kinds import OneOfKind, OptionsMappingKind
from mjrun.suffixes import is_yaml

CAMERA = OptionsMappingKind(CameraDocument, CameraDocument)


def read_camera(path: pathlib.Path | str) -> CameraScript:
    """Reads the camera document at `path`; the script is named after the file, without its suffix.

    Raises:
      DocumentError: lines are faulty; all are listed.
      FileError: the file is missing or cannot be read.
    """
    return read(path, CAMERA)[0].script(pathlib.Path(path).stem, str(path))


class _DocumentMujocoNameKind(TextKind):
    """A name that MuJoCo defines, such as a visual flag."""

    def __init__(self, of: str) -> None:
        super().__init__()
        self._of = of

    @property
    def form(self) -> Schema:
        from mjrun.rendering.visual import flags, frame_axes, groupings, labels

        names = {"visual flag": flags, "segmentation": lambda: [*groupings()], "frame": frame_axes, "label": labels}
        return {"type": "string", "enum": names[self._of]()}

    def read(self, value: object, reader: ReadingContext) -> object:
        from mjrun.rendering.visual import Visual, check_segmentation_name

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


BROKEN = "free"  # replaces a camera document whose faults are already reported


class DocumentCameraKind(OneOfKind[object, object]):
    """A camera as text, possibly the file of a camera document, as an index, or as a document of shots."""

    def __init__(self) -> None:
        forms = "a camera as text, by index, or as {name, speed, shots}"
        super().__init__(
            forms, string=TextKind(), number=IntegerKind(), object=OptionsMappingKind(InlineCamera, _inline_script)
        )

    def read(self, value: object, reader: ReadingContext) -> object:
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
    """A translucent copy of the model; without key, trace or recording, it moves as the model does."""

    offset: Vector = option(converter=PointKind(), default=(0.0, 0.0, 0.0), help="Displacement of the ghost [m].")
    opacity: float | None = option(
        converter=optional(RealKind(above=0, most=1)), default=None, help="Opacity of the ghost; 1 is solid."
    )
    key: str | None = option(
        converter=optional(NameOrIndexKind()),
        default=None,
        help="Keyframe that sets the pose of the ghost, by name or index.",
    )
    trace: str | None = option(
        converter=optional(TextKind()),
        default=None,
        help="Table of positions that the ghost follows, relative to the folder of this document.",
    )
    map: str | None = option(
        converter=optional(TextKind()),
        default=None,
        help="File of lines that define the columns of that table, instead of the map of the simulation; or none.",
    )
    recording: str | None = option(
        converter=optional(TextKind()),
        default=None,
        help="Recording (.npz) that the ghost follows, relative to the folder of this document.",
    )

    @classmethod
    def conflicts(cls, values: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
        first, *others = [key for key in GHOST_MOTIONS if key in values] or [""]
        yield from (
            ((key,), f"{first} and {key} exclude each other: each sets the motion of the ghost") for key in others
        )
        with_comma = [key for key in (*GHOST_MOTIONS, "map") if "," in str(values.get(key, ""))]
        yield from (((key,), "the keyframe and files of a ghost cannot contain a comma") for key in with_comma)

    def text(self) -> str:
        """Formats the ghost as text, as on the command line."""
        offset = "/".join(str(number(value)) for value in self.offset) if any(self.offset) else None
        motions = {"key": self.key, "trace": self.trace, "recording": self.recording}
        settings = {"offset": offset, "opacity": self.opacity, **motions, "map": self.map}
        return ",".join(f"{name}={value}" for name, value in settings.items() if value is not None)


class _GhostTextKind(TextKind):
    """The settings of a ghost as text."""

    @property
    def form(self) -> Schema:
        return {"type": "string"}


class _DocumentGhostKind(OneOfKind[object, object]):
    """A ghost as text or as a mapping; its files are relative to the document."""

    def __init__(self) -> None:
        def text(**values: object) -> str:
            return cast("Callable[..., InlineGhost]", InlineGhost)(**values).text()

        forms = "text as in offset=0/1/0,opacity=0.3 or {offset, opacity, key, trace, map, recording}"
        super().__init__(forms, string=_GhostTextKind(), object=OptionsMappingKind(InlineGhost, text))

    def read(self, value: object, reader: ReadingContext) -> object:
        return ghost_text(str(super().read(value, reader)), reader.input)


def ghost_text(text: str, resolved: Callable[[str], str]) -> str:
    """Formats the settings of a ghost, with the paths of its files `resolved`.

    Raises:
      UsageError: the path of a file contains a comma.
    """
    settings: list[str] = []
    for part in text.split(","):
        name, equals, value = part.partition("=")
        is_path = name in ("trace", "recording") or (name == "map" and value != NO_MAP)
        path = resolved(value) if is_path and value else value
        if "," in path:
            raise UsageError(f"{quoted(path)}: the path of a ghost's file cannot contain a comma")
        settings.append(f"{name}{equals}{path}")
    return ",".join(settings)


FORMS: dict[type[AnyKind], AnyKind] = {
    kinds.CameraKind: DocumentCameraKind(),
    kinds.GhostKind: _DocumentGhostKind(),
    number_kinds.InstantKind: InstantOrEventKind(zero=True),
}


def form_of(kind: AnyKind) -> AnyKind:
    """Returns the kind that reads values of `kind` from documents."""
    if isinstance(kind, kinds.MujocoNameKind):
        return _DocumentMujocoNameKind(kind.of)
    return FORMS.get(type(kind), kind)
