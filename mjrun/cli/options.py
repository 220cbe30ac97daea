"""Options that commands share, in sections of the help text. A name means the same everywhere."""

from collections.abc import Callable
from typing import Any

import click

from mjrun.cli.console import Console
from mjrun.cli.params import Assignment, Exact, Groups, Jobs, NotNegative, PathValue, Range, Size, Words

Command = Callable[..., Any]
INTEGRATORS = ("euler", "rk4", "implicit", "implicitfast", "discrete")
GROUP_KINDS = ("geom", "site", "joint", "tendon", "actuator", "flex", "skin")


class SectionOption(click.Option):
    """An option that stands under a heading of its own in the help text."""

    section = "Options"


class SectionedCommand(click.Command):
    """A command whose help shows its options by section."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        sections: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record and isinstance(param, click.Option):
                sections.setdefault(getattr(param, "section", "Options"), []).append(record)
        for name, records in sections.items():
            with formatter.section(name):
                formatter.write_dl(records)


def bundle(section: str, *options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    def decorate(command: Command) -> Command:
        for option in reversed(options):
            option(command)
        count = len(options)
        for param in command.__click_params__[-count:]:  # type: ignore[attr-defined]
            param.section = section
        return command

    return decorate


def option(*names: str, **settings: Any) -> Callable[[Command], Command]:
    return click.option(*names, cls=SectionOption, **settings)


def _tell_console(**settings: Any) -> Callable[[click.Context, click.Parameter, bool], None]:
    """A callback that changes the console when its flag is given."""

    def callback(ctx: click.Context, param: click.Parameter, value: bool) -> None:
        console = ctx.find_object(Console)
        for name, setting in settings.items() if value and console else ():
            setattr(console, name, setting)

    return callback


def _message_flag(*names: str, help: str, **settings: Any) -> Callable[[Command], Command]:  # noqa: A002
    return option(*names, is_flag=True, expose_value=False, callback=_tell_console(**settings), help=help)


model_argument = click.argument("model", type=click.Path())

model_options = bundle(
    "Model",
    option("--integrator", type=click.Choice(INTEGRATORS, case_sensitive=False), help="Instead of the model's."),
    option("--timestep", type=Exact("SECONDS"), help="Instead of the model's."),
    option(
        "--set",
        "settings",
        type=PathValue(),
        multiple=True,
        help="Override anything before compilation, by MuJoCo's own names: opt.gravity=0,0,10, opt.cone=elliptic, "
        "opt.flag.contact=disable, geom/floor.friction=.1,.005,.0001, vis.quality.shadowsize=1024. Repeatable.",
    ),
)

controller_parts = (
    option(
        "--controller",
        metavar="CODE",
        help="Python that sets the controls: policy.py:act or package.module:Policy, called with (model, data). "
        "It writes data.ctrl or returns the controls; a class may have a method reset.",
    ),
    option("--control-dt", type=Exact("SECONDS"), help="Time between two calls of it.  [default: every step]"),
)

simulation_options = bundle(
    "Simulation",
    option("--key", metavar="NAME|INDEX", help="Start from a keyframe."),
    option(
        "--qpos",
        type=Assignment(),
        multiple=True,
        help="Initial joint position, by name: hip=0.3, root/z=1. Repeatable.",
    ),
    option(
        "--qvel",
        type=Assignment(),
        multiple=True,
        help="Initial joint velocity, by name: hip=2, root/wx=1. Repeatable.",
    ),
    option(
        "--ctrl", type=Assignment(), multiple=True, help="Constant control, by actuator name or wildcard. Repeatable."
    ),
    option(
        "--ctrl-from",
        metavar="FILE",
        help="Controls in time from a table with columns time and ctrl/ACTUATOR: csv, parquet, npz; a trace will do.",
    ),
    option(
        "--ctrl-interpolation",
        type=click.Choice(["hold", "linear"]),
        default="hold",
        show_default=True,
        help="Between the rows of that table.",
    ),
    option(
        "--ctrl-noise",
        type=click.FloatRange(min=0),
        default=0.0,
        metavar="STD",
        help="Gaussian noise on every control, in its own units.",
    ),
    option(
        "--ctrl-noise-time",
        type=click.FloatRange(min=0),
        default=0.0,
        metavar="SECONDS",
        help="Time in which that noise forgets.  [default: 0, new at every step]",
    ),
    *controller_parts,
    option(
        "--replay",
        metavar="FILE",
        help="Go through the states that --recording kept (.npz), instead of simulating.",
    ),
    option("--recording", metavar="FILE", help="Keep the state of every step, for --replay (.npz)."),
    option(
        "--perturb", type=click.FloatRange(min=0), default=0.0, metavar="STD", help="Noise on the initial velocities."
    ),
    option("--seed", type=click.IntRange(min=0), default=0, metavar="N", help="Of the noise.  [default: 0]"),
)

duration_options = bundle(
    "Simulation",
    option("--duration", type=Exact("SECONDS"), help="Simulated time.  [default: 5]"),
    option("--steps", type=click.IntRange(min=1), metavar="N", help="Number of steps, instead of --duration."),
)

view_options = bundle(
    "View",
    option("--size", type=Size(), default="1280x720", show_default=True, help="Of one view, in pixels."),
    option(
        "--camera",
        "cameras",
        multiple=True,
        metavar="SPEC",
        help="A camera of the model, by name or index; or free, orbit or track with settings after a colon: "
        "free:azimuth=90,elevation=-20 orbit:lookat=box,azimuth=140..240,ease=cosine track:box,distance=.5; "
        "or a camera document, camera.yaml, with shots in time. Repeat for several.  [default: free]",
    ),
    option(
        "--view",
        "views",
        type=click.Choice(["rgb", "depth", "seg"]),
        multiple=True,
        help="Colour, depth or segmentation. Repeat for several.  [default: rgb]",
    ),
    option(
        "--layout",
        type=click.Choice(["row", "column", "grid"]),
        default="row",
        show_default=True,
        help="How several views stand in one picture.",
    ),
    option("--separate", is_flag=True, help="A file for each view instead, called NAME-CAMERA-VIEW."),
    option("--captions", is_flag=True, help="Say in each view what it is."),
    option(
        "--style",
        type=click.Choice(["color", "exact"]),
        help="Depth and segmentation as colours for the eye, or as numbers of 16 bits: millimetres, ids.",
    ),
    option("--depth-range", type=Range("NEAR..FAR"), help="Of the colours of depth, in metres.  [default: as seen]"),
    option(
        "--seg-by",
        default="object",
        metavar="KIND",
        show_default=True,
        help="What a segmentation tells apart: object, geom, site, …, body or root-body.",
    ),
    option(
        "--show",
        type=Words("FLAG,…"),
        multiple=True,
        help="Switch on visual flags by MuJoCo's names: contactpoint, contactforce, transparent, joint, … "
        "A wrong name lists them all.",
    ),
    option("--hide", type=Words("FLAG,…"), multiple=True, help="Switch off visual flags: shadow, skybox, texture, …"),
    *(
        option(f"--{kind}group", f"{kind}group", type=Groups(), help=f"The {kind} groups to draw: 0,1,2, all or none.")
        for kind in GROUP_KINDS
    ),
    option(
        "--frame-axes", default="none", metavar="KIND", help="Axes of: body, geom, site, camera, light, contact, world."
    ),
    option(
        "--label", default="none", metavar="KIND", help="Names of: body, joint, geom, site, camera, tendon, actuator, …"
    ),
    option(
        "--trail",
        "trails",
        multiple=True,
        metavar="OBJECT,…",
        help="Draw the path of bodies, geoms or sites, wider and warmer where they are faster. Repeatable.",
    ),
    option("--trail-span", type=Exact("SECONDS"), help="How much of the past it shows.  [default: all]"),
    option(
        "--ghost",
        "ghosts",
        multiple=True,
        metavar="SETTING,…",
        help="The model once more, translucent: offset=0/1/0, opacity=.3; in the pose of a keyframe, key=NAME, or "
        "moving as a trace or a recording says, trace=FILE or recording=FILE. Repeatable.",
    ),
    option(
        "--text",
        metavar="TEMPLATE",
        help="Write over the picture: '{time:.2f} s', '{speed}x', any column of a trace as in '{qpos/knee:.1f}'.",
    ),
    option(
        "--text-corner",
        type=click.Choice(["top-left", "top", "top-right", "bottom-left", "bottom", "bottom-right"]),
        help="Where it stands.  [default: top-left; with captions bottom-right]",
    ),
)

device_parts = (
    option(
        "--gl", envvar="MUJOCO_GL", metavar="BACKEND", help="auto, egl, osmesa or glfw.  [default: $MUJOCO_GL, or auto]"
    ),
    option("--require-gpu", is_flag=True, help="Refuse to draw in software."),
)

renderer_options = bundle(
    "Renderer",
    option(
        "--quality",
        type=click.Choice(["draft", "model", "high"]),
        default="model",
        show_default=True,
        help="draft: no shadows, reflections and multisampling; model: as the model asks; high: supersampled.",
    ),
    option(
        "--renderer",
        type=click.Choice(["classic", "filament"]),
        default="classic",
        show_default=True,
        help="MuJoCo's own, or the physically based one, which needs Vulkan.",
    ),
    *device_parts,
)

_calibration = (
    option(
        "--calibration",
        metavar="FILE",
        help="What each picture is seen through: K, world from camera, near, far, time; in OpenCV's axes.",
    ),
    option(
        "--calibration-format",
        type=click.Choice(["mjrun", "nerfstudio", "bop", "ros"]),
        default="mjrun",
        show_default=True,
        help="Whose file it is.",
    ),
)

_record = (
    option(
        "--manifest",
        metavar="FILE",
        help="What made the output, as JSON: versions, command, model, options, wall times, hashes.",
    ),
    option("--print-document", is_flag=True, help="Print the command as a document for mjrun run, and stop."),
)

image_options = bundle(
    "Picture",
    option(
        "-o",
        "--output",
        metavar="FILE",
        help="png, jpg, webp, tiff; depth also npy, exr; segmentation also npy, json (COCO); or - for a pipe.  "
        "[default: MODEL.png]",
    ),
    option("-t", "--time", "at", type=NotNegative("SECONDS"), help="The instant to draw.  [default: 0]"),
    option("--step", type=click.IntRange(min=0), metavar="N", help="The instant, by step."),
    option(
        "--format",
        "format_",
        metavar="NAME",
        help="Instead of the output's suffix, as for a pipe; palette for a segmentation in colours.  [default: png]",
    ),
    option("--legend/--no-legend", default=True, help="List what a coloured segmentation shows.  [default: --legend]"),
    option(
        "--pointcloud",
        metavar="FILE",
        help="All that the cameras see as coloured points in the world, in a .ply; labelled with --view seg.",
    ),
    *_calibration,
    *_record,
)


def jobs_part(default: str | None) -> Callable[[Command], Command]:
    return option(
        "--jobs",
        type=Jobs(),
        default=default,
        metavar="N|auto",
        show_default=True,
        help="Processes that draw; auto is one per core where a CPU draws a long film.",
    )


film_options = bundle(
    "Film",
    option(
        "-o",
        "--output",
        metavar="FILE",
        help="mp4, webm, mkv, mov, gif, apng, webp, a folder or pattern of PNGs (frames/, frame_%04d.png), "
        "or - for a pipe.  [default: MODEL.mp4]",
    ),
    option("--fps", type=Exact("FPS"), help="Frames per second.  [default: 30; 25 in a GIF]"),
    option(
        "--speed", type=Exact("FACTOR"), default="1", help="Simulated seconds per second of film; 0.25 is slow motion."
    ),
    option("--format", "format_", metavar="NAME", help="Instead of the output's suffix; for a pipe.  [default: mp4]"),
    option("--codec", metavar="NAME", help="h264, h265, av1, vp9, prores, ffv1, as the format holds."),
    option("--crf", type=int, metavar="N", help="Constant rate factor: lower is better and larger."),
    option("--preset", metavar="NAME", help="The codec's own, from fast to thorough."),
    option(
        "--plot",
        "plots",
        multiple=True,
        metavar="PROBE,…",
        help="A live graph of what a trace would measure: energy, qpos[left_*]. Repeat for several graphs.",
    ),
    option(
        "--plot-side", type=click.Choice(["under", "beside"]), default="under", show_default=True, help="Where it is."
    ),
    jobs_part("auto"),
    *_calibration,
    *_record,
)

table_options = bundle(
    "Table",
    option(
        "-o",
        "--output",
        metavar="FILE",
        help="csv, jsonl, parquet, feather, npz, mat, or - for standard output.  [default: -]",
    ),
    option("--csv", is_flag=True, help="Short for --format csv."),
    option("--format", "format_", metavar="NAME", help="Instead of the output's suffix.  [default: csv]"),
    option(
        "--probe",
        "probes",
        multiple=True,
        metavar="NAME,…",
        help="What to measure: qpos, qvel, qacc, ctrl, act, energy, sensor, contact, xpos, speed, momentum, … or any "
        "field of MjData; of some objects, qpos[left_*], xpos[hand]; or a column, xpos/hand/z. Repeatable.  "
        "[default: qpos,qvel,ctrl,act,energy,contact,sensor]",
    ),
    option(
        "--list",
        "list_",
        is_flag=True,
        help="List every column that the model offers, or those of --probe, and stop; nothing is written.",
    ),
    option("--every", type=click.IntRange(min=1), default=1, metavar="N", help="A row every N steps.  [default: 1]"),
    option(
        "--rate", type=Exact("HZ"), help="Rows per simulated second, instead of --every; at most one for each step."
    ),
    option(
        "--assert",
        "asserts",
        multiple=True,
        metavar="EXPR",
        help="Exit with 1 unless this holds: max(abs(energy/drift)) < 1e-3. Repeatable.",
    ),
    option("--keep-partial", is_flag=True, help="Keep the rows before an instability."),
    option(
        "--contacts",
        metavar="FILE",
        help="A second table, a row for each contact of each instant: who, where, how deep, force and torque. "
        "Suffixes as for -o.",
    ),
    *_record,
)

run_options = bundle(
    "Run",
    option("-o", "--output", metavar="DIR", help="The folder of all outputs; made if need be.  [default: .]"),
    option("--dry-run", is_flag=True, help="Show what would be made, and stop."),
    option("--quality", type=click.Choice(["draft", "model", "high"]), help="Of all films and stills, instead."),
    jobs_part(None),
    *device_parts,
    *controller_parts,
)

output_options = bundle(
    "Messages",
    option("--json", "as_json", is_flag=True, help="One JSON document on stdout instead of prose."),
    _message_flag("-q", "--quiet", verbosity=-1, help="Only errors."),
    _message_flag("-v", "--verbose", verbosity=1, help="More, such as where the time went."),
    _message_flag("--debug", debug=True, help="Show tracebacks."),
)
