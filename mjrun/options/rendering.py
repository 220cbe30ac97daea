"""Options of views: cameras, visible objects and the renderer."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import (
    CameraKind,
    ChoiceKind,
    FlagKind,
    GhostKind,
    MujocoNameKind,
    OneOrMoreKind,
    PathKind,
    TextKind,
    optional,
)
from mjrun.options.number_kinds import ExactNumberKind, GroupsKind, RangeKind, SizeKind
from mjrun.options.option import (
    FrontEnd,
    OptionExclusion,
    OptionRequirement,
    Options,
    is_given,
    option,
    options,
    options_of,
)
from mjrun.suffixes import MODELS

VIEWS = ("rgb", "depth", "seg")
LAYOUTS = ("row", "column", "grid")
STYLES = ("color", "exact")
# The rigs that the command line supports, each with an example.
RIG_EXAMPLES = {
    "auto": "auto:azimuth=90",
    "free": "free:azimuth=90,elevation=-20",
    "orbit": "orbit:lookat=box,azimuth=140..240,ease=cosine",
    "track": "track:box,distance=.5",
    "look": "look:from=0/-2/1,at=box",
}
CORNERS = ("top-left", "top", "top-right", "bottom-left", "bottom", "bottom-right")
GHOST_MOTIONS = ("key", "trace", "recording")  # settings that determine how a ghost moves
NO_MAP = "none"  # disables the map for the table of a ghost
QUALITIES = ("draft", "model", "high")
STAGE = ("auto", "none", "floor", "light", "sky")
RENDERERS = ("classic", "filament")
CALIBRATION_FORMATS = ("mjrun", "nerfstudio", "bop", "ros")
BACKENDS = "auto, egl, osmesa or glfw"


def geoms_option() -> str | None:
    """Declares the option by which looks, collisions or both are shown."""
    return option(
        converter=optional(ChoiceKind(("visual", "collision", "both"))),
        default=None,
        usual="visual where both have about the same place",
        help="Geoms to show of bodies that have some for looks and others for collisions.",
    )


@options
class BackendOptions(Options):
    """OpenGL on this machine; documents cannot set it."""

    section: ClassVar[str] = "Renderer"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND | FrontEnd.PYTHON

    gl: str | None = option(
        converter=optional(TextKind("BACKEND")),
        default=None,
        usual="$MUJOCO_GL, or auto",
        help=f"OpenGL backend: {BACKENDS}.",
    )
    require_gpu: bool = option(
        converter=FlagKind(),
        default=False,
        help="Fail instead of rendering in software.",
    )


@options
class RendererOptions(BackendOptions):
    """Renderer and rendering quality."""

    section: ClassVar[str] = "Renderer"

    quality: str = option(
        converter=ChoiceKind(QUALITIES),
        default="model",
        help="Rendering quality: draft omits shadows, reflections and multisampling; model uses the model's "
        "settings; high adds supersampling.",
    )
    renderer: str = option(
        converter=ChoiceKind(RENDERERS),
        default="classic",
        help="Renderer: classic is MuJoCo's OpenGL renderer; filament is its physically based one, which requires "
        "Vulkan.",
    )


@options
class DecorationOptions(Options):
    """Decorations: additions to the scene, which only images of colour show."""

    section: ClassVar[str] = "View"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        OptionRequirement("trail_span", "trail", "whose length it limits"),
    )

    trail: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("OBJECT,…")),
        default=(),
        help="Bodies, geoms or sites whose paths are drawn, wider and in warmer colours where the speed is higher.",
    )
    trail_span: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS")),
        default=None,
        usual="all",
        help="Duration of the motion that a trail shows [s].",
    )
    ghost: tuple[str, ...] = option(
        converter=OneOrMoreKind(GhostKind()),
        default=(),
        help="Translucent copy of the model, without flexes and skins: offset=0/1/0, opacity=.3. It shows the pose of "
        "a keyframe, key=NAME; the motion of a recording, recording=FILE; or that of a table of positions, trace=FILE, "
        "with map=FILE or --map.",
    )


@options
class SceneOptions(DecorationOptions, RendererOptions):
    """Cameras, visible objects, and decorations."""

    section: ClassVar[str] = "View"
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (
        OptionExclusion(("geoms", "geomgroup"), "both choose the geoms to show"),
    )

    size: tuple[int, int] = option(
        converter=SizeKind(), default=(1280, 720), help="Width and height of one view [pixels]."
    )
    camera: tuple[object, ...] = option(
        converter=OneOrMoreKind(CameraKind()),
        default="auto",
        help=f"Camera of the model, by name or index; or one of {', '.join(RIG_EXAMPLES)} with settings after a colon: "
        f"{' '.join(RIG_EXAMPLES.values())}; or a camera script, camera.yaml, with a sequence of shots.",
    )
    stage: tuple[str, ...] = option(
        converter=OneOrMoreKind(ChoiceKind((*STAGE, "camera")), commas=True),
        default="auto",
        help="Surroundings to add to the image: a floor that nothing collides with, light, sky, a camera that frames "
        "the model closely, or none; auto adds what a model without a floor and a sky lacks.",
    )
    geoms: str | None = geoms_option()
    show: tuple[str, ...] = option(
        converter=OneOrMoreKind(MujocoNameKind("FLAG", of="visual flag"), commas=True),
        default=(),
        help="Visual flags to switch on, by MuJoCo's names: contactpoint, contactforce, transparent, joint, …",
    )
    hide: tuple[str, ...] = option(
        converter=OneOrMoreKind(MujocoNameKind("FLAG", of="visual flag"), commas=True),
        default=(),
        help="Visual flags to switch off: shadow, skybox, texture, …",
    )
    geomgroup: tuple[int, ...] | None = option(
        converter=optional(GroupsKind()), default=None, help="Groups of geoms to show: 0,1,2, all or none."
    )
    sitegroup: tuple[int, ...] | None = option(
        converter=optional(GroupsKind()), default=None, help="Groups of sites to show."
    )
    jointgroup: tuple[int, ...] | None = option(
        converter=optional(GroupsKind()), default=None, help="Groups of joints to show."
    )
    tendongroup: tuple[int, ...] | None = option(
        converter=optional(GroupsKind()), default=None, help="Groups of tendons to show."
    )
    actuatorgroup: tuple[int, ...] | None = option(
        converter=optional(GroupsKind()), default=None, help="Groups of actuators to show."
    )
    flexgroup: tuple[int, ...] | None = option(
        converter=optional(GroupsKind()), default=None, help="Groups of flexes to show."
    )
    skingroup: tuple[int, ...] | None = option(
        converter=optional(GroupsKind()), default=None, help="Groups of skins to show."
    )
    frame_axes: str = option(
        converter=MujocoNameKind("KIND", of="frame"),
        default="none",
        help="Objects whose axes are shown: body, geom, site, camera, light, contact or world.",
    )
    label: str = option(
        converter=MujocoNameKind("KIND", of="label"),
        default="none",
        help="Objects whose names are shown: body, joint, geom, site, camera, tendon, actuator, …",
    )


def decoration_options(options: SceneOptions) -> list[str]:
    """Returns the names of the decorations that `options` request."""
    return [each.name for each in options_of(DecorationOptions) if is_given(options, each.name)]


@options
class ImageContentOptions(Options):
    """Kinds of images, their arrangement, and text on them."""

    section: ClassVar[str] = "View"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        OptionRequirement("depth_range", "view", "whose colours it sets", value="depth"),
        OptionRequirement("seg_by", "view", "whose objects it chooses", value="seg"),
        OptionRequirement("text_corner", "text", "whose position it sets"),
        OptionRequirement("calibration_format", "calibration", "whose format it sets"),
    )

    view: tuple[str, ...] = option(
        converter=OneOrMoreKind(ChoiceKind(VIEWS)),
        default="rgb",
        help="Kind of image: colour, depth [m] or segmentation.",
    )
    layout: str = option(
        converter=ChoiceKind(LAYOUTS), default="row", help="Arrangement of several views in one frame."
    )
    separate: bool = option(
        converter=FlagKind(), default=False, help="Write each view to a separate file, named NAME-CAMERA-VIEW."
    )
    captions: bool = option(converter=FlagKind(), default=False, help="Label each view with its camera and its kind.")
    style: str | None = option(
        converter=optional(ChoiceKind(STYLES)),
        default=None,
        usual="chosen by the file format",
        help="Pixel values of depth and segmentation: color writes colours for viewing; exact writes 16-bit "
        "millimetres or ids.",
    )
    depth_range: tuple[float, float] | None = option(
        converter=optional(RangeKind("NEAR..FAR", "two depths in metres, the nearer first")),
        default=None,
        usual="the visible range",
        help="Depths [m] shown in the first and the last colour.",
    )
    seg_by: str = option(
        converter=MujocoNameKind("KIND", of="segmentation"),
        default="object",
        help="Objects that a segmentation distinguishes: object, geom, site, …, body or root-body.",
    )
    text: str | None = option(
        converter=optional(TextKind("TEMPLATE")),
        default=None,
        help="Text on the frame, with values in braces: '{time:.2f} s', '{speed}x', or any column of a trace as in "
        "'{qpos/knee:.1f}'.",
    )
    text_corner: str | None = option(
        converter=optional(ChoiceKind(CORNERS)),
        default=None,
        usual="top-left; bottom-right with captions",
        help="Position of the text.",
    )
    calibration: str | None = option(
        converter=optional(PathKind(written=True, unlike=(*MODELS, ".py"))),  # and not YAML, which is that of ROS
        default=None,
        help="File for the calibration of each frame: K, world from camera, near and far [m] and time [s], in "
        "OpenCV axes.",
    )
    calibration_format: str = option(
        converter=ChoiceKind(CALIBRATION_FORMATS), default="mjrun", help="Format of the calibration file."
    )


@options
class ViewOptions(SceneOptions, ImageContentOptions):
    """Cameras, views, visible objects and additions to the image."""

    section: ClassVar[str] = "View"
