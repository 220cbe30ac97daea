"""Options of what is seen, and of who draws it."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import (
    Camera,
    Choice,
    ExactNumber,
    File,
    Flag,
    Ghost,
    Groups,
    MujocoName,
    Optional,
    Range,
    Several,
    Size,
    Text,
)
from mjrun.options.option import FrontEnd, Options, option, options

VIEWS = ("rgb", "depth", "seg")
LAYOUTS = ("row", "column", "grid")
STYLES = ("color", "exact")
# Rig that the command line can write → an example.
RIGS = {
    "free": "free:azimuth=90,elevation=-20",
    "orbit": "orbit:lookat=box,azimuth=140..240,ease=cosine",
    "track": "track:box,distance=.5",
    "look": "look:from=0/-2/1,at=box",
}
CORNERS = ("top-left", "top", "top-right", "bottom-left", "bottom", "bottom-right")
GHOST_MOTIONS = ("key", "trace", "recording")  # settings of a ghost, each of which says how it moves
NO_MAP = "none"  # of a ghost's table
QUALITIES = ("draft", "model", "high")
RENDERERS = ("classic", "filament")
CALIBRATION_FORMATS = ("mjrun", "nerfstudio", "bop", "ros")
BACKENDS = "auto, egl, osmesa or glfw"


@options
class BackendOptions(Options):
    """What this machine draws with; documents leave it open."""

    section: ClassVar[str] = "Renderer"

    gl: str | None = option(
        converter=Optional(Text("BACKEND")),
        default=None,
        usual="$MUJOCO_GL, or auto",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help=f"OpenGL backend: {BACKENDS}.",
    )
    require_gpu: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Refuse to draw in software.",
    )


@options
class RendererOptions(BackendOptions):
    """Who draws, and how well."""

    section: ClassVar[str] = "Renderer"

    quality: str = option(
        converter=Choice(QUALITIES),
        default="model",
        help="draft: no shadows, reflections or multisampling; model: as the model asks; high: supersampled.",
    )
    renderer: str = option(
        converter=Choice(RENDERERS),
        default="classic",
        help="MuJoCo's OpenGL renderer, or its physically based one, which needs Vulkan.",
    )


@options
class ViewOptions(RendererOptions):
    """What is seen: cameras, views, what is drawn and what is added."""

    section: ClassVar[str] = "View"

    size: tuple[int, int] = option(converter=Size(), default=(1280, 720), help="Width and height of one view [pixels].")
    camera: tuple[object, ...] = option(
        converter=Several(Camera()),
        default="free",
        help=f"A camera of the model, by name or index; or one of {', '.join(RIGS)} with settings after a colon: "
        f"{' '.join(RIGS.values())}; or a camera script, camera.yaml, with shots in time.",
    )
    view: tuple[str, ...] = option(
        converter=Several(Choice(VIEWS)), default="rgb", help="Colour, depth [m] or segmentation."
    )
    layout: str = option(converter=Choice(LAYOUTS), default="row", help="How several views stand in one frame.")
    separate: bool = option(
        converter=Flag(), default=False, help="A file for each view instead, called NAME-CAMERA-VIEW."
    )
    captions: bool = option(converter=Flag(), default=False, help="Label each view.")
    style: str | None = option(
        converter=Optional(Choice(STYLES)),
        default=None,
        usual="what the file can hold",
        help="Depth and segmentation as colours for the eye, or as exact 16-bit numbers: millimetres, ids.",
    )
    depth_range: tuple[float, float] | None = option(
        converter=Optional(Range("NEAR..FAR", "two depths in metres, the nearer first")),
        default=None,
        usual="as seen",
        help="Depths [m] of the first and the last colour.",
    )
    seg_by: str = option(
        converter=MujocoName("KIND", of="segmentation"),
        default="object",
        help="What a segmentation tells apart: object, geom, site, …, body or root-body.",
    )
    show: tuple[str, ...] = option(
        converter=Several(MujocoName("FLAG", of="visual flag"), commas=True),
        default=(),
        help="Visual flags to switch on, by MuJoCo's names: contactpoint, contactforce, transparent, joint, …",
    )
    hide: tuple[str, ...] = option(
        converter=Several(MujocoName("FLAG", of="visual flag"), commas=True),
        default=(),
        help="Visual flags to switch off: shadow, skybox, texture, …",
    )
    geomgroup: tuple[int, ...] | None = option(
        converter=Optional(Groups()), default=None, help="Groups of geoms to draw: 0,1,2, all or none."
    )
    sitegroup: tuple[int, ...] | None = option(
        converter=Optional(Groups()), default=None, help="Groups of sites to draw."
    )
    jointgroup: tuple[int, ...] | None = option(
        converter=Optional(Groups()), default=None, help="Groups of joints to draw."
    )
    tendongroup: tuple[int, ...] | None = option(
        converter=Optional(Groups()), default=None, help="Groups of tendons to draw."
    )
    actuatorgroup: tuple[int, ...] | None = option(
        converter=Optional(Groups()), default=None, help="Groups of actuators to draw."
    )
    flexgroup: tuple[int, ...] | None = option(
        converter=Optional(Groups()), default=None, help="Groups of flexes to draw."
    )
    skingroup: tuple[int, ...] | None = option(
        converter=Optional(Groups()), default=None, help="Groups of skins to draw."
    )
    frame_axes: str = option(
        converter=MujocoName("KIND", of="frame"),
        default="none",
        help="Draw the axes of: body, geom, site, camera, light, contact or world.",
    )
    label: str = option(
        converter=MujocoName("KIND", of="label"),
        default="none",
        help="Draw the names of: body, joint, geom, site, camera, tendon, actuator, …",
    )
    trail: tuple[str, ...] = option(
        converter=Several(Text("OBJECT,…")),
        default=(),
        help="Bodies, geoms or sites whose path is drawn, wider and warmer where they are faster.",
    )
    trail_span: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS")),
        default=None,
        usual="all",
        help="How much of the past a trail shows [s].",
    )
    ghost: tuple[str, ...] = option(
        converter=Several(Ghost()),
        default=(),
        help="The model once more, translucent: offset=0/1/0, opacity=.3; in the pose of a keyframe, key=NAME, or "
        "moving as in a recording, recording=FILE, or in any table of positions, trace=FILE, with map=FILE or --map.",
    )
    text: str | None = option(
        converter=Optional(Text("TEMPLATE")),
        default=None,
        help="Text over the frame: '{time:.2f} s', '{speed}x', any column of a trace as in '{qpos/knee:.1f}'.",
    )
    text_corner: str | None = option(
        converter=Optional(Choice(CORNERS)),
        default=None,
        usual="top-left; bottom-right with captions",
        help="Where the text stands.",
    )
    calibration: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help="A file for the calibration of each frame: K, world from camera, near and far [m], time [s]; "
        "in the axes of OpenCV.",
    )
    calibration_format: str = option(
        converter=Choice(CALIBRATION_FORMATS), default="mjrun", help="The format of that file."
    )
