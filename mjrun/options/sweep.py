"""Options of the command `sweep`: a study of many simulations."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import field
from fractions import Fraction
from itertools import combinations
from typing import ClassVar, cast

from mjrun.options.kinds import ChoiceKind, FlagKind, Kind, OneOrMoreKind, PathKind, TextKind, optional
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind, ProcessCountKind, RealKind
from mjrun.options.option import FrontEnd, OptionExclusion, OptionRequirement, Options, option, options, required
from mjrun.options.output import VIDEOS
from mjrun.options.report import ExperimentTrackerOptions, PageOptions
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.setting_kinds import CALL, SettingsKind, VariedSettingsKind
from mjrun.options.trace import PROBES
from mjrun.options.video import VIDEO_CLAUSES, PointOrEpisodeVideoOptions
from mjrun.suffixes import SOURCES

# The extras of studies, with the libraries that each installs and the feature that needs them.
EXTRAS: dict[str, tuple[tuple[str, ...], str]] = {
    "sweep": (("scipy", "pyarrow"), "mjrun sweep"),
    "dask": (("distributed",), "mjrun sweep on Dask"),
    "ray": (("ray",), "mjrun sweep on Ray"),
    "slurm": (("submitit",), "mjrun sweep on Slurm"),
    "cloud": (("fsspec",), "mjrun sweep in object stores"),
}
MOST_POINTS = 10_000_000  # of a study
MOST_IN_CSV = 100_000  # points of a study whose table is also written as CSV without --csv
PLANS = (".jsonl",)  # suffixes of plans, which are accepted in place of a model
MANIFEST = "study.json"  # of the folder of a study
PARTS = "parts"  # in that folder, with the results
DESIGNS = ("grid", "zip")
STOPPING = ("dry_run", "print_document", "plan", "task", "collect", "status", "gc")  # each replaces the run
SAMPLER_DESCRIPTIONS = {
    "sobol": "a scrambled Sobol sequence, which keeps its points when samples are added",
    "halton": "a scrambled Halton sequence, which keeps its points, too, for any number of samples",
    "lhs": "a Latin hypercube",
    "random": "independent random numbers",
    "saltelli": "N samples of parameters + 2 points each, for Sobol' indices of the metrics",
    "morris": "N trajectories of parameters + 1 points each, for the elementary effects on the metrics",
}


KEPT = ("trace", "recording", "video")


@options
class KeptFileOptions(PointOrEpisodeVideoOptions):
    """Files of selected points, which are simulated again, with identical results, once all metrics are known."""

    section: ClassVar[str] = "Files of points"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        *(
            OptionRequirement(name, "keep", clause, value="video", alternatives=("contact_sheet",))
            for name, clause in VIDEO_CLAUSES.items()
        ),
        *(
            OptionRequirement(f"keep_{name}", "keep", "whose points it chooses", alternatives=("contact_sheet",))
            for name in ("where", "lowest", "highest")
        ),
        OptionRequirement("probe", "keep", "whose columns it chooses", value="trace"),
    )

    keep: tuple[str, ...] = option(
        converter=OneOrMoreKind(ChoiceKind(KEPT), commas=True, expected="trace, recording or video"),
        default=(),
        help="Files to write for each kept point, in points/NUMBER in the study's folder: trace.parquet, "
        "recording.npz, video.mp4.",
    )
    keep_where: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("EXPR")),
        default=(),
        help="Keep the files of points for which this condition on parameters, metrics and statuses holds: "
        "unstable, drift > 1.",
    )
    keep_lowest: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("N:METRIC")),
        default=(),
        help="Keep the files of the N points with the lowest values of a metric: 4:drift.",
    )
    keep_highest: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("N:METRIC")),
        default=(),
        help="Keep the files of the N points with the highest values of a metric: 4:drift.",
    )
    contact_sheet: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help=f"Video that shows the videos of all kept points side by side with their values: {VIDEOS}.",
    )
    probe: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("NAME"), commas=True, expected="the name of something to measure"),
        default=PROBES,
        usual=",".join(PROBES),
        help="Values to measure in kept traces, in addition to the columns that the metrics read.",
    )


class _JobTaskNumberKind(Kind[Sequence[int], tuple[int, int]]):
    """One of N tasks, counted from 1: `3/16`."""

    metavar = "I/N"

    def __call__(self, value: Sequence[int]) -> tuple[int, int]:
        if len(value) != 2 or not 1 <= value[0] <= value[1]:
            raise InvalidValueError("one of N tasks; write it as in 1/16")
        return value[0], value[1]

    def parse(self, text: str) -> tuple[int, int]:
        task, _, tasks = text.partition("/")
        return self((int(task), int(tasks)) if task.isdecimal() and tasks.isdecimal() else ())


def _distributions(vary: object) -> list[bool]:
    """Returns whether each of the parameters that vary has a distribution instead of a list of values."""
    settings = dict(cast("Sequence[tuple[str, str]] | Mapping[str, str]", vary or ()))
    return [bool(re.fullmatch(CALL, text)) for text in settings.values()]


@options
class VariationOptions(Options):
    """Differences between the simulations."""

    section: ClassVar[str] = "Study"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        *(
            OptionRequirement(
                name,
                "vary",
                "from whose distribution it draws",
                value="NAME=uniform(LOW,HIGH)",
                test=lambda vary: any(_distributions(vary)),
            )
            for name in ("samples", "sampler")
        ),
        OptionRequirement(
            "design",
            "vary",
            "whose lists it combines",
            value="NAME=VALUE,VALUE for at least two parameters",
            test=lambda vary: _distributions(vary).count(False) > 1,
        ),
    )

    vary: tuple[tuple[str, str], ...] = option(
        converter=VariedSettingsKind(),
        default=(),
        help="Parameter to vary and its values: geom/floor.friction[0]=0.3,0.6,1, opt.timestep=log:1e-4..1e-2:5, "
        "seed=1..40:40, qpos/hip=-1..1:21, scale:body/torso.mass=uniform(.8,1.2). Accepts any path of --set; "
        "each:PATH, which varies all objects that match a wildcard separately; or an option of the "
        "simulation, such as controller=a.py:act,b.py:act.",
    )
    points: str | None = option(
        converter=optional(PathKind()),
        default=None,
        help="Table of points: one column per parameter, one row per point.",
    )
    design: str = option(
        converter=ChoiceKind(DESIGNS),
        default="grid",
        help="How lists of values combine: grid makes all combinations, zip pairs them in order.",
    )
    samples: int = option(
        converter=IntegerKind(1, MOST_POINTS),
        default=64,
        help="Number of points to draw from distributions such as uniform(0,1); of saltelli and morris, the number of "
        "groups of points.",
    )
    sampler: str = option(
        converter=ChoiceKind(tuple(SAMPLER_DESCRIPTIONS)),
        default="sobol",
        help="Sampling method: " + "; ".join(f"{name}, {how}" for name, how in SAMPLER_DESCRIPTIONS.items()) + ".",
    )
    correlate: tuple[tuple[str, str], ...] = option(
        converter=SettingsKind("NAME,NAME=R", "mass,friction=0.7"),
        default=(),
        help="Rank correlation (Spearman's) of sampled parameters: mass,friction=0.7. Each keeps its distribution.",
    )
    repeats: int = option(
        converter=IntegerKind(1),
        default=1,
        help="Number of simulations per point, each with the next seed; the table of means, repeats.csv, has "
        "confidence intervals.",
    )
    when: tuple[tuple[str, str], ...] = option(
        converter=SettingsKind("NAME=EXPR", "iterations=cone == 'elliptic'"),
        default=(),
        help="Condition on other parameters under which a parameter exists: kd=kp > 0, iterations=integrator == "
        "'rk4'. Elsewhere the model keeps its own value, the cell is empty, and equal points are one.",
    )
    where: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("EXPR")),
        default=(),
        help="Include only points for which this condition holds: mass < 10, integrator != 'rk4'.",
    )


@options
class ConfidenceOptions(Options):
    """Confidence intervals of results."""

    section: ClassVar[str] = "Study"

    confidence: float = option(
        converter=RealKind(above=0, most=0.9999, metavar="SHARE"),
        default=0.95,
        help="Confidence level of all intervals.",
    )


@options
class StudyOptions(KeptFileOptions, PageOptions, ExperimentTrackerOptions, VariationOptions, ConfidenceOptions):
    """A study.

    Args:
      simulation: the simulation that the points vary.
    """

    simulation: object = field(kw_only=False)
    output: str = required(
        converter=PathKind("DIR", written=True, stored=True),
        kw_only=False,
        short="-o",
        usual="MODEL_study, or from the document",
        help="Folder for the study, on this machine or in an object store: s3://bucket/study. Running again with the "
        "same folder continues the study.",
    )
    metric: tuple[tuple[str, str], ...] = option(
        converter=SettingsKind("NAME=EXPR", "drift=max(abs(energy/drift))"),
        default=(),
        key="metrics",
        help="Number computed from each simulation: drift=max(abs(energy/drift)), fell=first(time, xpos/torso/z < "
        "0.8), 'pace [km/h]=3.6*max(speed/torso)' with a unit. Uses the same expressions as --assert.",
    )
    every: int = option(converter=IntegerKind(1), default=1, help="Evaluate metrics at every N-th step.")
    require: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("EXPR")),
        default=(),
        help="Exit with code 1 unless this condition holds over all points: share(failed) < 0.05.",
    )


# Settings of Slurm jobs, with the pattern of the values of each.
SLURM_SETTINGS = {
    **dict.fromkeys(("partition", "account", "qos", "constraint"), r"[\w.@&|*-]+"),
    "time": r"[0-9]+(min|h)",
    "mem": r"[0-9]+[MGT]B?",
    "gpus": r"([\w.-]+:)?[0-9]+",
    "cpus": r"[1-9][0-9]*",
    "array": r"[1-9][0-9]*",
}
SLURM_JOBS = 1000  # in flight, unless --jobs sets their number: an array of Slurm has at most 1001 by default


class _SlurmSettingKind(Kind[str, str]):
    """A setting of Slurm jobs: `partition=gpu`, `time=90min`, `mem=16G`, `gpus=a100:1`."""

    metavar = "NAME=VALUE"

    def __call__(self, value: str) -> str:
        name, _, text = value.partition("=")
        if name not in SLURM_SETTINGS:
            raise InvalidValueError(f"a setting of Slurm; settings: {', '.join(SLURM_SETTINGS)}", value)
        if not re.fullmatch(SLURM_SETTINGS[name], text):
            expected = "a valid setting; write it as in partition=long, time=90min, mem=16G, gpus=1 or gpus=a100:1"
            raise InvalidValueError(expected, value)
        return value

    def parse(self, text: str) -> str:
        return self(text)


@options
class ExecutionOptions(Options):
    """Execution of the points, or of the episodes of an evaluation or a dataset."""

    section: ClassVar[str] = "Execution"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        OptionRequirement("slurm", "engine", "whose jobs it sets", value="slurm"),
    )

    jobs: int | str = option(
        converter=ProcessCountKind("N", of="processes"),
        default="auto",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help=f"Number of processes on this machine; on Slurm, largest number of jobs that run or wait, "
        f"by default {SLURM_JOBS}, and as many as the cluster accepts.",
    )
    engine: str = option(
        converter=TextKind("ENGINE"),
        default="local",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Engine that simulates points or episodes: local, warp (MuJoCo Warp, in single precision), dask, "
        "dask://HOST:PORT, ray, ray://HOST:PORT, slurm, or module:factory, a function that returns a "
        "concurrent.futures.Executor.",
    )
    slurm: tuple[str, ...] = option(
        converter=OneOrMoreKind(_SlurmSettingKind(), commas=True, expected="NAME=VALUE, as in partition=long"),
        default=(),
        usual="time=5min, and what the cluster sets",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Settings of Slurm jobs: partition=long,account=lab,time=2h,mem=16G,gpus=1,cpus=4; also qos, "
        "constraint, and array=N, the largest number of jobs that run at once. Requires --engine slurm.",
    )
    chunk: int | None = option(
        converter=optional(IntegerKind(1)),
        default=None,
        usual="a few seconds' worth",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Number of points or episodes per task of the engine.",
    )
    time_limit: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS")),
        default=None,
        usual="none",
        help="Maximum wall time per point or episode [s].",
    )
    time_budget: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS")),
        default=None,
        usual="none",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Start no more points or episodes after this wall time [s], as in 2h or 50min; those that are running "
        "finish. Exits with code 8 if some are left; the same command continues.",
    )
    max_failures: int | None = option(
        converter=optional(IntegerKind(1)),
        default=None,
        usual="none",
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Start no more points or episodes once N of them have failed in this run; the same command continues. "
        "Exits with code 8.",
    )
    retry_failed: bool = option(
        converter=FlagKind(),
        default=False,
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Simulate again the points or episodes that failed before.",
    )

    @property
    def processes(self) -> int | str:
        """Number of processes on this machine, also where `jobs` is the number of jobs of Slurm."""
        return "auto" if self.engine == "slurm" else self.jobs


@options
class StudyCommandOptions(Options):
    """Modes that replace the normal run, and what the command prints."""

    section: ClassVar[str] = "Execution"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = tuple(
        OptionExclusion(pair, "each of these replaces the run; give only one")
        for pair in combinations(STOPPING, 2)
        if pair != ("dry_run", "gc")
    )

    dry_run: bool = option(
        converter=FlagKind(),
        default=False,
        help="Report the number of simulations and an estimate of their time, and exit; with --gc, what it removes.",
    )
    print_document: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print a study document equivalent to this command and exit.",
    )
    plan: str | None = option(
        converter=optional(PathKind(written=True, unlike=SOURCES)),
        default=None,
        help="Write a plan of the missing points to this .jsonl file and exit: the study, and ranges of points.",
    )
    task: tuple[int, int] | None = option(
        converter=optional(_JobTaskNumberKind()),
        default=None,
        help="Simulate the I-th of N equal parts of a plan and exit; for job arrays, xargs and make.",
    )
    collect: bool = option(
        converter=FlagKind(),
        default=False,
        help="Write the table from the existing results, without simulating.",
    )
    status: bool = option(
        converter=FlagKind(),
        default=False,
        help="Report the progress of a study, also while processes work on it, and exit with 1 unless it is finished. "
        "With --html, update a page until it is finished or no process works on it.",
    )
    gc: bool = option(
        converter=FlagKind(),
        default=False,
        help="Remove files of a study that its table does not use: parts of other versions, damaged parts, "
        "leases and temporary files of ended processes, and logs of Slurm jobs.",
    )
    csv: bool = option(
        converter=FlagKind(),
        default=False,
        help=f"Print the table of all points to stdout; write results.csv even of more than {MOST_IN_CSV:,} points.",
    )
    markdown: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print the report as Markdown to stdout, for the summary of a pull request.",
    )
