"""What a run document says of pictures: cameras, views, what is drawn, what is added."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, Strict, Tag

from mjrun.camera.script import CameraScript
from mjrun.document.camera import Document, read_camera
from mjrun.document.document_model import (
    LIST,
    MAPPING,
    NUMBER,
    TEXT,
    Among,
    Form,
    Loc,
    Maybe,
    Name,
    Positive,
    Vector,
    items,
    kinds,
)
from mjrun.document.field_types import Several, Size, all_of, listed, taken_by
from mjrun.document.machine import Machine
from mjrun.document.output_folder import Inside
from mjrun.document.reader import SUFFIXES
from mjrun.document.simulation import Whole, within
from mjrun.document.yaml_writer import number
from mjrun.errors import UsageError, quoted
from mjrun.formats.calibration_writer import FORMATS as CALIBRATIONS
from mjrun.job.scene_decorations import MOTIONS
from mjrun.job.view import LAYOUTS, RENDERERS, SIZE, STYLES
from mjrun.rendering.compositor import VIEWS
from mjrun.rendering.segmentation import grouping
from mjrun.rendering.text import CORNERS
from mjrun.rendering.visual import GROUPS, QUALITIES, Visual, flags

ALL = tuple(range(6))  # groups

Flag = Annotated[str, taken_by(lambda name: Visual(show=[name])), listed(flags())]
Group = Annotated[int, Field(ge=0, le=ALL[-1])]
Drawn = Maybe[
    Annotated[
        Annotated[list[Group], Tag(LIST)] | Annotated[Literal["all", "none"], Tag(TEXT)],
        kinds("a list of groups from 0 to 5, all or none", LIST, TEXT),
    ]
]
Range = Annotated[tuple[float, float], Strict(False), BeforeValidator(items(2, "numbers"))]


class Groups(Form):
    """The groups to draw, of each kind of object; those of kinds that are left out stay as MuJoCo has them."""

    geom: Drawn = None
    """Of geoms: a list of groups from 0 to 5, all or none."""
    site: Drawn = None
    """Of sites."""
    joint: Drawn = None
    """Of joints."""
    tendon: Drawn = None
    """Of tendons."""
    actuator: Drawn = None
    """Of actuators."""
    flex: Drawn = None
    """Of flexes."""
    skin: Drawn = None
    """Of skins."""

    def drawn(self) -> dict[str, tuple[int, ...]]:
        """The groups of each kind that is mentioned."""
        known = {"all": ALL, "none": ()}
        given = {kind: getattr(self, kind) for kind in GROUPS}
        return {kind: known.get(str(value), value) for kind, value in given.items() if value is not None}


class Camera(Document):
    """A camera document written where it is used."""

    name: Name = "script"
    """What captions and files call it."""


class Ghost(Form):
    """The model once more, translucent; it does what the model does, unless key, trace or recording says otherwise."""

    offset: Vector = (0.0, 0.0, 0.0)
    """How far it is displaced [m]."""
    opacity: Maybe[Annotated[float, Field(gt=0, le=1)]] = None
    """How clearly it is seen, 1 being solid."""
    key: Maybe[
        Annotated[
            Annotated[Name, Tag(TEXT)] | Annotated[Whole, Tag(NUMBER)],
            kinds("the name or index of a keyframe", TEXT, NUMBER),
        ]
    ] = None
    """The keyframe in whose pose it stands, by name or index."""
    trace: Maybe[Name] = None
    """A table of positions that it goes through, relative to the folder of this document."""
    recording: Maybe[Name] = None
    """A recording (.npz) that it goes through, relative to the folder of this document."""

    @classmethod
    def complaints(cls, given: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
        first, *others = [key for key in MOTIONS if key in given] or [""]
        yield from (((key,), f"{first} and {key} exclude each other: each says what the ghost does") for key in others)
        held = [key for key in MOTIONS if "," in str(given.get(key, ""))]
        yield from (((key,), "what a ghost goes by holds no comma") for key in held)

    def text(self) -> str:
        """What `--ghost` would be given."""
        offset = "/".join(str(number(value)) for value in self.offset) if any(self.offset) else None
        settings = {"offset": offset, "opacity": self.opacity, **{name: getattr(self, name) for name in MOTIONS}}
        return ",".join(f"{name}={value}" for name, value in settings.items() if value is not None)


OneCamera = Annotated[
    Annotated[Name, Tag(TEXT)] | Annotated[Whole, Tag(NUMBER)] | Annotated[Camera, Tag(MAPPING)],
    kinds("a camera as text, by index, or as {name, speed, shots}", TEXT, NUMBER, MAPPING),
]
OneGhost = Annotated[
    Annotated[str, Tag(TEXT)] | Annotated[Ghost, Tag(MAPPING)],
    kinds("text as in offset=0/1/0,opacity=0.3 or {offset, opacity, key, trace, recording}", TEXT, MAPPING),
]


class Picture(Form):
    """What films and stills have in common."""

    output: Inside
    """The file, inside the folder of outputs."""
    size: Size = SIZE
    """Width and height of one view [pixels], 1280x720 or [1280, 720]."""
    camera: Several[OneCamera] = "free"
    """A camera of the model, free, orbit:…, track:…, a camera document (.yaml), one written here; or a list."""
    view: Several[Annotated[str, Among(VIEWS)]] = "rgb"
    """Colour, depth [m] or segmentation; or a list."""
    layout: Annotated[str, Among(LAYOUTS)] = "row"
    """How several views stand in one picture."""
    separate: bool = False
    """Whether each view has a file of its own instead, called NAME-CAMERA-VIEW."""
    captions: bool = False
    """Whether each view says what it is."""
    style: Maybe[Annotated[str, Among(STYLES)]] = None
    """Depth and segmentation as colours for the eye, or as exact numbers; what the file can hold if left out."""
    depth_range: Maybe[Range] = None
    """Depths [m] of the first and the last colour; as seen if left out."""
    seg_by: Annotated[str, Among(tuple(grouping()))] = "object"
    """What a segmentation tells apart."""
    show: Several[Flag] = Field([])
    """Visual flags to switch on, by MuJoCo's names: contactpoint, or a list."""
    hide: Several[Flag] = Field([])
    """Visual flags to switch off: shadow, or a list."""
    groups: Maybe[Groups] = None
    """The groups to draw: {geom: [0, 1], site: all}."""
    frame_axes: Annotated[str, taken_by(lambda name: Visual(frame=name))] = "none"
    """Axes of: body, geom, site, camera, light, contact or world."""
    label: Annotated[str, taken_by(lambda name: Visual(label=name))] = "none"
    """Names of: body, joint, geom, site, camera, tendon, actuator, …"""
    trail: Several[Name] = Field([])
    """Bodies, geoms or sites whose path is drawn, wider and warmer where they are faster."""
    trail_span: Maybe[Positive] = None
    """How much of the past it shows [s]; all if left out."""
    ghost: Several[OneGhost] = Field([])
    """The model once more, translucent: {offset: [0, 1, 0]}, {key: home}, offset=0/1/0,opacity=0.3; or a list."""
    text: Maybe[Name] = None
    """Written over the picture: '{time:.2f} s', '{speed}x', any column of a trace as in '{qpos/knee:.1f}'."""
    text_corner: Maybe[Annotated[str, Among(tuple(CORNERS))]] = None
    """Where the text stands; top-left if left out, with captions bottom-left."""
    quality: Annotated[str, Among(QUALITIES)] = "model"
    """draft: no shadows, reflections and multisampling; model: as the model asks; high: supersampled."""
    renderer: Annotated[str, Among(tuple(RENDERERS))] = "classic"
    """MuJoCo's own, or the physically based one, which needs Vulkan."""
    calibration: Maybe[Inside] = None
    """A file for what each picture is seen through: K, world from camera, near and far [m], time [s]."""
    calibration_format: Annotated[str, Among(tuple(CALIBRATIONS))] = "mjrun"
    """Whose file it is."""
    manifest: Maybe[Inside] = None
    """A file for what made the output, as JSON."""

    def drawing(self, inputs: Path, machine: Machine) -> dict[str, Any]:
        """What `Drawing` takes, but for files; those that are read are relative to the folder `inputs`.

        Raises:
          UsageError: what it says cannot be together, or a camera document has errors.
          FileError: a camera document cannot be read.
        """
        same = ("size", "layout", "separate", "captions", "style", "depth_range", "seg_by", "trail_span", "text")
        same += ("text_corner", "calibration_format", "renderer")
        return {
            "camera": tuple(_camera(one, inputs) for one in all_of(self.camera)),
            "view": all_of(self.view),
            "visual": self._visual(machine),
            "trail": all_of(self.trail),
            "ghost": tuple(_ghost(one, inputs) for one in all_of(self.ghost)),
            "gl": machine.gl,
            "require_gpu": machine.require_gpu,
            "command": machine.command,
            **{name: getattr(self, name) for name in same},
        }

    def _visual(self, machine: Machine) -> Visual:
        return Visual(
            show=all_of(self.show),
            hide=all_of(self.hide),
            groups=self.groups.drawn() if self.groups else {},
            frame=self.frame_axes,
            label=self.label,
            quality=machine.quality or self.quality,
        )


def _camera(given: str | int | Camera, inputs: Path) -> str | CameraScript:
    if isinstance(given, Camera):
        return given.script(given.name)
    text = str(given)
    return read_camera(inputs / text) if Path(text).suffix.lower() in SUFFIXES else text


def _ghost(given: str | Ghost, inputs: Path) -> str:
    """A ghost as `--ghost` takes it, its files as they are from here."""
    settings = []
    for part in (given.text() if isinstance(given, Ghost) else given).split(","):
        name, equals, value = part.partition("=")
        path = within(inputs, value) if name in ("trace", "recording") and value else value
        if "," in str(path):
            raise UsageError(f"{quoted(str(path))}: the path of what a ghost goes through holds no comma")
        settings.append(f"{name}{equals}{path}")
    return ",".join(settings)
