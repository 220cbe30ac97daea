"""Options of the command `sweep`: a study of many simulations."""

from collections.abc import Sequence
from dataclasses import field
from fractions import Fraction
from itertools import combinations
from typing import ClassVar

from mjrun.options.keep import KeepOptions
from mjrun.options.kinds import (
    Choice,
    ExactNumber,
    ExpectedError,
    File,
    Flag,
    Integer,
    Kind,
    Optional,
    Processes,
    Settings,
    Several,
    Text,
)
from mjrun.options.option import Exclusion, FrontEnd, Options, option, options, required
from mjrun.options.variations import Variations

# Extras of studies: the libraries that each installs, and what needs them.
EXTRAS = {
    "sweep": (("scipy", "pyarrow"), "mjrun sweep"),
    "dask": (("distributed",), "mjrun sweep on Dask"),
    "slurm": (("submitit",), "mjrun sweep on Slurm"),
}
MOST_POINTS = 10_000_000  # of a study
PLANS = (".jsonl",)  # suffixes of plans, which are accepted in place of a model
MANIFEST = "study.json"  # of the folder of a study
PARTS = "parts"  # in that folder, with the results
DESIGNS = ("grid", "zip")
STOPPING = ("dry_run", "print_document", "plan", "task", "collect")  # instead of a run
SAMPLERS = {
    "sobol": "a scrambled Sobol sequence, which keeps its points when samples are added",
    "lhs": "a Latin hypercube",
    "random": "independent random numbers",
}


class TaskNumber(Kind[Sequence[int], tuple[int, int]]):
    """One of several tasks, counted from 1: `3/16`."""

    metavar = "I/N"

    def __call__(self, value: Sequence[int]) -> tuple[int, int]:
        if len(value) != 2 or not 1 <= value[0] <= value[1]:
            raise ExpectedError("one of N tasks; write it as in 1/16")
        return value[0], value[1]

    def parse(self, text: str) -> tuple[int, int]:
        task, _, tasks = text.partition("/")
        return self((int(task), int(tasks)) if task.isdecimal() and tasks.isdecimal() else ())


@options
class VariationOptions(Options):
    """What differs between the simulations."""

    section: ClassVar[str] = "Study"

    vary: tuple[tuple[str, str], ...] = option(
        converter=Variations(),
        default=(),
        help="What varies, and over which values: geom/floor.friction[0]=0.3,0.6,1, opt.timestep=log:1e-4..1e-2:5, "
        "seed=1..40:40, qpos/hip=-1..1:21, scale:body/torso.mass=uniform(.8,1.2). Any path of --set, each:PATH for "
        "the objects that match a wildcard one by one, or an option of the simulation, such as "
        "controller=a.py:act,b.py:act.",
    )
    points: str | None = option(
        converter=Optional(File()),
        default=None,
        help="A table of points: a column for each thing that varies, a row for each point.",
    )
    design: str = option(
        converter=Choice(DESIGNS), default="grid", help="How lists of values combine: all with all, or side by side."
    )
    samples: int = option(
        converter=Integer(1, MOST_POINTS),
        default=64,
        help="How many points are drawn from distributions such as uniform(0,1).",
    )
    sampler: str = option(
        converter=Choice(tuple(SAMPLERS)),
        default="sobol",
        help="How they are drawn: " + "; ".join(f"{name}, {how}" for name, how in SAMPLERS.items()) + ".",
    )
    repeats: int = option(
        converter=Integer(1), default=1, help="How often each point is simulated, each time with the next seed."
    )
    where: tuple[str, ...] = option(
        converter=Several(Text("EXPR")), default=(), help="Leave out points for which this does not hold: mass < 10."
    )


@options
class StudyOptions(KeepOptions, VariationOptions):
    """A study.

    Args:
      simulation: what its points vary.
    """

    simulation: object = field(kw_only=False)
    output: str = required(
        converter=File("DIR", written=True),
        kw_only=False,
        short="-o",
        usual="MODEL_study, or as the document",
        help="The folder of the study, which a second run continues.",
    )
    metric: tuple[tuple[str, str], ...] = option(
        converter=Settings("NAME=EXPR", "drift=max(abs(energy/drift))"),
        default=(),
        key="metrics",
        help="A number of each simulation: drift=max(abs(energy/drift)), fell=first(time, xpos/torso/z < 0.8). "
        "The language is that of assertions.",
    )
    every: int = option(converter=Integer(1), default=1, help="Metrics look at every N-th step.")
    require: tuple[str, ...] = option(
        converter=Several(Text("EXPR")),
        default=(),
        help="Fail, with exit code 1, unless this holds over all points: share(failed) < 0.05.",
    )


@options
class ExecutionOptions(Options):
    """Where and how the points are simulated."""

    section: ClassVar[str] = "Execution"
    exclusions: ClassVar[tuple[Exclusion, ...]] = ()

    jobs: int | str = option(
        converter=Processes("N", of="processes"),
        default="auto",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Processes on this machine.",
    )
    engine: str = option(
        converter=Text("ENGINE"),
        default="local",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="What runs them: local, warp (MuJoCo Warp, in single precision), dask, dask://HOST:PORT, slurm, or "
        "module:factory, which returns an Executor of concurrent.futures.",
    )
    chunk: int | None = option(
        converter=Optional(Integer(1)),
        default=None,
        usual="seconds, as measured",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Points in a task.",
    )
    time_limit: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS")), default=None, usual="none", help="Wall time for a point [s]."
    )
    retry_failed: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Simulate the points that failed once more.",
    )


@options
class StudyCommandOptions(Options):
    """What the command can do besides."""

    section: ClassVar[str] = "Execution"
    exclusions: ClassVar[tuple[Exclusion, ...]] = tuple(
        Exclusion(pair, "each is all that is done") for pair in combinations(STOPPING, 2)
    )

    dry_run: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="Say what would be done, and how long it would take, and stop.",
    )
    print_document: bool = option(
        converter=Flag(), default=False, places=FrontEnd.COMMAND, help="Print this command as a document, and stop."
    )
    plan: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        places=FrontEnd.COMMAND,
        help="Write what is to be simulated to this .jsonl file, many points on a line, and stop.",
    )
    task: tuple[int, int] | None = option(
        converter=Optional(TaskNumber()),
        default=None,
        places=FrontEnd.COMMAND,
        help="Simulate the I-th of N equal parts of a plan, and stop: for job arrays, xargs and make.",
    )
    collect: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="Simulate nothing; make the table of the results that are there.",
    )
    csv: bool = option(
        converter=Flag(), default=False, places=FrontEnd.COMMAND, help="The table of all points on stdout."
    )
