"""Options of `mjrun bench`."""

import click

from mjrun.cli.options import bundle, device_parts, option
from mjrun.cli.params import Exact, PathValue, Percent, Size, Words

simulation_options = bundle(
    "Simulation",
    option("--key", metavar="NAME|INDEX", help="Start from a keyframe.  [default: test, if there is one]"),
    option(
        "--steps",
        "--nstep",
        "steps",
        type=click.IntRange(min=1),
        metavar="N",
        help="Steps of one rollout.  [default: 10000, or what the budget allows]",
    ),
    option(
        "--noise-std",
        type=click.FloatRange(0, 1),
        default=0.01,
        show_default=True,
        metavar="STD",
        help="Scale of pseudo-random noise on the controls, in half ranges; 0 leaves them as they start.",
    ),
    option(
        "--noise-rate",
        type=click.FloatRange(min=0),
        default=0.1,
        show_default=True,
        metavar="SECONDS",
        help="Time in which controls return to the keyframe's, or to the middle of their ranges.",
    ),
)

measurement_options = bundle(
    "Measurement",
    option("--budget", type=Exact("SECONDS"), default="3", show_default=True, help="Wall time to spend, about."),
    option("--repeats", type=click.IntRange(min=1), metavar="N", help="Of a rollout.  [default: 7 to 50]"),
    option(
        "--threads", type=Words("N,…"), help="Copies to run side by side: 1,2,auto.  [default: 1,auto; 1 with --scan]"
    ),
    option(
        "--scan",
        type=PathValue(),
        multiple=True,
        help="Measure a grid: integrator=euler,rk4 timestep=.001,.002 opt.solver=cg,newton, or any path of --set. "
        "Values with commas are separated by semicolons. Repeatable.",
    ),
    option("--accuracy", is_flag=True, help="Add energy drift, and distance from a run with finer steps."),
    option(
        "--horizon",
        type=Exact("SECONDS"),
        help="Simulated time after which accuracy is measured.  [default: 1]",
    ),
    option("--reference", type=Exact("SECONDS"), help="Timestep of the finer run.  [default: an eighth of the finest]"),
    option("--whole", is_flag=True, help="Also time a whole trace and a whole video of 1 s."),
)

engine_options = bundle(
    "Engine",
    option(
        "--engine",
        type=click.Choice(["c", "warp"]),
        default="c",
        show_default=True,
        help="What takes the steps: MuJoCo, or MuJoCo Warp, of many worlds at once and in single precision. "
        "Needs the extra warp.",
    ),
    option(
        "--worlds",
        type=click.IntRange(1, 2**20),
        metavar="N",
        help="Copies that warp steps at once.  [default: 4096 on a GPU, 8 on a CPU]",
    ),
    option("--device", metavar="cpu|cuda:N", help="Where warp computes.  [default: the first GPU, or cpu]"),
    option(
        "--nconmax",
        type=click.IntRange(min=1),
        metavar="N",
        help="Contacts of a world that warp has room for.  [default: its own guess]",
    ),
    option("--njmax", type=click.IntRange(min=1), metavar="N", help="Constraints, likewise."),
)

drawing_options = bundle(
    "Drawing",
    option("--render", is_flag=True, help="Also time drawing and encoding."),
    option("--size", "sizes", type=Size(), multiple=True, help="Of a view. Repeatable.  [default: 1280x720]"),
    option("--camera", metavar="SPEC", help="As for mjrun video.  [default: free]"),
    option(
        "--view",
        "views",
        type=click.Choice(["rgb", "depth", "seg"]),
        multiple=True,
        help="Repeatable.  [default: rgb]",
    ),
    option(
        "--quality",
        "qualities",
        type=click.Choice(["draft", "model", "high"]),
        multiple=True,
        help="Repeatable.  [default: model]",
    ),
    option(
        "--renderer",
        "renderers",
        type=click.Choice(["classic", "filament"]),
        multiple=True,
        help="Repeatable.  [default: classic]",
    ),
    *device_parts,
)

report_options = bundle(
    "Report",
    option("--csv", is_flag=True, help="A CSV table instead, a line for each point of the grid."),
    option("--markdown", is_flag=True, help="Markdown instead."),
    option(
        "--summary",
        is_flag=False,
        flag_value="",
        metavar="[FILE]",
        help="Also append Markdown to a file, or to that named by $GITHUB_STEP_SUMMARY.",
    ),
    option("--save", metavar="FILE", help="Save the result as a baseline."),
    option(
        "--compare",
        metavar="FILE",
        help="Compare with a saved result.",
    ),
    option(
        "--fail-above",
        type=Percent(),
        help="Exit with 1 if it is certainly slower than that: 10%, or became unstable. A ratio whose interval "
        "contains the limit is inconclusive.",
    ),
    option("--force", is_flag=True, help="Compare in spite of other models, options or machines."),
)
