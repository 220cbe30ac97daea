"""Options of the command `bench`."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import ChoiceKind, FlagKind, NameOrIndexKind, OneOrMoreKind, PathKind, TextKind, optional
from mjrun.options.model import ModelOptions
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind, PercentKind, ProcessCountKind, RealKind, SizeKind
from mjrun.options.option import FrontEnd, OptionExclusion, Options, option, options
from mjrun.options.rendering import QUALITIES, RENDERERS, VIEWS, BackendOptions
from mjrun.options.setting_kinds import ScanValuesKind
from mjrun.suffixes import SOURCES

ENGINES = ("c", "warp")
SUMMARY = "$GITHUB_STEP_SUMMARY"


@options
class StepTimingOptions(Options):
    """Measurement of simulation speed."""

    section: ClassVar[str] = "Measurement"

    budget: Fraction = option(
        converter=ExactNumberKind("SECONDS"), default=3, help="Approximate wall time to spend [s]."
    )
    repeats: int | None = option(
        converter=optional(IntegerKind(1)),
        default=None,
        usual="7 to 50",
        help="Number of times to repeat each rollout.",
    )
    threads: tuple[int | str, ...] = option(
        converter=OneOrMoreKind(ProcessCountKind("N", of="threads"), commas=True),
        default=(),
        usual="1,auto; 1 with --scan",
        help="Numbers of simulations to run side by side, each measured in turn: 1,2,auto.",
    )
    scan: tuple[tuple[str, str], ...] = option(
        converter=ScanValuesKind(),
        default=(),
        help="Measure every combination of these settings: integrator=euler,rk4 timestep=.001,.002 "
        "opt.solver=cg,newton, or any path of --set. Separate values that contain commas by semicolons.",
    )
    accuracy: bool = option(
        converter=FlagKind(),
        default=False,
        help="Add the energy drift, and the distance from a run with a smaller timestep.",
    )
    horizon: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS")),
        default=None,
        usual="1",
        help="Simulated time after which accuracy is measured [s].",
    )
    reference: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS")),
        default=None,
        usual="an eighth of the smallest",
        help="Timestep of the run against which accuracy is measured [s].",
    )
    whole: bool = option(
        converter=FlagKind(), default=False, help="Also time a complete trace and a complete video of 1 s."
    )


@options
class EngineOptions(Options):
    """The engine that computes the steps."""

    section: ClassVar[str] = "Engine"

    engine: str = option(
        converter=ChoiceKind(ENGINES),
        default="c",
        help="Physics engine: c is MuJoCo; warp is MuJoCo Warp, which steps many worlds at once in single "
        "precision and requires the extra warp.",
    )
    worlds: int | None = option(
        converter=optional(IntegerKind(1, 2**20)),
        default=None,
        usual="4096 on a GPU, 8 on a CPU",
        help="Number of worlds that Warp steps at once.",
    )
    device: str | None = option(
        converter=optional(TextKind("cpu|cuda:N")),
        default=None,
        usual="the first GPU, or cpu",
        help="Warp device: cpu or cuda:N.",
    )
    nconmax: int | None = option(
        converter=optional(IntegerKind(1)),
        default=None,
        usual="chosen by MuJoCo Warp",
        help="Maximum number of contacts per Warp world.",
    )
    njmax: int | None = option(
        converter=optional(IntegerKind(1)),
        default=None,
        usual="chosen by MuJoCo Warp",
        help="Maximum number of constraints per Warp world.",
    )


@options
class RolloutOptions(Options):
    """The simulation that is timed."""

    section: ClassVar[str] = "Simulation"

    key: str | None = option(
        converter=optional(NameOrIndexKind()),
        default=None,
        usual="test, if it exists",
        help="Keyframe to start from, by name or index.",
    )
    steps: int | None = option(
        converter=optional(IntegerKind(1)),
        default=None,
        usual="10000, or what the budget allows",
        short="--nstep",
        help="Number of steps per rollout.",
    )
    noise_std: float = option(
        converter=RealKind(most=1, metavar="STD"),
        default=0.01,
        help="Standard deviation of noise on the controls, as a share of half their range; 0 keeps the initial "
        "controls.",
    )
    noise_rate: float = option(
        converter=RealKind(metavar="SECONDS"),
        default=0.1,
        help="Time constant [s] of the control noise around the keyframe's controls, or the middle of their ranges.",
    )


@options
class FrameTimingOptions(BackendOptions):
    """Measurement of rendering speed."""

    section: ClassVar[str] = "Rendering"

    render: bool = option(converter=FlagKind(), default=False, help="Also time rendering and encoding.")
    size: tuple[tuple[int, int], ...] = option(
        converter=OneOrMoreKind(SizeKind()), default=(), usual="1280x720", help="Width and height of a view [pixels]."
    )
    camera: str | None = option(
        converter=optional(TextKind("SPEC")), default=None, usual="free", help="Camera, as for mjrun video."
    )
    view: tuple[str, ...] = option(
        converter=OneOrMoreKind(ChoiceKind(VIEWS)),
        default=(),
        usual="rgb",
        help="Kind of image: colour, depth or segmentation.",
    )
    quality: tuple[str, ...] = option(
        converter=OneOrMoreKind(ChoiceKind(QUALITIES)),
        default=(),
        usual="model",
        help="Rendering quality, as for mjrun video.",
    )
    renderer: tuple[str, ...] = option(
        converter=OneOrMoreKind(ChoiceKind(RENDERERS)),
        default=(),
        usual="classic",
        help="Renderer, as for mjrun video.",
    )


@options
class BaselineOptions(Options):
    """Comparison with a saved result."""

    section: ClassVar[str] = "Report"

    save: str | None = option(
        converter=optional(PathKind(written=True, unlike=SOURCES)), default=None, help="Save the result as a baseline."
    )
    compare: str | None = option(converter=optional(PathKind()), default=None, help="Compare with a saved baseline.")
    fail_above: float | None = option(
        converter=optional(PercentKind()),
        default=None,
        help="Exit with code 1 if the result is certainly more than this much slower than the baseline, such as "
        "10%, or if the simulation became unstable. A slowdown whose confidence interval contains the limit "
        "is inconclusive.",
    )
    force: bool = option(
        converter=FlagKind(), default=False, help="Compare even if the model, the options or the machine differ."
    )


@options
class BenchReportOptions(Options):
    """Formats of the report."""

    section: ClassVar[str] = "Report"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (
        OptionExclusion(("csv", "markdown"), "both print to standard output"),
    )

    csv: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print a CSV table instead, one line per combination of settings.",
    )
    markdown: bool = option(converter=FlagKind(), default=False, help="Print Markdown instead.")
    summary: str | None = option(
        converter=optional(PathKind("[FILE]", written=True, unlike=SOURCES)),
        default=None,
        flag_value=SUMMARY,
        help="Also append the report as Markdown to a file; without a name, to the file in $GITHUB_STEP_SUMMARY.",
    )
    html: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Self-contained page (.html) with the report and how it was measured.",
    )


@options
class BenchOptions(StepTimingOptions, EngineOptions, RolloutOptions, ModelOptions, FrameTimingOptions, BaselineOptions):
    """All options of a benchmark."""

    section: ClassVar[str] = "Measurement"
