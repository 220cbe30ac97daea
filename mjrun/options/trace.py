"""Options of traces, recordings and golden tables."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.diff import ToleranceOptions
from mjrun.options.kinds import ChoiceKind, FlagKind, OneOrMoreKind, PathKind, TextKind, optional
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind
from mjrun.options.option import FrontEnd, OptionExclusion, OptionRequirement, Options, option, options, required
from mjrun.options.output import TABLES, OutputOptions

UNIT_PLACES = COMMENT, METADATA = "comment", "metadata"  # for CSV files
PROBES = ("qpos", "qvel", "ctrl", "act", "energy", "contact", "sensor")  # by default


@options
class SamplingOptions(OutputOptions):
    """Sampling rate and format of measured values."""

    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (
        OptionExclusion(("every", "rate"), "both set the sampling rate"),
    )

    every: int = option(converter=IntegerKind(1), default=1, help="Write a row every N steps.")
    rate: Fraction | None = option(
        converter=optional(ExactNumberKind("HZ")),
        default=None,
        help="Rows per simulated second [Hz], at most one per step, instead of every N steps.",
    )
    format: str | None = option(
        converter=optional(TextKind("NAME")), default=None, usual="the output's suffix", help="File format."
    )


@options
class GoldenOptions(ToleranceOptions):
    """Comparison of a trace with a golden table."""

    section: ClassVar[str] = "Golden table"
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        OptionRequirement("update", "golden", "which it creates or replaces"),
        *(OptionRequirement(name, "golden", "which is compared within it") for name in ("atol", "rtol", "tol")),
    )

    golden: str | None = option(
        converter=optional(PathKind()),
        default=None,
        help="Table of an earlier run with which to compare, within the tolerances; the exit code is 1 if they differ.",
    )
    update: bool = option(
        converter=FlagKind(),
        default=False,
        places=FrontEnd.COMMAND | FrontEnd.PYTHON,
        help="Create or replace the golden table, and report what changed.",
    )


@options
class TraceOptions(SamplingOptions, GoldenOptions):
    """A trace: a table of measured values."""

    section: ClassVar[str] = "Trace"

    output: str = option(
        converter=PathKind(written=True, streamed=True),
        default="-",
        kw_only=False,
        short="-o",
        help=f"{TABLES}, or - for standard output.",
    )
    probe: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("NAME"), commas=True, expected="the name of something to measure"),
        default=PROBES,
        usual=",".join(PROBES),
        help="Values to measure: qpos, qvel, qacc, ctrl, act, energy, sensor, contact, xpos, speed, momentum, … or "
        "any field of MjData; values of some objects, qpos[left_*], xpos[hand]; or a column, xpos/hand/z.",
    )
    assert_: tuple[str, ...] = option(
        converter=OneOrMoreKind(TextKind("EXPR")),
        default=(),
        help="Exit with code 1 unless this condition holds: max(abs(energy/drift)) < 1e-3.",
    )
    units: str | None = option(
        converter=optional(ChoiceKind(UNIT_PLACES)),
        default=None,
        help="Where a CSV file states its units: in a comment below the header, # units: s,rad, or in a file beside "
        "it, run.csv-metadata.json (CSV on the Web). Other formats hold their units.",
    )
    keep_partial: bool = option(
        converter=FlagKind(), default=False, help="If the simulation becomes unstable, keep the rows from before."
    )
    contacts: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Second table with one row per contact and instant: the geoms, position and depth [m], force [N] and "
        "torque [N m].",
    )


@options
class TraceCommandLineOptions(Options):
    """Modes that replace the normal run, and a short form."""

    section: ClassVar[str] = "Trace"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    csv: bool = option(converter=FlagKind(), default=False, help="Same as --format csv.")
    list_: bool = option(
        converter=FlagKind(),
        default=False,
        help="List the groups of columns that the model offers, or the columns of --probe, and exit.",
    )
    all_: bool = option(
        converter=FlagKind(),
        default=False,
        help="List every column with --list, not only their groups.",
    )
    verify: bool = option(
        converter=FlagKind(),
        default=False,
        help="Simulate the recording of --replay again, compare every state bit for bit, and exit; the exit code "
        "is 1 if a state differs.",
    )


@options
class RecordingOptions(OutputOptions):
    """A recording of the states of all steps, for replay."""

    section: ClassVar[str] = "Recording"

    output: str = required(converter=PathKind(written=True), kw_only=False, help="An .npz file.")
    keep_partial: bool = option(
        converter=FlagKind(), default=False, help="If the simulation becomes unstable, keep the states from before."
    )
