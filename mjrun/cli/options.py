"""Options that commands share, in sections of the help text. A name means the same everywhere."""

from collections.abc import Callable
from typing import Any

import click

from mjrun.cli.console import Console
from mjrun.cli.params import Assignment, Exact, Groups, Jobs, NotNegative, PathValue, Percent, Range, Size, Words

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


def _bundle(section: str, *options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    def decorate(command: Command) -> Command:
        for option in reversed(options):
            option(command)
        count = len(options)
        for param in command.__click_params__[-count:]:  # type: ignore[attr-defined]
            param.section = section
        return command

    return decorate


def _option(*names: str, **settings: Any) -> Callable[[Command], Command]:
    return click.option(*names, cls=SectionOption, **settings)


def _tell_console(**settings: Any) -> Callable[[click.Context, click.Parameter, bool], None]:
    """A callback that changes the console when its flag is given."""

    def callback(ctx: click.Context, param: click.Parameter, value: bool) -> None:
        console = ctx.find_object(Console)
        for name, setting in settings.items() if value and console else ():
            setattr(console, name, setting)

    return callback


def _message_flag(*names: str, help: str, **settings: Any) -> Callable[[Command], Command]:  # noqa: A002
    return _option(*names, is_flag=True, expose_value=False, callback=_tell_console(**settings), help=help)


model_argument = click.argument("model", type=click.Path())

model_options = _bundle(
    "Model",
    _option("--integrator", type=click.Choice(INTEGRATORS, case_sensitive=False), help="Instead of the model's."),
    _option("--timestep", type=Exact("SECONDS"), help="Instead of the model's."),
    _option(
        "--set",
        "settings",
        type=PathValue(),
        multiple=True,
        help="Override anything before compilation, by MuJoCo's own names: opt.gravity=0,0,10, opt.cone=elliptic, "
        "opt.flag.contact=disable, geom/floor.friction=.1,.005,.0001, vis.quality.shadowsize=1024. Repeatable.",
    ),
)

_controller = (
    _option(
        "--controller",
        metavar="CODE",
        help="Python that sets the controls: policy.py:act or package.module:Policy, called with (model, data). "
        "It writes data.ctrl or returns the controls; a class may have a method reset.",
    ),
    _option("--control-dt", type=Exact("SECONDS"), help="Time between two calls of it.  [default: every step]"),
)

simulation_options = _bundle(
    "Simulation",
    _option("--key", metavar="NAME|INDEX", help="Start from a keyframe."),
    _option(
        "--qpos",
        type=Assignment(),
        multiple=True,
        help="Initial joint position, by name: hip=0.3, root/z=1. Repeatable.",
    ),
    _option(
        "--qvel",
        type=Assignment(),
        multiple=True,
        help="Initial joint velocity, by name: hip=2, root/wx=1. Repeatable.",
    ),
    _option(
        "--ctrl", type=Assignment(), multiple=True, help="Constant control, by actuator name or wildcard. Repeatable."
    ),
    _option(
        "--ctrl-from",
        metavar="FILE",
        help="Controls in time from a table with columns time and ctrl/ACTUATOR: csv, parquet, npz; a trace will do.",
    ),
    _option(
        "--ctrl-interpolation",
        type=click.Choice(["hold", "linear"]),
        default="hold",
        show_default=True,
        help="Between the rows of that table.",
    ),
    _option(
        "--ctrl-noise",
        type=click.FloatRange(min=0),
        default=0.0,
        metavar="STD",
        help="Gaussian noise on every control, in its own units.",
    ),
    _option(
        "--ctrl-noise-time",
        type=click.FloatRange(min=0),
        default=0.0,
        metavar="SECONDS",
        help="Time in which that noise forgets.  [default: 0, new at every step]",
    ),
    *_controller,
    _option(
        "--replay",
        metavar="FILE",
        help="Go through the states that --recording kept (.npz), instead of simulating.",
    ),
    _option("--recording", metavar="FILE", help="Keep the state of every step, for --replay (.npz)."),
    _option(
        "--perturb", type=click.FloatRange(min=0), default=0.0, metavar="STD", help="Noise on the initial velocities."
    ),
    _option("--seed", type=click.IntRange(min=0), default=0, metavar="N", help="Of the noise.  [default: 0]"),
)

duration_options = _bundle(
    "Simulation",
    _option("--duration", type=Exact("SECONDS"), help="Simulated time.  [default: 5]"),
    _option("--steps", type=click.IntRange(min=1), metavar="N", help="Number of steps, instead of --duration."),
)

view_options = _bundle(
    "View",
    _option("--size", type=Size(), default="1280x720", show_default=True, help="Of one view, in pixels."),
    _option(
        "--camera",
        "cameras",
        multiple=True,
        metavar="SPEC",
        help="A camera of the model, by name or index; or free, orbit or track with settings after a colon: "
        "free:azimuth=90,elevation=-20 orbit:lookat=box,azimuth=140..240,ease=cosine track:box,distance=.5; "
        "or a camera document, camera.yaml, with shots in time. Repeat for several.  [default: free]",
    ),
    _option(
        "--view",
        "views",
        type=click.Choice(["rgb", "depth", "seg"]),
        multiple=True,
        help="Colour, depth or segmentation. Repeat for several.  [default: rgb]",
    ),
    _option(
        "--layout",
        type=click.Choice(["row", "column", "grid"]),
        default="row",
        show_default=True,
        help="How several views stand in one picture.",
    ),
    _option("--separate", is_flag=True, help="A file for each view instead, called NAME-CAMERA-VIEW."),
    _option("--captions", is_flag=True, help="Say in each view what it is."),
    _option(
        "--style",
        type=click.Choice(["color", "exact"]),
        help="Depth and segmentation as colours for the eye, or as numbers of 16 bits: millimetres, ids.",
    ),
    _option("--depth-range", type=Range("NEAR..FAR"), help="Of the colours of depth, in metres.  [default: as seen]"),
    _option(
        "--seg-by",
        default="object",
        metavar="KIND",
        show_default=True,
        help="What a segmentation tells apart: object, geom, site, …, body or root-body.",
    ),
    _option(
        "--show",
        type=Words("FLAG,…"),
        multiple=True,
        help="Switch on visual flags by MuJoCo's names: contactpoint, contactforce, transparent, joint, … "
        "A wrong name lists them all.",
    ),
    _option("--hide", type=Words("FLAG,…"), multiple=True, help="Switch off visual flags: shadow, skybox, texture, …"),
    *(
        _option(f"--{kind}group", f"{kind}group", type=Groups(), help=f"The {kind} groups to draw: 0,1,2, all or none.")
        for kind in GROUP_KINDS
    ),
    _option(
        "--frame-axes", default="none", metavar="KIND", help="Axes of: body, geom, site, camera, light, contact, world."
    ),
    _option(
        "--label", default="none", metavar="KIND", help="Names of: body, joint, geom, site, camera, tendon, actuator, …"
    ),
    _option(
        "--trail",
        "trails",
        multiple=True,
        metavar="OBJECT,…",
        help="Draw the path of bodies, geoms or sites, wider and warmer where they are faster. Repeatable.",
    ),
    _option("--trail-span", type=Exact("SECONDS"), help="How much of the past it shows.  [default: all]"),
    _option(
        "--ghost",
        "ghosts",
        multiple=True,
        metavar="SETTING,…",
        help="The model once more, translucent: offset=0/1/0, opacity=.3; in the pose of a keyframe, key=NAME, or "
        "moving as a trace says, trace=FILE. Repeatable.",
    ),
    _option(
        "--text",
        metavar="TEMPLATE",
        help="Write over the picture: '{time:.2f} s', '{speed}x', any column of a trace as in '{qpos/knee:.1f}'.",
    ),
    _option(
        "--text-corner",
        type=click.Choice(["top-left", "top", "top-right", "bottom-left", "bottom", "bottom-right"]),
        help="Where it stands.  [default: top-left; with captions bottom-left]",
    ),
)

_device = (
    _option(
        "--gl", envvar="MUJOCO_GL", metavar="BACKEND", help="auto, egl, osmesa or glfw.  [default: $MUJOCO_GL, or auto]"
    ),
    _option("--require-gpu", is_flag=True, help="Refuse to draw in software."),
)

renderer_options = _bundle(
    "Renderer",
    _option(
        "--quality",
        type=click.Choice(["draft", "model", "high"]),
        default="model",
        show_default=True,
        help="draft: no shadows, reflections and multisampling; model: as the model asks; high: supersampled.",
    ),
    _option(
        "--renderer",
        type=click.Choice(["classic", "filament"]),
        default="classic",
        show_default=True,
        help="MuJoCo's own, or the physically based one, which needs Vulkan.",
    ),
    *_device,
)

_calibration = (
    _option(
        "--calibration",
        metavar="FILE",
        help="What each picture is seen through: K, world from camera, near, far, time; in OpenCV's axes.",
    ),
    _option(
        "--calibration-format",
        type=click.Choice(["mjrun", "nerfstudio", "bop", "ros"]),
        default="mjrun",
        show_default=True,
        help="Whose file it is.",
    ),
)

_record = (
    _option(
        "--manifest",
        metavar="FILE",
        help="What made the output, as JSON: versions, command, model, options, wall times, hashes.",
    ),
    _option("--print-document", is_flag=True, help="Print the command as a document for mjrun run, and stop."),
)

image_options = _bundle(
    "Picture",
    _option(
        "-o",
        "--output",
        metavar="FILE",
        help="png, jpg, webp, tiff; depth also npy, exr; segmentation also npy, json (COCO); or - for a pipe.  "
        "[default: MODEL.png]",
    ),
    _option("-t", "--time", "at", type=NotNegative("SECONDS"), help="The instant to draw.  [default: 0]"),
    _option("--step", type=click.IntRange(min=0), metavar="N", help="The instant, by step."),
    _option(
        "--format",
        "format_",
        metavar="NAME",
        help="Instead of the output's suffix, as for a pipe; palette for a segmentation in colours.  [default: png]",
    ),
    _option("--legend/--no-legend", default=True, help="List what a coloured segmentation shows.  [default: --legend]"),
    _option(
        "--pointcloud",
        metavar="FILE",
        help="All that the cameras see as coloured points in the world, in a .ply; labelled with --view seg.",
    ),
    *_calibration,
    *_record,
)


def _jobs(default: str | None) -> Callable[[Command], Command]:
    return _option(
        "--jobs",
        type=Jobs(),
        default=default,
        metavar="N|auto",
        show_default=True,
        help="Processes that draw; auto is one per core where a CPU draws a long film.",
    )


film_options = _bundle(
    "Film",
    _option(
        "-o",
        "--output",
        metavar="FILE",
        help="mp4, webm, mkv, mov, gif, apng, webp, a folder or pattern of PNGs (frames/, frame_%04d.png), "
        "or - for a pipe.  [default: MODEL.mp4]",
    ),
    _option("--fps", type=Exact("FPS"), help="Frames per second.  [default: 30; 25 in a GIF]"),
    _option(
        "--speed", type=Exact("FACTOR"), default="1", help="Simulated seconds per second of film; 0.25 is slow motion."
    ),
    _option("--format", "format_", metavar="NAME", help="Instead of the output's suffix; for a pipe.  [default: mp4]"),
    _option("--codec", metavar="NAME", help="h264, h265, av1, vp9, prores, ffv1, as the format holds."),
    _option("--crf", type=int, metavar="N", help="Constant rate factor: lower is better and larger."),
    _option("--preset", metavar="NAME", help="The codec's own, from fast to thorough."),
    _option(
        "--plot",
        "plots",
        multiple=True,
        metavar="PROBE,…",
        help="A live graph of what a trace would measure: energy, qpos[left_*]. Repeat for several graphs.",
    ),
    _option(
        "--plot-side", type=click.Choice(["under", "beside"]), default="under", show_default=True, help="Where it is."
    ),
    _jobs("auto"),
    *_calibration,
    *_record,
)

table_options = _bundle(
    "Table",
    _option(
        "-o",
        "--output",
        metavar="FILE",
        help="csv, jsonl, parquet, feather, npz, mat, or - for standard output.  [default: -]",
    ),
    _option("--csv", is_flag=True, help="CSV, whatever the output's name."),
    _option("--format", "format_", metavar="NAME", help="Instead of the output's suffix.  [default: csv]"),
    _option(
        "--probe",
        "probes",
        multiple=True,
        metavar="NAME,…",
        help="What to measure: qpos, qvel, qacc, ctrl, act, energy, sensor, contact, xpos, speed, momentum, … or any "
        "field of MjData; of some objects, qpos[left_*], xpos[hand]; or a column, xpos/hand/z. Repeatable.  "
        "[default: qpos,qvel,ctrl,act,energy,contact,sensor]",
    ),
    _option("--list", "list_", is_flag=True, help="List every column that the model offers, and stop."),
    _option("--every", type=click.IntRange(min=1), default=1, metavar="N", help="A row every N steps.  [default: 1]"),
    _option("--rate", type=Exact("HZ"), help="Rows per simulated second, instead of --every."),
    _option(
        "--assert",
        "asserts",
        multiple=True,
        metavar="EXPR",
        help="Exit with 1 unless this holds: max(abs(energy/drift)) < 1e-3. Repeatable.",
    ),
    _option("--keep-partial", is_flag=True, help="Keep the rows before an instability."),
    _option(
        "--contacts",
        metavar="FILE",
        help="A second table, a row for each contact of each instant: who, where, how deep, force and torque. "
        "Suffixes as for -o.",
    ),
    *_record,
)

run_options = _bundle(
    "Run",
    _option("-o", "--output", metavar="DIR", help="The folder of all outputs; made if need be.  [default: .]"),
    _option("--dry-run", is_flag=True, help="Show what would be made, and stop."),
    _option("--quality", type=click.Choice(["draft", "model", "high"]), help="Of all films and stills, instead."),
    _jobs(None),
    *_device,
    *_controller,
)

output_options = _bundle(
    "Messages",
    _option("--json", "as_json", is_flag=True, help="One JSON document on stdout instead of prose."),
    _message_flag("-q", "--quiet", verbosity=-1, help="Only errors."),
    _message_flag("-v", "--verbose", verbosity=1, help="More, such as where the time went."),
    _message_flag("--debug", debug=True, help="Show tracebacks."),
)

check_options = _bundle(
    "Check",
    _option(
        "--select",
        type=Words("CODE,…"),
        multiple=True,
        help="Look for these only: MJ301, or MJ3 for all that begin so.",
    ),
    _option(
        "--ignore", type=Words("CODE,…"), multiple=True, help="Leave these out. What keeps a model from loading stays."
    ),
    _option(
        "--fail-on",
        type=click.Choice(["error", "warning", "note"]),
        default="error",
        show_default=True,
        help="Exit with 1 when something so severe, or more, is found.",
    ),
    _option("--list", "list_", is_flag=True, help="List all codes, and stop."),
    _option(
        "--steps",
        type=click.IntRange(min=0),
        default=200,
        metavar="N",
        show_default=True,
        help="Steps that a model must live through, from its own start; 0 for none.",
    ),
    _option("--timeout", type=Exact("SECONDS"), default="60", show_default=True, help="Wall time for one model."),
    _option(
        "--memory",
        type=click.IntRange(min=1),
        default=4096,
        metavar="MIB",
        show_default=True,
        help="Memory for one model.",
    ),
    _option("--jobs", type=Jobs(), default="auto", metavar="N|auto", help="Models at once.  [default: one per core]"),
    _option("--sarif", is_flag=True, help="One SARIF 2.1.0 document on stdout, for code scanning."),
    _option("--github", is_flag=True, help="Annotations of a GitHub workflow on stdout."),
)

bench_simulation_options = _bundle(
    "Simulation",
    _option("--key", metavar="NAME|INDEX", help="Start from a keyframe.  [default: test, if there is one]"),
    _option(
        "--steps",
        "--nstep",
        "steps",
        type=click.IntRange(min=1),
        metavar="N",
        help="Steps of one rollout.  [default: 10000, or what the budget allows]",
    ),
    _option(
        "--noise-std",
        type=click.FloatRange(0, 1),
        default=0.01,
        show_default=True,
        metavar="STD",
        help="Scale of pseudo-random noise on the controls, in half ranges; 0 leaves them as they start.",
    ),
    _option(
        "--noise-rate",
        type=click.FloatRange(min=0),
        default=0.1,
        show_default=True,
        metavar="SECONDS",
        help="Time in which controls return to the keyframe's, or to the middle of their ranges.",
    ),
)

bench_options = _bundle(
    "Measurement",
    _option("--budget", type=Exact("SECONDS"), default="3", show_default=True, help="Wall time to spend, about."),
    _option("--repeats", type=click.IntRange(min=1), metavar="N", help="Of a rollout.  [default: 7 to 50]"),
    _option(
        "--threads", type=Words("N,…"), help="Copies to run side by side: 1,2,auto.  [default: 1,auto; 1 with --scan]"
    ),
    _option(
        "--scan",
        type=PathValue(),
        multiple=True,
        help="Measure a grid: integrator=euler,rk4 timestep=.001,.002 opt.solver=cg,newton, or any path of --set. "
        "Values with commas are separated by semicolons. Repeatable.",
    ),
    _option("--accuracy", is_flag=True, help="Add energy drift, and distance from a run with finer steps."),
    _option(
        "--horizon",
        type=Exact("SECONDS"),
        default="1",
        show_default=True,
        help="Simulated time after which accuracy is measured.",
    ),
    _option(
        "--reference", type=Exact("SECONDS"), help="Timestep of the finer run.  [default: an eighth of the finest]"
    ),
    _option("--whole", is_flag=True, help="Also time a whole trace and a whole film of 1 s."),
)

bench_drawing_options = _bundle(
    "Drawing",
    _option("--render", is_flag=True, help="Also time drawing and encoding."),
    _option("--size", "sizes", type=Size(), multiple=True, help="Of a view. Repeatable.  [default: 1280x720]"),
    _option("--camera", default="free", show_default=True, metavar="SPEC", help="As for mjrun video."),
    _option(
        "--view",
        "views",
        type=click.Choice(["rgb", "depth", "seg"]),
        multiple=True,
        help="Repeatable.  [default: rgb]",
    ),
    _option(
        "--quality",
        "qualities",
        type=click.Choice(["draft", "model", "high"]),
        multiple=True,
        help="Repeatable.  [default: model]",
    ),
    _option(
        "--renderer",
        "renderers",
        type=click.Choice(["classic", "filament"]),
        multiple=True,
        help="Repeatable.  [default: classic]",
    ),
    *_device,
)

bench_report_options = _bundle(
    "Report",
    _option("--csv", is_flag=True, help="A CSV table instead, a line for each point of the grid."),
    _option("--markdown", is_flag=True, help="Markdown instead."),
    _option(
        "--summary",
        is_flag=False,
        flag_value="",
        metavar="[FILE]",
        help="Also append Markdown to a file, or to that named by $GITHUB_STEP_SUMMARY.",
    ),
    _option("--save", metavar="FILE", help="Keep the result, to compare with."),
    _option("--compare", metavar="FILE", help="Compare with a result that was kept."),
    _option(
        "--fail-above",
        type=Percent(),
        help="Exit with 1 if it is surely slower than that: 10%. A ratio whose interval does not clear it is "
        "inconclusive.",
    ),
    _option("--force", is_flag=True, help="Compare other models, options or machines all the same."),
)
