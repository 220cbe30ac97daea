"""Options of the command `bench`."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import (
    Choice,
    ExactNumber,
    File,
    Flag,
    Integer,
    Key,
    Optional,
    Percent,
    Processes,
    Real,
    ScanValues,
    Several,
    Size,
    Text,
)
from mjrun.options.model import ModelOptions
from mjrun.options.option import Exclusion, FrontEnd, Options, option, options
from mjrun.options.view import QUALITIES, RENDERERS, VIEWS, BackendOptions

ENGINES = ("c", "warp")


@options
class StepTimingOptions(Options):
    """What is measured of steps."""

    section: ClassVar[str] = "Measurement"

    budget: Fraction = option(converter=ExactNumber("SECONDS"), default=3, help="Wall time to spend [s], roughly.")
    repeats: int | None = option(
        converter=Optional(Integer(1)), default=None, usual="7 to 50", help="How often a rollout is repeated."
    )
    threads: tuple[int | str, ...] = option(
        converter=Several(Processes("N", of="threads"), commas=True),
        default=(),
        usual="1,auto; 1 with --scan",
        help="Copies to run side by side: 1,2,auto.",
    )
    scan: tuple[tuple[str, str], ...] = option(
        converter=ScanValues(),
        default=(),
        help="Measure a grid: integrator=euler,rk4 timestep=.001,.002 opt.solver=cg,newton, or any path of --set. "
        "Values with commas are separated by semicolons.",
    )
    accuracy: bool = option(
        converter=Flag(), default=False, help="Add energy drift, and distance from a run with finer steps."
    )
    horizon: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS")),
        default=None,
        usual="1",
        help="Simulated time after which accuracy is measured [s].",
    )
    reference: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS")),
        default=None,
        usual="an eighth of the finest",
        help="Timestep of the finer run [s].",
    )
    whole: bool = option(converter=Flag(), default=False, help="Also time a whole trace and a whole video of 1 s.")


@options
class EngineOptions(Options):
    """What takes the steps."""

    section: ClassVar[str] = "Engine"

    engine: str = option(
        converter=Choice(ENGINES),
        default="c",
        help="MuJoCo, or MuJoCo Warp, of many worlds at once and in single precision. Needs the extra warp.",
    )
    worlds: int | None = option(
        converter=Optional(Integer(1, 2**20)),
        default=None,
        usual="4096 on a GPU, 8 on a CPU",
        help="Copies that warp steps at once.",
    )
    device: str | None = option(
        converter=Optional(Text("cpu|cuda:N")),
        default=None,
        usual="the first GPU, or cpu",
        help="Where warp computes.",
    )
    nconmax: int | None = option(
        converter=Optional(Integer(1)),
        default=None,
        usual="its own guess",
        help="Contacts of a world that warp has room for.",
    )
    njmax: int | None = option(
        converter=Optional(Integer(1)),
        default=None,
        usual="its own guess",
        help="Constraints of a world that warp has room for.",
    )


@options
class RolloutOptions(Options):
    """The simulation that is timed."""

    section: ClassVar[str] = "Simulation"

    key: str | None = option(
        converter=Optional(Key()),
        default=None,
        usual="test, if there is one",
        help="The keyframe to start from, by name or index.",
    )
    steps: int | None = option(
        converter=Optional(Integer(1)),
        default=None,
        usual="10000, or what the budget allows",
        short="--nstep",
        help="Steps of one rollout.",
    )
    noise_std: float = option(
        converter=Real(most=1, metavar="STD"),
        default=0.01,
        help="Scale of pseudo-random noise on the controls, in half ranges; 0 leaves them as they start.",
    )
    noise_rate: float = option(
        converter=Real(metavar="SECONDS"),
        default=0.1,
        help="Time in which controls return to the keyframe's, or to the middle of their ranges [s].",
    )


@options
class FrameTimingOptions(BackendOptions):
    """What is measured of drawing."""

    section: ClassVar[str] = "Drawing"

    render: bool = option(converter=Flag(), default=False, help="Also time drawing and encoding.")
    size: tuple[tuple[int, int], ...] = option(
        converter=Several(Size()), default=(), usual="1280x720", help="Width and height of a view [pixels]."
    )
    camera: str | None = option(
        converter=Optional(Text("SPEC")), default=None, usual="free", help="As for mjrun video."
    )
    view: tuple[str, ...] = option(
        converter=Several(Choice(VIEWS)), default=(), usual="rgb", help="Colour, depth or segmentation."
    )
    quality: tuple[str, ...] = option(
        converter=Several(Choice(QUALITIES)), default=(), usual="model", help="As for mjrun video."
    )
    renderer: tuple[str, ...] = option(
        converter=Several(Choice(RENDERERS)), default=(), usual="classic", help="As for mjrun video."
    )


@options
class BaselineOptions(Options):
    """Comparison with a result that was saved."""

    section: ClassVar[str] = "Report"

    save: str | None = option(
        converter=Optional(File(written=True)), default=None, help="Save the result as a baseline."
    )
    compare: str | None = option(converter=Optional(File()), default=None, help="Compare with a saved result.")
    fail_above: float | None = option(
        converter=Optional(Percent()),
        default=None,
        help="Exit with 1 if it is certainly slower than that: 10%, or became unstable. A ratio whose interval "
        "contains the limit is inconclusive.",
    )
    force: bool = option(converter=Flag(), default=False, help="Compare in spite of other models, options or machines.")


@options
class ReportOptions(Options):
    """How the result is printed."""

    section: ClassVar[str] = "Report"
    exclusions: ClassVar[tuple[Exclusion, ...]] = (Exclusion(("csv", "markdown"), "both want standard output"),)

    csv: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="A CSV table instead, a line for each point of the grid.",
    )
    markdown: bool = option(converter=Flag(), default=False, places=FrontEnd.COMMAND, help="Markdown instead.")
    summary: str | None = option(
        converter=Optional(Text("[FILE]")),
        default=None,
        places=FrontEnd.COMMAND,
        flag_value="",
        help="Also append Markdown to a file, or to that named by $GITHUB_STEP_SUMMARY.",
    )


@options
class BenchOptions(StepTimingOptions, EngineOptions, RolloutOptions, ModelOptions, FrameTimingOptions, BaselineOptions):
    """What to measure."""

    section: ClassVar[str] = "Measurement"
